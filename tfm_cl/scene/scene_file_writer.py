"""From a scene to the text of a scene file: what it says, how short, and where its files are from there."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomlkit

from tfm_cl.errors import SceneError
from tfm_cl.files.paths import real_path, source_of
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.bodies.base import BODIES, Body
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.lights.base import parse_light
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.phases.base import parse_phase
from tfm_cl.scene.presets import expanded
from tfm_cl.scene.settings import ImageSettings, MapSettings, MarchSettings, ShadowSettings
from tfm_cl.scene.solids.base import parse_solid

if TYPE_CHECKING:
    from tfm_cl.model import Model
    from tfm_cl.scene.lights.base import Light
    from tfm_cl.scene.solids.base import Solid

Values = dict[str, Any]
"""A scene as TOML gives it: nested tables."""

PLAIN: tuple[type[Model], ...] = (
    Medium,
    Camera,
    Ambient,
    ShadowSettings,
    MapSettings,
    MarchSettings,
    ImageSettings,
)
"""Sections that are one table of one class."""
KINDS = frozenset({"type", "shape"})
"""Keys that tell what a table is, and stay in it."""
KEPT = {
    "volume": frozenset({"shape", "density_scale"}),
    "map": frozenset({"res", "steps"}),
    "march": frozenset({"steps"}),
}
"""Keys that stay though they are at their default: without them others are warned of, or chosen otherwise."""


def scene_table(
    bodies: Sequence[Body],
    medium: Medium,
    lights: Iterable[Light],
    solids: Iterable[Solid],
    *sections: Model,
    beside: Mapping[int, Path] | None = None,
) -> Values:
    """Return what the parts of a scene say, in the shape of a scene file; files by whole names.

    Parameters
    ----------
    sections
        The camera and all others that are one table.
    beside
        Files, which may not be there yet, of bodies that are arrays, by their number from 0.

    Raises
    ------
    SceneError
        A body or a mesh that no file has.
    """
    beside, said = beside or {}, {section.SECTION: section.to_dict() for section in sections}
    volumes = [_of_body(bodies, number, beside.get(number), medium) for number in range(len(bodies))]
    return {
        "volume": volumes[0] if len(volumes) == 1 else volumes,
        "medium": _of_medium(medium),
        "camera": said.pop("camera"),
        "light": [
            _with_files(light.to_dict(), filter(None, [getattr(light, "texture", None)])) for light in lights
        ],
        "solid": [_with_files(solid.to_dict(), solid.files()) for solid in solids],
        **said,
    }


def _of_body(bodies: Sequence[Body], number: int, file: Path | None, medium: Medium) -> Values:
    body = bodies[number]
    table = body.to_table()
    if file is not None and (arrays := body.to_arrays()) is not None:
        table = {arrays[0]: str(real_path(file)), **arrays[1]}
    if table is None:
        which = f"volume.{number}" if len(bodies) > 1 else "volume"
        raise SceneError(
            f"{which}: {body.label} is of arrays, or has been changed since its file was read, and no scene "
            "file holds it; write it to a file, and load that"
        )
    return table | {"medium": _own(body.own_medium, medium.to_dict())}


def _own(medium: Medium | None, base: Values) -> Values | None:
    """Write a body's own medium, which has nothing of the scene's: empty is what it lacks of that."""
    if medium is None:
        return None
    table = _of_medium(medium)
    lacking = [key for key, value in table.items() if value is None and base.get(key) is not None]
    return table | dict.fromkeys(lacking, "")


def _of_medium(medium: Medium) -> Values:
    return _with_files(medium.to_dict(), medium.phase.files())


def _with_files(table: Values, names: Iterable[str]) -> Values:
    """Write the whole names of files instead of these."""
    whole = {name: str(real_path(source_of(name))) for name in names}
    return _mapped(table, lambda text: whole.get(text, text))


def relative_to(values: Values, folder: Path) -> Values:
    """Write files relative to the folder that a scene file is in, where they have one in common.

    Links are followed, as the scene file itself may be one.
    """
    here = os.path.realpath(folder)

    def shortened(text: str) -> str:
        if not Path(text).is_absolute() or not (Path(text).exists() or Path(text).parent == Path(here)):
            return text
        try:
            common = Path(os.path.commonpath([here, text]))
        except ValueError:  # on another drive
            return text
        return text if common == Path(common.anchor) else Path(os.path.relpath(text, here)).as_posix()

    return _mapped(values, shortened)


def _mapped(table: Values, change: Callable[[str], str]) -> Values:
    """Return the same with every text changed."""
    return {key: _changed(item, change) for key, item in table.items()}


def _changed(value: Any, change: Callable[[str], str]) -> Any:
    if isinstance(value, dict):
        return _mapped(value, change)
    if isinstance(value, list):
        return [_changed(item, change) for item in value]
    return change(value) if isinstance(value, str) else value


def without_defaults(values: Values) -> Values:
    """Leave out what says no more than a default does; what is left reads as all of it."""
    values = _without_none(values)
    short: Values = {cls.SECTION: _short_section(cls, values.get(cls.SECTION, {})) for cls in PLAIN}
    short["medium"] = _short_medium(values.get("medium", {}), {})
    short["light"] = [
        _shortest(light, lambda table: parse_light(table).to_dict(), KINDS) for light in values["light"]
    ]
    short["solid"] = [
        _shortest(solid, lambda table: parse_solid(table).to_dict(), KINDS) for solid in values["solid"]
    ]
    bodies = values["volume"]
    medium = values.get("medium", {})
    short["volume"] = (
        _short_body(bodies, medium)
        if isinstance(bodies, dict)
        else [_short_body(body, medium) for body in bodies]
    )
    return {name: short[name] for name in values if short[name] or name == "light"}


def _short_section(cls: type[Model], table: Values) -> Values:
    return _shortest(table, lambda given: cls.from_table(given).to_dict(), KEPT.get(cls.SECTION, KINDS))


def _short_medium(table: Values, base: Values) -> Values:
    """Shorten the table of a medium that overrides another's keys, those of ``base``."""

    def told(given: Values) -> Values:
        return Medium.from_table(expanded(base) | expanded(given)).to_dict()

    short = _shortest(table, told, frozenset())
    if isinstance(short.get("phase"), dict):
        short["phase"] = _shortest(short["phase"], lambda given: parse_phase(given).to_dict(), KINDS)
    return short


