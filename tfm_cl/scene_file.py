"""Scene files: TOML to a scene and back."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tomli_w
from pydantic import BeforeValidator, Field

from tfm_cl import placement, volume_io
from tfm_cl.ambient import Ambient
from tfm_cl.camera import Camera
from tfm_cl.errors import SceneError
from tfm_cl.homogeneous import Homogeneous, parse_homogeneous
from tfm_cl.lights import LIGHTS, Light, parse_light
from tfm_cl.medium import Medium
from tfm_cl.model import LARGEST_COLOUR, Model, Vec3, is_auto, number_or_auto, unknown_key
from tfm_cl.scene import Media, Scene
from tfm_cl.settings import ImageSettings, MapSettings, MarchSettings, ShadowSettings
from tfm_cl.solids import Solid, parse_solid
from tfm_cl.transform import Transform
from tfm_cl.volume import Volume
from tfm_cl.volume_io import colour as colour_io
from tfm_cl.volumes import MOST_VOLUMES, joined

MAX_BYTES = 1 << 20
"""A scene file larger than this is not one."""

Values = dict[str, Any]
"""A scene as TOML gives it: nested tables."""


def _sizes(value: Any) -> Any:
    return (value,) * 3 if isinstance(value, int | float) and not isinstance(value, bool) else value


def _file(value: Any) -> Any:
    if not isinstance(value, str) or not value or not value.isprintable():
        raise ValueError("should be the name of a volume file")
    return value


def _colour_source(value: Any) -> Any:
    names = [value] if isinstance(value, str) else value
    if value is None or value is False:
        return value
    if (
        not isinstance(names, list | tuple)
        or len(names) != (1 if isinstance(value, str) else 3)
        or not all(isinstance(name, str) and name and name.isprintable() for name in names)
    ):
        raise ValueError(
            "should be the name of an array, of a grid of vectors or of a file with one, three names of "
            "grids ['r', 'g', 'b'], or false"
        )
    return value if isinstance(value, str) else tuple(value)


def _window(value: Any) -> Any:
    if value is None:
        return value
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2  # noqa: PLR2004 - low and high
        or not all(isinstance(end, int | float) and not isinstance(end, bool) for end in value)
        or not -LARGEST_COLOUR <= value[0] < value[1] <= LARGEST_COLOUR
    ):
        raise ValueError("should be two numbers [low, high], low < high")
    return float(value[0]), float(value[1])


class VolumeSettings(Model):
    """Which grid of which file, and where it lies."""

    SECTION: ClassVar[str] = "volume"

    file: Annotated[str, BeforeValidator(_file)] = Field(
        description="volume file, relative to the scene file"
    )
    grid: str | None = Field(None, description="name of the grid")
    colour: Annotated[str | tuple[str, str, str] | Literal[False] | None, BeforeValidator(_colour_source)] = (
        Field(
            None,
            description="RGB extinction of each voxel relative to the grid: an array [z, y, x, 3] of the "
            "same npz, a grid of vectors of the same file ('Cd'), a file with such an array or grid "
            "(relative to the scene file), or three grids of the same file; false: none; left out: the array "
            "'colour' of an npz, if any",
        )
    )
    offset: float = Field(
        0.0,
        ge=-LARGEST_COLOUR,
        le=LARGEST_COLOUR,
        description="added to each value of the grid, for instance 1000 to a CT in Hounsfield units; what is "
        "then below 0 becomes 0",
    )
    window: Annotated[tuple[float, float] | None, BeforeValidator(_window)] = Field(
        None,
        description="low,high: of the values of the grid (after the offset) these become 0 and 1, those "
        "between in proportion, others the nearer of the two",
    )
    density_scale: Annotated[float | Literal["auto"], number_or_auto(0, LARGEST_COLOUR)] = Field(
        1.0,
        description="density = density_scale * grid; auto: a sensible optical depth (bare volumes' default)",
    )
    voxel_size: Annotated[Vec3 | None, BeforeValidator(_sizes)] = Field(
        None, description="edge of a voxel, world units, one number or x,y,z (files without a transform)"
    )
    origin: Vec3 | None = Field(
        None, description="world position of the low corner of voxel 0,0,0 (files without a transform)"
    )
    transform: Transform | None = Field(
        None,
        description="4x4, 16 numbers row by row: moves the volume from where its file, or voxel_size and "
        "origin, put it",
    )
    sanitize: bool = Field(
        default=False, description="set NaN, infinite and negative densities and colours to 0"
    )

    def load(self, folder: Path) -> Volume:
        """Read the volume."""
        volume = Volume.load(
            folder / self.file,
            self.grid,
            colour=self._colour_in(folder),
            offset=self.offset,
            window=self.window,
            voxel_size=self.voxel_size,
            origin=self.origin,
            sanitize=self.sanitize,
        )
        if self.transform is not None:
            volume = volume.transformed(self.transform)
        if self.density_scale == "auto":
            return volume.with_density_scale(placement.density_scale_for(volume))
        return volume.with_density_scale(self.density_scale)

    def _colour_in(self, folder: Path) -> colour_io.ColourSource:
        is_file = isinstance(self.colour, str) and colour_io.is_file(self.colour)
        return folder / str(self.colour) if is_file else self.colour

    def resolved(self, folder: Path, volume: Volume) -> Values:
        """Return the section of a scene file anywhere that loads ``volume`` again."""
        colour = self._colour_in(folder)
        if isinstance(colour, Path):
            colour = str(colour.resolve())
        elif colour is None and volume.colour is not None and self.file.lower().endswith(".npz"):
            colour = volume_io.COLOUR
        return self.to_dict() | {
            "file": str((folder / self.file).resolve()),
            "grid": volume.name or None,
            "colour": list(colour) if isinstance(colour, tuple) else colour,
            "density_scale": volume.density_scale,
        }


SECTIONS: dict[str, type[Model]] = {
    cls.SECTION: cls
    for cls in (
        VolumeSettings,
        Medium,
        Camera,
        Ambient,
        ShadowSettings,
        MapSettings,
        MarchSettings,
        ImageSettings,
    )
}
"""Tables of a scene file; besides them there are arrays of tables."""
ARRAYS = ("light", "solid")
"""Arrays of tables, ``[[light]]``; ``[[volume]]`` may be one too."""


@dataclass(frozen=True)
class SceneFile:
    """A scene file with the command line's overrides, checked as far as it can be without volume and meshes.

    ``light`` is None when the scene leaves its light to us; then ``placed_light`` holds what was said of
    it. Keys missing in ``camera`` are placed too.
    """

    path: Path
    volumes: tuple[VolumeSettings | Homogeneous, ...]
    medium: Medium
    solids: tuple[Solid, ...]
    ambient: Ambient
    shadow: ShadowSettings
    map: MapSettings
    march: MarchSettings
    image: ImageSettings
    camera: Values
    light: tuple[Light, ...] | None
    placed_light: Values

    @classmethod
    def read(cls, path: Path, overrides: Iterable[tuple[str, Any]] = ()) -> SceneFile:
        """Read a scene (``.toml``), or make one around a bare volume file.

        Parameters
        ----------
        overrides
            Pairs of a dotted key and a value that win over the file: ``("camera.fov", 30.0)``.
            ``light.KEY`` means the first light, ``light.1.KEY`` the second; likewise solids and volumes.

        Raises
        ------
        SceneError
            Unknown key (names the nearest), wrong type or impossible value.
        VolumeError
            Neither a scene nor a volume.
        """
        values, placed_light = _values_of(path), Values()
        try:
            _check_tables(values)
            overrides = list(overrides)
            _make_way(values, {key for key, _ in overrides})
            for key, value in overrides:
                _override(values, placed_light, key, value)
            return cls._checked(path, values, placed_light)
        except SceneError as error:
            raise SceneError(f"{path}: {error}") from None

    @classmethod
    def _checked(cls, path: Path, values: Values, placed_light: Values) -> SceneFile:
        _check_tables(values)
        camera = values.get("camera", {})
        known = list(Camera.keys())
        for key in camera:
            if key not in known:
                raise SceneError(unknown_key(key, known, "camera"))
        lights = values.get("light")
        _check_light(placed_light)
        volumes = values.get("volume", {})
        tables = volumes if isinstance(volumes, list) else [volumes]
        return cls(
            path=path,
            volumes=_volumes(tables),
            medium=Medium(**values.get("medium", {})),
            solids=tuple(_solid(i, table, path.parent) for i, table in enumerate(values.get("solid", []))),
            ambient=Ambient(**values.get("ambient", {})),
            shadow=ShadowSettings(**values.get("shadow", {})),
            map=MapSettings(**values.get("map", {})),
            march=MarchSettings(**values.get("march", {})),
            image=ImageSettings(**values.get("image", {})),
            camera=camera,
            light=None
            if lights is None
            else tuple(_light(i, table, path.parent) for i, table in enumerate(lights)),
            placed_light=placed_light,
        )

    def scene(self) -> Scene:
        """Read the volume and place what the file left out.

        Raises
        ------
        SceneError, VolumeError
            Impossible camera or light, or a volume that cannot be used.
        """
        volume = self._volume()
        try:
            lights = self.light
            camera = placement.camera_for(volume, **self.camera)
            if lights is None:
                placed = _beside(self.placed_light, "texture", self.path.parent)
                lights = (placement.light_for(volume, camera, **placed),)
            self._check_crop(camera)
            return Scene(
                volume,
                self.medium,
                camera,
                lights,
                self.map,
                self.march,
                solids=self.solids,
                ambient=self.ambient,
                shadow=self.shadow,
            )
        except SceneError as error:
            raise SceneError(f"{self.path}: {error}") from None

    def _volume(self) -> Media:
        grids = []
        for settings in self.volumes:
            if isinstance(settings, Homogeneous):
                return settings  # it stands alone
            grids.append(settings.load(self.path.parent))
        return joined(grids)

    def files(self) -> list[str]:
        """Name all files that the scene reads, relative to its own or absolute."""
        named: list[str | None] = []
        for volume in self.volumes:
            if isinstance(volume, VolumeSettings):
                named += [volume.file, volume.colour if isinstance(volume.colour, str) else None]
        named += [getattr(light, "texture", None) for light in self.light or ()]
        named += [getattr(solid, "mesh", None) for solid in self.solids]
        return [name for name in named if name]

    def _check_crop(self, camera: Camera) -> None:
        width, height = camera.res
        if self.image.crop is not None and (self.image.crop[2] > width or self.image.crop[3] > height):
            crop = list(self.image.crop)
            raise SceneError(f"image.crop = {crop}: does not lie in the image of {width}×{height} pixels")

    def chosen(self, scene: Scene) -> Values:
        """Return what was placed, scaled or counted by itself, by dotted key, to be fixed by hand."""
        values: Values = {}
        for number, settings, volume in self._grids(scene):
            if settings.density_scale == "auto":
                values[f"volume.{number}density_scale"] = volume.density_scale
        camera = scene.camera.to_dict()
        values |= {f"camera.{key}": camera[key] for key in ("from", "to") if key not in self.camera}
        if self.light is None:
            light = scene.lights[0].to_dict()
            placed = (key for key in ("from", "to", "cone", "intensity") if key not in self.placed_light)
            values |= {f"light.{key}": light[key] for key in placed if key in light}
        resolved = scene.resolved()
        for section, key in (("map", "res"), ("map", "steps"), ("march", "steps")):
            if is_auto(getattr(getattr(self, section), key)):
                values[f"{section}.{key}"] = getattr(getattr(resolved, section), key)
        return values

    def warnings(self, scene: Scene) -> tuple[str, ...]:
        """Tell, one line each, what the file leaves out and most likely should not."""
        return tuple(
            f'{self.path}: volume.{number}density_scale is not given: 1 is used; "auto" would take '
            f"{sensible:g}: give one of them"
            for number, settings, volume in self._grids(scene)
            if "density_scale" not in settings.model_fields_set
            and _is_far_from_one(
                sensible := placement.density_scale_for(volume), float(scene.medium.sigma_t.max())
            )
        )

    def _grids(self, scene: Scene) -> Iterator[tuple[str, VolumeSettings, Volume]]:
        """Yield each volume that is a grid, with its settings and what its keys' section is numbered with."""
        for i, (settings, volume) in enumerate(zip(self.volumes, scene.volume.parts, strict=False)):
            if isinstance(settings, VolumeSettings):
                yield f"{i}." if len(self.volumes) > 1 else "", settings, volume

    def resolved(self, scene: Scene) -> Values:
        """Return every option as resolved, in the shape of a scene file that reproduces this run."""
        scene = scene.resolved()
        volumes = [
            settings.resolved(self.path.parent, volume) for _, settings, volume in self._grids(scene)
        ] or [settings.to_dict() for settings in self.volumes]
        return {
            "volume": volumes[0] if len(volumes) == 1 else volumes,
            "medium": scene.medium.to_dict(),
            "camera": scene.camera.to_dict(),
            "light": [light.to_dict() for light in scene.lights],
            "solid": [solid.to_dict() for solid in scene.solids],
            "ambient": scene.ambient.to_dict(),
            "shadow": scene.shadow.to_dict(),
            "map": scene.map.to_dict(),
            "march": scene.march.to_dict(),
            "image": self.image.to_dict(),
        }


