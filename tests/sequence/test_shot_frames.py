"""What a frame is read with."""

import os
import time
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.sequence import shot_frames
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


class Steps:
    """A renderer of frames that note when they begin and end."""

    def __init__(self, *, prepares=True):
        self.found, self._prepares = [], prepares

    def prepare(self, _):
        return self._prepares

    def forget_unused(self):
        self.found.append("frame")


def steps_of(tmp_path, renderer, seconds=0.0):
    """Render frames, the third before the second is asked for."""

    def begin(number):
        renderer.found.append(f"begin {number}")

        def end():
            time.sleep(seconds)
            renderer.found.append(f"end {number}")

        return end

    def read(_file, number, _like):
        return SimpleNamespace(scene=None, read_files=lambda: None, begin=lambda *_: begin(number))

    np.save(tmp_path / "still.npy", blobs())
    (tmp_path / "scene.toml").write_text('volume = { file = "still.npy" }\nlight = []\n')
    files = Files((tmp_path / "a.####.exr",), ())
    with ShotFrames(Shot(tmp_path / "scene.toml"), files, read, lambda: nullcontext(renderer)) as frames:
        assert frames.renderer is renderer
        frames.render(frames.read(1))()
        ends = [frames.render(frames.read(number)) for number in (2, 3)]
        for end in ends:
            end()
    assert renderer.found[:3] == ["begin 1", "end 1", "frame"]  # how long they take is not known
    return renderer.found[3:]


def test_a_frame_may_begin_before_the_last_has_ended(tmp_path):
    assert steps_of(tmp_path, Steps()) == ["begin 2", "frame", "begin 3", "frame", "end 2", "end 3"]


def test_frames_end_at_once_where_there_is_no_room_for_two(tmp_path):
    found = steps_of(tmp_path, Steps(prepares=False))
    assert found == ["begin 2", "end 2", "frame", "begin 3", "end 3", "frame"]


def test_long_frames_end_before_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr(shot_frames, "SHORT", 0.01)
    found = steps_of(tmp_path, Steps(), 0.02)
    assert found == ["begin 2", "end 2", "frame", "begin 3", "end 3", "frame"]


def like(frames, number):
    """Number of the frame that one is read like."""
    return frames.read(number).frame.like


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
