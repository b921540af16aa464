"""Deep OpenEXR, ``.deep.exr``: the samples along each pixel's ray, of a deep scanline part.

Channels ``A``, ``Z`` and ``ZBack``, and ``R G B`` where there are colours; all float, as `DeepSamples` has
them.
ZIPS compression, the one of deep images that most programs read.
"""

import io
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import WriteOptions
from tfm_cl.files.image_io.exr_header import header_of, line_of
from tfm_cl.files.image_io.image import Image, Picture

HOLDS_LAYERS = False
MEANING = {
    "tfm_cl:depth": "Z and ZBack: distance along the camera's viewing direction, world units",
    "tfm_cl:samples": "in order, without overlap; constant extinction from Z to ZBack",
}
"""Attributes that say what the channels mean."""


def write(path: Path, image: Image, _options: WriteOptions) -> None:
    """Write the samples and the metadata."""
    deep = image.deep
    if deep is None:
        raise ImageError("has no deep samples to write; render with deep = TOLERANCE")
    header = header_of(image, OpenEXR.deepscanline, OpenEXR.ZIPS_COMPRESSION) | MEANING
    channels = {"A": deep.alpha, "Z": deep.z, "ZBack": deep.z_back}
    if deep.rgb is not None:
        channels |= {name: np.ascontiguousarray(deep.rgb[:, i]) for i, name in enumerate("RGB")}
    ends, shape = deep.ends, deep.counts.shape
    starts = ends - deep.counts.ravel()
    pixels = {name: _by_pixel(values, starts, ends, shape) for name, values in channels.items()}
    # Not to the file itself: OpenEXR does not report every failure on a full disk.
    stream = io.BytesIO()
    try:
        OpenEXR.File(header, pixels).write(stream)
    except (RuntimeError, ValueError, TypeError) as error:
        raise ImageError(f"OpenEXR cannot write it ({line_of(error)})") from error
    path.write_bytes(stream.getbuffer())


def read(path: Path) -> Picture:
    """Refuse to: a deep image has no picture.

    Raises
    ------
    ImageError
        Always.
    """
    raise ImageError(f"{path}: is a deep image, without one value for a pixel; flatten it first")


def _by_pixel(
    values: NDArray[np.float32], starts: NDArray[np.int64], ends: NDArray[np.int64], shape: tuple[int, ...]
) -> NDArray[np.object_]:
    """Return each pixel's samples as OpenEXR takes them."""
    pixels = np.empty(len(ends), object)
    none = values[:0]  # one for all that have none
    pixels[:] = [
        values[first:end] if first < end else none
        for first, end in zip(starts.tolist(), ends.tolist(), strict=True)
    ]
    return pixels.reshape(shape)
