"""Films hold the frames that they were given, as long as each is to be shown, or are not there at all."""

import importlib
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from tolerances import FILM_CODES

from tfm_cl.errors import ImageError
from tfm_cl.files import film_io
from tfm_cl.files.film_io import FilmOptions
from tfm_cl.files.film_io.contact_sheet import GAP, LABEL, PAPER, chosen
from tfm_cl.files.film_io.sampling import MOST_PIXELS, spread

COLOURS = np.array([[200, 120, 60], [30, 90, 160], [128, 128, 128], [12, 200, 40], [90, 10, 90]], np.uint8)
SIZE = 33, 21
"""Odd, which H.264 does not know."""


@dataclass(frozen=True)
class Plain:
    """Frames of one colour each."""

    numbers: tuple[int, ...] = (1, 2, 3, 4, 5)
    size: tuple[int, int] = SIZE

    def codes(self, index):
        return np.broadcast_to(COLOURS[index], (self.size[1], self.size[0], 3)).copy()


def save(path, film=None, **options):
    film_io.save(path, film or Plain(), FilmOptions(**options), lambda _stage, _part: None)


def shown(path):
    """Frames that Pillow finds in a file, and how many milliseconds each is shown."""
    frames, durations = [], []
    with PIL.Image.open(path) as film:
        for index in range(film.n_frames):
            film.seek(index)
            film.load()
            frames.append(np.asarray(film.convert("RGB")))
            durations.append(film.info["duration"])
        assert film.info["loop"] == 0
    return np.stack(frames), durations


@pytest.mark.parametrize("extension", [".gif", ".webp"])
def test_animations(tmp_path, extension):
    save(tmp_path / f"film{extension}")
    frames, durations = shown(tmp_path / f"film{extension}")

    assert frames.shape == (5, 21, 33, 3)
    assert np.abs(frames - COLOURS[:, None, None].astype(int)).max() <= FILM_CODES
    unit = 10 if extension == ".gif" else 1
    assert abs(sum(durations) - 5000 / 24) <= unit


def test_mp4(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="pip install 'tfm_cl[movie]'")
    save(tmp_path / "film.mp4", fps=23.976)
    decode = [
        ffmpeg.get_ffmpeg_exe(),
        "-i",
        tmp_path / "film.mp4",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    ]
    done = subprocess.run(decode, capture_output=True, check=True)
    frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, 22, 34, 3)

    about = next(line for line in done.stderr.decode().splitlines() if "Video: h264" in line)
    assert "yuv420p(tv, bt709/bt709/iec61966-2-1" in about
    assert "34x22" in about
    assert "23.98 fps" in about
    assert len(frames) == len(COLOURS)
    # The last row and column were added.
    assert np.abs(frames - COLOURS[:, None, None].astype(int)).max() <= FILM_CODES


@pytest.mark.skipif(importlib.util.find_spec("fcntl") is None, reason="a script as POSIX runs it")
@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("echo '[vost#0:0 @ 0x55] No space left on device' >&2; exit 1", "No space left on device"),
        ("cat >/dev/null; exit 7", "exit code 7"),
        ("cat >/dev/null; exit 0", "it ended without a film"),
        ("exit 0", "it ended without a film"),
    ],
)
def test_ffmpeg_that_fails_is_told_in_a_line(tmp_path, monkeypatch, script, said):
    pytest.importorskip("imageio_ffmpeg", reason="pip install 'tfm_cl[movie]'")
    program = tmp_path / "ffmpeg"
    program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))

    with pytest.raises(ImageError) as error:
        save(tmp_path / "film.mp4")

    assert str(error.value) == f"{tmp_path / 'film.mp4'}: ffmpeg failed ({said})"
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.parametrize("extension", [".mp4", ".gif", ".webp", ".png"])
def test_nothing_is_left_of_a_film_that_is_interrupted(tmp_path, extension):
    if extension == ".mp4":
        pytest.importorskip("imageio_ffmpeg", reason="pip install 'tfm_cl[movie]'")

    class Interrupted(Plain):
        def codes(self, index):
            if index == 3:
                raise KeyboardInterrupt
            return super().codes(index)

    (tmp_path / f"film{extension}").write_bytes(b"before")
    with pytest.raises(KeyboardInterrupt):
        save(tmp_path / f"film{extension}", Interrupted())

    (left,) = tmp_path.iterdir()
    assert left.read_bytes() == b"before"


def test_contact_sheet(tmp_path):
    save(tmp_path / "sheet.png", contact_sheet=(3, 4))
    sheet = np.asarray(PIL.Image.open(tmp_path / "sheet.png"))

    width, height = SIZE
    assert sheet.shape == (2 * (height + LABEL + GAP) + GAP, 3 * (width + GAP) + GAP, 3)
    for place, colour in enumerate(COLOURS):
        x, y = GAP + place % 3 * (width + GAP), GAP + place // 3 * (height + LABEL + GAP)
        assert (sheet[y : y + height, x : x + width] == colour).all()
        label = sheet[y + height : y + height + LABEL, x : x + width]
        assert (label.max(axis=(0, 1)) > 2 * np.array(PAPER)).all()
    assert (sheet[:GAP] == PAPER).all()


@pytest.mark.parametrize(
    ("count", "cells", "expected"), [(3, 4, [0, 1, 2]), (9, 3, [0, 4, 8]), (100, 2, [0, 99]), (5, 1, [0])]
)
def test_frames_of_a_sheet_are_spread_evenly(count, cells, expected):
    assert chosen(count, cells) == expected


@pytest.mark.parametrize("fps", [24, 25, 23.976, 60, 240])
def test_durations_add_up(fps):
    durations = FilmOptions(fps=fps).milliseconds(100)
    assert abs(sum(durations) - 100_000 / fps) <= 0.5
    assert max(durations) - min(durations) <= 1


def test_few_pixels_stand_for_all():
    frame = np.arange(5000 * 1000 * 3, dtype=np.float32).reshape(5000, 1000, 3)
    few = spread(frame, 10)
    assert few.shape == (MOST_PIXELS // 10, 3)
    assert np.allclose(few.mean(), frame.mean(), rtol=1e-3)
    assert spread(frame[:4], 10).shape == (4000, 3)


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("film.avi", {}, "not a known film format '.avi'; known: .mp4 .gif .webp .png"),
        ("film.gif", {"fps": 60}, "a .gif has at most 50 frames a second; got 60"),
        ("film.webp", {"fps": 0}, "fps is a number of frames a second from 0.1 to 240; got 0"),
        ("film.webp", {"fps": float("nan")}, "fps is a number of frames a second"),
        ("film.webp", {"quality": 101}, "quality is a number from 0 to 100; got 101"),
        ("sheet.png", {"contact_sheet": (0, 4)}, "a contact sheet has 1 to 100 columns and rows; got 0x4"),
    ],
)
def test_bad_options_are_refused(tmp_path, name, options, said):
    with pytest.raises(ImageError) as error:
        save(tmp_path / name, **options)
    assert said in str(error.value)
    assert not list(Path(tmp_path).iterdir())
