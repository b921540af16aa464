"""Scene files: TOML to a scene and back."""

from __future__ import annotations

import contextlib
import copy
import os
import re
import tomllib
import zipfile
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar

from pydantic import BeforeValidator, Field, PlainValidator

from tfm_cl.errors import (
    Fault,
    Faults,
    InputError,
    Key,
    SceneError,
    meant_by,
    nearest,
    unknown_key,
    words,
)
from tfm_cl.files import curves_io, points_io, volume_io
from tfm_cl.files.curves_io.numpy_arrays import COUNTS
from tfm_cl.files.named_files import named_by
from tfm_cl.files.paths import check_readable, name_of, real_path, reason_of, source_of
from tfm_cl.files.patterns import FilePattern
from tfm_cl.files.points_io.attributes import POSITIONS
from tfm_cl.files.toml_lines import TomlLines
from tfm_cl.files.volume_io import colour as colour_io
from tfm_cl.limits import LARGEST_COLOUR
from tfm_cl.model import SPELLINGS, Model, Point, number_or_auto, one_or_three_numbers
from tfm_cl.model_fields import NUMBER, TEXT, Accepts, Numbers, accepts, numbers
from tfm_cl.scene import frame_files, keyframes, looks, placement
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.background import check_surrounded
from tfm_cl.scene.bodies.base import BODIES, MOST_BODIES, OF_BODIES, Body, BodySettings
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.moving import MovingSettings
from tfm_cl.scene.bodies.velocity import OUTLIERS
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.camera import outdone as outdone_of_camera
from tfm_cl.scene.frame_numbers import FrameNumbers, OfFrames, name_at
from tfm_cl.scene.lights.base import LIGHTS, Light, names_of, parse_light
from tfm_cl.scene.medium import Medium, OwnMedium
from tfm_cl.scene.movable import Movable, outdone
from tfm_cl.scene.optical_depth import density_scale_for
from tfm_cl.scene.presets import PRESETS, expanded
from tfm_cl.scene.settings import ImageSettings, MapSettings, MarchSettings, ShadowSettings
from tfm_cl.scene.solids.base import Solid, parse_solid
from tfm_cl.scene.transform import Matrix, Rows

MAX_BYTES = 1 << 20
"""A scene file larger than this is not one."""

S = TypeVar("S")
Values = dict[str, Any]
"""A scene as TOML gives it: nested tables."""
Overrides = tuple[tuple[str, Any], ...]
"""Pairs of a dotted key and a value."""


@accepts(NUMBER, numbers(3))
def _sizes(value: Any) -> Any:
    return value if value is None else one_or_three_numbers(value)


@accepts(TEXT)
def _file(value: Any) -> str:
    return name_of(value, "a volume file")


NAMES = (TEXT, {"type": "array", "items": TEXT, "minItems": 3, "maxItems": 3}, {"const": False})
"""JSON Schemas of what is read beside a grid."""


@accepts(*NAMES)
def _colour_source(value: Any) -> Any:
    what = (
        "an array, of a grid of vectors or of a file with one, three names of grids ['r', 'g', 'b'], or false"
    )
    return _named(value, what)


def _named(value: Any, what: str) -> Any:
    """Check the name, or the three names, of what is read beside a grid; false means nothing."""
    if value is None or value is False:
        return value
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list | tuple) or len(names) != (1 if isinstance(value, str) else 3):
        raise ValueError(f"should be the name of {what}")
    checked = tuple(name_of(name, what) for name in names)
    return value if isinstance(value, str) else checked


@accepts(numbers(2))
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


@accepts(*NAMES)
def _velocity_source(value: Any) -> Any:
    what = "a grid of vectors or of a file with one, three names of grids ['x', 'y', 'z'], or false"
    return _named(value, what)


