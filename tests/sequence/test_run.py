"""The loop over frames: what is made, kept, failed and shared, with frames that are files of text."""

import errno
import gc
import os
import threading
import time
import weakref

import numpy as np
import pytest

from tfm_cl.errors import DeviceError, DeviceMemoryError, InputError, NoDeviceError, VolumeError
from tfm_cl.sequence import run as sequence
from tfm_cl.sequence.claims import Ledger
from tfm_cl.sequence.run import run


class Texts:
    """Frames whose picture is their number; each step is noted."""

    def __init__(self, folder, failing=None, *, names=("a.{:04d}.txt",)):
        self._folder, self._failing, self._names = folder, failing or {}, names
        self.version, self.steps, self.read_ahead = "1", [], threading.Event()

    def _step(self, name, frame):
        self.steps.append((name, frame))
        error = self._failing.get((name, frame))
        if error is not None:
            raise error

    def name(self, frame):
        return self.outputs(frame)[0].name

    def outputs(self, frame):
        return [self._folder / name.format(frame) for name in self._names]

    def fingerprint(self, frame):
        return f"{self.version} {frame}"

    def read(self, frame):
        self._step("read", frame)
        return frame

    def render(self, frame):
        self._step("render", frame)

        def made():
            self._step("end", frame)
            return f"picture {frame}"

        return made

    def write(self, frame, made):
        self._step("write", frame)
        for path in self.outputs(frame):
            path.write_text(made)

    @property
    def rendered(self):
        return [frame for step, frame in self.steps if step == "render"]


@pytest.fixture
def ledger(tmp_path):
    with Ledger(tmp_path / ".a.tfm") as ledger:
        yield ledger


@pytest.fixture
def no_space():
    problem = InputError("a.0002.txt: cannot be written (No space left on device)")
    problem.__cause__ = OSError(errno.ENOSPC, "No space left on device")
    return problem


def test_all_in_order(tmp_path, ledger):
    work = Texts(tmp_path)
    outcome = run([3, 1, 2], work, ledger)
    assert outcome.made == work.rendered == [3, 1, 2]
    assert outcome.exit_code == 0
    assert (tmp_path / "a.0003.txt").read_text() == "picture 3"
    assert not list(ledger._folder.glob("*.claim"))


def test_the_next_is_read_and_the_last_written_meanwhile(tmp_path, ledger):
    """The device ends 2 when 3 is read and 1 written: it never would, were one after the other."""

    class Waits(Texts):
        def render(self, frame):
            made = super().render(frame)

            def waits():
                deadline = time.monotonic() + 20
                while frame == 2 and time.monotonic() < deadline:
                    if {("read", 3), ("write", 1)} <= set(self.steps):
                        self.read_ahead.set()
                        break
                    time.sleep(0.001)
                return made()

            return waits

    work = Waits(tmp_path)
    run([1, 2, 3], work, ledger)
    assert work.read_ahead.is_set()


def test_what_is_done_is_kept(tmp_path, ledger):
    run([1, 2, 3], Texts(tmp_path), ledger)
    work = Texts(tmp_path)
    outcome = run([1, 2, 3, 4], work, ledger, skip_existing=True)
    assert (outcome.kept, outcome.made, work.rendered) == ([1, 2, 3], [4], [4])
    assert not [step for step in work.steps if step == ("read", 1)]


def test_not_what_was_made_from_something_else(tmp_path, ledger):
    run([1, 2], Texts(tmp_path), ledger)
    work = Texts(tmp_path)
    work.version = "2"
    assert run([1, 2], work, ledger, skip_existing=True).made == [1, 2]


def test_not_what_lacks_one_of_several_files(tmp_path, ledger):
    names = "a.{:04d}.txt", "b.{:04d}.txt"
    work = Texts(tmp_path, names=names)
    run([1, 2], work, ledger)
    (tmp_path / "b.0002.txt").unlink()
    assert run([1, 2], work, ledger, skip_existing=True).made == [2]


def test_without_being_asked_nothing_is_kept_or_claimed(tmp_path, ledger):
    ledger.claim("a.0001.txt")
    assert run([1], Texts(tmp_path), ledger).made == [1]
    assert run([1], Texts(tmp_path), ledger).made == [1]


def test_the_next_is_begun_before_one_has_ended(tmp_path, ledger):
    work = Texts(tmp_path)
    outcome = run([1, 2, 3], work, ledger, waits=False)
    steps = [step for step in work.steps if step[0] in ("render", "end")]
    assert outcome.made == [1, 2, 3]
    assert [frame for step, frame in steps if step == "end"] == [1, 2, 3]
    assert all(steps.index(("end", frame)) <= steps.index(("render", frame + 1)) + 1 for frame in (1, 2))


def test_one_ends_while_the_next_is_still_read(tmp_path, ledger, monkeypatch):
    """Reading 2 waits until 1 is written: it would wait for ever, were 2 begun first."""

    class Waits(Texts):
        def read(self, frame):
            if frame == 2:
                self.read_ahead.wait(20)
            return super().read(frame)

        def write(self, frame, made):
            super().write(frame, made)
            self.read_ahead.set()

    monkeypatch.setattr(sequence, "READ_SOON", 0.01)
    work = Waits(tmp_path)
    run([1, 2], work, ledger)
    assert work.steps.index(("write", 1)) < work.steps.index(("read", 2))


