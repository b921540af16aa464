"""Files of transmittance function maps: an ``.npz`` archive of arrays, one of which says what they are.

The text is JSON in UTF-8, the array ``about`` of bytes; it names the format and its version. Nothing is
pickled, and no array is read before its shape and type are those that the text asks for.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tfm_cl.errors import InputError, SceneError
from tfm_cl.files.paths import check_readable, path_of, replacing, source_of
from tfm_cl.files.volume_io.numpy_array import StoredArray, open_arrays

FORMAT = "tfm_cl transmittance map"
VERSION = 1
"""Raised when older programs would misread a file."""
ABOUT = "about"
MOST_TEXT = 1 << 20
"""Bytes of the text."""
SUFFIX = ".npz"


class MapFile(NamedTuple):
    """An opened file."""

    path: Path
    about: dict[str, Any]
    """The text."""
    arrays: dict[str, StoredArray]

    def fault(self, what: str) -> SceneError:
        """Return the error of a file that is not as it should be."""
        return SceneError(f"{self.path}: damaged map ({what}); save it again")

    def get(self, key: str, kind: type | tuple[type, ...]) -> Any:
        """Return what the text says of a key; raises `SceneError` where it is missing or of another kind."""
        value = self.about.get(key)
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise self.fault(f"it says nothing valid of '{key}'")
        return value

    def number(self, key: str, least: float = 0.0) -> float:
        """Return a finite number."""
        value = float(self.get(key, (int, float)))
        if not least <= value <= np.finfo(np.float32).max:
            raise self.fault(f"{key} = {value:g} is no number from {least:g}")
        return value

    def take(
        self, name: str, shape: tuple[int, ...], dtype: DTypeLike, *, finite: bool = True
    ) -> NDArray[Any]:
        """Read an array, which must have this shape and type."""
        stored, dtype = self.arrays.get(name), np.dtype(dtype)
        if stored is None:
            raise self.fault(f"the array '{name}' is missing")
        if stored.header.shape != shape or stored.header.dtype != dtype:
            found = f"{stored.header.dtype.name} {list(stored.header.shape)[:8]}"
            raise self.fault(f"the array '{name}' is {found}, not {dtype.name} {list(shape)}")
        if stored.header.data_bytes > self.path.stat().st_size:
            raise self.fault(f"the array '{name}' is compressed, as no saved map is")
        array = stored.read()
        if finite and dtype.kind == "f" and not np.isfinite(array).all():
            raise self.fault(f"the array '{name}' holds numbers that are not finite")
        return array

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an array."""
        if name not in self.arrays:
            raise self.fault(f"the array '{name}' is missing")
        return self.arrays[name].header.shape


def write(name: str | Path, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a file, whole or not at all.

    Raises
    ------
    InputError
        Not an ``.npz``, or it cannot be written.
    """
    path = path_of(name)
    if path.suffix.lower() != SUFFIX:
        raise InputError(f"{path}: a map is saved as {SUFFIX}, not '{path.suffix}'")
    text = json.dumps({"format": FORMAT, "version": VERSION, **about}, allow_nan=False)
    with replacing(path) as temporary, temporary.open("wb") as stream:
        written: dict[str, Any] = {ABOUT: np.frombuffer(text.encode(), np.uint8), **arrays}
        np.savez(stream, **written)


def read(name: str | Path) -> MapFile:
    """Open a file and read its text.

    Raises
    ------
    InputError
        Missing, damaged, no map, or one of a newer version.
    """
    path = source_of(name)
    check_readable(path)
    if path.suffix.lower() != SUFFIX:
        raise SceneError(f"{path}: not a saved map, which is an {SUFFIX} by TransmittanceMap.save")
    file = MapFile(path, {}, open_arrays(path))
    text = file.arrays.get(ABOUT)
    if text is None or text.header.dtype != np.uint8:
        raise SceneError(f"{path}: is an archive, but of no map: TransmittanceMap.save writes those")
    try:
        about = json.loads(text.read_up_to(MOST_TEXT).tobytes())
    except (ValueError, RecursionError) as error:
        raise file.fault("its text is no JSON") from error
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        raise SceneError(f"{path}: is an archive, but of no map: TransmittanceMap.save writes those")
    if about.get("version") != VERSION:
        raise SceneError(
            f"{path}: a map of version {about.get('version')!r}, of which this program knows {VERSION} only; "
            "build and save it again"
        )
    return file._replace(about=about)
