"""A scene: bodies of media, solids, a camera, lights, and the settings of the passes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError, VolumeError
from tfm_cl.files.paths import check_writable, path_of, replacing, source_of
from tfm_cl.scene import placement
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.bodies.base import MOST_BODIES, Body, MarchedBody, around
from tfm_cl.scene.bodies.flame import flame_of
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.emission_lights import emission_lights_of, radius_of_emission
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.scene_file_writer import scene_table, scene_text
from tfm_cl.scene.settings import ImageSettings, MapSettings, MarchSettings, ShadowSettings

if TYPE_CHECKING:
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.emission_lights import EmissionLight
    from tfm_cl.scene.lights.base import Light
    from tfm_cl.scene.solids.base import Solid


SHOWN = 2
"""Bodies that a scene's ``repr`` names."""


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Scene:
    """What is rendered.

    Scenes are equal where all their parts are, number by number, and can be pickled.

    Parameters
    ----------
    volume
        Where the density is: a body, or a sequence of up to `MOST_BODIES`, in any mixture. Where they
        overlap, their extinctions add up.
    medium
        What bodies are made of that have no medium of their own.
    camera, lights
        Placed from the volume's occupied bounds when left out; ``lights`` may be a list.
    map, march
        Settings of the light pass and of the view pass.
    solids
        What stands in the way of light and sight; may be a list. A ground is placed under everything where it
        does not say otherwise.
    ambient
        Light from everywhere.
    shadow
        Settings of the solids' shadows in the medium.

    Raises
    ------
    SceneError
        A medium everywhere, and nothing else, without a camera or without ``lights``; or one that emits light
        of a colour that nothing everywhere extinguishes; temperatures of a body that has no file, or that are
        impossible; a ground under nothing.
    VolumeError
        When there is no body, or there are too many; a grid of temperatures that cannot be read.
    """

    bodies: tuple[Body, ...]
    medium: Medium
    camera: Camera
    lights: tuple[Light, ...]
    map: MapSettings
    march: MarchSettings
    solids: tuple[Solid, ...]
    ambient: Ambient
    shadow: ShadowSettings
    flames: tuple[Volume, ...] = field(init=False, repr=False, compare=False)
    """What glows where grids of temperatures are hot: volumes that only the camera sees."""

    def __init__(
        self,
        volume: Body | Sequence[Body],
        medium: Medium | None = None,
        camera: Camera | None = None,
        lights: Iterable[Light] | None = None,
        map: MapSettings | None = None,  # noqa: A002 - the scene file's name
        march: MarchSettings | None = None,
        solids: Iterable[Solid] = (),
        ambient: Ambient | None = None,
        shadow: ShadowSettings | None = None,
    ) -> None:
        bodies = (volume,) if isinstance(volume, Body) else tuple(volume)
        if not 1 <= len(bodies) <= MOST_BODIES:
            raise VolumeError(f"a scene has 1 to {MOST_BODIES} volumes; got {len(bodies)}")
        camera = camera or placement.camera_for(bodies)
        lights = (placement.light_for(bodies, camera),) if lights is None else lights
        lights = tuple(light.upright(placement.upwards(camera)) for light in lights)
        solids = placement.solids_for(tuple(solids), bodies, camera)
        map, march = map or MapSettings(), march or MarchSettings()  # noqa: A001
        if map.max_error is not None and "steps" not in march.model_fields_set:
            march = march.replace(steps="auto")
        for name, value in (
            ("bodies", bodies),
            ("medium", medium or Medium()),
            ("camera", camera),
            ("lights", lights),
            ("map", map),
            ("march", march),
            ("solids", solids),
            ("ambient", ambient or Ambient()),
            ("shadow", shadow or ShadowSettings()),
        ):
            object.__setattr__(self, name, value)
        self._check_emission()
        flames = (flame_of(body, self.medium_of(body)) for body in bodies)
        object.__setattr__(self, "flames", tuple(flame for flame in flames if flame is not None))

    def _check_emission(self) -> None:
        endless = [body for body in self.homogeneous if not np.isfinite(body.bounds).all()]
        extinction = sum((body.density * self.medium_of(body).sigma_t for body in endless), np.zeros(3))
        for body in endless:
            medium = self.medium_of(body)
            if body.density > 0 and (np.asarray(medium.emission)[extinction == 0] > 0).any():
                number = f".{self.bodies.index(body)}" if len(self.bodies) > 1 else ""
                key = "medium" if body.own_medium is None else f"volume{number}.medium"
                raise SceneError(
                    f"{key}.emission = {list(medium.emission)}: a medium everywhere that emits a colour and "
                    "extinguishes none of it is infinitely bright; give it a sigma_a > 0 in that channel"
                )
        unlit = [("a medium everywhere", self.medium_of(body)) for body in endless]
        unlit += [("points, curves or polygons", self.medium_of(body)) for body in self.primitives]
        for what, medium in unlit:
            if medium.emission_lights and medium.emits:
                raise SceneError(
                    f"medium.emission_lights = {medium.emission_lights}: the emission of {what} lights "
                    "nothing; use volumes, boxes or spheres, or emission_lights = 0"
                )

    def __eq__(self, other: object) -> bool:
        """Compare all parts by their content, wherever they come from."""
        if not isinstance(other, Scene) or len(self.bodies) != len(other.bodies):
            return False
        pairs = zip(self.bodies, other.bodies, strict=True)
        return self._settings == other._settings and all(one.equals(another) for one, another in pairs)

    def __hash__(self) -> int:
        """Hash what of that is small."""
        return hash((len(self.bodies), self.medium, self.camera, self.lights, self.map, self.march))

    @property
    def _settings(self) -> tuple[Any, ...]:
        """All parts but the bodies."""
        names = (field.name for field in fields(self) if field.init and field.name != "bodies")
        return tuple(getattr(self, name) for name in names)

    def __repr__(self) -> str:
        width, height = self.camera.res
        counted = ((self.lights, "light"), (self.solids, "solid"))
        parts = [f"{len(some)} {name}{'s' * (len(some) > 1)}" for some, name in counted if some]
        shown = ", ".join(map(repr, self.bodies[:SHOWN]))
        if len(self.bodies) > SHOWN:
            shown += f", … {len(self.bodies)} bodies"
        return f"Scene({', '.join([shown, *parts, f'{width}×{height} pixels'])})"

    @property
    def volume(self) -> Body:
        """The body, where there is one alone.

        Raises
        ------
        SceneError
            The scene has several.
        """
        if len(self.bodies) > 1:
            raise SceneError(f"this works with one volume only; the scene has {len(self.bodies)}")
        return self.bodies[0]

    @property
    def grids(self) -> tuple[Volume, ...]:
        """The bodies whose density is a grid's, in order."""
        return tuple(body for body in self.bodies if isinstance(body, Volume))

    @property
    def primitives(self) -> tuple[Primitives, ...]:
        """The bodies made of many small things, in order."""
        return tuple(body for body in self.bodies if isinstance(body, Primitives))

    @property
    def marched(self) -> tuple[MarchedBody, ...]:
        """The bodies that rays are marched through: grids, then primitives."""
        return (*self.grids, *self.primitives)

    @property
    def homogeneous(self) -> tuple[Homogeneous, ...]:
        """The bodies of constant density, in order: what lies between two points is known in closed form."""
        return tuple(body for body in self.bodies if isinstance(body, Homogeneous))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """World box around all bodies, [2, 3]: low and high corner; may be infinite."""
        return around([body.bounds for body in self.bodies])

    @cached_property
    def finite_bounds(self) -> NDArray[np.float64] | None:
        """World box around the bodies that have an end, [2, 3], read-only; None where there are none."""
        boxes = [box for box in (body.bounds for body in self.bodies) if np.isfinite(box).all()]
        found = around(boxes) if boxes else None
        if found is not None:
            found.flags.writeable = False
        return found

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """World box around all that has density, [2, 3]; may be infinite."""
        return around([body.occupied_bounds for body in self.bodies])

    def medium_of(self, body: Body) -> Medium:
        """Return what a body is made of: its own medium, or the scene's."""
        return body.own_medium or self.medium

    @cached_property
    def emission_lights(self) -> tuple[EmissionLight, ...]:
        """What media emit, as lights on their surroundings: of each body in turn (`medium.emission_lights`).

        Raises
        ------
        SceneError
            More light than float32 holds.
        """
        found: list[EmissionLight] = []
        for body in self.bodies:
            medium = self.medium_of(body)
            if medium.emission_lights:
                found += emission_lights_of(body, medium, flame_of(body, medium))
        return tuple(found)

    @cached_property
    def smallest_emission(self) -> float:
        """Radius of the smallest thing that media emit from and that is not taken for lights; 0 without."""
        radii = [
            radius_of_emission(body, medium, flame_of(body, medium))
            for body in self.bodies
            if not (medium := self.medium_of(body)).emission_lights
        ]
        return min((radius for radius in radii if radius > 0), default=0.0)

    @property
    def dark(self) -> Scene:
        """The same, but no medium emits anything."""
        own = [(body, body.own_medium) for body in self.bodies]
        bodies = [body if medium is None else body.with_medium(medium.dark) for body, medium in own]
        return self.replace(volume=bodies, medium=self.medium.dark)

    @property
    def is_lit(self) -> bool:
        """Whether any light, or what media emit, lights it."""
        return bool(self.lights or self.emission_lights)

    @property
    def media(self) -> tuple[Medium, ...]:
        """What its bodies and flames are made of, each once, in order."""
        return tuple(dict.fromkeys(self.medium_of(body) for body in (*self.bodies, *self.flames)))

    @property
    def spreads(self) -> tuple[float, ...]:
        """The `Light.spread` of its lights, each once, ascending; one that has none is among them."""
        return tuple(sorted({0.0, *(light.spread for light in self.lights)}))

    @property
    def emits(self) -> bool:
        """Whether any body's medium emits light."""
        return bool(self.flames) or any(self.medium_of(body).emits for body in self.bodies)

    @classmethod
    def load(cls, path: str | Path, frame: float | None = None) -> Scene:
        """Read a scene file (TOML), or a bare volume file with everything placed by itself.

        Parameters
        ----------
        path
            ``.toml``, a volume, or a pattern of either, as ``smoke.####.vdb``.
        frame
            Of what changes from frame to frame; it may lie between whole ones.

        Raises
        ------
        SceneError, VolumeError
            One line naming the file, the key, and what was expected.
        """
        return SceneFile.read(source_of(path, error=SceneError), frame=frame).make(cls)

    def save(self, path: str | Path, *, image: ImageSettings | None = None) -> None:
        """Write a scene file (TOML) that loads as this scene; names of files are relative to it.

        Volumes and points that are arrays are written beside it, as ``NAME.volume.0.npz`` and so on; files of
        points hold float32.

        Parameters
        ----------
        path
            ``.toml``; what is there is replaced once the new one is whole.
        image
            For ``[image]``, which is no part of a scene; by default it is left out.

        Raises
        ------
        SceneError
            Curves, polygons or a mesh of arrays, or changed since their file was read; a name that is not
            UTF-8; or it cannot be written.
        """
        target = path_of(path, SceneError)
        if target.suffix.lower() != ".toml":
            raise SceneError(f"{target}: a scene file is called .toml")
        check_writable(target, SceneError)
        files, arrays = dict[int, Path](), dict[Path, dict[str, NDArray[Any]]]()
        for number, body in enumerate(self.bodies):
            if body.to_table() is None and (held := body.to_arrays()) is not None:
                files[number] = target.with_name(f"{target.stem}.volume.{number}.npz")
                arrays[files[number]] = held[2]
        values = self.to_table(files)
        if image is not None:
            values["image"] = image.to_dict()
        text = scene_text(values, target.parent, every_key=False)
        for name, named in arrays.items():
            with replacing(name, SceneError) as temporary, temporary.open("wb") as stream:
                save: Any = np.savez_compressed  # whose type knows no names
                save(stream, **named)
        with replacing(target, SceneError) as temporary:
            temporary.write_text(text, encoding="utf-8")

    def to_table(self, beside: Mapping[int, Path] | None = None) -> dict[str, Any]:
        """Return what it says in the shape of a scene file: `tfm_cl.scene.scene_file_writer.scene_table`."""
        settings = (self.camera, self.ambient, self.shadow, self.map, self.march)
        return scene_table(self.bodies, self.medium, self.lights, self.solids, *settings, beside=beside)

    def read_files(self) -> None:
        """Read what solids, lights and media name, where that has not been done; volumes are read already.

        Afterwards nothing is read any more, but an image that has changed since.

        Raises
        ------
        SceneError
            A mesh, an image or a table that cannot be used.
        """
        for solid in self.solids:
            solid.read_files()
        for light in self.lights:
            light.read_files()
        for body in self.bodies:
            self.medium_of(body).phase.read_files()

    def replace(self, **changes: Any) -> Scene:
        """Return a copy with other parts: ``scene.replace(medium=Medium(sigma_s=(1, .8, .5)))``."""
        values = {field.name: getattr(self, field.name) for field in fields(self) if field.init}
        values["volume"] = values.pop("bodies")
        return type(self)(**values | changes)