class VolumeSettings(OfFrames, MovingSettings):
    """Which grid of which file, and where it lies."""

    SECTION: ClassVar[str] = "volume"
    WORDS: ClassVar[dict[str, str]] = OF_BODIES | words(
        {
            "file": "filename filepath path vdb source",
            "grid": "gridname gridid field attribute channel",
            "density_scale": "density densityscale densitymultiplier gain strength thickness multiplier",
            "voxel_size": "spacing voxelsize cellsize dx resolution",
            "write window = [low, high]": "range clip valuerange",
        }
    )

    file: Annotated[str, PlainValidator(_file)] = Field(description="volume file, relative to the scene file")
    grid: str | None = Field(default=None, description="name of the grid")
    colour: Annotated[str | tuple[str, str, str] | Literal[False] | None, PlainValidator(_colour_source)] = (
        Field(
            default=None,
            description="RGB extinction of each voxel relative to the grid: an array [z, y, x, 3] of the "
            "same npz, a grid of vectors of the same file ('Cd'), a file with such an array or grid "
            "(relative to the scene file), or three grids of the same file; false: none; left out: the array "
            "'colour' of an npz, if any",
        )
    )
    offset: float = Field(
        default=0.0,
        ge=-LARGEST_COLOUR,
        le=LARGEST_COLOUR,
        description="added to each value of the grid, for instance 1000 to a CT in Hounsfield units; what is "
        "then below 0 becomes 0",
    )
    window: Annotated[tuple[float, float] | None, BeforeValidator(_window)] = Field(
        default=None,
        description="low,high: of the values of the grid (after the offset) these become 0 and 1, those "
        "between in proportion, others the nearer of the two",
    )
    density_scale: Annotated[float | Literal["auto"], number_or_auto(0, LARGEST_COLOUR)] = Field(
        default=1.0,
        description="density = density_scale * grid; auto: a sensible optical depth (bare volumes' default)",
    )
    voxel_size: Accepts[float | Numbers | None, Annotated[Point | None, BeforeValidator(_sizes)]] = Field(
        default=None,
        validate_default=True,
        description="edge of a voxel, world units, one number or x,y,z (files without a transform)",
    )
    origin: Accepts[Numbers | None, Point | None] = Field(
        default=None,
        validate_default=True,
        description="position of the low corner of voxel 0,0,0, world units (files without a transform)",
    )
    transform: Accepts[Rows | None, Matrix | None] = Field(
        default=None,
        validate_default=True,
        description="4x4, 16 numbers row by row: moves the volume from where its file, or voxel_size and "
        "origin, put it",
    )
    medium: OwnMedium = Field(
        default=None,
        validate_default=True,
        description="what this body alone is made of: a table like [medium], whose keys it overrides",
    )
    sanitize: bool = Field(
        default=False,
        description="set NaN, infinite and negative densities and colours, and such velocities, to 0",
    )
    velocity: Annotated[
        str | tuple[str, str, str] | Literal[False] | None, PlainValidator(_velocity_source)
    ] = Field(
        default=None,
        description="motion blur: how fast what the grid holds moves, in the file's units per second: a "
        "grid of vectors or an array [z, y, x, 3] of the same file ('vel'), a file with one (relative to the "
        "scene file), or three grids ['vel.x', 'vel.y', 'vel.z']; false: it does not move; left out: what is "
        "called v, vel or velocity, if any",
    )
    velocity_outlier_threshold: float = Field(
        default=OUTLIERS,
        ge=0,
        lt=1,
        description="motion blur: share of the voxels, the fastest along an axis, that are slowed down to "
        "the fastest of the others; 0: none",
    )

    def load(
        self, folder: Path, optical_depth: float, like: tuple[BodySettings, Body] | None = None
    ) -> Volume:
        """As `BodySettings.load`."""
        other, read = like or (None, None)
        if isinstance(other, VolumeSettings) and isinstance(read, Volume) and self._reads_as(other):
            volume = read.as_stored()
        else:
            other = None
            volume = Volume.load(
                source_of(self.file, folder),
                self.grid,
                colour=self._in(folder, self.colour),
                offset=self.offset,
                window=self.window,
                voxel_size=self.voxel_size,
                origin=self.origin,
                sanitize=self.sanitize,
            ).with_velocity(
                self._in(folder, self.velocity),
                scale=self.velocity_scale,
                fps=self.velocity_fps,
                outlier_threshold=self.velocity_outlier_threshold,
            )
        volume = volume.with_medium(self.medium)
        if self.transform is not None:
            volume = volume.transformed(self.transform)
        found = volume.made_from or {}
        named = ("file", "grid", "colour", "velocity")
        volume.made_from = self.to_dict() | {key: found.get(key) for key in named}
        if self.density_scale != "auto":
            return volume.with_density_scale(self.density_scale)
        if other is not None and other.density_scale == "auto":
            return volume  # one for all moments
        return volume.with_density_scale(density_scale_for(volume, optical_depth))

    def _reads_as(self, other: VolumeSettings) -> bool:
        """Tell whether others read the same of the same files: they may put it elsewhere, or scale it."""
        placed = {*Movable.model_fields, "density_scale", "medium"}
        return all(
            getattr(self, key) == getattr(other, key) for key in type(self).model_fields if key not in placed
        )

    @staticmethod
    def _in(
        folder: Path, source: str | tuple[str, str, str] | Literal[False] | None
    ) -> colour_io.ColourSource:
        """Return where something is read beside the grid: of a file, where that is."""
        is_file = isinstance(source, str) and volume_io.is_volume_file(source)
        return source_of(str(source), folder) if is_file else source

    def sources(self) -> list[str]:
        """As `BodySettings.sources`."""
        beside = [name for name in (self.colour, self.velocity) if isinstance(name, str)]
        return [self.file, *filter(volume_io.is_volume_file, beside)]


