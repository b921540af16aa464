"""Attributes of OpenEXR files: metadata, windows and primaries.

Here matrices in the metadata act on column vectors, ``v' = M v``; those of EXR act on row vectors, so the
transpose is stored.
"""

from typing import Any

import numpy as np

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io.image import Image, Metadata

REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
"""Rec. 709 chromaticities: x and y of red, green, blue and white."""

_INT32_MAX = 2**31 - 1
_RESERVED = {
    *("channels", "chromaticities", "compression", "dataWindow", "displayWindow", "lineOrder"),
    *("pixelAspectRatio", "screenWindowCenter", "screenWindowWidth", "tiles"),
    *("type", "name", "version", "chunkCount"),
}


def header_of(image: Image, kind: Any, compression: Any) -> dict[str, Any]:
    """Return the attributes of a part: metadata, windows and primaries."""
    x0, y0, x1, y1 = image.data_window
    width, height = image.frame_size
    header: dict[str, Any] = {name: _attribute(name, value) for name, value in image.metadata.items()}
    return header | {
        "type": kind,
        "compression": compression,
        "chromaticities": REC_709,
        "dataWindow": ((x0, y0), (x1 - 1, y1 - 1)),  # EXR includes the last pixel
        "displayWindow": ((0, 0), (width - 1, height - 1)),
    }


def _attribute(name: str, value: Metadata) -> Any:
    """Convert metadata to types that OpenEXR stores (it writes other integers as 0 or refuses them)."""
    if name in _RESERVED or not name or not name.isprintable():
        raise ImageError(
            f"metadata '{name}' cannot be set: EXR has an attribute of that name for its own use"
        )
    if isinstance(value, np.ndarray):
        if value.shape != (4, 4) or not np.isfinite(value).all():
            raise ImageError(f"metadata '{name}' is a finite 4×4 matrix; got the shape {value.shape}")
        return np.ascontiguousarray(value.T, dtype=np.float32)
    if isinstance(value, int | np.integer):
        return int(value) if abs(value) <= _INT32_MAX else str(value)
    return float(value) if isinstance(value, float | np.floating) else str(value)


def line_of(error: Exception) -> str:
    """Return what an error of OpenEXR says, in one line."""
    return " ".join(str(error).split())[:160] or type(error).__name__
