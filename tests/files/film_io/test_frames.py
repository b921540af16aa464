"""Which files are a film's frames, in which order, and what is said of those that are missing."""

from pathlib import Path

import pytest

from tfm_cl.errors import ImageError
from tfm_cl.files.film_io.frames import MOST_FRAMES, frames_of


@pytest.fixture
def files(tmp_path, monkeypatch):
    """``files(name, …)`` makes files in the working directory."""
    monkeypatch.chdir(tmp_path)

    def make(*names):
        for name in names:
            Path(name).touch()

    return make


@pytest.mark.parametrize(
    ("there", "names", "asked", "missing", "expected"),
    [
        ((1, 2, 10), ["a.#.png"], None, "skip", [(1, 1), (2, 2), (10, 10)]),
        ((2, 4, 8), ["a.#.png"], None, "hold", [(2, 2), (4, 4), (6, 4), (8, 8)]),
        ((2, 3), ["a.%04d.png"], (1, 2, 3, 4), "hold", [(1, 2), (2, 2), (3, 3), (4, 3)]),
        ((2, 3), ["a.$F4.png"], (3, 2, 1), "skip", [(3, 3), (2, 2)]),
        ((1, 2, 10), ["a.0010.png", "a.0001.png", "a.0002.png"], None, "skip", [(1, 1), (2, 2), (10, 10)]),
        ((5,), ["a.0005.png"], None, "error", [(5, 5)]),
    ],
    ids=["pattern", "every second", "asked for", "backwards", "files", "one file"],
)
def test_frames(files, there, names, asked, missing, expected):
    files(*(f"a.{number:04d}.png" for number in there))
    found = [(frame.number, frame.path.name) for frame in frames_of(names, asked, missing)]
    assert found == [(number, f"a.{shown:04d}.png") for number, shown in expected]


@pytest.mark.parametrize("names", [["b.png", "a.png"], ["a_1.png", "b_2.png"], ["a.png", "a.png"]])
def test_files_without_numbers_of_their_own_stay_as_they_are(names):
    assert [(frame.number, frame.path.name) for frame in frames_of(names)] == list(enumerate(names, 1))


def test_numbers_below_0():
    names = ["a.-001.png", "a.0000.png", "a.-002.png", "a.0001.png"]
    assert [frame.number for frame in frames_of(names)] == [-2, -1, 0, 1]


@pytest.mark.parametrize(
    ("names", "asked", "said"),
    [
        (["a.####.png"], None, "a.####.png: no frame 3; render what is missing, or add --missing hold"),
        (["a.####.png"], (1, 5, 6, 7), "a.####.png: no frame 5-7; "),
        (["a.0001.png", "a.0002.png", "a.0004.png"], None, "a.0001.png to a.0004.png: no frame 3; "),
        (["b.####.png"], None, "b.####.png: no such files"),
        (["a.0001.png"], (1, 2), "a.0001.png: has no place for the numbers of frames"),
        (["a.0.png", "a.1.png", f"a.{MOST_FRAMES}.png"], None, "are too far apart to be of one film"),
    ],
)
def test_what_is_missing_is_told(files, names, asked, said):
    files("a.0001.png", "a.0002.png", "a.0004.png")
    with pytest.raises(ImageError) as error:
        frames_of(names, asked)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
