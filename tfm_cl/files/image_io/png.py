"""PNG: 8-bit RGB over black, sRGB.

Tone mapping is only an exposure and a clip, so that measurements on the picture are meaningful.
"""

import io
import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import PIL.Image
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngInfo

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import MAX_PIXELS, WriteOptions
from tfm_cl.files.image_io.image import Image, Picture, check_finite
from tfm_cl.files.srgb import linear_from_srgb, srgb_from_linear

HOLDS_LAYERS = False
_MAX_DEFLATE_RATIO = 1032  # largest ratio of the deflate format
_RGB = 3
_DAMAGE = (  # errors of Pillow's chunk parsers and zlib
    *(OSError, SyntaxError, ValueError, ArithmeticError, LookupError, EOFError, TypeError),
    *(struct.error, zlib.error, PIL.Image.DecompressionBombError),
)


def write(path: Path, image: Image, options: WriteOptions) -> None:
    """Write the colours; as they are premultiplied, no change is needed to put them over black."""
    path.write_bytes(png_bytes(image.rgba[..., :3], options.exposure))


def png_bytes(rgb: NDArray[np.float32], exposure: float = 0.0) -> bytes:
    """Encode a picture in memory.

    Parameters
    ----------
    rgb
        [H, W, 3] scene-linear, Rec. 709 primaries; the alpha channel of [H, W, 4] is ignored.
    exposure
        In stops; the picture is multiplied by 2 to this power.

    Raises
    ------
    ImageError
        The array has another shape, or values that are NaN or infinite.
    """
    if rgb.ndim != _RGB or rgb.shape[2] not in {3, 4} or rgb.size == 0:
        raise ImageError(f"a picture is [height, width, 3 or 4] and not empty; got the shape {rgb.shape}")
    exposure = WriteOptions(exposure=exposure).exposure
    check_finite(rgb, "the picture")
    linear = rgb[..., :3].astype(np.float64) * 2.0**exposure
    encoded = srgb_from_linear(np.clip(linear, 0, 1))
    pixels = np.floor(encoded * 255 + 0.5).astype(np.uint8)
    tagged = PngInfo()
    tagged.add(b"sRGB", b"\x00")  # declares the colour space; 0: perceptual intent
    stream = io.BytesIO()
    PIL.Image.fromarray(pixels).save(stream, format="PNG", pnginfo=tagged, compress_level=4)
    return stream.getvalue()


def read(path: Path) -> Picture:
    """Read [H, W, 3], or premultiplied [H, W, 4] if there is an alpha channel; in linear light.

    Raises
    ------
    ImageError
        Damaged, or not a PNG.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's own limit on pixels; ours is MAX_PIXELS
            return Picture(_decode(path))
    except _DAMAGE as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ImageError(f"{path}: not a readable PNG ({reason})") from error


def _decode(path: Path) -> NDArray[np.float32]:
    with PIL.Image.open(path, formats=["PNG"]) as picture:
        pixels = picture.width * picture.height
        if pixels > MAX_PIXELS or pixels // 8 > path.stat().st_size * _MAX_DEFLATE_RATIO:
            raise ImageError(
                f"{path}: declares {picture.width}×{picture.height} pixels, more than it can hold"
            )
        deep = picture.mode.startswith("I")  # 16-bit grey, which Pillow would clip to 8 bits
        alpha = "A" in picture.mode or "transparency" in picture.info
        values = np.asarray(picture if deep else picture.convert("RGBA" if alpha else "RGB"))
    if deep:
        values = np.repeat(values[..., np.newaxis], 3, axis=2)
    linear = linear_from_srgb(values[..., :3] / (65535.0 if deep else 255.0))
    if values.shape[2] == _RGB:
        return linear.astype(np.float32)
    opacity = values[..., 3:] / 255.0
    return np.concatenate([linear * opacity, opacity], axis=2).astype(np.float32)
