"""Textures for other programs: one module per format, selected by its name.

A texture is an array of layers of four channels, float32 ``[layers, height, width, 4]``; row 0 is at v = 0.
To add a format, write a module with ``write(path, layers, pixel_type)`` and add it to ``FORMATS``.
"""

import importlib
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError
from tfm_cl.files.paths import replacing

Format = Literal["exr", "ktx2"]
FORMATS: tuple[Format, ...] = get_args(Format)
"""Modules of this package, and extensions; imported when a texture of that kind is written."""
PixelType = Literal["half", "float"]
TYPES: dict[PixelType, type[np.floating[Any]]] = {"half": np.float16, "float": np.float32}

__all__ = ["FORMATS", "TYPES", "Format", "PixelType", "write"]


def write(path: Path, layers: NDArray[np.float32], pixel_type: PixelType = "float") -> None:
    """Write a texture, whole or not at all; the extension determines the format.

    Raises
    ------
    ImageError
        Numbers that the type does not hold, or the file cannot be written.
    """
    stored = TYPES[pixel_type]
    largest = float(np.abs(layers).max(initial=0.0))
    if not largest <= float(np.finfo(stored).max):
        raise ImageError(f"{path}: holds {largest:g}, which is beyond {pixel_type}; write it as float")
    module = importlib.import_module(f"{__name__}.{path.suffix.removeprefix('.')}")
    with replacing(path, ImageError) as temporary:
        module.write(temporary, layers.astype(stored))
