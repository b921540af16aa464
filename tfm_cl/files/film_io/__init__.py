"""Films and contact sheets of frames: one module per format, selected by the file's extension.

To add a format, write a module with ``USES``, ``check`` and ``write`` (see `FilmFormat`) and add it to
``FORMATS``.
"""

import importlib
from pathlib import Path
from typing import Protocol, cast

from tfm_cl.errors import ImageError
from tfm_cl.files.film_io.film import EncodingError, Film, FilmOptions, Progress
from tfm_cl.files.paths import replacing

FORMATS: dict[str, str] = {".mp4": ".mp4", ".gif": ".gif", ".webp": ".webp", ".png": ".contact_sheet"}
"""Modules by file extension, as ``.NAME``; imported when one is met."""

__all__ = ["FORMATS", "Film", "FilmOptions", "Progress", "format_of", "save"]


class FilmFormat(Protocol):
    """A module of this package that writes one kind of file."""

    USES: tuple[str, ...]
    """Names of the `FilmOptions` that apply to it."""
    WIDTH: int | None
    """Of a frame, pixels, unless another is asked for; None: as it is."""

    def check(self, options: FilmOptions) -> None:
        """Refuse options that the format has no room for, and say what is not installed."""
        ...

    def write(self, path: Path, film: Film, options: FilmOptions, progress: Progress) -> None:
        """Write to an empty file; may leave it incomplete if it raises."""
        ...


def format_of(path: Path) -> FilmFormat:
    """Return the module that writes a file of that name.

    Raises
    ------
    ImageError
        Unknown extension.
    """
    name = FORMATS.get(path.suffix.lower())
    if name is None:
        raise ImageError(
            f"{path}: not a known film format '{path.suffix}'; known: {' '.join(FORMATS)} (a contact sheet)"
        )
    return cast("FilmFormat", importlib.import_module(name, __name__))


def save(path: Path, film: Film, options: FilmOptions, progress: Progress) -> None:
    """Write a film, whole or not at all; the extension determines the format.

    Parameters
    ----------
    path
        ``.mp4`` (H.264), ``.gif``, ``.webp`` or ``.png`` (a contact sheet).
    film
        The frames, of which one is in memory at a time.
    options
        Those that the format ``USES`` count.
    progress
        Is told how far the film is.

    Raises
    ------
    ImageError
        Unknown extension, a frame that cannot be read, or the file cannot be written.
    """
    module = format_of(path)
    module.check(options)
    with replacing(path, ImageError) as temporary:
        try:
            module.write(temporary, film, options, progress)
        except EncodingError as error:
            raise ImageError(f"{path}: {error}") from error