BODIES["file"] = VolumeSettings.from_table

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
WORDS = words(
    {
        "volume": "volumes grid vdb density domain",
        "medium": "media material materials interior",
        "camera": "cameras sensor view",
        "light": "lights lamp lamps emitter emitters lightsource",
        "solid": "solids object objects mesh meshes geometry shape shapes",
        "image": "output film picture",
        "write [[light]] with type = 'sun', 'sky' or 'environment'": "sun sky environment world hdri",
        "write [[solid]] with shape = 'ground'": "ground floor",
        "write [[volume]] with shape = 'everywhere' or 'box'": "fog",
        "write it in [medium]: phase = { type = 'hg', g = 0.3 }": "phase phasefunction",
        "its keys are in [camera] (res), [image] (samples), [march] and [map]": "render settings sampler",
        "its keys are in [march] (method, steps), [map], and [medium] (orders)": "integrator",
    }
)
"""Sections of other programs -> the section here, or what to do."""


@dataclass(frozen=True, eq=False)
class Source:
    """What a scene was read from, to say where in it something is wrong."""

    path: Path
    lines: TomlLines | None = None
    """None of a bare volume."""
    overridden: set[Key] = field(default_factory=set)
    """Keys whose values are not the file's."""

    def located(self, error: SceneError, *, by_words: bool = False) -> SceneError:
        """Return the same with the file, and its line, in front of every fault, in the order of the lines.

        Parameters
        ----------
        by_words
            The keys are those that the faults begin with, of the whole file.
        """
        placed = [(self._line_of(fault, by_words=by_words), fault) for fault in error.faults]
        placed.sort(key=lambda pair: pair[0] or MAX_BYTES)
        return SceneError(
            *(fault.within(f"{self.path}:{line}" if line else str(self.path)) for line, fault in placed)
        )

    def has(self, key: Key) -> bool:
        """Tell whether the file has a key."""
        return self.lines is not None and self.lines.exactly(key) is not None

    def _line_of(self, fault: Fault, *, by_words: bool) -> int | None:
        if self.lines is None:
            return None
        key = _key_in(fault) if by_words else fault.key
        if any(key[:length] in self.overridden for length in range(1, len(key) + 1)):
            return None
        other = {name: spelling for spelling, name in SPELLINGS.items()}
        spelt = tuple(other.get(str(part), part) for part in key)
        line = self.lines.exactly(key) or self.lines.exactly(spelt)
        return line if line or by_words else self.lines.nearest(key)


def _key_of(place: Key, settings: Any, name: str) -> Key:
    """Return the key by which a table names a file."""
    keys = type(settings).keys()
    return *place, *[key for key, field in keys.items() if getattr(settings, field) == name][:1]


def _key_in(fault: str) -> Key:
    """Return the dotted key that a line begins with."""
    found = re.match(r"[a-z_]+(\.\w+)*(?= = |: )", fault)
    return tuple(int(part) if part.isdecimal() else part for part in found[0].split(".")) if found else ()


class Made(NamedTuple):
    """A scene file, and the bodies that were made of it."""

    file: SceneFile
    bodies: tuple[Body, ...]
    is_moment: bool = True
    """Whether it is the same at another moment: what was chosen by a grid's values stays. Else it is chosen
    anew, and only what is read alike is taken from there."""


