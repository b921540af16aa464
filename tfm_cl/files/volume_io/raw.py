"""Headerless voxels (``.raw``), described by a JSON file beside them.

The description of ``NAME.raw`` is ``NAME.raw.json``, else ``NAME.json``::

    {"shape": [64, 128, 256],     // [z, y, x]
     "dtype": "uint8",            // bool int8 … uint64 float16 float32 float64
     "byte_order": "little",      // or "big"
     "order": "C",                // x varies fastest; "F": z varies fastest
     "offset": 0,                 // bytes before the first voxel
     "voxel_size": 0.1,           // world units, one number or [x, y, z]
     "origin": [0, 0, 0],         // world position of the low corner of voxel 0, 0, 0
     "name": "density"}

Only ``shape`` and ``dtype`` are required. (JSON has no comments: leave them out.) The file must have exactly
the size that follows from the description.
"""

import difflib
import json
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.paths import is_file
from tfm_cl.files.volume_io.decoding import read_voxels
from tfm_cl.files.volume_io.grid import Grid, world_from_index_of

EXTENSIONS = (".raw",)

_KEYS = ("shape", "dtype", "byte_order", "order", "offset", "voxel_size", "origin", "name")
_DTYPES = (
    *("bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"),
    *("float16", "float32", "float64"),
)
_MAX_SIDECAR_BYTES = 1 << 20
_LARGEST = 2**63  # limit of every number in a description


def open_grids(path: Path) -> list[Grid]:
    """Describe the one grid of a ``.raw`` file.

    Raises
    ------
    VolumeError
        The description is missing, invalid, or does not match the size of the file.
    """
    sidecar, keys = _read_sidecar(path)
    shape = _shape(keys.get("shape"), sidecar)
    order: Literal["C", "F"] = _choice(keys.get("order", "C"), ("C", "F"), "order", sidecar)
    byte_order = _choice(keys.get("byte_order", "little"), ("little", "big"), "byte_order", sidecar)
    dtype = np.dtype(_choice(keys.get("dtype"), _DTYPES, "dtype", sidecar))
    dtype = dtype.newbyteorder("<" if byte_order == "little" else ">")
    offset = _whole_number(keys.get("offset", 0), "offset", sidecar)
    name = keys.get("name", "density")
    if not isinstance(name, str):
        raise VolumeError(f"{sidecar}: name is a string; got {name!r}")
    size, expected = path.stat().st_size, offset + math.prod(shape) * dtype.itemsize
    if size != expected:
        raise VolumeError(
            f"{path}: holds {size:,} bytes where {sidecar.name} tells {expected:,} "
            f"(offset {offset} + shape {list(shape)} of {dtype.name}); correct the description"
        )

    def read() -> NDArray[np.float32]:
        with path.open("rb") as stream:
            stream.seek(offset)
            return read_voxels(stream, dtype, shape, path, order=order)

    return [
        Grid(
            name=name,
            grid_class="unknown",
            value_type=dtype.name,
            shape=shape,
            world_from_index=world_from_index_of(
                _vector(keys.get("voxel_size", 1.0), "voxel_size", sidecar),
                _vector(keys.get("origin", [0, 0, 0]), "origin", sidecar),
            ),
            has_transform="voxel_size" in keys or "origin" in keys,
            read=read,
        )
    ]


def _read_sidecar(path: Path) -> tuple[Path, dict[str, Any]]:
    candidates = (path.with_name(path.name + ".json"), path.with_suffix(".json"))
    sidecar = next((candidate for candidate in candidates if is_file(candidate)), None)
    if sidecar is None:
        raise VolumeError(
            f"{path}: raw voxels need a description; write {candidates[0].name} beside it, for instance "
            '{"shape": [z, y, x], "dtype": "uint8"}'
        )
    if sidecar.stat().st_size > _MAX_SIDECAR_BYTES:
        raise VolumeError(f"{sidecar}: too large for the description of a raw file (at most 1 MiB)")
    try:
        keys = json.loads(sidecar.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise VolumeError(f"{sidecar}: not valid JSON ({error})") from error
    if not isinstance(keys, dict):
        raise VolumeError(f'{sidecar}: must be a JSON object, {{"shape": [z, y, x], "dtype": …}}')
    for key in keys:
        if key not in _KEYS:
            near = difflib.get_close_matches(key, _KEYS, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(_KEYS)}"
            raise VolumeError(f"{sidecar}: unknown key {key!r}; {hint}")
    return sidecar, keys


def _shape(value: object, sidecar: Path) -> tuple[int, int, int]:
    match value:
        case [int(z), int(y), int(x)] if min(z, y, x) > 0 and max(z, y, x) < _LARGEST:
            return z, y, x
    raise VolumeError(f"{sidecar}: shape is [z, y, x], three whole numbers > 0; got {_shown(value)}")


def _whole_number(value: object, key: str, sidecar: Path) -> int:
    if isinstance(value, int) and 0 <= value < _LARGEST:
        return value
    raise VolumeError(f"{sidecar}: {key} is a whole number ≥ 0; got {_shown(value)}")


def _choice(value: object, choices: tuple[Any, ...], key: str, sidecar: Path) -> Any:
    if value in choices:
        return value
    near = difflib.get_close_matches(str(value), choices, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise VolumeError(f"{sidecar}: {key} is one of {' '.join(choices)}; got {_shown(value)}{hint}")


def _vector(value: object, key: str, sidecar: Path) -> tuple[float, float, float]:
    numbers = [value] * 3 if key == "voxel_size" and not isinstance(value, list) else value
    match numbers:
        case [int() | float() as x, int() | float() as y, int() | float() as z] if max(
            abs(x), abs(y), abs(z)
        ) < _LARGEST and (key != "voxel_size" or min(x, y, z) > 0):
            return float(x), float(y), float(z)
    expected = "one number or [x, y, z], > 0" if key == "voxel_size" else "[x, y, z]"
    raise VolumeError(f"{sidecar}: {key} is {expected}; got {_shown(value)}")


def _shown(value: object) -> str:
    text = "nothing" if value is None else json.dumps(value)
    return text if len(text) <= 80 else text[:80] + "…"  # noqa: PLR2004 - a line of a terminal
