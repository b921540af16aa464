"""Frames that Pillow asks for one after the other, as it reads those of an animation."""

from collections.abc import Callable
from typing import Any

import PIL.Image

from tfm_cl.files.film_io.film import EncodingError, Film, Progress
from tfm_cl.files.paths import reason_of

Made = Callable[[int], PIL.Image.Image]


class Animation(PIL.Image.Image):
    """A picture of several frames, of which one is in memory.

    Parameters
    ----------
    film
        Its frames.
    made
        Makes a frame, counted from 0.
    progress
        Is told how far Pillow is.
    """

    def __init__(self, film: Film, made: Made, progress: Progress) -> None:
        super().__init__()
        self.n_frames = len(film.numbers)
        self._made, self._progress, self._at = made, progress, -1
        self.seek(0)

    def tell(self) -> int:
        """Return the number of the frame that is in memory."""
        return self._at

    def seek(self, frame: int) -> None:
        """Make a frame; raises `EOFError` after the last."""
        if frame >= self.n_frames:
            raise EOFError
        if frame == self._at:
            return
        picture = self._made(frame)
        self.im, self._mode, self._size = picture.im, picture.mode, picture.size
        self.palette, self._at = picture.palette, frame
        self._progress("film", (frame + 1) / self.n_frames)


def save(animation: Animation, stream: Any, kind: str, **options: Any) -> None:
    """Write all frames, for ever.

    Raises
    ------
    EncodingError
        The format does not take them.
    """
    try:
        animation.save(stream, format=kind, save_all=True, loop=0, **options)
    except (ValueError, RuntimeError) as error:
        raise EncodingError(f"Pillow cannot write it ({reason_of(error)})") from error
