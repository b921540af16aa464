"""Image files: one module per format, selected by the file's extension.

To add a format, write a module with ``write(path, image, options)`` and ``read(path)`` (see
`ImageFormat`) and add it to ``FORMATS``.
"""

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, TypedDict, Unpack, cast, get_args

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError, unknown_key
from tfm_cl.files import paths as files
from tfm_cl.files.image_io.image import Image, Picture
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.files.paths import check_readable, path_of, reason_of, replacing, source_of
from tfm_cl.interrupts import interrupts_held
from tfm_cl.limits import MOST_STOPS
from tfm_cl.plugins import register_format, register_installed

FORMATS: dict[str, str] = {".exr": ".exr", ".png": ".png", ".npy": ".npy", ".deep.exr": ".deep_exr"}
"""Modules by file extension, those of this package as ``.NAME``; imported when one is met."""
DEEP = ".deep.exr"
"""Extension of deep images, which hold samples along the rays of pixels."""

MAX_PIXELS = 1 << 28
"""Largest number of pixels of an image that is read (4 GiB of float32 RGBA)."""

PixelType = Literal["half", "float"]
Compression = Literal["none", "rle", "zips", "zip", "piz", "pxr24", "dwaa", "dwab", "htj2k"]
"""Of OpenEXR; ``htj2k`` is its HTJ2K of 256 lines."""
Exposure = float | Literal["auto"]
"""Stops; ``"auto"``: chosen from the picture, by `tfm_cl.files.image_io.display.automatic_exposure`."""

__all__ = [
    "FORMATS",
    "MAX_PIXELS",
    "Compression",
    "Exposure",
    "Image",
    "Picture",
    "PngOptions",
    "WriteOptions",
    "check_writable",
    "holds_layers",
    "is_deep",
    "load_image",
    "load_picture",
    "register_image_format",
    "save",
    "with_alpha",
]


class PngOptions(TypedDict, total=False):
    """How a PNG shows a picture, besides its exposure."""

    view: str
    """From exposed light to a display's: ``standard`` (only a clip), ``filmic``, ``agx`` or ``aces``."""
    transparent: bool
    """Whether to write alpha, without the background; otherwise the picture lies over that, or black."""
    png_bits: int
    """8 or 16 a channel."""
    dither: bool
    """Whether 8 bits are dithered: each code is next to its value, above or below, and right on average;
    otherwise it is the nearest. Values of a code, black and white are the same in both."""


@dataclass(frozen=True, kw_only=True)
class WriteOptions:
    """Options for writing an image; each format uses those that apply to it."""

    pixel_type: PixelType = "half"
    """EXR: type of the colours; scalar AOVs are always float."""
    compression: Compression = "zip"
    """EXR, but for deep images."""
    exposure: Exposure = 0.0
    """PNG: exposure in stops; the image is multiplied by 2 to this power."""
    view: str = "standard"
    """PNG, as all that follow: see `PngOptions`."""
    transparent: bool = False
    png_bits: int = 8
    dither: bool = True

    def __post_init__(self) -> None:
        if self.pixel_type not in {"half", "float"}:
            raise ImageError(f"pixel_type is 'half' or 'float'; got {self.pixel_type!r}")
        if self.compression not in get_args(Compression):
            known = ", ".join(get_args(Compression))
            raise ImageError(f"compression is one of {known}; got {self.compression!r}")
        stops: object = self.exposure
        is_number = isinstance(stops, int | float | np.floating) and abs(float(stops)) <= MOST_STOPS
        if stops != "auto" and not is_number:
            raise ImageError(
                f"exposure is a number of stops from -{MOST_STOPS} to {MOST_STOPS}, or 'auto'; got {stops}"
            )
        if self.view not in VIEWS:
            raise ImageError(unknown_key(str(self.view), list(VIEWS)).replace("key", "view"))
        if self.png_bits not in {8, 16}:
            raise ImageError(f"png_bits is 8 or 16; got {self.png_bits}")


class ImageFormat(Protocol):
    """A module of this package that reads and writes one kind of file."""

    HOLDS_LAYERS: bool
    """Whether the format stores AOVs; otherwise they are left out."""

    def write(self, path: Path, image: Image, options: WriteOptions) -> None:
        """Write to an empty file; may leave it incomplete if it raises."""
        ...

    def read(self, path: Path) -> Picture:
        """Read scene-linear colours; raises `ImageError` if the file is damaged."""
        ...


class LayeredFormat(ImageFormat, Protocol):
    """One that stores AOVs."""

    def read_layer(self, path: Path, name: str) -> Picture:
        """Read an AOV, and the picture's alpha; raises `ImageError` if the file is damaged or has none."""
        ...


