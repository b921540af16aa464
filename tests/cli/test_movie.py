"""``tfm movie``."""

import json

import numpy as np
import PIL.Image
import pytest

from tfm_cl.cli import movie
from tfm_cl.files import image_io
from tfm_cl.files.film_io.frames import Frame
from tfm_cl.files.image_io import Image


@pytest.fixture
def frames(folder, rng):
    """Three frames, ``a.0001.exr`` …, that say how they were rendered."""
    said = json.dumps({"image": {"exposure": 1.5, "view": "agx"}})
    for number in (1, 2, 3):
        pixels = rng.random((9, 16, 4)).astype(np.float32)
        image = Image(rgba=pixels, metadata={"tfm_cl:options": said} if number == 1 else {})
        image_io.save(folder / f"a.{number:04d}.exr", image)
    return "a.####.exr"


@pytest.mark.parametrize("name", ["film.mp4", "film.gif", "film.webp", "sheet.png"])
def test_films(cli, folder, frames, name):
    if name.endswith("mp4"):
        pytest.importorskip("imageio_ffmpeg", reason="pip install 'tfm_cl[movie]'")
    done = cli("movie", frames, "-o", name)
    assert (done.code, done.out) == (0, "")
    assert done.err == "chosen for 3 frames: --exposure 1.5 --view agx\n"
    assert (folder / name).stat().st_size > 100
    assert len(list(folder.iterdir())) == 4


def test_options_win_over_what_a_frame_says(cli, folder, frames):
    image_io.save("a.0001.png", Image(rgba=image_io.load_image("a.0001.exr")), exposure=-2.0)
    assert cli("movie", frames, "-o", "b.png", "--exposure", "-2", "--view", "standard").err == ""
    assert cli("movie", "a.0001.png", "-o", "c.png", "-q").err == ""
    sheets = [np.asarray(PIL.Image.open(folder / name))[6:15, 6:22] for name in ("b.png", "c.png")]
    assert (sheets[0] == sheets[1]).all()


def test_auto_exposure_is_told(cli, frames):
    done = cli("movie", frames, "-o", "film.gif", "--exposure", "auto", "--frames", "3,1")
    assert done.err.startswith("chosen for 2 frames: --exposure -")


def test_what_others_write_into_a_frame_is_no_matter(folder):
    for text in ("[]", "{", '{"image": 3}', '{"image": {"exposure": 1e9, "view": "agx"}}', "[" * 100_000):
        picture = Image(rgba=np.zeros((2, 2, 4), np.float32), metadata={"tfm_cl:options": text})
        image_io.save(folder / "a.exr", picture)
        shown = movie._shown([Frame(1, folder / "a.exr")], None, None)
        assert (shown.exposure, shown.view) == (0.0, "standard")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-o", "film.avi"), "film.avi: not a known film format '.avi'"),
        (("-o", "film.gif", "--quality", "50"), "--quality: makes no difference to .gif files; leave it out"),
        (("-o", "film.gif", "--contact-sheet", "2x2"), "--contact-sheet: makes no difference to .gif files"),
        (("-o", "sheet.png", "--fps", "25"), "--fps: makes no difference to .png files; leave it out"),
        (("-o", "sheet.png", "--contact-sheet", "six"), "'six' is not COLUMNSxROWS, as 6x4"),
        (("-o", "film.gif", "--frames", "1-5"), "a.####.exr: no frame 4-5; render what is missing"),
        (("-o", "film.gif", "--frames", "one"), "'one'"),
        (("-o", "film.gif", "--view", "flat"), "'flat' is not one of"),
        (("-o", "film.gif", "--exposure", "bright"), "'bright' is not a number"),
        (("-o", "film.####.gif"), "film.####.gif: is a name of many frames, and a film is one;"),
        (("-o", "no/film.gif"), "no/film.gif: there is no directory"),
    ],
)
def test_bad_input_is_refused(refused, frames, arguments, said):
    assert said in refused("movie", frames, *arguments)


def test_a_frame_is_not_replaced(refused, frames):
    image_io.save("a.0001.png", Image(rgba=image_io.load_image("a.0001.exr")))
    assert "is one of the frames" in refused("movie", "a.####.png", "-o", "a.0001.png")
    assert frames
