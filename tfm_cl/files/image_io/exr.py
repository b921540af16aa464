"""OpenEXR: colours, AOVs, windows and metadata.

Channels: ``R G B A``; a scalar AOV by its name (``depth``); a colour AOV as ``name.R name.G name.B``,
where the name may have a dot itself (``light.key.R``).
"""

import contextlib
import io
import os
import re
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from tfm_cl.errors import ImageError, unknown_key
from tfm_cl.files.image_io import MAX_PIXELS, Compression, PixelType, WriteOptions, with_alpha
from tfm_cl.files.image_io.channels import Bits
from tfm_cl.files.image_io.exr_header import header_of, line_of
from tfm_cl.files.image_io.exr_layers import Part, beauty
from tfm_cl.files.image_io.image import Image, Picture, Window

HOLDS_LAYERS = True
_HALF_MAX = 65504.0
_COMPRESSIONS: dict[Compression, Any] = {
    "none": OpenEXR.NO_COMPRESSION,
    "rle": OpenEXR.RLE_COMPRESSION,
    "zips": OpenEXR.ZIPS_COMPRESSION,
    "zip": OpenEXR.ZIP_COMPRESSION,
    "piz": OpenEXR.PIZ_COMPRESSION,
    "pxr24": OpenEXR.PXR24_COMPRESSION,
    "dwaa": OpenEXR.DWAA_COMPRESSION,
    "dwab": OpenEXR.DWAB_COMPRESSION,
    "htj2k": OpenEXR.HTJ2K256_COMPRESSION,
}
_MAX_RATIO = 1 << 16  # pixels per byte, more than any of the compressions reaches on real pictures
_stderr_lock = threading.Lock()


def write_channels(path: Path, channels: NDArray[np.float32], _bits: Bits) -> None:
    """Write numbers [H, W, 4] of any size, as float32."""
    write(path, Image(rgba=channels), WriteOptions(pixel_type="float"))


def write(path: Path, image: Image, options: WriteOptions) -> None:
    """Write the colours, the AOVs and the metadata."""
    header = header_of(image, OpenEXR.scanlineimage, _COMPRESSIONS[options.compression])
    channels = {"RGBA": _colours(image.rgba, options.pixel_type)}
    for name, aov in image.aovs.items():
        scalar = aov.ndim == 2  # noqa: PLR2004 - height and width
        # What follows a dot is a layer's channel, of colours: here only the last dot is.
        allowed = r"\w[\w-]*" if scalar else r"\w[\w-]*(\.[\w-]+)?"
        if not re.fullmatch(allowed, name) or name in {"R", "G", "B", "A", "RGB", "RGBA"}:
            raise ImageError(f"AOV '{name}' cannot be the name of an EXR channel; use letters, digits and _")
        channels[name] = (
            np.ascontiguousarray(aov, np.float32) if scalar else _colours(aov, options.pixel_type)
        )
    _write_file(header, channels, path)


def read(path: Path) -> Picture:
    """Read the colours of the data window; `beauty` selects the channels and the part.

    Raises
    ------
    ImageError
        The file is damaged, deep, or has no channels that hold the picture.
    """
    parts = _declared(path)
    try:
        layer = beauty(parts)
    except ImageError as error:
        raise ImageError(f"{path}: {error}") from None
    pixels = _pixels_of(path, parts)[layer.part]
    part = parts[layer.part]
    return Picture(_stacked([pixels[name] for name in layer.colours], path), part.window, part.frame)


def read_layer(path: Path, name: str) -> Picture:
    """Read an AOV, with the alpha of its part as the fourth channel where that has one.

    Raises
    ------
    ImageError
        The file is damaged, or has no AOV of that name (the message lists the nearest, or all).
    """
    parts = _declared(path)
    known: dict[str, tuple[int, list[str]]] = {}
    for number, part in reversed(list(enumerate(parts))):
        for channel in part.channels:
            stem, _, end = channel.rpartition(".")
            colours = [f"{stem}.{c}" for c in ("RGB" if end in "RGB" else "XYZ")]
            if stem and end and part.channels.keys() >= set(colours):
                known[stem] = number, colours
            elif channel not in "RGBA":
                known[channel] = number, [channel]
    if name not in known:
        raise ImageError(f"{path}: {unknown_key(name, sorted(known)).replace('key', 'layer')}")
    number, channels = known[name]
    pixels, part = _pixels_of(path, parts)[number], parts[number]
    alpha = [channel for channel in ("A",) if channel in pixels]
    stacked = _stacked([pixels[channel] for channel in (*channels, *alpha)], path)
    layer, count = stacked[..., : len(channels)], len(channels)
    picture = with_alpha(layer if count > 1 else layer[..., 0], stacked[..., count] if alpha else None)
    return Picture(picture, part.window, part.frame)


def read_aov(path: Path, name: str) -> NDArray[np.float32]:
    """Read one AOV: [H, W], or [H, W, 3] if it has the channels ``name.R name.G name.B``.

    Raises
    ------
    ImageError
        The file is damaged, or has no AOV of that name (the message lists the channels).
    """
    pixels = _pixels(path)
    if name in pixels:
        return pixels[name].astype(np.float32)
    colours = [pixels[f"{name}.{c}"] for c in "RGB" if f"{name}.{c}" in pixels]
    if len(colours) != len("RGB"):
        raise ImageError(f"{path}: has no AOV '{name}'; its channels are {' '.join(sorted(pixels))}")
    return _stacked(colours, path)