def save(
    path: str | Path,
    image: Image,
    *,
    pixel_type: PixelType = "half",
    compression: Compression = "zip",
    exposure: Exposure = 0.0,
    **png: Unpack[PngOptions],
) -> None:
    """Write an image; the extension determines the format.

    The file appears complete or not at all: it is written under another name in the same directory,
    flushed to the disk, and renamed. An existing file is replaced.

    Parameters
    ----------
    path
        ``.exr`` (colours, AOVs, windows and metadata), ``.png`` (sRGB, as a view shows it), ``.npy``
        (float32 [H, W, 4]) or ``.deep.exr`` (deep samples, windows and metadata).
    image
        The picture.
    pixel_type
        EXR only: type of the colours, ``half`` (clipped to ±65504) or ``float``.
    compression
        EXR only, but for deep images: ``pxr24`` rounds floats to 24 bits, ``dwaa`` and ``dwab`` change
        colours a little, and all others keep every bit.
    exposure
        PNG only: stops, or ``"auto"``.
    **png
        PNG only: see `PngOptions`.

    Raises
    ------
    ImageError
        Unknown extension, an option that is none, or the file cannot be written (the message says why).
    """
    path = path_of(path, ImageError)
    options = WriteOptions(pixel_type=pixel_type, compression=compression, exposure=exposure, **png)
    module = _format(path)
    with replacing(path, ImageError) as temporary:
        try:
            module.write(temporary, image, options)
        except ImageError as error:
            raise ImageError(f"{path}: {error}") from error


def load_image(path: str | Path) -> NDArray[np.float32]:
    """Read an image: [H, W, 3], or [H, W, 4] if it has an alpha channel.

    EXR and ``.npy`` are returned as they are (from an EXR, the data window of the layer that holds the
    picture); a PNG is decoded from sRGB to linear light and premultiplied.

    Raises
    ------
    ImageError
        As `load_picture`.
    """
    return load_picture(path).pixels


def load_picture(path: str | Path, layer: str | None = None) -> Picture:
    """Read an image like `load_image`, with its position in the full frame if an EXR states it.

    Parameters
    ----------
    path
        The file.
    layer
        Of an EXR, instead of the picture; three channels, and the picture's alpha where it has one.

    Raises
    ------
    ImageError
        The file is missing, damaged, of unknown type, has more than `MAX_PIXELS`, or no such layer.
    """
    path = source_of(path, error=ImageError)
    module = _format(path)
    check_readable(path, ImageError)
    if layer is not None and not module.HOLDS_LAYERS:
        raise ImageError(f"{path}: has no layer '{layer}': {path.suffix} files have none, .exr has")
    try:
        return module.read(path) if layer is None else cast("LayeredFormat", module).read_layer(path, layer)
    except (OSError, MemoryError) as error:
        raise ImageError(f"{path}: cannot be read ({reason_of(error)})") from error


def with_alpha(layer: NDArray[np.float32], alpha: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """Return a layer, [H, W] or [H, W, 3], as three channels and an alpha, if any, [H, W]."""
    colours = np.repeat(layer[..., None], 3, axis=2) if layer.ndim == 2 else layer  # noqa: PLR2004
    return colours if alpha is None else np.concatenate([colours, alpha[..., None]], axis=2)


def holds_layers(path: str | Path) -> bool:
    """Tell whether `save` writes AOVs to a file of that name or omits them; may raise `ImageError`."""
    return _format(path_of(path, ImageError)).HOLDS_LAYERS


def is_deep(path: str | Path) -> bool:
    """Tell whether `save` writes deep samples to a file of that name."""
    return str(path).lower().endswith(DEEP)


def check_writable(path: str | Path) -> None:
    """Check that `save` can write to a path, before hours are spent on the image.

    Raises
    ------
    ImageError
        Unknown extension, no such directory, no permission to write there, or the path is a directory.
    """
    path = path_of(path, ImageError)
    _format(path)
    files.check_writable(path, ImageError)


def _format(path: Path) -> ImageFormat:
    module_name = FORMATS.get(DEEP if is_deep(path) else path.suffix.lower())
    if module_name is None:
        raise ImageError(
            f"{path}: not a known image format '{path.suffix}'; known: {' '.join(sorted(FORMATS))}"
        )
    with interrupts_held():  # modules in C that Ctrl-C meets while they are imported fail, or forget it
        return cast("ImageFormat", importlib.import_module(module_name, __name__))


def register_image_format(extension: str, module: str) -> None:
    """Add a format of images.

    Parameters
    ----------
    extension
        Of its files, as ``.abc``.
    module
        Name of the module that knows it, in a plugin's file ``__name__``; it has what
        `ImageFormat` says, and is imported when such a file is met.

    Raises
    ------
    InputError
        The extension is none, or known already.
    """
    register_format("images", extension, module, FORMATS)


register_installed(
    "image_formats",
    lambda name, module: register_image_format(f".{name.removeprefix('.')}", module.__name__),
)