@dataclass(frozen=True)
class SceneFile:
    """A scene file with the command line's overrides, checked as far as it can be without volume and meshes.

    ``light`` is None when the scene leaves its light to us; then ``placed_light`` holds what was said of
    it. Keys missing in ``camera`` are placed too.
    """

    source: Source
    path: Path
    volumes: tuple[BodySettings, ...]
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
    look: looks.Chosen
    changing: tuple[Key, ...] = ()
    """Keys whose values change from frame to frame."""
    patterns: tuple[frame_files.Changing, ...] = ()
    """Of the files that change."""
    turn: float | None = None
    """Degrees by which the camera, once it is placed, is turned about ``camera.up`` through ``camera.to``;
    None where no frame has it turned."""
    turn_a_frame: float = 0.0
    """By how much more it is in the next frame."""
    asked: tuple[Path, Overrides, str, float | None, Overrides] | None = None
    """Path, overrides, look, frame and what was decided that it was read for."""

    @classmethod
    def read(
        cls,
        path: Path,
        overrides: Iterable[tuple[str, Any]] = (),
        look: str = looks.PLAIN,
        frame: float | None = None,
        decided: Iterable[tuple[str, Any]] = (),
        after: float = 0.0,
    ) -> SceneFile:
        """Read a scene (``.toml``), or make one around a bare volume file.

        Parameters
        ----------
        path
            May be a pattern, as ``smoke.####.vdb``.
        overrides
            Pairs of a dotted key and a value that win over the file: ``("camera.fov", 30.0)``.
            ``light.KEY`` means the first light, ``light.1.KEY`` the second; likewise solids and volumes.
            A section alone, as ``light``, is replaced by the value, a table or an array of them.
        look
            ``plain``, ``auto`` or one of `tfm_cl.scene.looks.LOOKS`: what is chosen where the file and the
            overrides say nothing.
        frame
            At which keyframes have their values, and of which files that are patterns are taken: of the whole
            frame before, where it lies between two.
        decided
            Likewise, of what these, the file and the look leave open, decided for many frames.
        after
            Frames from there to the moment at which keyframes have their values; files stay the frame's.

        Raises
        ------
        SceneError
            Unknown key (names the nearest), wrong type or impossible value; no frame, where something changes
            from frame to frame; or the file of a frame is not there.
        VolumeError
            Neither a scene nor a volume.
        """
        overrides, decided = tuple(overrides), tuple(decided)
        asked, moment = (path, overrides, look, frame, decided), None if frame is None else frame + after
        (values, source), placed_light = _values_at(path, dict(overrides), frame), Values()
        path = source.path
        # What a section is as a whole comes first, then a medium by name: what is said besides changes them.
        overrides, faults = sorted(overrides, key=_order), Faults()
        _make_way(values, {key for key, _ in overrides})
        _change_kinds(values, overrides)
        holds = None if path.suffix.lower() == ".toml" else next(iter(values["volume"]))
        chosen = looks.chosen(look, path, holds)
        if chosen.name != looks.PLAIN:
            _dress(values, chosen.name, path, dict(overrides), frame)
        for key, value in overrides:
            with faults.collect():
                source.overridden.add(_override(values, placed_light, key, value))
                _check_used(values, key)
        _make_way(values, {key for key, _ in decided})
        for key, value in decided:
            with faults.collect():
                source.overridden.add(_override(values, placed_light, key, value))
        try:
            given, (values, changing, files) = values, _at_frame(values, frame, moment, path.parent)
            placed, others, more = _at_frame({"light": placed_light}, frame, moment, path.parent)
        except SceneError as error:
            raise source.located(error) from None
        tables, written = _tables(values, faults)
        sections = cls._sections(tables, written, path.parent, faults)
        with faults.collect():
            _check_placed(placed["light"], path.parent)
        try:
            faults.raise_any()
        except SceneError as error:
            between = {key for key in changing if keyframes.is_between_whole(given, values, key)}
            raise source.located(_with_steps(error, between)) from None
        return cls(
            source=source,
            path=path,
            placed_light=placed["light"],
            look=chosen,
            changing=(*changing, *others),
            patterns=(*files, *more),
            asked=asked,
            **sections,
        )

    def moment(self, after: float) -> SceneFile:
        """Return it as it is so many frames later, or earlier, while the files of its frame are shown.

        Raises
        ------
        SceneError
            What keyframes are there makes no scene.
        """
        if self.asked is None or not (self.changing or self.turn_a_frame):
            return self
        found = SceneFile.read(*self.asked, after=after)
        if self.turn is None:
            return found
        turn = self.turn + after * self.turn_a_frame
        return replace(found, turn=turn, turn_a_frame=self.turn_a_frame)

    @property
    def is_animated(self) -> bool:
        """Whether it differs from frame to frame."""
        return bool(self.changing) or self.turn is not None

    @property
    def is_empty(self) -> bool:
        """Whether no body is there in this frame, as ``before`` and ``after`` of their files say."""
        return bool(self.patterns) and all(map(_is_nothing, self.volumes))

    @property
    def lost_motion(self) -> str | None:
        """What moves by keyframes, or a turn, while the shutter is open, in a line; None where nothing does.

        A scene of this frame alone would be of things that stand still meanwhile.
        """
        files = {file.key for file in self.patterns}
        moving = [".".join(map(str, key)) for key in self.changing if key not in files]
        moving += ["camera"] if self.turn_a_frame else []
        if not (self.image.is_blurred and moving):
            return None
        shutter = list(self.image.shutter or ())
        return (
            f"image.shutter = {shutter}: {moving[0]} moves meanwhile, which a scene of one frame cannot say"
        )

    @staticmethod
    def _sections(tables: Values, written: dict[str, str], folder: Path, faults: Faults) -> Values:
        """Check all tables, each by itself, and return what they make by the name of the attribute.

        ``written`` is how the file writes names of tables that it misspells.
        """
        makers: dict[str, Callable[[Any], Any]] = {name: cls.from_table for name, cls in SECTIONS.items()}
        makers |= {
            "volume": lambda bodies: _volumes(bodies, tables.get("medium"), folder),
            "medium": lambda medium: Medium.from_table(medium).beside(folder),
            "camera": _camera,
            "light": lambda lights: _lights(lights, folder),
            "solid": lambda solids: _each("solid", solids, lambda table: _solid(table, folder)),
        }
        attributes = {"volume": "volumes", "solid": "solids"}
        made: Values = {"light": None, "solids": ()}
        for name in dict.fromkeys([*tables, *makers]):
            table = tables.get(name, None if name in ARRAYS else {})
            if table is not None:
                with faults.collect("", written.get(name, name)):
                    made[attributes.get(name, name)] = makers[name](table)
        return made

    def make(self, scene_class: Callable[..., S], like: Made | None = None) -> S:
        """Read the volumes, place what the file left out, and make the scene.

        Parameters
        ----------
        scene_class
            `tfm_cl.scene.scene.Scene`, which builds on this module.
        like
            The same at another moment or with other settings, and what it was made: grids that are the same
            are taken from there.

        Raises
        ------
        SceneError, VolumeError
            Impossible camera or light, or a volume that cannot be used.
        """
        if like is None or not like.is_moment:
            self.check_files("volume")
        bodies = self._bodies(like)
        try:
            lights = self.light
            seen = [body for body in bodies if not _is_nothing(body)] or bodies
            camera = placement.camera_for(seen, **looks.framing(self.look.name), **self.camera)
            if lights is None:
                placed = _beside(self.placed_light, "texture", self.path.parent)
                lights = (placement.light_for(seen, camera, **placed),)
            camera = camera.turned(self.turn or 0.0)
            self._check_crop(camera)
            if self.image.shows_environment:
                check_surrounded(lights)
            return scene_class(
                bodies,
                self.medium,
                camera,
                lights,
                self.map,
                self.march,
                solids=self._solids(like),
                ambient=self.ambient,
                shadow=self.shadow,
            )
        except SceneError as error:
            raise self.source.located(error, by_words=True) from None

    def _bodies(self, like: Made | None) -> tuple[Body, ...]:
        same = like is not None and len(like.file.volumes) == len(self.volumes)
        others: Iterable[tuple[BodySettings, Body] | None] = ()
        if like is not None and same:
            others = zip(like.file.volumes, like.bodies, strict=True)
            if not like.is_moment:
                others = map(partial(self._chosen_anew, like.file), self.volumes, others)
        return tuple(map(self._body, self.volumes, chain(others, repeat(None))))

    def _chosen_anew(
        self, file: SceneFile, settings: BodySettings, like: tuple[BodySettings, Body]
    ) -> tuple[BodySettings, Body] | None:
        """Return what a body takes from that of another file: not what other settings had chosen there."""
        other, body = like
        depth = (other.medium or file.medium).typical_depth
        if settings == other and depth == (settings.medium or self.medium).typical_depth:
            return like
        return (other.replace(density_scale=1.0), body) if isinstance(other, VolumeSettings) else None

    def _body(self, settings: BodySettings, like: tuple[BodySettings, Body] | None) -> Body:
        if like is not None and settings == like[0]:
            return like[1]
        return settings.load(self.path.parent, (settings.medium or self.medium).typical_depth, like)

    def _solids(self, like: Made | None) -> tuple[Solid, ...]:
        """Return the solids: those that are the same at another moment have been read there."""
        if like is None or len(like.file.solids) != len(self.solids):
            return self.solids
        pairs = zip(self.solids, like.file.solids, strict=True)
        return tuple(other if solid == other else solid.like(other) for solid, other in pairs)

    def is_file_of_a_frame(self, path: Path) -> bool:
        """Tell whether a file, there or not yet, is one that another frame would read."""
        return any(
            (whole := FilePattern.of(real_path(file.folder / file.pattern.text))) is not None
            and whole.frame_of(real_path(path)) is not None
            for file in self.patterns
        )

    def files(self) -> list[Path]:
        """Return all files that the scene reads, but its own: what it names, and what these name."""
        named = [source_of(name, self.path.parent) for _, name in self._named()]
        return [*named, *(further for path in named for further in named_by(path))]

    def _named(self) -> Iterator[tuple[Key, str]]:
        """Yield the names of all files that the scene reads, and the keys that say them."""
        media: list[tuple[Key, Medium | None]] = [(("medium",), self.medium)]
        for i, volume in enumerate(self.volumes):
            place: Key = ("volume", i) if self.source.has(("volume", i)) else ("volume",)
            yield from ((_key_of(place, volume, name), name) for name in volume.sources())
            media.append(((*place, "medium"), volume.medium))
        for i, light in enumerate(self.light or ()):
            if name := getattr(light, "texture", None):
                yield ("light", i, "texture"), name
        for i, solid in enumerate(self.solids):
            yield from ((_key_of(("solid", i), solid, name), name) for name in solid.files())
        for place, medium in media:
            if medium is not None:
                yield from (((*place, "phase"), name) for name in medium.phase.files())

    def check_files(self, *sections: str) -> None:
        """Refuse files that are not there, all at once, where a scene file says them.

        Parameters
        ----------
        sections
            Those that count, as ``volume``; by default all.

        Raises
        ------
        SceneError
            A line for each.
        """
        faults = Faults()
        for key, name in self._named() if self.source.lines else ():
            if sections and key[0] not in sections:
                continue
            try:
                check_readable(source_of(name, self.path.parent))
            except InputError as error:
                told = ".".join(part for part in key if isinstance(part, str))
                faults.add(Fault(f"{told}: {error}", key))
        try:
            faults.raise_any()
        except SceneError as error:
            raise self.source.located(error) from None

    def _check_crop(self, camera: Camera) -> None:
        width, height = camera.res
        if self.image.crop is not None and (self.image.crop[2] > width or self.image.crop[3] > height):
            crop = list(self.image.crop)
            raise SceneError(f"image.crop = {crop}: does not lie in the image of {width}×{height} pixels")


