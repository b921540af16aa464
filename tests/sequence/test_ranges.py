"""Ranges of frames, against the documents of fileseq, OpenCue, Nuke and Flamenco."""

import pytest

from tfm_cl.errors import InputError
from tfm_cl.sequence.ranges import frames_of


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("47", [47]),
        ("1-5", [1, 2, 3, 4, 5]),
        ("1-10x3", [1, 4, 7, 10]),
        ("1-10x4", [1, 5, 9]),
        ("5-1", [5, 4, 3, 2, 1]),
        ("10-1x3", [10, 7, 4, 1]),
        ("3, 5-7,47-49", [3, 5, 6, 7, 47, 48, 49]),  # Flamenco's
        ("1-3 7-8", [1, 2, 3, 7, 8]),  # Nuke's
        ("-3--1", [-3, -2, -1]),
        ("-1-1", [-1, 0, 1]),
        ("1-10y3", [2, 3, 5, 6, 8, 9]),  # OpenCue's: all others
        ("1-10:3", [1, 4, 7, 10, 3, 5, 9, 2, 6, 8]),  # OpenCue's: interleaved
        ("1-3,2-5", [1, 2, 3, 4, 5]),
        ("007-009", [7, 8, 9]),
    ],
)
def test_ranges_are_read(text, frames):
    assert list(frames_of(text)) == frames


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "''"),
        (",", "','"),
        ("a", "'a': is no range of frames"),
        ("1-", "'1-'"),
        ("1..10", "'1..10'"),
        ("1-10x", "'1-10x'"),
        ("1-10x0", "step of 0"),
        ("1-10x-2", "'1-10x-2'"),
        ("1.5", "'1.5'"),
        ("1-nan", "'1-nan'"),
        ("1-99999999999", "numbers up to"),
        ("9" * 5000, "is no range of frames"),
        ("1-2000000", "more than 1,000,000 frames"),
        ("1-600000,1-600000", "more than 1,000,000 frames"),
    ],
)
def test_what_is_none_is_told_in_a_line(text, said):
    with pytest.raises(InputError) as error:
        frames_of(text)

    assert said in str(error.value)
    assert "\n" not in str(error.value)
