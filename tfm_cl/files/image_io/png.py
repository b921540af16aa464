"""PNG: sRGB with 8 or 16 bits a channel, over black or with alpha.

The view ``standard`` is only an exposure and a clip, so that measurements on the picture are meaningful: with
``dither = false``, and with 16 bits, a code is the nearest to its value; otherwise it is one of the two next
to it, and the mean over a patch is that of the values. The other views are for looking at.

PNG holds straight alpha: with ``transparent`` the colours are divided by alpha, and then exposed and shown by
the view like those of an opaque picture. With the view ``standard``, where nothing is clipped, that is over
black, in linear light, the same as the picture without alpha. Light where alpha is 0 has no place in it.
"""

import struct
import warnings
import zlib
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import MAX_PIXELS, Exposure, PngOptions, WriteOptions
from tfm_cl.files.image_io.channels import Bits, codes_of
from tfm_cl.files.image_io.display import automatic_exposure, shown, straight
from tfm_cl.files.image_io.dither import thresholds
from tfm_cl.files.image_io.image import Image, Picture, check_finite
from tfm_cl.files.image_io.inline import SRGB, png_of
from tfm_cl.files.srgb import linear_from_srgb, srgb_from_linear

HOLDS_LAYERS = False
BAND = 1 << 16
"""Pixels that are encoded at once: what is made of them stays in the cache."""

_LEVEL = 4  # of compression
_MAX_DEFLATE_RATIO = 1032  # largest ratio of the deflate format
_RGB = 3
_WIDE = ("RGB;16B", "RGBA;16B")  # Pillow's names of 16-bit colours in a file
_DAMAGE = (  # errors of Pillow's chunk parsers and zlib
    *(OSError, SyntaxError, ValueError, ArithmeticError, LookupError, EOFError, TypeError),
    *(struct.error, zlib.error, PIL.Image.DecompressionBombError),
)


def write(path: Path, image: Image, options: WriteOptions) -> None:
    """Write the colours; as they are premultiplied, no change is needed to put them over black.

    With alpha they are those without a background.
    """
    rgba = image.foreground if options.transparent and image.foreground is not None else image.rgba
    path.write_bytes(_encoded(rgba, options, image.data_window[:2]))


def write_channels(path: Path, channels: NDArray[np.float32], bits: Bits) -> None:
    """Write numbers [H, W, 4] from 0 to 1, which are no colours; nothing says that they are sRGB."""
    codes = codes_of(channels, (1 << bits) - 1)
    if bits == 8:  # noqa: PLR2004 - a byte
        path.write_bytes(png_of(codes.astype(np.uint8), level=_LEVEL, is_srgb=False))
    else:
        path.write_bytes(_file_of_16_bits(codes.astype(np.uint16), is_srgb=False))


def png_bytes(
    rgb: NDArray[np.float32],
    exposure: Exposure = 0.0,
    *,
    corner: tuple[int, int] = (0, 0),
    **png: Unpack[PngOptions],
) -> bytes:
    """Encode a picture in memory.

    Parameters
    ----------
    rgb
        [H, W, 3] scene-linear, Rec. 709 primaries, or premultiplied [H, W, 4].
    exposure
        In stops; the picture is multiplied by 2 to this power. ``"auto"``: chosen from its luminances.
    corner
        (x, y) of the first pixel in the full frame, for the dithering.
    **png
        See `PngOptions`.

    Raises
    ------
    ImageError
        The array has another shape, or values that are NaN or infinite, or an option is none.
    """
    if rgb.ndim != _RGB or rgb.shape[2] not in {3, 4} or rgb.size == 0:
        raise ImageError(f"a picture is [height, width, 3 or 4] and not empty; got the shape {rgb.shape}")
    options = WriteOptions(exposure=exposure, **png)
    if options.transparent and rgb.shape[2] == _RGB:
        raise ImageError("a transparent picture is [height, width, 4]; this one has no alpha channel")
    check_finite(rgb if options.transparent else rgb[..., :3], "the picture")
    return _encoded(rgb, options, corner)


def _encoded(picture: NDArray[np.float32], options: WriteOptions, corner: tuple[int, int]) -> bytes:
    """Make the bytes of a file of a finite picture [H, W, 3 or 4]."""
    codes = codes_shown(picture, options, corner)
    if options.png_bits > 8:  # noqa: PLR2004 - a byte
        return _file_of_16_bits(codes.astype(np.uint16))
    return png_of(codes.astype(np.uint8), level=_LEVEL)


