"""Pictures of 8 bits as bytes: of a PNG file, or for pages and notebooks, which show them at once."""

import io
from typing import Literal

import numpy as np
import PIL.Image
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngInfo

Quality = Literal["low", "full"]

SRGB = b"\x00"
"""Declares the colour space of a PNG; 0: perceptual intent."""
JPEG_QUALITY = 85
"""Of pictures that are soon replaced: edges look clean, at a tenth of a PNG's bytes."""
PNG_LEVEL = 1
"""Of compression: dithered pictures hardly get smaller at a higher one, and take three times as long."""


def png_of(codes: NDArray[np.uint8], *, level: int, is_srgb: bool = True) -> bytes:
    """Make the bytes of a PNG of codes [H, W] or [H, W, 3 or 4], compressed at a level from 1 to 9."""
    tagged = PngInfo()
    if is_srgb:
        tagged.add(b"sRGB", SRGB)
    stream = io.BytesIO()
    PIL.Image.fromarray(codes).save(stream, format="PNG", pnginfo=tagged, compress_level=level)
    return stream.getvalue()


def encoded(pixels: NDArray[np.uint8], quality: Quality) -> tuple[str, bytes]:
    """Encode a picture.

    Parameters
    ----------
    pixels
        sRGB codes [H, W, 3].
    quality
        ``low``: a JPEG, fast and small; ``full``: a PNG, which holds every code.

    Returns
    -------
    mime, content
        ``image/jpeg`` or ``image/png``, and the file's bytes.
    """
    if quality == "full":
        return "image/png", png_of(pixels, level=PNG_LEVEL)
    stream = io.BytesIO()
    PIL.Image.fromarray(pixels).save(stream, format="JPEG", quality=JPEG_QUALITY)
    return "image/jpeg", stream.getvalue()
