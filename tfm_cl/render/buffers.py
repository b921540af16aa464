"""What the passes sum for the pixels of a crop, on the device and on the host."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.device.launch import Launcher
    from tfm_cl.render.visibility import GBuffer

SUMS: dict[str, tuple[type[np.generic], int]] = {
    "radiance": (np.float32, 4),
    "light_seen": (np.float32, 4),
    "transmittance": (np.float32, 4),
    "samples": (np.uint32, 1),
}
"""Name, as kernels take it -> type and numbers per pixel. All begin at 0."""


@dataclass(frozen=True)
class FrameBuffers:
    """Buffers of one crop, by the names that kernels have for them."""

    shape: tuple[int, int]
    """(height, width)."""
    sums: dict[str, cl.Buffer]
    solid: cl.Buffer
    """float4: normal and distance of the solid that a pixel shows; of no meaning without solids."""
    albedo: cl.Buffer
    """float4: its RGB albedo."""

    def arguments(self, *names: str) -> dict[str, cl.Buffer]:
        """Return kernel arguments, by name."""
        known = self.sums | {"solid": self.solid, "albedo": self.albedo}
        return {name: known[name] for name in names}


@dataclass(frozen=True)
class Sums:
    """`FrameBuffers` on the host, and what the pixels show of solids: `tfm_cl.scene.layers.Seen`."""

    radiance: NDArray[np.float32]
    light_seen: NDArray[np.float32]
    transmittance: NDArray[np.float32]
    samples: NDArray[np.float32]
    solid: NDArray[np.float32]
    albedo: NDArray[np.float32]
    errors: NDArray[np.float32]


def allocate(launcher: Launcher, crop: tuple[int, int, int, int], gbuffer: GBuffer | None) -> FrameBuffers:
    """Make empty buffers for the pixels x0, y0, x1, y1, with the solids that they show."""
    x0, y0, x1, y1 = crop
    pixels, none = (x1 - x0) * (y1 - y0), np.zeros(4, np.float32)
    return FrameBuffers(
        (y1 - y0, x1 - x0),
        sums={
            name: launcher.zeros("the image", np.dtype(kind).itemsize * count * pixels)
            for name, (kind, count) in SUMS.items()
        },
        solid=launcher.upload("the solids' pixels", none if gbuffer is None else gbuffer.solid),
        albedo=launcher.upload("the solids' pixels", none if gbuffer is None else gbuffer.albedo),
    )


def read(
    launcher: Launcher, frame: FrameBuffers, gbuffer: GBuffer | None, errors: FrameBuffers | None
) -> Sums:
    """Copy the sums to the host."""

    def download(buffers: FrameBuffers, name: str) -> NDArray[Any]:
        kind, count = SUMS[name]
        shape = (*frame.shape, count) if count > 1 else frame.shape
        return launcher.download(buffers.sums[name], shape, kind)

    none = np.zeros((*frame.shape, 4), np.float32)
    nowhere = none.copy()
    nowhere[..., 3] = np.inf
    return Sums(
        radiance=download(frame, "radiance"),
        light_seen=download(frame, "light_seen"),
        transmittance=download(frame, "transmittance"),
        samples=download(frame, "samples").astype(np.float32),
        solid=nowhere if gbuffer is None else gbuffer.solid,
        albedo=none if gbuffer is None else gbuffer.albedo,
        errors=none if errors is None else download(errors, "light_seen"),
    )