NUMBERS = ("coeffs", "bytes", "max_error")
"""Keys of the map that each say how many numbers a texel has."""


def _make_way(values: Values, overridden: set[str]) -> None:
    """Drop what a file says of the camera and of the map's numbers where an override says it another way."""
    if isinstance(values.get("camera"), dict):
        said = {key.removeprefix("camera.") for key in overridden if key.startswith("camera.")}
        dropped = outdone_of_camera(said)
        values["camera"] = {key: value for key, value in values["camera"].items() if key not in dropped}
    if isinstance(values.get("map"), dict) and overridden & {f"map.{key}" for key in NUMBERS}:
        values["map"] = {key: value for key, value in values["map"].items() if key not in NUMBERS}


def _values_at(path: Path, given: Values, frame: float | None) -> tuple[Values, Source]:
    """Return the values of a file, or of a frame's where its name is a pattern; ``given``: overrides."""
    pattern = FilePattern.of(path)
    if pattern is None:
        return _values_of(path)
    if frame is None:
        raise SceneError(f"{path}: no such file; as a pattern of files it needs a frame: {SAY_FRAME}")
    said = {key: given[f"volume.{key}"] for key in FrameNumbers.model_fields if f"volume.{key}" in given}
    try:
        numbers = FrameNumbers(**({} if path.suffix.lower() == ".toml" else said))
    except SceneError as error:
        raise SceneError(*(f"volume.{line}" for line in error.args)) from None
    name = name_at(pattern, frame, numbers)
    # Of what is not there, the first file tells what it would be.
    shown = name or pattern.at(next(iter(pattern.frames_in())))
    values, source = _values_of(Path(shown))
    if path.suffix.lower() != ".toml":
        (kind,) = [key for key in BODIES if key in values["volume"]]
        values["volume"][kind] = os.fspath(path.absolute())
    return values, source


