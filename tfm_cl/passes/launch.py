"""What every pass needs to run kernels: the queue, buffers within the device's limits, and timing."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from tfm_cl.errors import DeviceError, DeviceMemoryError
from tfm_cl.program import KernelLibrary

Progress = Callable[[str, float], None]
"""Called as ``progress(stage, fraction)`` with the stage's name and the part of it that is done, 0 to 1."""

SAMPLES_PER_LAUNCH = 1 << 24
"""Work is cut so that a launch takes about this many density samples: a few tenths of a second on a CPU."""


class Launcher:
    """One device's context, queue and kernels.

    Parameters
    ----------
    device
        OpenCL device.
    options
        Further compiler options.
    work_group
        Work-group size (x, y); None leaves it to the driver.
    """

    def __init__(
        self, device: cl.Device, options: tuple[str, ...] = (), work_group: tuple[int, int] | None = (8, 8)
    ) -> None:
        self.device = device
        self.context = cl.Context([device])
        self.queue = cl.CommandQueue(self.context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        self.kernels = KernelLibrary(self.context, options)
        self.work_group = work_group

    def run(
        self, kernel: cl.Kernel, size: tuple[int, ...], *args: Any, offset: tuple[int, ...] | None = None
    ) -> float:
        """Run a kernel over exactly ``size`` work-items, wait, and return its seconds on the device."""
        group = self.work_group
        if group is None or len(group) != len(size) or any(n % g for n, g in zip(size, group, strict=True)):
            group = None  # the driver finds one that divides the size
        try:
            event = kernel(self.queue, size, group, *args, global_offset=offset)
            event.wait()
        except cl.MemoryError as error:
            raise DeviceMemoryError(f"{self.device.name.strip()}: out of memory ({error})") from error
        except cl.Error as error:
            raise DeviceError(
                f"{self.device.name.strip()}: {kernel.function_name} failed ({error})"
            ) from error
        return float(event.profile.end - event.profile.start) * 1e-9

    def empty(self, what: str, nbytes: int) -> cl.Buffer:
        """Allocate a device buffer.

        Raises
        ------
        DeviceMemoryError
            When it exceeds the device's largest allocation, or allocation fails: with both numbers.
        """
        limit = self.device.max_mem_alloc_size
        if nbytes > limit:
            raise DeviceMemoryError(
                f"{what} needs a buffer of {nbytes / 2**20:,.0f} MiB; "
                f"{self.device.name.strip()} allows {limit / 2**20:,.0f} MiB"
            )
        try:
            return cl.Buffer(self.context, cl.mem_flags.READ_WRITE, max(nbytes, 16))
        except cl.Error as error:
            raise DeviceMemoryError(
                f"{what}: {self.device.name.strip()} could not allocate {nbytes / 2**20:,.0f} MiB "
                f"of its {self.device.global_mem_size / 2**20:,.0f} MiB ({error})"
            ) from error

    def zeros(self, what: str, nbytes: int) -> cl.Buffer:
        """Allocate a device buffer of zeros."""
        buffer = self.empty(what, nbytes)
        cl.enqueue_fill_buffer(self.queue, buffer, np.zeros(1, np.uint8), 0, max(nbytes, 16))
        return buffer

    def upload(self, what: str, array: NDArray[Any]) -> cl.Buffer:
        """Copy an array to the device."""
        buffer = self.empty(what, array.nbytes)
        self.write(buffer, array)
        return buffer

    def write(self, buffer: cl.Buffer, array: NDArray[Any]) -> None:
        """Copy an array into a buffer of its size."""
        cl.enqueue_copy(self.queue, buffer, np.ascontiguousarray(array))

    def download(self, buffer: cl.Buffer, shape: tuple[int, ...], dtype: type[np.generic]) -> NDArray[Any]:
        """Copy a buffer to the host."""
        array = np.empty(shape, dtype)
        cl.enqueue_copy(self.queue, array, buffer)
        return array


def tiles(x0: int, y0: int, x1: int, y1: int, samples_per_pixel: int) -> Iterator[tuple[int, int, int, int]]:
    """Cut a rectangle into square tiles (x, y, width, height) of about `SAMPLES_PER_LAUNCH` samples."""
    edge = 256
    while edge > 8 and edge * edge * samples_per_pixel > SAMPLES_PER_LAUNCH:  # noqa: PLR2004 - a work-group
        edge //= 2
    for y in range(y0, y1, edge):
        for x in range(x0, x1, edge):
            yield x, y, min(edge, x1 - x), min(edge, y1 - y)
