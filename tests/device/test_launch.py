"""Memory that kernels write and the host reads, and launches."""

import gc
import weakref
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
import pytest

from tfm_cl.device.launch import FIRST_BOUNDED, FIRST_SAMPLES, Pacing, Windows
from tfm_cl.device.running import InTurn, Running
from tfm_cl.errors import DeviceError, DeviceMemoryError


@pytest.mark.parametrize("shares", [True, False])
def test_the_host_reads_what_was_written(launcher, monkeypatch, shares):
    monkeypatch.setattr(launcher, "_shares_memory", shares)
    output = launcher.output("numbers", (5, 3), np.uint32)
    launcher.write(output.buffer, np.arange(15, dtype=np.uint32))
    numbers = launcher.start_read(output)()
    assert (numbers == np.arange(15).reshape(5, 3)).all()
    assert output.nbytes == 60


def test_outputs_are_as_large_as_a_buffer_at_most(launcher, monkeypatch):
    monkeypatch.setattr(launcher, "largest_buffer", 1 << 20)
    with pytest.raises(DeviceMemoryError, match=r"the picture needs a buffer of 2 MiB; .* allows 1 MiB"):
        launcher.output("the picture", (1 << 19,), np.float32)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(12, dtype=np.float32).reshape(3, 4)[:, ::2],
        np.array([(1, 2.0)], [("number", np.int32), ("value", np.float32)]),
        np.arange(3, dtype=np.uint8),
        np.zeros((0, 4), np.float32),
    ],
    ids=["strided", "struct", "three bytes", "empty"],
)
def test_what_is_uploaded_is_there_without_a_command(launcher, monkeypatch, array):
    monkeypatch.setattr(launcher, "write", lambda *_: pytest.fail("a command was enqueued"))
    buffer = launcher.upload("some numbers", array)
    assert buffer.size == max(array.nbytes, 16)
    assert (launcher.download(buffer, array.shape, array.dtype) == array).all()


def test_what_is_uploaded_is_as_large_as_a_buffer_at_most(launcher, monkeypatch):
    monkeypatch.setattr(launcher, "largest_buffer", 1 << 20)
    with pytest.raises(DeviceMemoryError, match=r"the voxels needs a buffer of 2 MiB; .* allows 1 MiB"):
        launcher.upload("the voxels", np.zeros(1 << 19, np.float32))


@pytest.mark.parametrize("shares", [True, False])
@pytest.mark.parametrize("rows", [(3, 0, 2), (0, 0, 0)])
def test_arrays_are_joined(launcher, monkeypatch, rng, shares, rows):
    monkeypatch.setattr(launcher, "_shares_memory", shares)
    arrays = [rng.random((count, 4), np.float32) for count in rows]
    for _ in range(2):  # the second time in the memory of the first
        buffer = launcher.joined("some rows", arrays)
        assert (launcher.download(buffer, (sum(rows), 4), np.float32) == np.concatenate(arrays)).all()
        del buffer


@pytest.mark.parametrize("then", ["is waited for", "is given up", "all are waited for"])
def test_what_a_launch_reads_is_held_until_it_has_ended(launcher, then):
    """Else the host might write the next arrays where it still reads, or the system have the memory."""

    class Memory:
        pass

    class AnyKernel:
        function_name = "any"

        def __call__(self, *_):
            return event

        def ordered(self, _):
            return ()

    status = cl.command_execution_status
    event = SimpleNamespace(
        wait=lambda: None,
        profile=SimpleNamespace(start=0, end=10),
        command_execution_status=status.RUNNING,
    )
    memory = Memory()
    held = weakref.ref(memory)
    running = launcher.start(AnyKernel(), (64,), {"numbers": memory})
    del memory
    gc.collect()
    assert held() is not None
    if then == "is waited for":
        assert running.wait() == pytest.approx(1e-8)
    else:
        del running
        gc.collect()
        assert held() is not None
        event.command_execution_status = status.COMPLETE
        if then == "is given up":
            before, event = event, SimpleNamespace(**vars(event))
            launcher.start(AnyKernel(), (64,), {}).wait()
            del before
        else:
            launcher.finish()
    gc.collect()
    assert held() is None


@pytest.mark.parametrize("most", [1, 2, 3])
def test_so_many_pieces_of_work_at_most_are_under_way(most):
    ended = []
    work = InTurn(most)
    for number in range(3):
        work.add(Running(lambda number=number: ended.append(number) or 0.5))
        assert ended == [*range(number + 2 - most)]

    assert work.wait() == work.wait() == 1.5
    assert ended == [0, 1, 2]


def windows_of(width, height, samples, **bounds):
    return Windows(0, 0, width, height, Pacing(samples, Windows.EDGE**2, **bounds))


def launches(windows, seconds):
    """Areas and times of a pass's launches, of which an item of a row takes ``seconds(row)``."""
    areas, times = [], []
    for window in windows:
        x0, y0, x1, y1 = window
        areas.append((x1 - x0) * (y1 - y0))
        times.append((x1 - x0) * sum(map(seconds, range(y0, y1))))
        windows.took(window, times[-1])
    return areas, times


