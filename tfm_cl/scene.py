"""A scene: one volume of a medium, a camera, lights, and the settings of the two passes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tfm_cl import placement, resolution
from tfm_cl.camera import Camera
from tfm_cl.errors import SceneError
from tfm_cl.lights import Light
from tfm_cl.medium import Medium
from tfm_cl.settings import MapSettings, MarchSettings
from tfm_cl.volume import Volume


@dataclass(frozen=True, init=False)
class Scene:
    """What is rendered.

    Parameters
    ----------
    volume
        Where the density is.
    medium
        What it is made of.
    camera, lights
        Placed from the volume's occupied bounds when left out; ``lights`` may be a list.
    map, march
        Settings of the light pass and of the view pass.

    Raises
    ------
    SceneError
        When there is no light in ``lights``.
    """

    volume: Volume
    medium: Medium
    camera: Camera
    lights: tuple[Light, ...]
    map: MapSettings
    march: MarchSettings

    def __init__(
        self,
        volume: Volume,
        medium: Medium | None = None,
        camera: Camera | None = None,
        lights: Iterable[Light] | None = None,
        map: MapSettings | None = None,  # noqa: A002 - the scene file's name
        march: MarchSettings | None = None,
    ) -> None:
        camera = camera or placement.camera_for(volume)
        lights = (placement.light_for(volume, camera),) if lights is None else tuple(lights)
        if not lights:
            raise SceneError("a scene needs at least one light; leave lights out to have one placed")
        for name, value in (
            ("volume", volume),
            ("medium", medium or Medium()),
            ("camera", camera),
            ("lights", lights),
            ("map", map or MapSettings()),
            ("march", march or MarchSettings()),
        ):
            object.__setattr__(self, name, value)

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene file (TOML), or a bare volume file with everything placed by itself.

        Raises
        ------
        SceneError, VolumeError
            One line naming the file, the key, and what was expected.
        """
        from tfm_cl.scene_file import SceneFile  # noqa: PLC0415 - it builds on this module

        return SceneFile.read(Path(path)).scene()

    def replace(self, **changes: Any) -> Scene:
        """Return a copy with other parts: ``scene.replace(medium=Medium(sigma_s=(1, .8, .5)))``."""
        return replace(self, **changes)

    def resolved(self, maps: MapSettings | None = None) -> Scene:
        """Return the scene with numbers for every ``"auto"`` of map resolution and steps.

        Parameters
        ----------
        maps
            Settings of maps that are there already, and whose numbers are to be kept.
        """
        return resolution.resolved(self, maps)
