"""A scene: volumes of a medium, solids, a camera, lights, and the settings of the passes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tfm_cl import placement, resolution
from tfm_cl.ambient import Ambient
from tfm_cl.camera import Camera
from tfm_cl.errors import SceneError
from tfm_cl.files import source_of
from tfm_cl.homogeneous import Homogeneous
from tfm_cl.lights import Light
from tfm_cl.medium import Medium
from tfm_cl.settings import MapSettings, MarchSettings, ShadowSettings
from tfm_cl.solids import Solid
from tfm_cl.volume import Volume
from tfm_cl.volumes import Volumes, joined

Media = Volume | Volumes | Homogeneous
"""What a medium may fill."""


FARTHEST = 3e4
"""Sizes of the medium between it and the camera or a light, at which float32 on the device errs by about a
hundredth of the picture; ten times as far, the picture is wrong."""


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
        When there is no light in ``lights``; a medium everywhere without a camera or without lights; a
        camera or a light too far from the medium (`FARTHEST`).
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
        if not lights:
            raise SceneError("a scene needs at least one light; leave lights out to have one placed")
        _check_distances(volume, camera, lights)
        for name, value in (
            ("volume", volume),
            ("medium", medium or Medium()),
            ("camera", camera),
            ("lights", lights),
            ("map", map or MapSettings()),
            ("march", march or MarchSettings()),
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
        from tfm_cl.scene_file import SceneFile  # noqa: PLC0415 - it builds on this module

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


def _check_distances(volume: Media, camera: Camera, lights: Sequence[Light]) -> None:
    """Refuse a camera or a light that the device could not place exactly enough; a sun may be anywhere."""
    bounds = volume.bounds
    if not np.isfinite(bounds).all():
        return
    middle, size = bounds.mean(axis=0), float(np.linalg.norm(bounds[1] - bounds[0]))
    places = np.array([camera.from_, *(getattr(light, "from_", middle) for light in lights)])
    distances = np.linalg.norm(places - middle, axis=1)
    for i in np.flatnonzero(distances > FARTHEST * size).tolist():
        name, instead = "camera.from", "come nearer, with a larger fov"
        if i > 0:
            cone = lights[i - 1].lit_cone()
            if cone is None or cone.reach < distances[i] - size:
                continue  # its place does not matter, or nothing of it arrives
            name, instead = f"light {i - 1}: light.from", "come nearer, or use a light of the type sun"
        raise SceneError(
            f"{name} = {places[i].tolist()}: is {distances[i]:g} world units from the medium, whose size is "
            f"{size:.3g}; float32 on the device places things up to {FARTHEST:g} sizes away: {instead}"
        )
