"""Converts stored values to densities by an offset and a window, as needed for CT data."""

import math
import reprlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.files.volume_io.limits import too_large
from tfm_cl.limits import LARGEST_COLOUR


def _is_number(value: Any) -> bool:
    is_real = isinstance(value, int | float | np.integer | np.floating)
    return is_real and bool(-LARGEST_COLOUR <= value <= LARGEST_COLOUR)  # NaN is not


class ValueMap(NamedTuple):
    """Conversion of stored values to densities, before the density scale.

    Each value becomes ``value + offset``. Without a window, negative results then become 0; with one, low to
    high are mapped to 0 to 1, and values outside the window are clamped. NaN stays NaN. If neither is given,
    values do not change.
    """

    offset: float = 0.0
    window: tuple[float, float] | None = None
    """Values (low, high), low < high, that become 0 and 1."""

    def check(self, label: str) -> None:
        """Raise `VolumeError` if the numbers are not finite or too large, or do not form a window."""
        if not _is_number(self.offset):
            raise VolumeError(
                f"{label}: offset is a finite number, at most {LARGEST_COLOUR:g}; got "
                f"{reprlib.repr(self.offset)}"
            )
        match self.window:
            case None:
                return
            case [low, high] if _is_number(low) and _is_number(high) and np.float32(low) < np.float32(high):
                return
        raise VolumeError(
            f"{label}: window is two numbers [low, high], low < high; got {reprlib.repr(self.window)}"
        )

    @property
    def is_identity(self) -> bool:
        """Whether values do not change."""
        return self.offset == 0 and self.window is None

    def of_number(self, value: float) -> float:
        """Convert one stored value."""
        return float(self.of_array(np.array([value], np.float32))[0])

    def of_array(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Convert an array in place and return it."""
        if self.is_identity:
            return values
        with np.errstate(invalid="ignore", over="ignore"):
            values += np.float32(self.offset)
            if self.window is None:
                return np.maximum(values, np.float32(0), out=values)
            low, high = (np.float32(end) for end in self.window)
            values -= low
            values /= high - low
            return np.clip(values, np.float32(0), np.float32(1), out=values)

    def of_stored(self, stored: NDArray[np.float32] | Leaves, label: str) -> NDArray[np.float32] | Leaves:
        """Convert voxels in their stored form: a dense array in place, leaves as new leaves.

        Leaves become a dense array if the empty space between them does not stay 0.

        Raises
        ------
        VolumeError
            If that array would be too large.
        """
        if not isinstance(stored, Leaves):
            return self.of_array(stored)
        if self.is_identity:
            return stored
        empty = self.of_number(0.0)
        if empty == 0:
            mapped = self.of_array(stored.values.copy())
            return Leaves(stored.shape, stored.first, stored.coordinates, mapped)
        reason = too_large(stored.shape, sparse=False)
        if reason:
            raise VolumeError(
                f"{label}: offset and window make its empty space {empty:g}, so that all of it takes memory; "
                f"it {reason}; choose them so that 0 stays 0"
            )
        return self.of_array(stored.to_dense())

    def note(self, outside: float, label: str) -> str:
        """Describe what becomes of a file's value outside its voxels; empty if it is 0."""
        value = self.of_number(outside)
        if value == 0:
            return ""
        shown = "no number" if math.isnan(value) else f"{value:g}"
        return (
            f"{label}: outside what the file stores its value is {shown} without end; it is that inside the "
            "box around what is stored, and 0 outside"
        )
