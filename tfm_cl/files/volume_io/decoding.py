"""Plain numbers, one after the other, as voxels: what formats without a tree share."""

import math
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError

_VOXELS_PER_STEP = 1 << 20


class ByteSource(Protocol):
    """A source from which voxels are decoded: a file, a member of an archive, a decompressor."""

    def read(self, size: int, /) -> bytes:
        """Return ``size`` bytes, fewer only at the end."""
        ...


def read_voxels(
    source: ByteSource,
    dtype: np.dtype[Any],
    shape: tuple[int, int, int],
    path: Path,
    *,
    order: Literal["C", "F"] = "C",
    channels: int = 1,
    channel: int = 0,
) -> NDArray[np.float32]:
    """Decode one channel of an array of numbers.

    The memory grows with what has really been read, so that a small file cannot have a large array
    allocated by declaring one.

    Parameters
    ----------
    source
        Stands at the first value.
    dtype
        Type of a value: real, integer or bool, of either byte order.
    shape
        (z, y, x).
    path
        For the message.
    order
        ``C``: x varies fastest in the file; ``F``: z does.
    channels, channel
        Number of interleaved values of a voxel, and the one wanted.

    Returns
    -------
    NDArray[np.float32]
        [z, y, x], C order; values beyond float32 become infinite.

    Raises
    ------
    VolumeError
        ``source`` ends too early.
    """
    count, done = math.prod(shape), 0
    stored = np.dtype(np.uint8) if dtype.kind == "b" else dtype
    voxels = np.empty(min(count, _VOXELS_PER_STEP), np.float32)
    while done < count:
        step = min(_VOXELS_PER_STEP, count - done)
        chunk = source.read(step * channels * stored.itemsize)
        if len(chunk) != step * channels * stored.itemsize:
            raise VolumeError(f"{path}: its data end early, within {count:,} voxels; the file is cut short")
        if done + step > voxels.size:
            voxels.resize(min(count, 2 * voxels.size), refcheck=False)
        values = np.frombuffer(chunk, stored).reshape(step, channels)[:, channel]
        with np.errstate(over="ignore", invalid="ignore"):
            voxels[done : done + step] = values if dtype.kind != "b" else values != 0
        done += step
    if order == "F":
        return np.ascontiguousarray(voxels.reshape(shape[::-1]).T)
    voxels.resize(shape, refcheck=False)  # not a view: an array of its own can be kept without a copy
    return voxels
