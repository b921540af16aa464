"""A scene: volumes of a medium, solids, a camera, lights, and the settings of the passes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tfm_cl.errors import SceneError
from tfm_cl.files.paths import source_of
from tfm_cl.plan import placement, resolution
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.bodies.volumes import Volumes, joined
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.lights import Light
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.settings import AUTO, MapSettings, MarchSettings, ShadowSettings
from tfm_cl.scene.solids import Solid

Media = Volume | Volumes | Homogeneous
"""What a medium may fill."""


@dataclass(frozen=True, init=False)
class Scene:
    """What is rendered.

    Parameters
    ----------
    volume
        Where the density is: a volume, several whose densities add up, or a homogeneous one.
    medium
        What it is made of.
    camera, lights
        Placed from the volume's occupied bounds when left out; ``lights`` may be a list.
    map, march
        Settings of the light pass and of the view pass.
    solids
        What stands in the way of light and sight; may be a list.
    ambient
        Light from everywhere.
    shadow
        Settings of the solids' shadows in the medium.

    Raises
    ------
    SceneError
        When there is no light in ``lights``; a medium everywhere without a camera or without lights.
    VolumeError
        When there is no volume, or several cannot be added.
    """

    volume: Media
    medium: Medium
    camera: Camera
    lights: tuple[Light, ...]
    map: MapSettings
    march: MarchSettings
    solids: tuple[Solid, ...]
    ambient: Ambient
    shadow: ShadowSettings

    def __init__(
        self,
        volume: Media | Sequence[Volume],
        medium: Medium | None = None,
        camera: Camera | None = None,
        lights: Iterable[Light] | None = None,
        map: MapSettings | None = None,  # noqa: A002 - the scene file's name
        march: MarchSettings | None = None,
        solids: Iterable[Solid] = (),
        ambient: Ambient | None = None,
        shadow: ShadowSettings | None = None,
    ) -> None:
        if isinstance(volume, Sequence):
            volume = joined(volume)
        camera = camera or placement.camera_for(volume)
        lights = (placement.light_for(volume, camera),) if lights is None else lights
        lights = tuple(lights)
        map, march = map or MapSettings(), march or MarchSettings()  # noqa: A001
        if map.max_error is not None and "steps" not in march.model_fields_set:
            march = march.replace(steps=AUTO)
        if not lights:
            raise SceneError("a scene needs at least one light; leave lights out to have one placed")
        for name, value in (
            ("volume", volume),
            ("medium", medium or Medium()),
            ("camera", camera),
            ("lights", lights),
            ("map", map),
            ("march", march),
            ("solids", tuple(solids)),
            ("ambient", ambient or Ambient()),
            ("shadow", shadow or ShadowSettings()),
        ):
            object.__setattr__(self, name, value)

    @property
    def grid(self) -> Volume:
        """The volume, where it is one grid.

        Raises
        ------
        SceneError
            The scene has several volumes, or a homogeneous one.
        """
        if not isinstance(self.volume, Volume):
            raise SceneError("this works with a single volume only, not several or a homogeneous one")
        return self.volume

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene file (TOML), or a bare volume file with everything placed by itself.

        Raises
        ------
        SceneError, VolumeError
            One line naming the file, the key, and what was expected.
        """
        from tfm_cl.files.scene_file import SceneFile  # noqa: PLC0415 - it builds on this module

        return SceneFile.read(source_of(path, error=SceneError)).scene()

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
