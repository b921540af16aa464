"""Pictures whose four channels are no colours but numbers: written as they are, without sRGB or dither.

To add a format, write a module with ``write_channels(path, channels, bits)`` and add it to ``WRITERS``.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError

WRITERS: dict[str, str] = {".exr": "exr", ".png": "png", ".tga": "tga"}
"""Modules of `tfm_cl.files.image_io` by file extension; imported when a picture of that kind is written."""
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
    module = importlib.import_module(f"tfm_cl.files.image_io.{WRITERS[extension]}")
    module.write_channels(path, channels, bits)


def extension_of(path: Path) -> str:
    """Return a file's extension, in lower case.

    Raises
    ------
    ImageError
        None that `write_channels` knows.
    """
    extension = path.suffix.lower()
    if extension not in WRITERS:
        raise ImageError(
            f"{path}: channels cannot be written as '{path.suffix}'; known: {' '.join(sorted(WRITERS))}"
        )
    return extension


def codes_of(channels: NDArray[np.float32], largest: int) -> NDArray[np.float32]:
    """Return the nearest whole numbers to the channels' parts of the largest."""
    codes: NDArray[np.float32] = np.floor(np.clip(channels, 0, 1) * np.float32(largest) + np.float32(0.5))
    return codes