@pytest.mark.parametrize("step", ["read", "render", "end", "write"])
def test_one_that_fails_does_not_stop_the_others(tmp_path, ledger, step):
    work = Texts(tmp_path, {(step, 2): VolumeError("smoke.0002.vdb: no such file")})
    outcome = run([1, 2, 3], work, ledger, skip_existing=True)
    assert outcome.made == [1, 3]
    assert [str(failure) for failure in outcome.failures] == ["frame 2: smoke.0002.vdb: no such file"]
    assert outcome.exit_code == 5
    assert run([1, 2, 3], Texts(tmp_path), ledger, skip_existing=True).made == [2]  # nobody holds it


@pytest.mark.parametrize(
    ("failing", "code"),
    [
        ({1: InputError("x"), 2: VolumeError("y")}, 2),
        ({1: DeviceError("x"), 2: DeviceError("y")}, 3),
        ({1: DeviceError("x"), 2: VolumeError("y")}, 5),
        ({1: VolumeError("x")}, 5),
        ({1: MemoryError()}, 4),
        ({1: VolumeError("x"), 2: DeviceMemoryError("y")}, 4),
        ({1: PermissionError(13, "Permission denied")}, 5),
    ],
)
def test_exit_codes(tmp_path, ledger, failing, code):
    work = Texts(tmp_path, {("render", frame): error for frame, error in failing.items()})
    assert run([1, 2], work, ledger).exit_code == code


def test_a_full_disk_ends_it(tmp_path, ledger, no_space):
    work = Texts(tmp_path, {("write", 2): no_space})
    outcome = run(range(1, 101), work, ledger, skip_existing=True)
    assert outcome.made == [1]
    assert [failure.frame for failure in outcome.failures] == [2]
    assert sorted(outcome.left) == list(range(3, 101))
    assert outcome.exit_code == 5
    assert not list(ledger._folder.glob("*.claim"))


def test_a_fault_of_ours_is_no_frames_fault(tmp_path, ledger):
    work = Texts(tmp_path, {("render", 2): ZeroDivisionError()})
    with pytest.raises(ZeroDivisionError):
        run([1, 2, 3], work, ledger, skip_existing=True)


def test_no_device_ends_it(tmp_path, ledger):
    work = Texts(tmp_path, {("render", 1): NoDeviceError("no OpenCL device")})
    with pytest.raises(NoDeviceError):
        run([1, 2, 3], work, ledger, skip_existing=True)


def test_ctrl_c_finishes_what_is_being_written(tmp_path):
    class Interrupted(Texts):
        def render(self, frame):
            if frame == 3:  # 2 is begun, 1 written
                raise KeyboardInterrupt
            return super().render(frame)

        def write(self, frame, made):
            time.sleep(0.05)
            super().write(frame, made)

    with pytest.raises(KeyboardInterrupt), Ledger(tmp_path / ".a.tfm") as ledger:
        run([1, 2, 3], Interrupted(tmp_path), ledger, skip_existing=True)
    assert not list(ledger._folder.glob("*.claim"))
    with Ledger(tmp_path / ".a.tfm") as ledger:
        assert run([1, 2, 3], Texts(tmp_path), ledger, skip_existing=True).kept == [1]


def test_what_others_make_is_waited_for(tmp_path, monkeypatch):
    """Two loops share a folder: each frame is made once, and both end when all are there."""
    monkeypatch.setattr(sequence, "LOOKED_AGAIN", 0.01)
    frames, found = list(range(40)), []

    def work_on(texts):
        with Ledger(tmp_path / ".a.tfm") as ledger:
            found.append(run(frames, texts, ledger, skip_existing=True))

    works = [Texts(tmp_path), Texts(tmp_path)]
    threads = [threading.Thread(target=work_on, args=(texts,)) for texts in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(works[0].rendered + works[1].rendered) == frames
    assert all(sorted(outcome.made + outcome.kept) == frames for outcome in found)


def test_waits_for_a_frame_until_its_claim_expires(tmp_path, monkeypatch):
    monkeypatch.setattr(sequence, "LOOKED_AGAIN", 0.01)
    told = []
    with Ledger(tmp_path / ".a.tfm", expired_after=60) as ledger:
        path = tmp_path / ".a.tfm" / "a.0001.txt.claim"
        path.write_text('{"host": "elsewhere", "machine": "x", "pid": 1, "token": "1", "locked": true}')

        def tell(frame, how, _):
            told.append((frame, how))
            if how == "waiting":
                os.utime(path, (0, 0))

        outcome = run([1, 2], Texts(tmp_path), ledger, skip_existing=True, tell=tell)
    assert outcome.made == [2, 1]
    assert told == [(2, "made"), (1, "waiting"), (1, "made")]


def test_what_fails_holds_nothing_of_its_frame(tmp_path, ledger):
    """Of a thousand bad frames a thousand lines are kept, not their voxels."""

    class Voxels(np.ndarray):
        """That can be told to be gone."""

    class Large(Texts):
        def render(self, read):
            voxels = np.full(3, read).view(Voxels)
            held.append(weakref.ref(voxels))
            try:
                float("device lost")
            except ValueError as error:
                raise DeviceError(f"{len(voxels)} voxels") from error

    held: list[weakref.ref[Voxels]] = []
    outcome = run([1, 2], Large(tmp_path), ledger)
    gc.collect()
    assert len(outcome.failures) == 2
    assert [reference() for reference in held] == [None, None]
