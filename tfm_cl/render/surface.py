"""The surface pass: what solids reflect of a batch of lights (TFM section 4.1)."""

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


def reflect(
    launcher: Launcher,
    media: MediaOnDevice,
    met: Met,
    view: Any,
    batch: Batch,
    samples: int,
    frame: FrameBuffers,
    done: Callable[[float], None],
) -> Running:
    """Begin to add what solids reflect; passes that leave the camera's transmittance were started before.

    Parameters are those of `tfm_cl.render.scatter.scatter`.
    """
    headers, defines = batch.variant(media)
    defines |= frame.defines
    kernel = launcher.kernels.kernel("surface_pass", "surface_pass.cl", headers, defines)
    return launcher.start_windows(
        kernel,
        batch.window,
        samples * batch.most_in_a_block + met.longest,
        {"view": view, "lit": batch.lit}
        | met.arguments
        | batch.arguments
        | batch.blocks
        | frame.arguments("places", "solid", "albedo", "transmittance", "radiance", "samples")
        | frame.layers,
        done,
    )