def test_launches_of_bounded_time_do_all_of_the_work():
    """Half of the picture is empty: where it is not, the first frame is taken by surprise."""
    pace = None
    for _ in range(3):
        windows = windows_of(960, 540, 100, most_seconds=0.03, pace=pace)
        areas, times = launches(windows, lambda row: 1e-9 if row < 200 else 5e-7)
        assert sum(areas) == 960 * 540
        pace = windows.pacing.pace

    assert max(times) <= 0.031
    assert len(areas) < 20


def test_the_first_launches_of_a_kernel_are_careful():
    """Nothing is known of it: neither are they long themselves, nor is what comes after empty space."""
    slow, late = (
        launches(windows_of(960, 540, 100, most_seconds=0.03), seconds)[1]
        for seconds in (lambda _: 2e-6, lambda row: 1e-10 if row < 500 else 1.5e-7)
    )
    assert max(slow) <= 0.07  # the smallest of a row of tiles
    assert max(late) <= 0.031


@pytest.mark.parametrize(("items", "most"), [(0, 1), (1, 1), (100_000, 2), (9_000_000, 200)])
def test_work_in_a_row_is_cut_into_launches_that_do_all_of_it(launcher, monkeypatch, items, most):
    class Counted:
        function_name = "counted"

    begins = []

    def run(_, size, arguments):
        first, end = arguments["items"]
        assert (end - first,) == size
        assert first == (begins[-1] if begins else 0)
        begins.append(end)
        return (end - first) * 1e-8

    monkeypatch.setattr(launcher, "run", run)
    monkeypatch.setattr(launcher, "_launch_seconds", 0.03)
    launcher.run_items(Counted, items, 8, {"count": 3})

    assert not items or begins[-1] == items
    assert len(begins) <= most
    assert max(np.diff([0, *begins]), default=0) < 1 << 16


def test_how_slow_the_slowest_launch_was_fades():
    windows = windows_of(4096, 4096, 1, most_seconds=0.03, pace=1e-5)

    areas, _ = launches(windows, lambda _: 1e-7)

    assert areas[-2] > 4 * areas[0]


@pytest.mark.parametrize(("pace", "rows"), [(None, 320), (1e-9, 540), (2.5e-9, 416), (1e-6, 320)])
def test_a_first_launch_is_as_large_as_earlier_ones_let_it_be(pace, rows):
    windows = windows_of(960, 540, 100, pace=pace)

    assert next(iter(windows)) == (0, 0, 960, rows)


def test_launches_that_are_not_bounded_grow_as_they_may():
    areas, _ = launches(windows_of(960, 540, 100), lambda _: 1e-9)

    assert areas == [960 * 320, 960 * 220]


@pytest.mark.parametrize(("bounded", "left"), [(False, 1), (True, 0)])
def test_a_launch_of_a_pass_is_started_before_the_last_has_ended(launcher, monkeypatch, bounded, left):
    """Not where they are to be short: what is cancelled waits for all that was started."""
    started, begun, ended, parts = [], [], [], []

    def start(_kernel, _size, arguments):
        assert len(started) - len(ended) <= left
        started.append(arguments["window"])
        return Running(lambda: ended.append(arguments["window"]) or 0.1)

    monkeypatch.setattr(launcher, "start", start)
    monkeypatch.setattr(launcher, "_launch_seconds", 0.1 if bounded else None)
    monkeypatch.setattr(launcher, "_paces", {})
    kernel = SimpleNamespace(function_name="any")
    samples = (FIRST_BOUNDED if bounded else FIRST_SAMPLES) // (64 * 32)
    running = launcher.start_windows(kernel, (0, 0, 64, 128), samples, {}, parts.append, begun.append)

    assert started == begun == [(0, 32 * n, 64, 32 * n + 32) for n in range(4)]
    assert ended == started[: 4 - left]
    assert running.wait() == running.wait() == pytest.approx(0.4)
    assert (ended, parts) == (started, [0.25, 0.5, 0.75, 1])


COMMANDS = {
    "download": lambda launcher, buffer: launcher.download(buffer, (4,), np.float32),
    "write": lambda launcher, buffer: launcher.write(buffer, np.zeros(4, np.float32)),
    "copy": lambda launcher, buffer: launcher.copy(buffer, buffer, 4, first=0, to=8),
    "clear": lambda launcher, buffer: launcher.clear(buffer, 16),
    "read": lambda launcher, _: launcher.start_read(launcher.output("the image", (4,), np.float32))(),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("error", "kind", "told"),
    [(cl.RuntimeError("lost"), DeviceError, "failed"), (cl.MemoryError("full"), DeviceMemoryError, "out of")],
    ids=["lost", "full"],
)
def test_a_command_that_fails_is_told_on_a_line(launcher, monkeypatch, command, error, kind, told):
    def fail(*_of, **_named):
        raise error

    buffer = launcher.empty("a buffer", 16)
    for name in ("enqueue_copy", "enqueue_fill_buffer", "enqueue_map_buffer"):
        monkeypatch.setattr(cl, name, fail)
    with pytest.raises(kind, match=f"^[^\\n]*{told}[^\\n]*$"):
        COMMANDS[command](launcher, buffer)


@pytest.mark.parametrize("seconds", [0, -1, float("nan"), float("inf")])
def test_launches_take_some_time(new_renderer, seconds):
    with pytest.raises(DeviceError, match=r"^launch_seconds = "):
        new_renderer(launch_seconds=seconds)