def _short_body(table: Values, medium: Values) -> Values:
    own = table.get("medium")
    kind = next(key for key in BODIES if key in table)
    rest = {key: value for key, value in table.items() if key != "medium"}

    def told(given: Values) -> Any:
        settings: Any = BODIES[kind](given)
        return settings.to_dict()

    short = _shortest(rest, told, KEPT["volume"] | {kind})
    return short if own is None else short | {"medium": _short_medium(own, medium)}


def _shortest(table: Values, told: Callable[[Values], Any], kept: frozenset[str]) -> Values:
    """Leave out each key without which a table tells the same."""
    whole = told(table)
    for key in [key for key in table if key not in kept]:
        shorter = {name: value for name, value in table.items() if name != key}
        try:
            is_same = told(shorter) == whole
        except (SceneError, ValueError):
            is_same = False
        table = shorter if is_same else table
    return table


def to_toml(values: Values) -> str:
    """Write resolved options as TOML, arrays on a line each; what is None is left out."""
    values = _without_none(values)
    are_tables = {name: isinstance(value, dict) or _is_of_tables(value) for name, value in values.items()}
    # What is no table comes first: it would belong to the table before it.
    parts = [tomlkit.dumps({name: _item(values[name])}) for name, is_one in are_tables.items() if not is_one]
    for name, is_one in are_tables.items():
        if is_one:
            tables, marks = (
                ([values[name]], "[{}]") if isinstance(values[name], dict) else (values[name], "[[{}]]")
            )
            parts += (marks.format(name) + "\n" + _lines(table) for table in tables)
    return "\n".join(parts)


def _is_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)


def _lines(table: Values) -> str:
    return tomlkit.dumps({key: _item(value) for key, value in table.items()})


def _item(value: Any) -> Any:
    """Return a value that is written on one line, tables within braces."""
    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update({key: _item(item) for key, item in value.items()})
        return inline
    if isinstance(value, list | tuple):
        array = tomlkit.array()
        for item in value:
            array.append(_item(item))
        return array
    return value


def scene_text(values: Values, folder: Path | None = None, *, every_key: bool = True) -> str:
    """Write resolved options as a scene file.

    Parameters
    ----------
    folder
        That the scene file will be in: names of files are relative to it. None: they are whole.
    every_key
        Also those at their default.

    Raises
    ------
    SceneError
        Where a file's name is not UTF-8, as all of TOML is.
    """
    values = values if every_key else without_defaults(values)
    text = to_toml(values if folder is None else relative_to(values, folder))
    try:
        text.encode()
    except UnicodeEncodeError as error:
        line = text[text.rfind("\n", 0, error.start) + 1 :].partition("\n")[0]
        raise SceneError(f"{line}: a name that is not UTF-8 cannot be in a scene file; rename it") from None
    return text


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        return [_without_none(item) for item in value]
    return value