def _at_frame(
    values: Values, frame: float | None, moment: float | None, folder: Path
) -> tuple[Values, list[Key], list[frame_files.Changing]]:
    """Return values at a moment of a frame, the keys of those that change, and of these the files.

    Raises
    ------
    SceneError
        Keyframes that are none, a file that is not there, or no frame where something changes.
    """
    faults = Faults()
    now, changing = keyframes.evaluated(values, moment, faults)
    files = frame_files.at_frame(now, frame, folder, faults)
    changing += [file.key for file in files]
    if frame is None:
        faults.add(*map(_needs_frame, changing[:1]))
    faults.raise_any()
    return now, changing, files


def _dress(values: Values, look: str, path: Path, given: Values, frame: float | None) -> None:
    """Fill in what a scene leaves out, as its other values are at a frame."""
    now, _ = keyframes.evaluated(values, frame, Faults())
    frame_files.at_frame(now, frame, path.parent, Faults())
    looks.dress(now, look, path, given)
    values |= {name: section for name, section in now.items() if name not in values}
    if isinstance(values.get("image"), dict):
        values["image"] = now["image"] | values["image"]


def _with_steps(error: SceneError, between: Collection[Key]) -> SceneError:
    """Return the same; of values that lie between keyframes of whole numbers it says how not to.

    ``between``: the keys of such values.
    """
    line = 'it is between two keyframes, which interpolation = "step" keeps apart'
    return SceneError(
        *(
            Fault(f"{fault}; {line}", fault.key)
            if fault.key in between and re.search("whole|integer", fault)
            else fault
            for fault in error.faults
        )
    )


def frames_of(path: Path, overrides: Iterable[tuple[str, Any]] = ()) -> tuple[float, float] | None:
    """Return the first and the last frame that a scene tells of: by keyframes, and by files that are there.

    Parameters
    ----------
    path, overrides
        As of `SceneFile.read`.

    Returns
    -------
    tuple of float, or None
        Where nothing changes from frame to frame, None.

    Raises
    ------
    SceneError
        It is neither a scene nor a volume.
    """
    given, found = dict(overrides), list[float]()
    if (pattern := FilePattern.of(path)) is not None:
        files = pattern.frames_in()
        if not files:
            return None
        kept = {key: given[f"volume.{key}"] for key in FrameNumbers.model_fields if f"volume.{key}" in given}
        found += FrameNumbers(**({} if path.suffix.lower() == ".toml" else kept)).frames(files[0], files[-1])
        path = Path(pattern.at(files[0]))
    values, _ = _values_of(path)
    found += keyframes.frames_told(values) + keyframes.frames_told({"set": given})
    found += frame_files.frames_there(values, path.parent)
    return (min(found), max(found)) if found else None


SAY_FRAME = "--frame 1, or --frames 1-24"
"""How a frame is said."""


def _needs_frame(key: Key) -> Fault:
    return Fault(f"{'.'.join(map(str, key))}: changes from frame to frame; say of which: {SAY_FRAME}", key)


def _change_kinds(values: Values, overrides: Iterable[tuple[str, Any]]) -> None:
    """Drop what a file says of lights that become others and lack such keys, as the cone of a spot."""
    lights = values.get("light")
    for key, kind in overrides:
        found = re.fullmatch(r"light(?:\.(\d+))?\.type", key)
        number = int(found[1] or 0) if found else 0
        if not found or not isinstance(lights, list) or number >= len(lights):
            continue
        table = lights[number]
        before = LIGHTS.get(str(table.get("type", "spot"))) if isinstance(table, dict) else None
        after = LIGHTS.get(str(kind))
        if before is not None and after is not None:
            gone = {*before.keys()} - {*after.keys()}
            lights[number] = {key: value for key, value in table.items() if key not in gone}


