"""What a sweep asks of a renderer: `tfm_cl.render.renderer.Renderer`, or one like it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tfm_cl.jobs.job import Progress
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.scene import Scene


class Stats(Protocol):
    """What a picture cost."""

    @property
    def seconds(self) -> dict[str, float]:
        """Of ``light_pass`` and ``view_pass``, on the device."""

    @property
    def map_bytes(self) -> int:
        """Of the numbers of all maps together."""


class Rendered(Protocol):
    """A picture, and what it cost."""

    @property
    def image(self) -> NDArray[np.float32]:
        """[H, W, 4], as `tfm_cl.render.result.RenderResult.image`."""

    @property
    def stats(self) -> Stats:
        """What it cost."""


class Renderer(Protocol):
    """Builds maps, and renders with them."""

    @property
    def device_name(self) -> str:
        """Name of the device that it uses."""

    def build_maps(self, scene: Scene, progress: Progress | None = None) -> list[TransmittanceMap]:
        """Run the light pass."""

    def render(
        self,
        scene: Scene,
        *,
        maps: list[TransmittanceMap] | None = None,
        method: str | None = None,
        progress: Progress | None = None,
    ) -> Rendered:
        """Render a scene, with maps that are there or by another method."""

    def close(self) -> None:
        """Release the device's memory."""
