"""Contact sheet: frames of a film in rows on one picture, each with its number below."""

from pathlib import Path

import numpy as np
import PIL.Image
import PIL.ImageDraw
import PIL.ImageFont

from tfm_cl.files.film_io.film import EncodingError, Film, FilmOptions, Progress

USES = ("contact_sheet",)
WIDTH = 240

PAPER, INK = (24, 24, 24), (200, 200, 200)
GAP, LABEL, TEXT = 6, 18, 13
"""Pixels between frames, of the line below one, and of the size of its text."""
MOST_PIXELS = 1 << 28


def check(options: FilmOptions) -> None:
    """Anything goes."""
    del options


def chosen(count: int, cells: int) -> list[int]:
    """Return which of so many frames have a place: the first, the last, and those between evenly."""
    if count <= cells:
        return list(range(count))
    return [int(index) for index in np.linspace(0, count - 1, cells).round()]


def write(path: Path, film: Film, options: FilmOptions, progress: Progress) -> None:
    """Write the sheet, no larger than its frames need."""
    columns, rows = options.contact_sheet
    indices = chosen(len(film.numbers), columns * rows)
    columns = min(columns, len(indices))
    rows = -(-len(indices) // columns)
    width, height = film.size
    across, down = width + GAP, height + LABEL + GAP
    size = columns * across + GAP, rows * down + GAP
    if size[0] * size[1] > MOST_PIXELS:
        raise EncodingError(f"a sheet of {size[0]}×{size[1]} pixels is too large; make its frames smaller")
    sheet = PIL.Image.new("RGB", size, PAPER)
    draw, font = PIL.ImageDraw.Draw(sheet), PIL.ImageFont.load_default(TEXT)
    for place, index in enumerate(indices):
        x, y = GAP + place % columns * across, GAP + place // columns * down
        sheet.paste(PIL.Image.fromarray(film.codes(index)), (x, y))
        middle = x + width / 2, y + height + LABEL / 2 + 1
        draw.text(middle, str(film.numbers[index]), INK, font, anchor="mm")
        progress("film", (place + 1) / len(indices))
    with path.open("wb") as stream:
        sheet.save(stream, format="PNG")
