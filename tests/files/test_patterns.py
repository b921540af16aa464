"""Names with a frame's number in them, against the documents of those who use them."""

from pathlib import Path

import pytest
from fileseq import FileSequence
from fileseq.constants import PAD_STYLE_HASH1, PAD_STYLE_HASH4

from tfm_cl.files.patterns import MOST_SHOWN, FilePattern, shown_frames


@pytest.mark.parametrize(
    ("name", "frame", "file"),
    [
        # Nuke and Blender: a run of # is as many digits; Houdini's and Nuke's # alone are four.
        ("out.####.exr", 7, "out.0007.exr"),
        ("out.#.exr", 7, "out.0007.exr"),
        ("out.##.exr", 7, "out.07.exr"),
        ("out.#####.exr", 7, "out.00007.exr"),
        ("out.########.exr", 7, "out.00000007.exr"),
        # Larger numbers have as many digits as they need, in all of them.
        ("out.##.exr", 1234, "out.1234.exr"),
        ("out.####.exr", 123456, "out.123456.exr"),
        # C's printf, as in Nuke and FFmpeg.
        ("out.%04d.exr", 7, "out.0007.exr"),
        ("out.%d.exr", 7, "out.7.exr"),
        ("out.%02d.exr", 123, "out.123.exr"),
        ("out.%04d.exr", -5, "out.-005.exr"),
        ("out.####.exr", -5, "out.-005.exr"),
        # Houdini.
        ("out.$F4.exr", 7, "out.0007.exr"),
        ("out.$F.exr", 7, "out.7.exr"),
        ("out.${F4}.exr", 7, "out.0007.exr"),
        ("shot${F}b.exr", 7, "shot7b.exr"),
        ("out$F4_b.exr", 7, "out0007_b.exr"),
        # In folders too.
        ("sim.####/smoke.####.vdb", 7, "sim.0007/smoke.0007.vdb"),
    ],
)
def test_frames_have_the_names_that_their_conventions_say(name, frame, file):
    pattern = FilePattern.of(name)

    assert pattern.at(frame) == file
    assert pattern.frame_of(file) == frame


@pytest.mark.parametrize(
    ("name", "style"),
    [
        ("out.####.exr", PAD_STYLE_HASH1),
        ("out.##.exr", PAD_STYLE_HASH1),
        ("out.#.exr", PAD_STYLE_HASH4),
        ("out.%04d.exr", PAD_STYLE_HASH4),
        ("out.$F4.exr", PAD_STYLE_HASH4),
    ],
)
@pytest.mark.parametrize("frame", [7, -5, 12345])
def test_fileseq_calls_files_the_same(name, style, frame):
    """In its style of a digit for each #; a lone one is four in its other style, of Houdini and Nuke."""
    theirs = FileSequence(name, pad_style=style, allow_subframes=False)

    assert FilePattern.of(name).at(frame) == theirs.frame(frame)


@pytest.mark.parametrize(
    "name", ["out.exr", "50%.exr", "a%4d.exr", "$FF.exr", "$FPS.exr", "$Farm.exr", "%s", ""]
)
def test_other_names_are_no_patterns(name):
    assert FilePattern.of(name) is None


@pytest.mark.parametrize(
    "other", ["out.7.exr", "out.00007.exr", "out.0007.png", "out.-0007.exr", "a/out.0007.exr"]
)
def test_names_of_other_files_are_none_of_a_pattern(other):
    assert FilePattern.of("out.####.exr").frame_of(other) is None


def test_all_places_are_of_one_frame():
    assert FilePattern.of("####/a.####.vdb").frame_of("0001/a.0002.vdb") is None


def test_what_is_really_called_so_is_no_pattern(tmp_path):
    (tmp_path / "take #2").mkdir()
    (tmp_path / "smoke#.vdb").touch()

    assert FilePattern.of("smoke#.vdb", tmp_path) is None
    assert FilePattern.of("take #2/smoke.vdb", tmp_path) is None
    assert FilePattern.of("take #2/a.##.vdb", tmp_path).at(3) == "take #2/a.03.vdb"


def test_frames_that_are_there_are_found(tmp_path):
    for name in (
        "a.0003.vdb",
        "a.0001.vdb",
        "a.-002.vdb",
        "a.12345.vdb",
        "a.00009.vdb",
        "b.0004.vdb",
        "a.xx.vdb",
    ):
        (tmp_path / name).touch()
    for frame in (1, 2):
        (tmp_path / f"s.{frame}").mkdir()
    (tmp_path / "s.2" / "a.2.vdb").touch()

    assert FilePattern.of("a.####.vdb", tmp_path).frames_in(tmp_path) == (-2, 1, 3, 12345)
    assert FilePattern.of("s.%d/a.%d.vdb", tmp_path).frames_in(tmp_path) == (2,)
    assert FilePattern.of(tmp_path / "a.####.vdb").frames_in() == (-2, 1, 3, 12345)
    assert FilePattern.of("none/a.####.vdb", tmp_path).frames_in(tmp_path) == ()


def test_many_frames_are_shown_shortly():
    assert shown_frames((5, 1, 2, 3)) == "1-3,5"
    assert len(shown_frames(range(0, 100_000, 7))) <= MOST_SHOWN
    assert len(shown_frames([n * n for n in range(1000)])) <= MOST_SHOWN + 2


def test_a_name_that_no_system_takes_is_a_pattern_without_files():
    pattern = FilePattern.of("a" * 5000 + "####", Path())

    assert pattern.frames_in() == ()
