"""The scatter pass: what the media scatter of a batch of lights (TFM algorithm 1 with section 4.2)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfm_cl.device.field import Met
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.device.running import Running
    from tfm_cl.render.batches import Batch
    from tfm_cl.render.buffers import FrameBuffers
    from tfm_cl.render.lattice_points import Around


def scatter_variant(batch: Batch, media: MediaOnDevice) -> tuple[tuple[str, ...], dict[str, int | str]]:
    """Headers and macros of the scatter pass."""
    headers, defines = batch.variant(media)
    return headers, defines | {"TFM_SHARED": int(batch.of.shares_samples)}


def scatter(
    launcher: Launcher,
    media: MediaOnDevice,
    met: Met,
    view: Any,
    batch: Batch,
    samples: int,
    frame: FrameBuffers,
    done: Callable[[float], None],
    *,
    sees_camera: bool = False,
    serves_camera: bool = False,
    around: Around | None = None,
) -> Running:
    """Begin to add the single scattering of some lights of one kind.

    Parameters
    ----------
    met
        What its camera rays meet.
    view
        The struct, on the device.
    samples
        Densities, at most, that one light takes for a pixel.
    sees_camera
        Fill in what the camera pass does from the same samples: of the first batch, where its lights share
        them.
    serves_camera
        There are but primitives and this light, which reaches them all: its samples do as well.
    around
        Light from all around that the same samples see, with what the camera does.
    """
    headers, defines = scatter_variant(batch, media)
    defines |= frame.defines
    if around is not None:
        defines |= around.defines
    kernel = launcher.kernels.kernel("scatter_pass", "scatter_pass.cl", headers, defines)
    return launcher.start_windows(
        kernel,
        batch.window,
        samples * batch.most_in_a_block + met.longest,
        {"view": view, "sees_camera": int(sees_camera), "serves_camera": int(serves_camera)}
        | met.arguments
        | batch.arguments
        | batch.blocks
        | ({} if around is None else around.arguments)
        | frame.arguments("places", "solid", "albedo")
        | frame.stored(),
        done,
    )
