"""Images as NumPy arrays: float32 [H, W, 4], scene-linear, premultiplied."""

from pathlib import Path

import numpy as np

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import MAX_PIXELS, WriteOptions
from tfm_cl.files.image_io.image import Image, Picture
from tfm_cl.files.volume_io.numpy_array import read_header

HOLDS_LAYERS = False


def write(path: Path, image: Image, _options: WriteOptions) -> None:
    """Write the colours."""
    rgba = np.ascontiguousarray(image.rgba, dtype="<f4")
    with path.open("wb") as stream:
        np.lib.format.write_array_header_1_0(stream, np.lib.format.header_data_from_array_1_0(rgba))
        stream.write(rgba.data)  # what `numpy.save` raises does not say that there is no room


def read(path: Path) -> Picture:
    """Read an array [H, W, 3 or 4] of real numbers of any type.

    Raises
    ------
    ImageError
        The array is of another kind, holds pickled objects (never loaded), or the file is truncated.
    """
    with path.open("rb") as stream:
        try:
            header = read_header(stream)
        except ValueError as error:
            reason = " ".join(str(error).split())[:120]
            raise ImageError(f"{path}: not a readable NumPy array ({reason})") from error
        height, width, channels = header.shape if len(header.shape) == 3 else (0, 0, 0)  # noqa: PLR2004
        if header.dtype.kind not in "fiub" or channels not in {3, 4} or height * width == 0:
            raise ImageError(
                f"{path}: an image is an array [height, width, 3 or 4] of numbers; this one is "
                f"{header.dtype.name} {header.shape}"
            )
        if height * width > MAX_PIXELS:
            raise ImageError(f"{path}: {width}×{height} pixels; the limit is {MAX_PIXELS:,}")
        if header.header_bytes + header.data_bytes > path.stat().st_size:
            raise ImageError(f"{path}: declares {header.shape} but is cut short")
        values = np.frombuffer(stream.read(header.data_bytes), header.dtype)
    with np.errstate(over="ignore", invalid="ignore"):
        image = values.reshape(header.shape, order=header.order).astype(np.float32)
    return Picture(np.ascontiguousarray(image))
