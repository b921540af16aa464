"""Images of albedo from files."""

import struct
import warnings
import zlib

from tfm_cl.errors import SceneError
from tfm_cl.files.mipmap import Mipmap
from tfm_cl.files.paths import check_readable, reason_of, source_of
from tfm_cl.files.srgb import decoded

_DAMAGE = (
    *(OSError, ArithmeticError, LookupError, MemoryError, SyntaxError, TypeError, ValueError),
    *(EOFError, struct.error, zlib.error),
)
"""What Pillow raises."""


def read_albedo(name: str) -> Mipmap:
    """Read an image of albedo; alpha is left out.

    Parameters
    ----------
    name
        The file, sRGB.

    Raises
    ------
    SceneError
        The file is missing, damaged or too large.
    """
    import PIL.Image  # noqa: PLC0415 - slow to import

    path = source_of(name, error=SceneError)
    check_readable(path, SceneError)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large images: they are refused when decoded
            with PIL.Image.open(path, formats=("PNG", "JPEG")) as picture:
                return Mipmap.of(decoded(picture))
    except (*_DAMAGE, PIL.Image.DecompressionBombError) as error:
        raise SceneError(f"solid.albedo: {path}: not a readable image ({reason_of(error)})") from error