FAR = 2.0
"""Factor between two density scales that makes another picture."""


def _is_far_from_one(sensible: float, sigma_t: float) -> bool:
    """Tell whether a density scale of 1 gives a much worse optical depth than ``sensible`` would.

    ``sensible`` is for σ_t = 1. A medium of another σ_t may say by it what the density scale does not: then
    both together would be worse.
    """
    if sigma_t <= 0:
        return False
    # Of logarithms, since a quotient may be beyond float64.
    as_it_is, with_sensible = abs(math.log(sigma_t) - math.log(sensible)), abs(math.log(sigma_t))
    return as_it_is >= math.log(FAR) and as_it_is > with_sensible


NUMBERS = ("coeffs", "bytes", "max_error")
"""Keys of the map that each say how many numbers a texel has."""


def _make_way(values: Values, overridden: set[str]) -> None:
    """Drop what a file says of the map's numbers where an override says it in another way."""
    if isinstance(values.get("map"), dict) and overridden & {f"map.{key}" for key in NUMBERS}:
        values["map"] = {key: value for key, value in values["map"].items() if key not in NUMBERS}


def to_toml(values: Values) -> str:
    """Write resolved options as TOML; what is None is left out."""
    return tomli_w.dumps(_without_none(values))


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        return [_without_none(item) for item in value]
    return value