def _values_of(path: Path) -> tuple[Values, Source]:
    body = bare_body(path)
    if body is not None:
        automatic = {"map": {"res": "auto", "steps": "auto"}, "march": {"steps": "auto"}}
        return {"volume": body, **automatic}, Source(path)
    if path.suffix.lower() != ".toml":
        known = " ".join(sorted({".toml", *volume_io.FORMATS, *points_io.FORMATS, *curves_io.FORMATS}))
        raise SceneError(f"{path}: neither a scene nor a volume; known extensions: {known}")
    if check_readable(path, SceneError) > MAX_BYTES:
        raise SceneError(f"{path}: larger than {MAX_BYTES:,} bytes: not a scene file")
    try:
        # Editors on Windows put a byte order mark in front.
        text = path.read_bytes().decode("utf-8-sig")
        return tomllib.loads(text), Source(path, TomlLines(text))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({reason_of(error)})") from None
    except (ValueError, RecursionError) as error:  # TOML, UTF-8, and integers of thousands of digits
        reason, where = str(error), str(path)
        if place := re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", reason, re.DOTALL):
            reason, where = f"{place[1]} (column {place[3]})", f"{path}:{place[2]}"
            if reason.startswith(("Cannot overwrite", "Cannot declare")):
                reason += "; it is there already; of several lights each begins with [[light]], not [light]"
        raise SceneError(f"{where}: not TOML: {reason}") from None


def bare_body(path: Path) -> Values | None:
    """Return the table of the body that a file holds, by its extension and, of some, content.

    None where it is no body's.
    """
    suffix = path.suffix.lower()
    if suffix in points_io.FORMATS and suffix in curves_io.FORMATS and suffix != ".npz":
        return {"points" if points_io.holds_points(path) else "curves": path.name}
    if suffix == ".npz":
        names = _arrays_of(path)
        if not names.isdisjoint(COUNTS):
            return {"curves": path.name}
        if not names.isdisjoint(POSITIONS):
            return {"points": path.name}
    if suffix in volume_io.FORMATS:
        return {"file": path.name, "density_scale": "auto"}
    if suffix in points_io.FORMATS:
        return {"points": path.name}
    return {"curves": path.name} if suffix in curves_io.FORMATS else None


def _arrays_of(path: Path) -> set[str]:
    """Return the names in an archive of arrays; of one that cannot be read none: its reader refuses it."""
    try:
        with zipfile.ZipFile(path) as archive:
            return {Path(name).stem.lower() for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile):
        return set()


def _tables(values: Values, faults: Faults) -> tuple[Values, dict[str, str]]:
    """Return the tables that are there, None for those of a wrong form; a misspelt one counts too.

    And names of the misspelt ones -> how they are written.
    """
    known = list(dict.fromkeys([*SECTIONS, *ARRAYS]))
    tables, written = Values(), dict[str, str]()
    for name, table in values.items():
        if name in known:
            form, is_one = _form(name, table)
            tables[name] = table if is_one else None
            if not is_one:
                faults.add(Fault(f"{name} should be {form}", (name,)))
            continue
        faults.add(Fault(unknown_key(name, known, words=WORDS), (name,)))
        meant = meant_by(name, WORDS) or nearest(name, known)
        if meant in known and meant not in values and meant not in tables and _form(meant, table)[1]:
            tables[meant], written[meant] = table, name
    return tables, written


def _form(name: str, table: Any) -> tuple[str, bool]:
    """Say what form a section has, and whether it is that of ``table``."""
    if name in ARRAYS:
        return f"[[{name}]] tables", isinstance(table, list)
    if name == "volume":
        return "a table [volume] or [[volume]] tables", isinstance(table, dict | list)
    return f"a table [{name}]", isinstance(table, dict)


def _order(override: tuple[str, Any]) -> tuple[bool, bool]:
    """Tell what of several overrides comes first."""
    key, _ = override
    return "." in key, not key.endswith(".preset")


def _override(values: Values, placed_light: Values, key: str, value: Any) -> Key:
    """Set a dotted key; what is said of a light that the scene does not have goes to ``placed_light``.

    Return the key as that of a file.
    """
    section, _, rest = key.partition(".")
    place: Key = (section,)
    if key in {*SECTIONS, *ARRAYS} and isinstance(value, dict | list):
        form, is_one = _form(key, value)
        if not is_one:
            raise SceneError(f"{key} should be {form}")
        values[key] = copy.deepcopy(value)
        return place
    if section not in ARRAYS and not isinstance(values.get(section), list):
        table = values.setdefault(section, {})
    else:
        number, dot, after = rest.partition(".")
        index, rest = (int(number), after) if dot and number.isdecimal() else (0, rest)
        place, tables = (section, index), values.get(section)
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
    for name in _said_by(last, value):
        table.pop(name, None)
    table[last] = value
    return (*place, *rest.split("."))


