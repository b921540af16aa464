"""Textures of lights: reads, checks, downsamples and caches them."""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainValidator

from tfm_cl.errors import ImageError, SceneError
from tfm_cl.files.image_io import load_image
from tfm_cl.files.paths import name_of, reason_of, source_of
from tfm_cl.limits import LARGEST_COLOUR
from tfm_cl.model_fields import TEXT, Accepts, accepts

TEXTURE_RES = 2048
"""Largest number of texels along each side; larger images are downsampled to it."""
PANORAMA_RES = 8192
"""The same of an image of surroundings that the camera sees."""
KEPT = 4
"""Images kept for the next render (50 MiB each at most), besides those that a scene holds."""


@accepts(TEXT)
def _name(value: Any) -> str:
    return "" if value == "" else name_of(value, "an image file")


ImagePath = Accepts[str | Path, Annotated[str, PlainValidator(_name)]]
"""Path of an image file; empty if there is none."""


def texture_for(path: str, intensity: tuple[float, float, float]) -> NDArray[np.float32] | None:
    """Return the texture of a light with some intensity, or None without a path.

    Returns
    -------
    ndarray or None
        Scene-linear [height, width, RGB], read-only, at most `TEXTURE_RES` per side. A PNG is decoded from
        sRGB. If the image has alpha, the premultiplied colours are used: transparent parts are dark.

    Raises
    ------
    SceneError
        As `read`, or if texture times intensity is brighter than a light may be.
    """
    if not path:
        return None
    image = _image(path, stamp(path))
    check_brightness(path, float(image.max()), intensity)
    return image


def panorama_for(path: str) -> NDArray[np.float32]:
    """Return an image [height, width, RGB] of surroundings, read-only, at most `PANORAMA_RES` per side.

    Raises
    ------
    SceneError
        As `read`.
    """
    return _panorama(path, stamp(path))


def read(path: str) -> NDArray[np.float32]:
    """Read an image [height, width, RGB] of finite values ≥ 0.

    Raises
    ------
    SceneError
        The file does not exist, is not an image or has other values; one line that names the key and the
        file.
    """
    try:
        image = load_image(path)[..., :3]
    except ImageError as error:
        raise SceneError(f"light.texture: {error}") from None
    wrong = ~(image >= 0) | np.isinf(image)
    if wrong.any():
        y, x, channel = np.argwhere(wrong)[0]
        raise SceneError(
            f"light.texture: {path}: should hold finite numbers ≥ 0; x={x}, y={y} is {image[y, x, channel]:g}"
        )
    return image


def stamp(path: str) -> tuple[int, int]:
    """Return a value that changes with the file; raises `SceneError` if it does not exist."""
    try:
        status = source_of(path, error=SceneError).stat()
    except OSError as error:
        raise SceneError(f"light.texture = {path!r}: cannot be read ({reason_of(error)})") from None
    return status.st_mtime_ns, status.st_size


def check_brightness(path: str, brightest: float, intensity: tuple[float, float, float]) -> None:
    """Raise `SceneError` if intensity times ``brightest`` exceeds the limit of a light."""
    if brightest * max(intensity) > LARGEST_COLOUR:
        raise SceneError(
            f"light.texture: {path}: {brightest:g} times the intensity {max(intensity):g} should be at most "
            f"{LARGEST_COLOUR:g}"
        )


def reduced(image: NDArray[np.float32], most: int = TEXTURE_RES) -> NDArray[np.float32]:
    """Average an image over areas, so that no side exceeds ``most`` texels; its mean is preserved."""
    for axis in (0, 1):
        if image.shape[axis] > most:
            image = np.moveaxis(_reduced_rows(np.moveaxis(image, axis, 0), most), 0, axis)
    return image


def _reduced_rows(image: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Reduce the rows: each is the mean of those it covers, the first and last weighted partially."""
    rows = np.empty((count, *image.shape[1:]), np.float32)
    size = len(image) / count
    for row in range(count):
        begin, end = row * size, min((row + 1) * size, len(image))
        first, last = math.floor(begin), math.ceil(end)
        weights = np.minimum(np.arange(first, last) + 1, end) - np.maximum(np.arange(first, last), begin)
        rows[row] = np.tensordot(weights / weights.sum(), image[first:last], axes=1)
    return rows


@dataclass(frozen=True, eq=False)
class Held:
    """An image that stays for as long as somebody holds it."""

    image: NDArray[np.float32] | None


_held: WeakValueDictionary[tuple[str, tuple[int, int]], NDArray[np.float32]] = WeakValueDictionary()


def _image(path: str, stamp: tuple[int, int]) -> NDArray[np.float32]:
    """Return an image that somebody holds, one of the last few, or read it."""
    image = _held.get((path, stamp))
    if image is None:
        image = _held[path, stamp] = _kept(path, stamp)
    return image


@lru_cache(maxsize=KEPT)
def _kept(path: str, _stamp: tuple[int, int]) -> NDArray[np.float32]:
    return _read_only(reduced(read(path)))


@lru_cache(maxsize=1)
def _panorama(path: str, _stamp: tuple[int, int]) -> NDArray[np.float32]:
    return _read_only(reduced(read(path), PANORAMA_RES))


def _read_only(image: NDArray[np.float32]) -> NDArray[np.float32]:
    image = np.array(image, dtype=np.float32, order="C")
    image.flags.writeable = False
    return image
