"""Pictures whose four channels are no colours but numbers: written as they are, without sRGB or dither."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import WriteOptions, exr
from tfm_cl.files.image_io.image import Image
from tfm_cl.files.image_io.png import file_of

Bits = Literal[8, 16]


def write_channels(path: Path, channels: NDArray[np.float32], bits: Bits = 8, *, extension: str) -> None:
    """Write numbers [H, W, 4] to an empty file.

    Parameters
    ----------
    path
        The file.
    channels
        From 0 to 1, but in an EXR; what is beyond is clipped.
    bits
        Of a PNG's channel.
    extension
        Which format it is: ``.exr`` (float32), ``.png`` or ``.tga``, as of `extension_of`.
    """
    _WRITERS[extension](path, channels, bits)


def extension_of(path: Path) -> str:
    """Return a file's extension, in lower case.

    Raises
    ------
    ImageError
        None that `write_channels` knows.
    """
    extension = path.suffix.lower()
    if extension not in _WRITERS:
        raise ImageError(
            f"{path}: channels cannot be written as '{path.suffix}'; known: {' '.join(sorted(_WRITERS))}"
        )
    return extension


def _codes(channels: NDArray[np.float32], largest: int) -> NDArray[np.float32]:
    """Return the nearest whole numbers to the channels' parts of the largest."""
    codes: NDArray[np.float32] = np.floor(np.clip(channels, 0, 1) * np.float32(largest) + np.float32(0.5))
    return codes


def _write_exr(path: Path, channels: NDArray[np.float32], bits: Bits) -> None:
    del bits
    exr.write(path, Image(rgba=channels), WriteOptions(pixel_type="float"))


def _write_png(path: Path, channels: NDArray[np.float32], bits: Bits) -> None:
    codes = _codes(channels, (1 << bits) - 1)
    narrow = bits == 8  # noqa: PLR2004 - a byte
    path.write_bytes(file_of(codes.astype(np.uint8) if narrow else codes.astype(np.uint16), is_srgb=False))


def _write_tga(path: Path, channels: NDArray[np.float32], bits: Bits) -> None:
    del bits
    PIL.Image.fromarray(_codes(channels, 255).astype(np.uint8)).save(
        path, format="TGA", compression="tga_rle"
    )


_WRITERS: dict[str, Callable[[Path, NDArray[np.float32], Bits], None]] = {
    ".exr": _write_exr,
    ".png": _write_png,
    ".tga": _write_tga,
}