def _values_of(path: Path) -> Values:
    if path.suffix.lower() in volume_io.FORMATS:
        return {
            "volume": {"file": path.name, "density_scale": "auto"},
            "map": {"res": "auto", "steps": "auto"},
            "march": {"steps": "auto"},
        }
    if path.suffix.lower() != ".toml":
        known = " ".join([".toml", *sorted(volume_io.FORMATS)])
        raise SceneError(f"{path}: neither a scene nor a volume; known extensions: {known}")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise SceneError(f"{path}: larger than {MAX_BYTES:,} bytes: not a scene file")
        with path.open("rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: not TOML: {error}") from None


def _check_tables(values: Values) -> None:
    known = list(dict.fromkeys([*SECTIONS, *ARRAYS]))
    for name, table in values.items():
        if name not in known:
            raise SceneError(unknown_key(name, known))
        if name == "volume":
            if not isinstance(table, dict | list):
                raise SceneError("volume should be a table [volume] or [[volume]] tables")
        elif not isinstance(table, list if name in ARRAYS else dict):
            raise SceneError(
                f"{name} should be {f'[[{name}]] tables' if name in ARRAYS else f'a table [{name}]'}"
            )


def _override(values: Values, placed_light: Values, key: str, value: Any) -> None:
    """Set a dotted key; what is said of a light that the scene does not have goes to ``placed_light``."""
    section, _, rest = key.partition(".")
    if section not in ARRAYS and not isinstance(values.get(section), list):
        table = values.setdefault(section, {})
    else:
        number, dot, after = rest.partition(".")
        index, rest = (int(number), after) if dot and number.isdecimal() else (0, rest)
        tables = values.get(section)
        if section == "light" and tables is None and index == 0:
            table = placed_light
        elif isinstance(tables, list) and index < len(tables):
            table = tables[index]
        else:
            number_of = len(tables) if isinstance(tables, list) else "no"
            raise SceneError(f"{key}: the scene has {number_of} [[{section}]] tables; they count from 0")
    if not rest or not isinstance(table, dict):
        known = dict.fromkeys([*SECTIONS, *ARRAYS])
        raise SceneError(f"{key}: should be SECTION.KEY with a section of {', '.join(known)}")
    *tables, last = rest.split(".")
    for name in tables:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise SceneError(f"{key}: '{name}' is not a table")
    table[last] = value


