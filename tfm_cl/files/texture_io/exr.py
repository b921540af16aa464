"""Textures as OpenEXR: layer i holds the numbers from 4 i on, as the channels ``c004.R`` to ``c004.A`` do.

A texture of one layer is plain ``R G B A``. Its rows are stored from v = 0 on: the first is the upper one.
"""

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from tfm_cl.errors import ImageError


def write(path: Path, layers: NDArray[np.floating[Any]]) -> None:
    """Write a file; ZIP compression."""
    names = ["RGBA"] if len(layers) == 1 else [f"c{4 * i:03d}" for i in range(len(layers))]
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    channels = {name: np.ascontiguousarray(layer) for name, layer in zip(names, layers, strict=True)}
    try:
        with path.open("wb") as stream:
            OpenEXR.File(header, channels).write(stream)
    except (RuntimeError, ValueError, TypeError) as error:
        raise ImageError(f"{path}: OpenEXR cannot write it ({' '.join(str(error).split())[:160]})") from error
