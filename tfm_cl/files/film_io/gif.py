"""Animated GIF: 256 colours, by Pillow. All frames have the same, so that nothing flickers."""

from pathlib import Path

import numpy as np
import PIL.Image

from tfm_cl.errors import ImageError
from tfm_cl.files.film_io.animation import Animation, save
from tfm_cl.files.film_io.film import Film, FilmOptions, Progress
from tfm_cl.files.film_io.sampling import spread

USES = ("fps",)
WIDTH = None

FASTEST = 50
"""Frames a second: viewers slow down what is shown for less than two hundredths."""
COLOURS = 256
HUNDREDTH = 10
"""Milliseconds, in which times are told."""


def check(options: FilmOptions) -> None:
    """Refuse rates that viewers do not show."""
    if options.fps > FASTEST:
        raise ImageError(f"a .gif has at most {FASTEST} frames a second; got {options.fps:g}")


def write(path: Path, film: Film, options: FilmOptions, progress: Progress) -> None:
    """Write the frames; a byte a pixel of each stays in memory until all are there."""
    colours = _palette(film, progress)

    def made(index: int) -> PIL.Image.Image:
        picture = PIL.Image.fromarray(film.codes(index))
        return picture.quantize(palette=colours, dither=PIL.Image.Dither.FLOYDSTEINBERG)

    durations = options.milliseconds(len(film.numbers), HUNDREDTH)
    with path.open("wb") as stream:
        save(Animation(film, made, progress), stream, "GIF", duration=durations, optimize=False)


def _palette(film: Film, progress: Progress) -> PIL.Image.Image:
    """Return a picture with the colours that suit all frames."""
    count, found = len(film.numbers), []
    for index in range(count):
        found.append(spread(film.codes(index), count))
        progress("colours", (index + 1) / count)
    strip = np.concatenate(found)[np.newaxis]
    return PIL.Image.fromarray(strip).quantize(COLOURS, method=PIL.Image.Quantize.MEDIANCUT)
