"""What a bake asks of a renderer: `tfm_cl.render.renderer.Renderer`, or one like it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress
    from tfm_cl.maps.light_at_points import LightAtPoints
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.scene import Scene


class Renderer(Protocol):
    """Builds maps, and looks lights up."""

    def build_maps(self, scene: Scene, progress: Progress | None = None) -> list[TransmittanceMap]:
        """Run the light pass."""

    def light_at(self, scene: Scene, points: ArrayLike, *, progress: Progress | None = None) -> LightAtPoints:
        """Look each light up at any points."""