def _volumes(tables: list[Any]) -> tuple[VolumeSettings | Homogeneous, ...]:
    if not 1 <= len(tables) <= MOST_VOLUMES:
        raise SceneError(f"a scene has 1 to {MOST_VOLUMES} [[volume]] tables; got {len(tables)}")
    volumes: list[VolumeSettings | Homogeneous] = []
    for table in tables:
        if not isinstance(table, dict):
            raise SceneError("volume should be a table [volume] or [[volume]] tables")
        if "shape" not in table:
            volumes.append(VolumeSettings(**table))
        elif len(tables) > 1:
            raise SceneError("volume.shape: a homogeneous volume stands alone; give it as the only [volume]")
        else:
            volumes.append(parse_homogeneous(table))
    return tuple(volumes)


def _light(index: int, table: Any, folder: Path) -> Light:
    try:
        _check_light(table)
        return parse_light(_beside(table, "texture", folder))
    except SceneError as error:
        raise SceneError(f"light {index}: {error}") from None


def _solid(index: int, table: Any, folder: Path) -> Solid:
    if not isinstance(table, dict):
        raise SceneError(f"solid {index}: solid should be a table")
    try:
        return parse_solid(_beside(table, "mesh", folder))
    except SceneError as error:
        raise SceneError(f"solid {index}: {error}") from None


def _beside(table: Values, key: str, folder: Path) -> Values:
    """Make a file's name, relative to the scene file, absolute."""
    name = table.get(key)
    if not isinstance(name, str) or not name:
        return table
    return table | {key: str((folder / name).resolve())}


def _check_light(table: Any) -> None:
    """Refuse what `parse_light` cannot tell: attributes' Python names are no keys."""
    if not isinstance(table, dict) or not isinstance(table.get("type", ""), str):
        raise SceneError("light should be a table with a name as its type")
    kind = LIGHTS.get(table.get("type", "spot"))
    known = list(kind.keys()) if kind else list(table)
    for key in table:
        if key not in known:
            raise SceneError(unknown_key(key, known, "light"))
