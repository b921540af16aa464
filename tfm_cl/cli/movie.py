"""``tfm movie``: rendered frames to a film or a contact sheet."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tfm_cl.cli.options import GroupedCommand, GroupedOption, as_flags, number_or_auto
from tfm_cl.cli.paths import TARGET
from tfm_cl.cli.progress import progress_bar
from tfm_cl.errors import ImageError
from tfm_cl.files import film_io
from tfm_cl.files.film_io import FilmOptions
from tfm_cl.files.film_io.frames import MISSING, Frame, Missing, frames_of
from tfm_cl.files.image_io import Exposure, WriteOptions
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.files.paths import check_readable, check_writable, real_path
from tfm_cl.files.patterns import FilePattern
from tfm_cl.sequence.ranges import frames_of as numbers_of

if TYPE_CHECKING:
    from tfm_cl.sequence.film import PicturesFilm

WIDEST = 1 << 14
"""Pixels."""
DEFAULTS = FilmOptions()
OPTIONS = {"fps": "--fps", "quality": "--quality", "contact_sheet": "--contact-sheet"}
"""Fields of `FilmOptions` and the flags that set them."""


def _cells(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Any:
    """``6x4``: columns and rows."""
    if text is None:
        return None
    columns, _, rows = text.lower().replace("×", "x").partition("x")
    if not (columns.isdecimal() and rows.isdecimal()):
        raise click.BadParameter(f"'{text}' is not COLUMNSxROWS, as 6x4")
    return int(columns), int(rows)


def _stops(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Any:
    return None if text is None else number_or_auto(text)


@click.command("movie", cls=GroupedCommand)
@click.argument("names", metavar="FRAMES...", nargs=-1, required=True)
@click.option(
    "-o",
    "out",
    metavar="OUT",
    required=True,
    type=TARGET,
    cls=GroupedOption,
    group="Output",
    help=".mp4 (H.264; needs pip install 'tfm_cl[movie]'), .gif, .webp, or .png: a contact sheet",
)
@click.option(
    "--frames",
    "asked",
    metavar="RANGE",
    cls=GroupedOption,
    group="Frames",
    help="of a pattern, as 1-100, 1-100x2 or 3,5-10, in this order  [all that are there]",
)
@click.option(
    "--missing",
    type=click.Choice(MISSING),
    default=MISSING[0],
    cls=GroupedOption,
    group="Frames",
    help="of frames that are not there. error; hold: the one before is shown; skip: the film is shorter  "
    f"[{MISSING[0]}]",
)
@click.option(
    "--exposure",
    metavar="STOPS|auto",
    callback=_stops,
    cls=GroupedOption,
    group="Frames",
    help="exposure in stops; auto: by how bright what is lit is, in all frames together  [what the first "
    ".exr was rendered with; else 0]",
)
@click.option(
    "--view",
    type=click.Choice(list(VIEWS)),
    cls=GroupedOption,
    group="Frames",
    help="how light is shown, as of tfm render  [as exposure; else standard]",
)
@click.option(
    "--width",
    metavar="PIXELS",
    type=click.IntRange(1, WIDEST),
    cls=GroupedOption,
    group="Film",
    help="width of a frame  [as it is; contact sheet: at most 240]",
)
@click.option(
    "--fps",
    metavar="N",
    type=click.FLOAT,
    cls=GroupedOption,
    group="Film",
    help=f"frames a second, not of a contact sheet  [{DEFAULTS.fps:g}]",
)
@click.option(
    "--quality",
    metavar="0-100",
    type=click.INT,
    cls=GroupedOption,
    group="Film",
    help=f"of .mp4 and .webp: larger is better and larger  [{DEFAULTS.quality}]",
)
@click.option(
    "--contact-sheet",
    metavar="COLUMNSxROWS",
    callback=_cells,
    cls=GroupedOption,
    group="Film",
    help="of a .png: most columns and rows; of more frames some are chosen, evenly  [{}x{}]".format(
        *DEFAULTS.contact_sheet
    ),
)
@click.option("-q", "quiet", is_flag=True, cls=GroupedOption, help="print errors only")
def command(
    names: tuple[str, ...],
    out: Path,
    asked: str | None,
    missing: Missing,
    exposure: Exposure | None,
    view: str | None,
    width: int | None,
    *,
    quiet: bool,
    **given: Any,
) -> None:
    """Make a film or a contact sheet of FRAMES: a pattern, as out.####.exr, or files (.exr .png .npy).

    \b
    tfm movie out.####.png -o film.mp4
    tfm movie out.####.exr -o film.webp --frames 1-100 --exposure auto --view agx
    tfm movie out.*.png -o sheet.png --contact-sheet 6x4
    """  # noqa: D301 - click wants the character \b, not its escape
    made = film_io.format_of(out)
    if FilePattern.of(out) is not None:
        raise click.UsageError(f"{out}: is a name of many frames, and a film is one; choose a plain name")
    options = _options(out, made.USES, given)
    made.check(options)
    frames = frames_of(names, None if asked is None else numbers_of(asked), missing)
    if real_path(out) in {real_path(frame.path) for frame in frames}:
        raise click.UsageError(f"{out}: is one of the frames; choose another name")
    check_writable(out)
    shown = _shown(frames, exposure, view)
    from tfm_cl.sequence.film import PicturesFilm  # noqa: PLC0415 - Pillow takes its time to import

    film = PicturesFilm.of(frames, shown, width)
    if width is None and made.WIDTH is not None and film.size[0] > made.WIDTH:
        film = PicturesFilm.of(frames, shown, made.WIDTH)
    with progress_bar(quiet=quiet) as progress:
        film = film.exposed(progress)
        if not quiet:
            _tell(film, exposure, view)
        film_io.save(out, film, options, progress)


def _options(out: Path, used: tuple[str, ...], given: dict[str, Any]) -> FilmOptions:
    """Return the options given; refuse those that would be ignored."""
    chosen = {name: value for name, value in given.items() if value is not None}
    for name in chosen:
        if name not in used:
            raise click.UsageError(
                f"{OPTIONS[name]}: makes no difference to {out.suffix.lower()} files; leave it out"
            )
    return FilmOptions(**chosen)


def _shown(frames: list[Frame], exposure: Exposure | None, view: str | None) -> WriteOptions:
    """Return exposure and view: those given, else those that the first frame was rendered with."""
    said = _as_rendered(frames[0].path)
    given: dict[str, Any] = {"exposure": exposure, "view": view}
    return WriteOptions(**said | {name: value for name, value in given.items() if value is not None})


def _as_rendered(path: Path) -> dict[str, Any]:
    """Return exposure and view of a picture that holds scene-linear light and says how it was rendered."""
    if path.suffix.lower() != ".exr":
        return {}
    from tfm_cl.files.image_io import exr  # noqa: PLC0415 - OpenEXR takes its time to import

    check_readable(path, ImageError)
    try:
        image = json.loads(exr.read_text(path, "tfm_cl:options") or "{}")["image"]
        found = {name: image[name] for name in ("exposure", "view")}
        WriteOptions(**found)
    except (ValueError, TypeError, LookupError, RecursionError, ImageError):
        return {}  # written by something else; what is wrong with its pixels is told when they are read
    return found


def _tell(film: "PicturesFilm", exposure: Exposure | None, view: str | None) -> None:
    """Say what was chosen, as flags."""
    used = film.options
    chosen: dict[str, Any] = {}
    if exposure in {None, "auto"} and used.exposure != WriteOptions.exposure:
        chosen["image.exposure"] = used.exposure
    if view is None and used.view != WriteOptions.view:
        chosen["image.view"] = used.view
    if chosen:
        print(f"chosen for {len(film.frames)} frames: {as_flags(chosen)}", file=sys.stderr)
