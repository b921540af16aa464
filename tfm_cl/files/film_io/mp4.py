"""MP4: H.264 as all players take it (4:2:0, 8 bits), by the ffmpeg that imageio-ffmpeg brings or finds.

imageio-ffmpeg's own writer does not look at ffmpeg's exit code, and a disk may be full.
"""

import contextlib
import re
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import IO, cast

import numpy as np

from tfm_cl.errors import ImageError
from tfm_cl.extras import needs
from tfm_cl.files.film_io.film import EncodingError, Film, FilmOptions, Progress
from tfm_cl.files.paths import reason_of
from tfm_cl.interrupts import interrupts_held

USES = ("fps", "quality")
WIDTH = None

_CRF = 50, 8
"""x264's constant rate factor for a quality of 0 and of 100; at 0 it would be lossless, which few players
take."""
_RATES = 1001
"""Largest denominator of rates, as of 24000/1001 frames a second."""
_MOST_TOLD = 1 << 16
"""Bytes of its errors that are read."""


def check(options: FilmOptions) -> None:
    """Find out whether there is an ffmpeg."""
    del options
    _ffmpeg()


def write(path: Path, film: Film, options: FilmOptions, progress: Progress) -> None:
    """Encode the frames; to sizes that are odd a column or a row is added, which repeats the last."""
    width, height = film.size
    odd = height % 2, width % 2
    with _encoder(path, (width + odd[1], height + odd[0]), options) as frames:
        for index in range(len(film.numbers)):
            codes = np.pad(film.codes(index), ((0, odd[0]), (0, odd[1]), (0, 0)), mode="edge")
            frames.write(codes.tobytes())
            progress("film", (index + 1) / len(film.numbers))


def _ffmpeg() -> str:
    with needs("movie", ".mp4", ImageError):
        import imageio_ffmpeg  # noqa: PLC0415 - an extra
    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError as error:
        raise ImageError(f".mp4 needs ffmpeg: {' '.join(str(error).split())}") from None


def _arguments(path: Path, size: tuple[int, int], options: FilmOptions) -> list[str]:
    rate = str(Fraction(options.fps).limit_denominator(_RATES))
    crf = round(_CRF[0] + (_CRF[1] - _CRF[0]) * options.quality / 100)
    given = f"-f rawvideo -pix_fmt rgb24 -s {size[0]}x{size[1]} -r {rate} -i -"
    # Players take what says nothing for Rec. 709 if it is large, and for Rec. 601 if it is small.
    filters = (
        "scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+full_chroma_int",
        "format=yuv420p",
        "setparams=colorspace=bt709:color_primaries=bt709:color_trc=iec61966-2-1:range=tv",
    )
    coded = f"-an -vf {','.join(filters)} -c:v libx264 -crf {crf} -movflags +faststart -f mp4"
    return ["-y", "-v", "error", *given.split(), *coded.split(), f"file:{path}"]


@contextmanager
def _encoder(path: Path, size: tuple[int, int], options: FilmOptions) -> Iterator[IO[bytes]]:
    """Give a stream of raw frames that ffmpeg encodes; it ends with the block, whatever happens there."""
    with tempfile.TemporaryFile() as told:
        process, frames = _started([_ffmpeg(), *_arguments(path, size, options)], told)
        try:
            with contextlib.suppress(BrokenPipeError):  # it has ended already, and told why
                yield frames
                frames.close()
            code = process.wait()
        finally:
            process.kill()
            process.wait()
            with contextlib.suppress(OSError):
                frames.close()
        if not code and not (path.is_file() and path.stat().st_size):
            raise EncodingError("ffmpeg failed (it ended without a film)")
        if code:
            told.seek(0)
            raise EncodingError(f"ffmpeg failed ({_reason(told.read(_MOST_TOLD)) or f'exit code {code}'})")


def _started(command: list[str], told: IO[bytes]) -> tuple[subprocess.Popen[bytes], IO[bytes]]:
    try:
        with interrupts_held():  # Ctrl-C is for us, who end it
            process = subprocess.Popen(  # noqa: S603 - ffmpeg
                command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=told
            )
    except OSError as error:
        raise ImageError(f"{command[0]}: cannot be started ({reason_of(error)})") from error
    return process, cast("IO[bytes]", process.stdin)


def _reason(told: bytes) -> str:
    """Return the first line of ffmpeg's errors, without the part of it that speaks."""
    lines = told.decode(errors="replace").split("\n")
    return re.sub(r"^\[[^]]* @ [^]]*\] *", "", lines[0]).strip()
