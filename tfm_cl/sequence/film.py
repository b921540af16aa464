"""A film of picture files, shown as a PNG shows them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from tfm_cl.errors import ImageError
from tfm_cl.files.film_io import Progress
from tfm_cl.files.film_io.frames import Frame
from tfm_cl.files.film_io.sampling import spread
from tfm_cl.files.image_io import MAX_PIXELS, WriteOptions, load_picture
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.files.image_io.image import Window, check_finite
from tfm_cl.files.image_io.png import codes_shown


@dataclass(frozen=True)
class PicturesFilm:
    """A `tfm_cl.files.film_io.Film` of files, of which one is in memory at a time.

    What is shown is the full frame where a file states it; what its pixels do not cover is black.
    """

    frames: Sequence[Frame]
    options: WriteOptions
    """Exposure and view."""
    full_size: tuple[int, int]
    """(width, height) of the pictures."""
    size: tuple[int, int]
    """(width, height) of the film."""

    @classmethod
    def of(cls, frames: Sequence[Frame], options: WriteOptions, width: int | None = None) -> "PicturesFilm":
        """Make a film of frames.

        Parameters
        ----------
        frames
            The files, of which the first is read for its size.
        options
            With an exposure of ``"auto"``, call `exposed` before a frame is asked for.
        width
            Of the film, pixels; the height follows. None: as wide as the pictures.

        Raises
        ------
        ImageError
            The first file cannot be read, or the film would be too large.
        """
        pixels = _full(frames[0].path)
        full = pixels.shape[1], pixels.shape[0]
        size = full if width is None else (width, max(round(width * full[1] / full[0]), 1))
        if size[0] * size[1] > MAX_PIXELS:
            raise ImageError(f"a film of {size[0]}×{size[1]} pixels is too large; take a smaller width")
        return cls(frames, options, full, size)

    @property
    def numbers(self) -> list[int]:
        """Numbers of the frames."""
        return [frame.number for frame in self.frames]

    def exposed(self, progress: Progress) -> "PicturesFilm":
        """Return the film with one exposure for all frames, where that is to be chosen.

        It is what `automatic_exposure` chooses for a picture of all frames side by side, from pixels all
        over them.
        """
        if self.options.exposure != "auto":
            return self
        count, found = len(self.frames), []
        for index in range(count):
            pixels = self._pixels(index)
            if pixels.shape[-1] == 3:  # noqa: PLR2004 - red, green, blue
                pixels = np.concatenate([pixels, np.ones((*pixels.shape[:2], 1), np.float32)], axis=2)
            found.append(spread(pixels, count))
            progress("exposure", (index + 1) / count)
        stops = automatic_exposure(np.concatenate(found), self.options.view)
        return replace(self, options=replace(self.options, exposure=stops))

    def codes(self, index: int) -> NDArray[np.uint8]:
        """As `Film.codes`."""
        shown = codes_shown(self._pixels(index), self.options).astype(np.uint8)
        if self.size == self.full_size:
            return shown
        resized = PIL.Image.fromarray(shown).resize(self.size, PIL.Image.Resampling.LANCZOS)
        return np.asarray(resized, np.uint8)

    def _pixels(self, index: int) -> NDArray[np.float32]:
        """Read a frame: finite, [H, W, 3 or 4]."""
        path = self.frames[index].path
        pixels = _full(path)
        size = pixels.shape[1], pixels.shape[0]
        if size != self.full_size:
            first, (width, height) = self.frames[0].path, self.full_size
            raise ImageError(
                f"{path}: is {size[0]}×{size[1]} pixels, and {first} is {width}×{height}; the frames of a "
                "film are of one size"
            )
        check_finite(pixels, f"{path}:")
        return pixels


def _full(path: Path) -> NDArray[np.float32]:
    """Read the pixels of the full frame; those beyond it are left out, and what is not there is black."""
    picture = load_picture(path)
    if picture.frame is None or picture.window is None or picture.frame == picture.window:
        return picture.pixels
    x0, y0, x1, y1 = picture.frame
    if x0 >= x1 or y0 >= y1 or (x1 - x0) * (y1 - y0) > MAX_PIXELS:
        raise ImageError(f"{path}: declares a full frame of {x1 - x0}×{y1 - y0} pixels; it is damaged")
    full = np.zeros((y1 - y0, x1 - x0, picture.pixels.shape[2]), np.float32)
    part = _common(picture.frame, picture.window)
    if part is not None:
        left, top, right, bottom = part
        full[top - y0 : bottom - y0, left - x0 : right - x0] = picture.part(part)
    return full


def _common(one: Window, other: Window) -> Window | None:
    x0, y0 = max(one[0], other[0]), max(one[1], other[1])
    x1, y1 = min(one[2], other[2]), min(one[3], other[3])
    return (x0, y0, x1, y1) if x0 < x1 and y0 < y1 else None
