"""What every pass needs to run kernels: the queue, buffers within the device's limits, and timing."""

import contextlib
import copy
import math
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
import pyopencl as cl
from numpy.typing import DTypeLike, NDArray
from pyopencl.tools import ImmediateAllocator, MemoryPool

from tfm_cl.device.device import check_process, was_forked
from tfm_cl.device.host_memory import HostMemory
from tfm_cl.device.program import Kernel, KernelLibrary, kernel_name
from tfm_cl.device.running import Finding, InTurn, Running
from tfm_cl.errors import CancelledError, DeviceError, DeviceMemoryError
from tfm_cl.interrupts import check_cancelled

T = TypeVar("T")
Progress = Callable[[str, float], None]
"""Called as ``progress(stage, fraction)`` with the stage's name and the part of it that is done, 0 to 1."""

UnderWay = dict[int, tuple[cl.Event, Mapping[str, Any]]]
"""By the ids of their events, launches and what they were given: some of it is memory of the host."""

LAUNCH_SECONDS = 0.1
"""Work is cut so that a launch takes about this long: a device shared with a screen stays responsive, and
Ctrl-C is heard."""

FIRST_SAMPLES = 1 << 25
"""Density samples, at most, of the first launch of a kernel: the following ones are cut by its time."""
FIRST_BOUNDED = 1 << 20
"""The same where launches are bounded: nothing is known of it."""
GROWTH, GROWTH_BOUNDED = 8, 2
"""By how many times more a launch may have than the last one, and where launches are bounded."""
LIKELY_PACE = 1.5e-9
"""Seconds of a sample, where launches are bounded, as long as none was slower: two cores, a dense medium.
What is empty tells nothing of what comes next."""
LOOK_UP = 16
"""Density samples that the look-up of a light's map takes as long as, at a point that no ray leads up to."""
MOST_SAMPLES = 1 << 28
"""Density samples, at most, of any launch: one that met nothing tells nothing of the next."""

PACE_KEPT = 0.98
"""Of how slow the slowest launch was, from one launch to the next."""

COPYING = "a copy of a buffer"
"""What messages call it when that fails."""

MOST_ITEMS = (1 << 16) - 64
"""Work-items of a launch of some in a row: for more than 16 bits of them PoCL compiles a kernel once more."""

WORK_GROUPS: dict[int, tuple[int, ...]] = {1: (64,), 2: (4, 4), 3: (4, 4, 4)}
"""Dimensions -> work-group size. Always the same: CPU drivers compile a kernel anew for every size; kernels
check their bounds."""
GPU_TILES = (8, 8)
"""Work-group of texels and pixels where a work-item carries one."""

TILE = {1: (1, 1), 4: (2, 2), 8: (4, 2), 16: (4, 4)}
"""Lanes a work-item -> texels or pixels (x, y) of its tile, as in ``kernels/core/lanes.h``."""


LEAST_BYTES = 16
"""Of a device buffer, so that none is empty."""

UPLOADED = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR

LANES_PROBE = """
#if defined(__AVX512F__)
__kernel void lanes_16(void) {}
#elif defined(__AVX__)
__kernel void lanes_8(void) {}
#else
__kernel void lanes_4(void) {}
#endif
"""
"""Its kernel's name tells how many floats fit a register of what a CPU's driver compiles for."""


def lanes_of(context: cl.Context) -> tuple[int, ...]:
    """Rays that a work-item may carry on the context's device; the last is what suits it best.

    On a CPU as many as fit a register of the code that the driver's compiler makes, which need not be the
    processor's: PoCL 3.0 compiles for a Zen 3 on its successors, and links built-in functions for AVX-512;
    callers and functions of wider vectors then disagree about where these are. Hardware that groups
    work-items itself takes any number, best one.
    """
    (device,) = context.devices
    if not device.type & cl.device_type.CPU:
        return (*sorted(TILE, reverse=True),)
    name = kernel_name(context, LANES_PROBE, ("-cl-std=CL1.2",))
    return tuple(lanes for lanes in TILE if lanes <= int(name.removeprefix("lanes_")))


