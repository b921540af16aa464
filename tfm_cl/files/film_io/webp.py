"""Animated WebP: millions of colours, by Pillow."""

from pathlib import Path

import PIL.features
import PIL.Image

from tfm_cl.errors import ImageError
from tfm_cl.files.film_io.animation import Animation, save
from tfm_cl.files.film_io.film import EncodingError, Film, FilmOptions, Progress

USES = ("fps", "quality")
WIDTH = None

_LARGEST = 16383
"""Most pixels along a side."""
_QUALITY = 50, 100
"""libwebp's quality for ours of 0 and of 100: blocks show in smoke where it is less than 90."""
_EFFORT = 4
"""0 to 6: libwebp's own default, where Pillow takes the least for animations."""


def check(options: FilmOptions) -> None:
    """Find out whether Pillow writes it."""
    del options
    if not PIL.features.check("webp"):
        raise ImageError("this Pillow was built without WebP; take .mp4 or .gif")


def write(path: Path, film: Film, options: FilmOptions, progress: Progress) -> None:
    """Write the frames; what is encoded of them stays in memory."""
    width, height = film.size
    if max(width, height) > _LARGEST:
        raise EncodingError(f"a frame has up to {_LARGEST} pixels along a side; got {width}×{height}")
    animation = Animation(film, lambda index: PIL.Image.fromarray(film.codes(index)), progress)
    durations = options.milliseconds(len(film.numbers))
    quality = round(_QUALITY[0] + (_QUALITY[1] - _QUALITY[0]) * options.quality / 100)
    with path.open("wb") as stream:
        save(animation, stream, "WEBP", duration=durations, quality=quality, method=_EFFORT)
