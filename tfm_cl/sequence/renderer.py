"""What a sequence asks of a renderer: `tfm_cl.render.renderer.Renderer`, or one like it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from tfm_cl.render.result import RenderResult
    from tfm_cl.scene.scene import Scene


class Renderer(Protocol):
    """Renders scenes, one after the other."""

    @property
    def render(self) -> Callable[..., RenderResult]:
        """`tfm_cl.render.renderer.Renderer.render`, which takes a scene and what is asked for."""

    @property
    def begin(self) -> Callable[..., Callable[[], RenderResult]]:
        """`tfm_cl.render.renderer.Renderer.begin`, likewise."""

    @property
    def render_blurred(self) -> Callable[..., RenderResult]:
        """`tfm_cl.render.renderer.Renderer.render_blurred`, which takes the scene of each moment besides."""

    @property
    def functions_for(self) -> Callable[..., str | None]:
        """`tfm_cl.render.renderer.Renderer.functions_for`, which takes the scenes of some frames."""

    def prepare(self, scene: Scene) -> bool:
        """As `tfm_cl.render.renderer.Renderer.prepare`, while another thread renders."""

    def forget_unused(self) -> None:
        """As `tfm_cl.render.renderer.Renderer.forget_unused`."""
