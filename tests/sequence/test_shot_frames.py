"""What a frame is read with."""

import os
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.sequence.names import Files
from tfm_cl.sequence.shot import Shot
from tfm_cl.sequence.shot_frames import ShotFrames


@pytest.fixture
def frames(tmp_path):
    """Frames of a volume of its own in each, ``smoke.#.npy``, that note which frame each is read like."""
    for frame in (1, 2):
        np.save(tmp_path / f"smoke.{frame}.npy", blobs())
    (tmp_path / "scene.toml").write_text(
        'volume = [{ file = "smoke.%d.npy" }, { file = "still.npy" }]\nlight = []\n'
    )
    np.save(tmp_path / "still.npy", blobs())

    def read(_file, number, like):
        return SimpleNamespace(number=number, like=like and like.number, read_files=lambda: None)

    files = Files((tmp_path / "a.####.exr",), ())
    return ShotFrames(Shot(tmp_path / "scene.toml"), files, read, lambda: pytest.fail("rendered"))


def like(frames, number):
    """Number of the frame that one is read like."""
    return frames.read(number)[0].like


def test_a_frame_is_read_like_the_one_before(frames):
    assert [like(frames, number) for number in (1, 2, 1)] == [None, 1, 2]


def test_files_that_have_changed_are_read_again(frames, tmp_path):
    frames.read(1)
    os.utime(tmp_path / "still.npy", (1, 1))
    assert like(frames, 2) is None
    assert like(frames, 1) == 2


def test_nothing_is_held_when_it_is_closed(frames):
    frames.read(1)
    frames.close()
    assert like(frames, 2) is None
