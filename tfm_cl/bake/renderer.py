"""What a bake asks of a renderer: `tfm_cl.render.renderer.Renderer`, or one like it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress
    from tfm_cl.maps.light_at_points import LightAtPoints
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.scene import Scene


class Rendered(Protocol):
    """A picture."""

    @property
    def aovs(self) -> Mapping[str, NDArray[np.float32]]:
        """Its layers by name."""


class Renderer(Protocol):
    """Builds maps, looks lights up, and renders."""

    def build_maps(self, scene: Scene, progress: Progress | None = None) -> list[TransmittanceMap]:
        """Run the light pass."""

    def light_at(self, scene: Scene, points: ArrayLike, *, progress: Progress | None = None) -> LightAtPoints:
        """Look each light up at any points."""

    def render(self, scene: Scene, *, aovs: Collection[str] = (), samples: int = 1) -> Rendered:
        """Render a scene, with layers that are made only when named."""