def _said_by(key: str, value: Any) -> list[str]:
    """Return other keys that say what this one says."""
    preset = PRESETS.get(value) if key == "preset" and isinstance(value, str) else None
    other = [pair[key == pair[0]] for pair in SPELLINGS.items() if key in pair]
    return [*other, *(preset.medium if preset else ()), *outdone(key)]


def _check_used(values: Values, key: str) -> None:
    """Refuse to set what every body sets for itself."""
    section, _, name = key.partition(".")
    name = name.partition(".")[0]
    volumes = values.get("volume")
    tables = volumes if isinstance(volumes, list) else [volumes]
    own = [table.get("medium") for table in tables if isinstance(table, dict)]
    if section == "medium" and own and all(isinstance(medium, dict) and name in medium for medium in own):
        number = "0." if isinstance(volumes, list) else ""
        raise SceneError(f"{key}: every volume has a {name} of its own: set volume.{number}medium.{name}")


def _each(name: str, tables: Any, make: Callable[[Values], Any]) -> tuple[Any, ...]:
    """Make what every table of an array says; the faults of all are told, with their numbers."""
    made, faults = [], Faults()
    for i, table in enumerate(tables):
        if table is None:  # not there in this frame
            continue
        with faults.collect(f"{name} {i}", i):
            if not isinstance(table, dict):
                raise SceneError(f"{name} should be a table")
            made.append(make(table))
    faults.raise_any()
    return tuple(made)


def _volumes(tables: Values | list[Any], medium: Values | None, folder: Path) -> tuple[BodySettings, ...]:
    """Make bodies; ``medium``: the scene's table, of which a body's own overrides some keys."""
    if isinstance(tables, dict):
        return (_volume(tables, medium, folder),)
    if not 1 <= len(tables) <= MOST_BODIES:
        raise SceneError(f"a scene has 1 to {MOST_BODIES} [[volume]] tables; got {len(tables)}")
    return _each("volume", tables, lambda table: _volume(table, medium, folder))


def _volume(table: Values, medium: Values | None, folder: Path) -> BodySettings:
    own = table.get("medium")
    if isinstance(own, dict) and medium:
        with contextlib.suppress(SceneError):  # what is wrong with [medium] is told there
            Medium.from_table(medium)
            table = table | {"medium": expanded(medium) | expanded(own)}
    told = [key for key in BODIES if key in table]
    if len(told) > 1:
        raise SceneError(f"volume: {told[0]} and {told[1]} are two kinds of bodies; keep one")
    body = BODIES[told[0] if told else "file"](table)
    return body if body.medium is None else body.replace(medium=body.medium.beside(folder))


def _lights(tables: Any, folder: Path) -> tuple[Light, ...]:
    lights = _each("light", tables, lambda table: _light(table, folder))
    names_of(lights)
    return lights


def _light(table: Values, folder: Path) -> Light:
    if not isinstance(table.get("type", ""), str):
        raise SceneError("light should be a table with a name as its type")
    return parse_light(_beside(table, "texture", folder))


def _solid(table: Values, folder: Path) -> Solid:
    return parse_solid(_beside(_beside(table, "mesh", folder), "albedo", folder))


PLACED: Values = {"from": (1.0, 2.0, 3.0), "to": (0.0, 0.0, 0.0)}
"""Stands in for what is placed once the volume is there."""


def _camera(table: Values) -> Values:
    """Return the keys that are given, each checked."""
    placed = {} if "matrix" in table else PLACED
    _without_place("camera", table, lambda: Camera.from_table(placed | table))
    return table


def _is_nothing(body: Body | BodySettings) -> bool:
    """Tell whether a body stands for one that is not there in this frame."""
    return isinstance(body, Homogeneous) and body.density == 0


def _check_placed(table: Values, folder: Path) -> None:
    """Check what is given of a light that is to be placed."""
    kind = LIGHTS.get(str(table.get("type", "spot")))
    placed = {key: value for key, value in PLACED.items() if kind is None or key in kind.keys()}  # noqa: SIM118 - no dict
    _without_place("light", table, lambda: _light(placed | table, folder))


def _without_place(section: str, table: Values, make: Callable[[], Any]) -> None:
    """Raise what is wrong with the keys of a table, but for how a place that stands in goes with them."""
    try:
        make()
    except SceneError as error:
        complete = all(key in table for key in PLACED)
        faults = [fault for fault in error.args if complete or not fault.startswith(f"{section}: ")]
        if faults:
            raise SceneError(*faults) from None


def _beside(table: Values, key: str, folder: Path) -> Values:
    """Make a file's name, relative to the scene file, absolute."""
    name = table.get(key)
    if not isinstance(name, str) or not name:
        return table
    try:
        return table | {key: str(real_path(source_of(name, folder)))}
    except InputError:
        return table  # whose own check says what is wrong with the name
