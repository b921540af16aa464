"""Files of a scene's values at a frame: names that are patterns become names of files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from tfm_cl.errors import Fault, Faults, InputError, Key, SceneError
from tfm_cl.files.paths import source_of
from tfm_cl.files.patterns import FilePattern
from tfm_cl.files.volume_io import is_volume_file
from tfm_cl.scene.bodies.base import BODIES
from tfm_cl.scene.frame_numbers import KEYS, FrameNumbers, name_at
from tfm_cl.scene.solids.base import MESHES

Values = dict[str, Any]

NOTHING: Values = {"shape": "box", "density": 0.0}
"""Body in the place of one that is not there yet, or any more: numbers of the others stay."""


BESIDE = ("colour", "velocity")
"""Keys of what is read beside a volume, of a file of its own or of the volume's."""


class Changing(NamedTuple):
    """A file of each frame."""

    key: Key
    pattern: FilePattern
    folder: Path


def at_frame(values: Values, frame: float | None, folder: Path, faults: Faults) -> list[Changing]:
    """Put the names of a frame's files into values, which are changed, and return all that change.

    What is wrong goes to ``faults``. Without a frame the values stay as they are.
    """
    found = list(_changing(values, folder))
    if frame is not None:
        for place in dict.fromkeys(changing.key[:-1] for changing in found):
            of_table = [changing for changing in found if changing.key[:-1] == place]
            _settle(values, place, of_table, frame, faults)
    return found


def frames_there(values: Values, folder: Path) -> list[int]:
    """Return the first and last frames that files of each pattern are there for."""
    found = list[int]()
    for key, pattern, _ in _changing(values, folder):
        table: Any = values
        for part in key[:-1]:
            table = table[part]
        try:
            numbers = FrameNumbers(**{name: table[name] for name in KEYS if name in table})
        except SceneError:
            continue  # said when a frame is read
        if files := pattern.frames_in(folder):
            found += numbers.frames(files[0], files[-1])
    return found


def _changing(values: Values, folder: Path) -> Iterator[Changing]:
    names = {
        "volume": [*(key for key in BODIES if key != "shape"), *BESIDE],
        "solid": [*MESHES, "albedo"],
        "light": ["texture"],
    }
    for section, keys in names.items():
        tables = values.get(section)
        numbered = enumerate(tables) if isinstance(tables, list) else [(None, tables)]
        for number, table in numbered:
            named = table if isinstance(table, dict) else {}
            for key in keys:
                pattern = _pattern(key, named.get(key), folder)
                if pattern is not None:
                    yield Changing((section, *(() if number is None else (number,)), key), pattern, folder)
    yield from _phases(values, folder)


def _phases(values: Values, folder: Path) -> Iterator[Changing]:
    """Yield files of phase functions: of a table with a file, or of text, ``NAME:FILE``."""
    volumes = values.get("volume")
    numbered = enumerate(volumes) if isinstance(volumes, list) else [(None, volumes)]
    media: list[tuple[Key, Any]] = [(("medium",), values.get("medium"))]
    for number, table in numbered:
        if isinstance(table, dict):
            place: Key = ("volume",) if number is None else ("volume", number)
            media.append(((*place, "medium"), table.get("medium")))
    for place, medium in media:
        phase = medium.get("phase") if isinstance(medium, dict) else None
        key: Key = (*place, "phase")
        named: Any = phase.partition(":")[2] if isinstance(phase, str) else None
        if isinstance(phase, dict):
            key, named = (*key, "file"), phase.get("file")
        pattern = _pattern("phase", named, folder) if named else None
        if pattern is not None:
            yield Changing(key, pattern, folder)


def _pattern(key: str, name: Any, folder: Path) -> FilePattern | None:
    if not isinstance(name, str) or (key in BESIDE and not is_volume_file(name)):
        return None
    try:
        return FilePattern.of(str(source_of(name)), folder)
    except InputError:
        return None  # whose own check says what is wrong with the name


def _settle(values: Values, place: Key, changing: list[Changing], frame: float, faults: Faults) -> None:
    """Put the names of a frame's files into the table at a place."""
    holder: Any = values
    for part in place[:-1]:
        if isinstance(holder, dict) and part not in holder:
            return  # of a body that is not there
        holder = holder[part]
    last = place[-1]
    table = holder[last]
    try:
        numbers = FrameNumbers(**{key: table[key] for key in KEYS if key in table})
    except SceneError:
        return  # the table's own check says what is wrong with the numbers
    table = {key: value for key, value in table.items() if key not in KEYS}
    for key, pattern, folder in changing:
        try:
            name = name_at(pattern, frame, numbers, folder)
        except SceneError as error:
            faults.add(*(Fault(f"{'.'.join(map(str, key))}: {line}", key) for line in error.args))
            continue
        if name is None and (place[0] == "light" or key[-1] in {"albedo", *BESIDE} or "phase" in key):
            line = '"empty" is for volumes and meshes; other files are held, or missing is an error'
            faults.add(Fault(f"{'.'.join(map(str, key))}: {line}", key))
        elif name is None:
            table = dict(NOTHING) if place[0] == "volume" else None
            break
        elif key[-1] == "phase":
            table["phase"] = f"{table['phase'].partition(':')[0]}:{name}"
        else:
            table[str(key[-1])] = name
    holder[last] = table