def read_text(path: Path, name: str) -> str | None:
    """Read an attribute of the first part that is text; None where it has no such.

    Raises
    ------
    ImageError
        The file is damaged.
    """
    try:
        with _silence(), path.open("rb") as stream, OpenEXR.File(stream, header_only=True) as file:
            found = [part.header.get(name) for part in file.parts[:1]]
    except Exception as error:  # as in `_declared`
        raise ImageError(f"{path}: not a readable EXR ({line_of(error)})") from error
    return found[0] if found and isinstance(found[0], str) else None


def _colours(values: NDArray[np.float32], pixel_type: PixelType) -> NDArray[np.float16 | np.float32]:
    if pixel_type == "float":
        return np.ascontiguousarray(values, np.float32)
    return np.ascontiguousarray(np.clip(values, -_HALF_MAX, _HALF_MAX), np.float16)


def _write_file(header: dict[str, Any], channels: dict[str, NDArray[Any]], path: Path) -> None:
    """Write the file, by way of memory: OpenEXR does not report every failure on a full disk."""
    file = io.BytesIO()
    try:
        OpenEXR.File(header, dict(channels)).write(file)  # OpenEXR changes the dictionary that it is given
    except (RuntimeError, ValueError, TypeError) as error:
        raise ImageError(f"OpenEXR cannot write it ({line_of(error)})") from error
    path.write_bytes(file.getbuffer())


def _pixels(path: Path) -> dict[str, NDArray[Any]]:
    """Read all channels; if several parts have one of the same name, the first."""
    pixels: dict[str, NDArray[Any]] = {}
    for part in reversed(_pixels_of(path, _declared(path))):
        pixels |= part
    return pixels


def _declared(path: Path) -> list[Part]:
    """Read the headers of all parts, and check that what they declare can be read."""
    try:
        with _silence(), path.open("rb") as stream, OpenEXR.File(stream, header_only=True) as file:
            parts = [_part(part.header) for part in file.parts]
    except Exception as error:  # the binding passes on any error of its C++ side
        raise ImageError(f"{path}: not a readable EXR ({line_of(error)})") from error
    if not parts:
        raise ImageError(f"{path}: damaged EXR (no part of it can be read)")
    for part in parts:
        if not part.is_flat:
            raise ImageError(f"{path}: is a deep image, without one value for a pixel; flatten it first")
        x0, y0, x1, y1 = part.window
        width, height, channels = x1 - x0, y1 - y0, len(part.channels)
        values = width * height * channels
        if min(width, height) < 1 or width * height > MAX_PIXELS or values > path.stat().st_size * _MAX_RATIO:
            raise ImageError(
                f"{path}: declares {width}×{height} pixels of {channels} channels; it is damaged"
            )
    return parts


def _part(header: dict[str, Any]) -> Part:
    return Part(
        str(header.get("name", "")),
        {channel.name: max(channel.xSampling, channel.ySampling) > 1 for channel in header["channels"]},
        _window(header["dataWindow"]),
        _window(header["displayWindow"]),
        header["type"] in {OpenEXR.scanlineimage, OpenEXR.tiledimage},
    )


def _pixels_of(path: Path, declared: list[Part]) -> list[dict[str, NDArray[Any]]]:
    """Read all channels of all parts."""
    try:
        with _silence(), path.open("rb") as stream, OpenEXR.File(stream, separate_channels=True) as file:
            parts = [{name: channel.pixels for name, channel in part.channels.items()} for part in file.parts]
    except Exception as error:
        raise ImageError(f"{path}: damaged EXR ({line_of(error)})") from error
    if [set(part) for part in parts] != [set(part.channels) for part in declared]:
        raise ImageError(f"{path}: damaged EXR (not all that it declares can be read)")
    return parts


def _window(corners: Any) -> Window:
    (x0, y0), (x1, y1) = (tuple(map(int, corner)) for corner in corners)
    return x0, y0, x1 + 1, y1 + 1  # EXR includes the last pixel


def _stacked(channels: list[NDArray[Any]], path: Path) -> NDArray[np.float32]:
    if len({channel.shape for channel in channels}) != 1:
        raise ImageError(f"{path}: its channels are of different sizes (subsampled); save it as plain RGB")
    return np.stack(channels, axis=2).astype(np.float32)


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Suppress what OpenEXR prints about damaged files; it also raises an error, which is sufficient.

    Its C++ side writes to the process's stderr, its Python side to ``sys.stdout``.
    """
    with _stderr_lock, contextlib.redirect_stdout(io.StringIO()), contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError, ValueError, AttributeError):  # a process without a stderr
            sys.stderr.flush()
            kept = os.dup(2)
            stack.callback(os.close, kept)
            null = os.open(os.devnull, os.O_WRONLY)
            stack.callback(os.close, null)
            os.dup2(null, 2)
            stack.callback(os.dup2, kept, 2)
        yield