def codes_shown(
    picture: NDArray[np.float32], options: WriteOptions, corner: tuple[int, int] = (0, 0)
) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Return what a PNG holds of a finite picture [H, W, 3 or 4]: [H, W, 3], with alpha [H, W, 4]."""
    stops = options.exposure
    if stops == "auto":
        stops = automatic_exposure(picture, options.view, transparent=options.transparent)
    height, width = picture.shape[:2]
    deep = options.png_bits > 8  # noqa: PLR2004 - a byte
    codes = np.empty((height, width, 4 if options.transparent else 3), np.uint16 if deep else np.uint8)
    rows = max(BAND // width, 1)
    for y in range(0, height, rows):
        band = picture[y : y + rows]
        values = _values(band, options, stops) * np.iinfo(codes.dtype).max
        if options.dither and not deep:
            values += _thresholds(values.shape, corner[0], corner[1] + y)
        else:
            values += 0.5
        codes[y : y + rows] = values  # rounded down
    return codes


def _values(picture: NDArray[np.float32], options: WriteOptions, stops: float) -> NDArray[np.float64]:
    """Return what is to be encoded, 0 to 1: sRGB, and alpha if it is asked for."""
    colours = straight(picture) if options.transparent else picture[..., :3]
    values = srgb_from_linear(shown(colours, stops, options.view))
    if not options.transparent:
        return values
    return np.concatenate([values, np.clip(picture[..., 3:], 0, 1)], axis=2)


def _thresholds(shape: tuple[int, ...], x: int, y: int) -> NDArray[np.floating[Any]]:
    """Dither colours alike, so that greys stay grey, and alpha half a step apart from them."""
    noise = thresholds(np.arange(x, x + shape[1]), np.arange(y, y + shape[0])[:, np.newaxis])
    channels = [noise] * _RGB + [1 - noise] * (shape[2] - _RGB)
    return np.stack(channels, axis=2)


def _file_of_16_bits(codes: NDArray[np.uint16], *, is_srgb: bool = True) -> bytes:
    """Write out the format, as Pillow has no pictures of 16-bit colours."""
    height, width, channels = codes.shape
    lines = codes.astype(">u2").reshape(height, -1).view(np.uint8)
    pixel = 2 * channels
    left, above = np.zeros_like(lines), np.zeros_like(lines)
    left[:, pixel:], above[1:] = lines[:, :-pixel], lines[:-1]
    filtered = np.stack([lines - left, lines - above])  # modulo 256
    # The filter of each line is the one that leaves the smaller differences, as the specification advises.
    best = np.abs(filtered.view(np.int8).astype(np.int16)).sum(axis=2).argmin(axis=0)
    numbered = np.empty((height, 1 + lines.shape[1]), np.uint8)
    numbered[:, 0], numbered[:, 1:] = 1 + best, filtered[best, np.arange(height)]  # 1: left, 2: above
    colour_type = 2 if channels == _RGB else 6
    header = struct.pack(">IIBBBBB", width, height, 16, colour_type, 0, 0, 0)
    body = zlib.compress(numbered.tobytes(), _LEVEL)
    tag = [(b"sRGB", SRGB)] * is_srgb
    chunks = ((b"IHDR", header), *tag, (b"IDAT", body), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in chunks)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


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
        wide = bool(picture.tile) and picture.tile[0].args in _WIDE and "transparency" not in picture.info
        alpha = "A" in picture.mode or "transparency" in picture.info
        values = np.asarray(picture if deep or wide else picture.convert("RGBA" if alpha else "RGB"))
    if deep:
        values = np.repeat(values[..., np.newaxis], 3, axis=2)
    if wide:
        values = values * np.uint16(256) + _low_bytes(path)
    largest = 65535.0 if deep or wide else 255.0
    linear = linear_from_srgb(values[..., :3] / largest)
    if values.shape[2] == _RGB:
        return linear.astype(np.float32)
    opacity = values[..., 3:] / largest
    return np.concatenate([linear * opacity, opacity], axis=2).astype(np.float32)


def _low_bytes(path: Path) -> NDArray[np.uint8]:
    """Read the lower byte of 16-bit colours, of which Pillow returns the higher one.

    The higher one is first; to a reader of the other byte order it is the lower.
    """
    with PIL.Image.open(path, formats=["PNG"]) as picture:
        picture.tile = [tile._replace(args=str(tile.args).replace("16B", "16L")) for tile in picture.tile]
        return np.asarray(picture)
