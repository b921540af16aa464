"""What the viewer asks of a renderer, and of what reads frames: both are given to it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tfm_cl.device.launch import Progress
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.scene_file import SceneFile, Values

LAUNCH_SECONDS = 0.03
"""That the device should work at a stretch: full pictures that are stale end between two launches."""


class Stats(Protocol):
    """What a picture cost: `tfm_cl.render.result.RenderStats`."""

    @property
    def seconds(self) -> dict[str, float]:
        """Of each pass, and in all."""

    @property
    def made(self) -> dict[str, int]:
        """What was made, as no earlier picture had it."""


class Result(Protocol):
    """A picture: `tfm_cl.render.result.RenderResult`."""

    @property
    def image(self) -> NDArray[np.float32]:
        """[H, W, 4]."""

    @property
    def aovs(self) -> Mapping[str, NDArray[np.float32]]:
        """Its layers."""

    @property
    def stats(self) -> Stats:
        """What it cost."""

    @property
    def scene(self) -> Scene:
        """With the numbers that it was rendered with."""

    @property
    def crop(self) -> tuple[int, int, int, int]:
        """Where it lies in the full frame."""

    def picture(self, *, transparent: bool = False) -> NDArray[np.float32]:
        """Return what a PNG shows, [H, W, 4]."""


class LightMap(Protocol):
    """A light's map: `tfm_cl.maps.transmittance_map.TransmittanceMap`."""

    @property
    def coefficients(self) -> NDArray[np.float32]:
        """[y, x, n]."""


class Renderer(Protocol):
    """Renders and builds maps: `tfm_cl.render.renderer.Renderer`."""

    @property
    def on_compiling(self) -> Callable[[str], None] | None:
        """Called before a kernel is compiled, with its name."""

    @on_compiling.setter
    def on_compiling(self, heard: Callable[[str], None] | None) -> None: ...

    def render(
        self,
        scene: Scene,
        *,
        crop: tuple[int, int, int, int] | None = None,
        aovs: Collection[str] = (),
        background: Any = 0.0,
        progress: Progress | None = None,
    ) -> Result:
        """Render a scene."""

    def maps_of(
        self, scene: Scene, light: int, part: int = 0, progress: Progress | None = None
    ) -> Sequence[LightMap]:
        """Return the maps that pictures of a scene have of one light."""

    def cancel(self) -> None:
        """End what another thread is rendering."""

    def forget_unused(self) -> None:
        """Give back what the last two frames had no use for."""

    def close(self) -> None:
        """Release the device's memory."""


class Planned(Protocol):
    """A plan: `tfm_cl.plan.plan.Plan`."""

    @property
    def scene(self) -> Scene:
        """With the numbers that are decided."""

    @property
    def decisions(self) -> Mapping[str, Any]:
        """By dotted key, all that was left open: its value and why."""


class RenderedFrame(Protocol):
    """A frame that is rendered: `tfm_cl.sequence.frame.RenderedFrame`."""

    @property
    def result(self) -> Result:
        """The picture."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know: one line each."""

    def save(self, pictures: Sequence[Path]) -> None:
        """Write its pictures."""


class ReadFrame(Protocol):
    """A frame that is read and planned: `tfm_cl.sequence.frame.ReadFrame`."""

    @property
    def file(self) -> SceneFile:
        """As it was read."""

    @property
    def scene(self) -> Scene:
        """As it was asked for."""

    @property
    def planned(self) -> Planned:
        """What it is rendered with."""

    @property
    def options(self) -> Values:
        """All options as resolved, in the shape of a scene file."""

    def warnings(self) -> tuple[str, ...]:
        """Tell what the file leaves out and most likely should not."""

    def read_files(self) -> None:
        """Read what rendering needs besides."""

    def render(
        self, renderer: Any, pictures: Sequence[Path], progress: Progress | None = None
    ) -> RenderedFrame:
        """Render it, for pictures that it will be saved as."""


class Read(Protocol):
    """Reads frames: `tfm_cl.sequence.frame.read`."""

    def __call__(self, file: SceneFile, number: float | None, like: Any = None, /) -> ReadFrame:
        """Read the volumes of a frame's scene file, and plan it."""