class Launcher:
    """One device's context, queue and kernels.

    Parameters
    ----------
    device
        OpenCL device.
    options
        Further compiler options.
    lanes
        Rays a work-item carries, 1, 4, 8 or 16; by default what suits the device.
    largest_buffer
        Bytes; by default the device's limit.
    work_group
        Work-items (x, y) of a work-group in maps and images; None leaves it to the driver.
    launch_seconds
        That a launch takes at most, as far as earlier ones of its kernel tell: what is cancelled ends so
        soon. None: about `LAUNCH_SECONDS`.

    Raises
    ------
    DeviceError
        Lanes that the device does not have; launches of no time.
    """

    def __init__(
        self,
        device: cl.Device,
        options: tuple[str, ...] = (),
        *,
        lanes: int | None = None,
        largest_buffer: int | None = None,
        work_group: tuple[int, int] | Literal["auto"] | None = "auto",
        launch_seconds: float | None = None,
    ) -> None:
        self.device = device
        self._context = cl.Context([device])
        self.lanes_possible = lanes_of(self.context)
        self.lanes = self.lanes_possible[-1] if lanes is None else lanes
        if self.lanes not in self.lanes_possible:
            possible = ", ".join(map(str, sorted(self.lanes_possible)))
            raise DeviceError(f"{device.name.strip()}: lanes = {lanes}: expected one of {possible}")
        if launch_seconds is not None and not 0 < launch_seconds < math.inf:
            raise DeviceError(f"launch_seconds = {launch_seconds:g}: expected more than 0 seconds, or None")
        self._options = (*options, f"-DTFM_LANES={self.lanes}")
        self._shares_memory = bool(device.type & cl.device_type.CPU)
        tiles = GPU_TILES if self.lanes == 1 else WORK_GROUPS[2]
        self._groups: dict[int, tuple[int, ...] | None] = {
            **WORK_GROUPS,
            2: tiles if work_group == "auto" else work_group,
        }
        self._launch_seconds = launch_seconds
        self.largest_buffer = min(largest_buffer or device.max_mem_alloc_size, device.max_mem_alloc_size)
        self._begin_work()

    def _begin_work(self) -> None:
        """Make what serves one thread at a time."""
        self._queue = cl.CommandQueue(self.context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        self._reads = cl.CommandQueue(self.context)
        """For copies of what has ended: they need not wait for what was started since."""
        self._kernels = KernelLibrary(self.context, self._options)
        self._host_memory = HostMemory()
        self._pool = MemoryPool(ImmediateAllocator(self.queue, cl.mem_flags.READ_WRITE))
        self._paces: dict[str, float] = {}
        """Kernel -> seconds of a density sample that an item may need, where that took longest."""
        self._findings = weakref.WeakSet[Finding[Any]]()
        """What may not have been read yet."""
        self._under_way: UnderWay = {}
        """Launches that may not have ended, in order."""
        weakref.finalize(self, _wait_for, self._queue, self._under_way)
        self._cancelled = threading.Event()
        self.turn = threading.RLock()
        """Held by the thread at work: kernels have arguments, and memory is pooled, for one at a time."""
        self.seconds = 0.0
        """Of all kernels so far, on the device."""

    def beside(self) -> "Launcher":
        """Return another for the same device, for what a second thread does meanwhile: buffers serve both."""
        other = copy.copy(self)
        other._begin_work()  # noqa: SLF001 - its own class
        return other

    # All that is done on the device goes through one of these three.

    @property
    def context(self) -> cl.Context:
        """With the one device."""
        check_process()
        return self._context

    @property
    def queue(self) -> cl.CommandQueue:
        """In order, with times."""
        check_process()
        return self._queue

    @property
    def kernels(self) -> KernelLibrary:
        """All kernels used so far."""
        check_process()
        return self._kernels

    def run(self, kernel: Kernel, size: tuple[int, ...], arguments: Mapping[str, Any]) -> float:
        """Run a kernel over at least ``size`` work-items, wait, and return its seconds on the device.

        Parameters
        ----------
        size, arguments
            As of `start`.
        """
        return self.start(kernel, size, arguments).wait()

    def start(self, kernel: Kernel, size: tuple[int, ...], arguments: Mapping[str, Any]) -> Running:
        """Let a kernel run over at least ``size`` work-items, when all that was started before has ended.

        The size is rounded up to whole work-groups: kernels check their bounds.

        Parameters
        ----------
        arguments
            All that the kernel's signature names: buffers, numbers, and tuples for vectors.
        """
        self.check()
        group = self._groups[len(size)]
        whole = size if group is None else tuple(-(-n // g) * g for n, g in zip(size, group, strict=True))
        queue = self.queue
        self._let_go()
        with self._doing(kernel.function_name):
            event = kernel(queue, whole, group, *kernel.ordered(arguments))
            self._under_way[id(event)] = event, arguments
            queue.flush()

        def end() -> float:
            with self._doing(kernel.function_name):
                event.wait()
            self._under_way.pop(id(event), None)
            self.kernels.ran(kernel, whole)
            seconds = float(event.profile.end - event.profile.start) * 1e-9
            self.seconds += seconds
            return seconds

        return Running(end)

    def _let_go(self) -> None:
        """Let go of what launches were given that have ended, and that nobody waits for any more."""
        for event, _ in [*self._under_way.values()]:
            if event.command_execution_status > cl.command_execution_status.COMPLETE:
                break
            self._under_way.pop(id(event), None)

    @contextlib.contextmanager
    def _doing(self, what: str) -> Iterator[None]:
        """Say what failed in here: a kernel, or a copy."""
        try:
            yield
        except cl.MemoryError as error:
            raise DeviceMemoryError(f"{self.device.name.strip()}: out of memory ({error})") from error
        except cl.Error as error:
            raise DeviceError(f"{self.device.name.strip()}: {what} failed ({error})") from error

    def run_windows(
        self,
        kernel: Kernel,
        bounds: tuple[int, int, int, int],
        samples_per_item: int,
        arguments: Mapping[str, Any],
        done: Callable[[float], None] | None = None,
    ) -> float:
        """Run a kernel over a rectangle, as `start_windows` does, and wait; returns seconds on the device."""
        return self.start_windows(kernel, bounds, samples_per_item, arguments, done).wait()

    def start_windows(
        self,
        kernel: Kernel,
        bounds: tuple[int, int, int, int],
        samples_per_item: int,
        arguments: Mapping[str, Any],
        done: Callable[[float], None] | None = None,
        begun: Callable[[tuple[int, int, int, int]], None] | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> Running:
        """Run a kernel whose work-items each take a tile over a rectangle, in launches of bounded time.

        All but the last have ended when this returns, and each was started before the one before it ended,
        so that the device has work while the host prepares the next. Where launches are to be short, each has
        ended before the next: what is cancelled has to wait for all that was started.

        Parameters
        ----------
        bounds
            x0, y0, x1, y1; the kernel gets the part of each launch as ``window``.
        samples_per_item
            Density samples that one texel or pixel may need.
        arguments
            As of `start`, but for ``window``.
        done
            Called after each launch with the part that is done, 0 to 1: what it raises ends the work.
        begun
            Called with the window of each launch when it was started, before the next: what it starts on the
            device comes between the two.
        meanwhile
            Called once, when the first launch was started: what the host does before it waits for any.
        """
        name = kernel.function_name
        windows = Windows(*bounds, self._pacing(kernel, samples_per_item, Windows.EDGE**2))
        launches = self.in_turn()
        for window in windows:
            launch = self.start(kernel, self.tiles(window), {**arguments, "window": window})
            if begun is not None:
                begun(window)
            if meanwhile is not None:
                meanwhile()
                meanwhile = None

            def end(
                launch: Running = launch,
                window: tuple[int, int, int, int] = window,
                part: float = windows.done,
            ) -> float:
                seconds = windows.took(window, launch.wait())
                self._paces[name] = windows.pacing.pace
                if done is not None:
                    done(part)
                return seconds

            launches.add(Running(end))
        return Running(launches.wait)

    def finding(self, running: Running, read: Callable[[], T], nbytes: int) -> Finding[T]:
        """Return what the host reads, so many bytes, when it needs what was started to find it."""
        finding = Finding(running, read, nbytes)
        self._findings.add(finding)
        return finding

    def in_turn(self, most: int = 2) -> InTurn:
        """Return what waits for launches that are started one after the other, so many at once.

        Where they are to be short, it waits for each, as of `start_windows`.
        """
        return InTurn(most if self._launch_seconds is None else 1)

    def run_items(
        self, kernel: Kernel, items: int, samples_per_item: int, arguments: Mapping[str, Any]
    ) -> float:
        """Run a kernel over work-items in a row, in launches of bounded time; returns seconds on the device.

        Parameters
        ----------
        items
            Their number; the kernel gets the first of each launch, and the end, as ``items``.
        samples_per_item
            Density samples that one may need, or what takes as long.
        arguments
            As of `run`, but for ``items``.
        """
        seconds, first = 0.0, 0
        pacing = self._pacing(kernel, samples_per_item, WORK_GROUPS[1][0])
        while first < items:
            end = min(first + min(pacing.items, MOST_ITEMS), items)
            took = self.run(kernel, (end - first,), {**arguments, "items": (first, end)})
            pacing.took(end - first, took)
            self._paces[kernel.function_name] = pacing.pace
            seconds, first = seconds + took, end
        return seconds

    def _pacing(self, kernel: Kernel, samples_per_item: int, least: int) -> "Pacing":
        pace = self._paces.get(kernel.function_name)
        return Pacing(samples_per_item, least, most_seconds=self._launch_seconds, pace=pace)

    def begin(self) -> None:
        """Begin work that may be cancelled: what was cancelled before has ended."""
        self._cancelled.clear()

    def finish(self) -> None:
        """Wait for all that was started: when work is given up, others may take its memory."""
        _wait_for(self.queue, self._under_way)
        for finding in [*self._findings]:
            finding.running.give_up()

    def cancel(self) -> None:
        """Let the next launch, or `check`, raise `CancelledError`; from any thread."""
        self._cancelled.set()

    def check(self) -> None:
        """Raise `CancelledError` if the work was cancelled."""
        if self._cancelled.is_set():
            self._cancelled.clear()
            raise CancelledError("the rendering was cancelled")

    def tiles(self, window: tuple[int, int, int, int]) -> tuple[int, int]:
        """Tiles along x and y that x0, y0, x1, y1 touches."""
        x0, y0, x1, y1 = window
        width, height = TILE[self.lanes]
        return -(-x1 // width) - x0 // width, -(-y1 // height) - y0 // height

    def widened(
        self, window: tuple[int, int, int, int], size: tuple[int, int], margin: int
    ) -> tuple[int, int, int, int]:
        """Widen a window x0, y0, x1, y1 of a rectangle by a margin; one that is empty stays so.

        It begins and ends where launches over all do.
        """
        x0, y0, x1, y1 = window
        if x0 >= x1 or y0 >= y1:
            return window
        (width, height), edge = size, Windows.EDGE
        x0, y0 = (max(low - margin, 0) // edge * edge for low in (x0, y0))
        x1, y1 = (-(-(high + margin) // edge) * edge for high in (x1, y1))
        return x0, y0, min(x1, width), min(y1, height)

    def joined(self, what: str, arrays: Sequence[NDArray[Any]]) -> cl.Buffer:
        """Copy some arrays of one kind to the device, one behind the other.

        Where host and device share memory, it is that of earlier frames: fresh pages cost more than the copy.
        """
        nbytes = sum(array.nbytes for array in arrays)
        if not self._shares_memory or not LEAST_BYTES <= nbytes <= self.largest_buffer:
            return self.upload(what, np.concatenate(arrays))
        memory = self._host_memory.take(nbytes)
        np.concatenate(arrays, out=memory.view(arrays[0].dtype).reshape(-1, *arrays[0].shape[1:]))
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
        with self._allocating(what, nbytes):
            return cl.Buffer(self.context, flags, hostbuf=memory)

    def empty(self, what: str, nbytes: int, *, reuse: bool = False) -> cl.Buffer:
        """Allocate a device buffer.

        Parameters
        ----------
        what
            Names it in messages.
        reuse
            Take memory that an earlier frame gave back: fresh pages cost as much as filling them.

        Raises
        ------
        DeviceMemoryError
            When it exceeds the device's largest allocation, or allocation fails: with both numbers.
        """
        with self._allocating(what, nbytes):
            if reuse:
                pooled: cl.Buffer = self._pool.allocate(max(nbytes, LEAST_BYTES))  # type: ignore[assignment]
                return pooled
            return cl.Buffer(self.context, cl.mem_flags.READ_WRITE, max(nbytes, LEAST_BYTES))

    def check_fits(self, what: str, nbytes: int) -> None:
        """Refuse what no buffer of the device can hold, as of `empty`."""
        limit = self.largest_buffer
        if nbytes > limit:
            raise DeviceMemoryError(
                f"{what} needs a buffer of {nbytes / 2**20:,.0f} MiB; "
                f"{self.device.name.strip()} allows {limit / 2**20:,.0f} MiB"
            )

    @contextlib.contextmanager
    def _allocating(self, what: str, nbytes: int) -> Iterator[None]:
        """Say what was allocated in here if the device refuses; if the work was cancelled it ends before."""
        check_cancelled()
        self.check_fits(what, nbytes)
        try:
            yield
        except cl.Error as error:
            raise DeviceMemoryError(
                f"{what}: {self.device.name.strip()} could not allocate {nbytes / 2**20:,.0f} MiB "
                f"of its {self.device.global_mem_size / 2**20:,.0f} MiB ({error})"
            ) from error

    def zeros(self, what: str, nbytes: int) -> cl.Buffer:
        """Allocate a device buffer of zeros, reusing memory."""
        buffer = self.empty(what, nbytes, reuse=True)
        self.clear(buffer, nbytes)
        return buffer

    def output(self, what: str, shape: tuple[int, ...], dtype: type[np.generic]) -> "Output":
        """Allocate what kernels write and the host reads: where they share memory it is not copied."""
        nbytes = int(np.prod(shape)) * np.dtype(dtype).itemsize
        if not self._shares_memory:
            return Output(self.empty(what, nbytes, reuse=True), shape, dtype, None)
        if nbytes > self.largest_buffer:
            self.empty(what, nbytes)  # says so
        memory = self._host_memory.take(max(nbytes, LEAST_BYTES))
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
        with self._allocating(what, nbytes):
            return Output(cl.Buffer(self.context, flags, hostbuf=memory), shape, dtype, memory)

    def start_read(self, output: "Output") -> Callable[[], NDArray[Any]]:
        """Let the host have what was started to write an output; nothing that is started later may write it.

        Returns what waits for that, but not for what was started later, and returns it.
        """
        memory = output.memory
        if memory is None:

            def copied() -> NDArray[Any]:
                array = np.empty(output.shape, output.dtype)
                with self._doing(COPYING):
                    cl.enqueue_copy(self._reads, array, output.buffer)
                return array

            return copied
        # Tells the driver that the host will look at its memory. A CPU's driver does this when all has ended
        # that was begun before, on whichever queue, so it is asked now.
        whole = 0, (memory.nbytes,), np.dtype(np.uint8)
        with self._doing(COPYING):
            mapped: Any
            mapped, event = cl.enqueue_map_buffer(
                self.queue, output.buffer, cl.map_flags.READ, *whole, is_blocking=False
            )
            self.queue.flush()

        def shared() -> NDArray[Any]:
            with self._doing(COPYING):
                event.wait()
                mapped.base.release(self.queue)
            return memory[: output.nbytes].view(output.dtype).reshape(output.shape)

        return shared

    def clear(self, buffer: cl.Buffer, nbytes: int, first: int = 0) -> None:
        """Fill a buffer, from byte ``first`` on, with zeros."""
        zero = np.zeros(1, np.uint8)
        with self._doing("the clearing of a buffer"):
            cl.enqueue_fill_buffer(self.queue, buffer, zero, first, max(nbytes, LEAST_BYTES))

    def release(self) -> None:
        """Give back the memory kept for reuse, when what was started has ended."""
        _wait_for(self._queue, self._under_way)
        self._host_memory.clear()
        if not was_forked():  # else it is not this process's
            self._pool.free_held()

    def upload(self, what: str, array: NDArray[Any]) -> cl.Buffer:
        """Copy an array to the device."""
        content = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
        if content.size < LEAST_BYTES:
            content = np.concatenate([content, np.zeros(LEAST_BYTES - content.size, np.uint8)])
        # Filled as it is made: a command for it would have to wake the threads of a CPU's driver.
        with self._allocating(what, content.nbytes):
            return cl.Buffer(self.context, UPLOADED, hostbuf=content)

    def write(self, buffer: cl.Buffer, array: NDArray[Any]) -> None:
        """Copy an array into a buffer of its size."""
        with self._doing(COPYING):
            cl.enqueue_copy(self.queue, buffer, np.ascontiguousarray(array))

    def copy(self, source: cl.Buffer, target: cl.Buffer, nbytes: int, *, first: int, to: int) -> None:
        """Copy a part of a buffer, from byte ``first`` on, to byte ``to`` of another."""
        with self._doing(COPYING):
            cl.enqueue_copy(self.queue, target, source, byte_count=nbytes, src_offset=first, dst_offset=to)

    def download(
        self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: DTypeLike, first: int = 0
    ) -> NDArray[Any]:
        """Copy a buffer, from byte ``first`` on, to the host."""
        array = np.empty(shape, dtype)
        with self._doing(COPYING):
            cl.enqueue_copy(self.queue, array, buffer, src_offset=first)
        return array

    def start_download(
        self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: DTypeLike
    ) -> Callable[[], NDArray[Any]]:
        """Let a buffer be copied to the host when all that was started before has ended.

        Returns what waits for that, whatever was started after it, and returns the copy.
        """
        array = np.empty(shape, dtype)
        with self._doing(COPYING):
            event = cl.enqueue_copy(self.queue, array, buffer, is_blocking=False)
            self.queue.flush()

        def wait() -> NDArray[Any]:
            with self._doing(COPYING):
                event.wait()
            return array

        return wait


def _wait_for(queue: cl.CommandQueue, under_way: UnderWay) -> None:
    """Wait for all that was started, and let go of it, though others may have given it up."""
    started = [*under_way]
    if not was_forked():  # else it is another process's
        with contextlib.suppress(cl.Error):  # what failed has been said
            queue.finish()
    for launch in started:
        under_way.pop(launch, None)


@dataclass(frozen=True)
class Output:
    """Memory that kernels write and the host reads."""

    buffer: cl.Buffer
    shape: tuple[int, ...]
    dtype: type[np.generic]
    memory: NDArray[np.uint8] | None
    """The same, for the host, where it is shared."""

    @property
    def nbytes(self) -> int:
        """Its size."""
        return int(np.prod(self.shape)) * np.dtype(self.dtype).itemsize


class Pacing:
    """How many items, texels or pixels, each launch of a pass takes: about `LAUNCH_SECONDS` of them.

    The first launch is small, unless it is known how long launches take; the next ones follow from its time;
    after each call `took`.

    Parameters
    ----------
    samples_per_item
        Density samples that one item may need.
    least
        Items of a launch, at least.
    most_seconds
        That a launch takes at most, where all of it is as slow as the slowest so far; None: they are about
        as long as the last one tells.
    pace
        Seconds of a sample in the slowest of earlier launches, which the first one is cut by; None: there was
        none.

    Attributes
    ----------
    items
        Of the next launch.
    pace
        Seconds of a sample in the slowest launch so far; it fades, as a device may be busy at times.
    """

    def __init__(
        self,
        samples_per_item: int,
        least: int,
        *,
        most_seconds: float | None = None,
        pace: float | None = None,
    ) -> None:
        self._samples_per_item, self._least, self._most_seconds = samples_per_item, least, most_seconds
        self._seconds = LAUNCH_SECONDS if most_seconds is None else most_seconds
        self._most = max(least, MOST_SAMPLES // samples_per_item)
        if most_seconds is not None:
            self.pace = LIKELY_PACE if pace is None else pace
            first = FIRST_BOUNDED // samples_per_item if pace is None else self._most
            self.items = self._bounded(max(least, first))
        else:
            self.pace = pace or 0.0
            self.items = max(least, FIRST_SAMPLES // samples_per_item)
            if pace:
                expected = int(self._seconds / (pace * samples_per_item))
                self.items = max(self.items, min(expected, GROWTH * self.items, self._most))

    def took(self, items: int, seconds: float) -> None:
        """Choose the number of the next launch by what the last one took."""
        wanted = items * self._seconds / max(seconds, 1e-6)
        growth = GROWTH if self._most_seconds is None else GROWTH_BOUNDED
        self.pace = max(seconds / (items * self._samples_per_item), PACE_KEPT * self.pace)
        self.items = self._bounded(int(min(max(wanted, self.items / 4), growth * self.items, self._most)))

    def _bounded(self, items: int) -> int:
        """Return how many items, at most, do not take too long even where they are slowest."""
        if self._most_seconds is None or self.pace == 0:
            return items
        slowest = int(self._most_seconds / (self.pace * self._samples_per_item))
        return max(min(items, slowest), self._least)


class Windows:
    """Cuts a rectangle into windows, one for each launch.

    Iterating yields (x0, y0, x1, y1); after each launch call `took`.

    Parameters
    ----------
    x0, y0, x1, y1
        The rectangle.
    pacing
        How large they are.
    """

    EDGE = 32
    """Windows end at multiples of it: a multiple of every tile and work-group."""

    def __init__(self, x0: int, y0: int, x1: int, y1: int, pacing: Pacing) -> None:
        self._bounds, self.pacing = (x0, y0, x1, y1), pacing
        self._done = 0

    def __iter__(self) -> Iterator[tuple[int, int, int, int]]:
        """Yield windows, row by row."""
        x0, y0, x1, y1 = self._bounds
        x, y = x0, y0
        while y < y1:
            # Cut where tiles of the whole frame end.
            rows, items = min(self.EDGE - y % self.EDGE, y1 - y), self.pacing.items
            columns = x1 - x
            if items < rows * columns:
                wide = max(items // rows // self.EDGE, 1) * self.EDGE
                columns = min(columns, wide - x % self.EDGE)
            elif x == x0:
                more = max(items // columns // self.EDGE - 1, 0) * self.EDGE
                rows = min(rows + more, y1 - y)
            self._done += rows * columns
            yield x, y, x + columns, y + rows
            x += columns
            if x >= x1:
                x, y = x0, y + rows

    def took(self, window: tuple[int, int, int, int], seconds: float) -> float:
        """Choose the next window's size by the seconds that one took; returns them."""
        x0, y0, x1, y1 = window
        self.pacing.took((x1 - x0) * (y1 - y0), seconds)
        return seconds

    @property
    def done(self) -> float:
        """The part of the rectangle handed out, 0 to 1."""
        x0, y0, x1, y1 = self._bounds
        return self._done / ((x1 - x0) * (y1 - y0))
