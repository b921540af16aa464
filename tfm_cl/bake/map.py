"""Transmittance function maps for other programs: numbers and ranges of each light's rays as images."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from tfm_cl.bake.base import Bake, check_folder, filling
from tfm_cl.errors import SceneError

if TYPE_CHECKING:
    from tfm_cl.bake.renderer import Renderer
    from tfm_cl.device.launch import Progress
    from tfm_cl.scene.scene import Scene


class MapBake(Bake):
    """The transmittance function maps of a scene's lights."""

    NAME: ClassVar[str] = "map"
    SUMMARY: ClassVar[str] = "a folder with the transmittance function map of each light"

    def check(self, out: Path) -> None:
        """As `Bake.check`."""
        check_folder(out)

    def bake(self, renderer: Renderer, scene: Scene, out: Path, progress: Progress) -> list[Path]:
        """As `Bake.bake`."""
        maps = renderer.build_maps(scene, progress)
        if not maps:
            raise SceneError("nothing to bake: without lights, or grids or primitives, there are no maps")
        with filling(out) as path:
            path("maps.json").write_text(json.dumps({"maps": len(maps)}), encoding="utf-8")
        return [out / "maps.json"]
