"""What lights bring to any points, through all media and past all solids (``kernels/light_at.cl``)."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.launch import LOOK_UP

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pyopencl as cl

    from tfm_cl.device.field import Met
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.media import MediaOnDevice
    from tfm_cl.render.batches import Batch

WHAT = "the light at points"
"""What messages call it."""
RGB = 3
SUMS = 2 * RGB + 1
"""Numbers of a point: what arrives, and what is left by its weight, and the weights."""


class PointSums:
    """Sums over the lights at some points.

    Parameters
    ----------
    media
        On the device.
    met
        What kernels are told of media.
    view
        The struct of a camera, which says how maps speak of media, too.
    points
        [n, 3], from the device's origin.
    groups
        Number of the group that each light belongs to.
    """

    def __init__(
        self,
        launcher: Launcher,
        media: MediaOnDevice,
        met: Met,
        view: cl.Buffer,
        points: NDArray[np.float32],
        groups: Sequence[int],
    ) -> None:
        self._launcher, self._media, self._met = launcher, media, met
        self._view, self._groups = view, groups
        self._count = len(points)
        self._points = launcher.upload(WHAT, np.ascontiguousarray(points.T))
        self._sums: dict[int, cl.Buffer] = {}

    @cached_property
    def _nbytes(self) -> int:
        return 4 * SUMS * self._count

    def add(self, batch: Batch) -> None:
        """Look some of the lights up."""
        launcher, lanes = self._launcher, self._launcher.lanes
        kernel = launcher.kernels.kernel("light_at_points", "light_at.cl", *batch.variant(self._media))
        known = self._met.arguments | batch.arguments
        known |= {"view": self._view, "points": self._points, "count": self._count}
        items = -(-self._count // lanes)
        for number, light in enumerate(batch.indices):
            group = self._groups[light]
            if group not in self._sums:
                self._sums[group] = launcher.zeros(WHAT, self._nbytes)
            of_light = known | {"number": number, "sums": self._sums[group]}
            launcher.run_items(kernel, items, LOOK_UP * lanes, of_light)

    def of(self, group: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return what is left of a group's light, and what arrives of it, both [n, RGB]."""
        sums = np.zeros((SUMS, self._count), np.float32)
        if group in self._sums:
            sums = self._launcher.download(self._sums[group], (SUMS, self._count), np.float32)
        arrives, weighted, weights = sums[:RGB].T, sums[RGB : 2 * RGB].T, sums[2 * RGB :].T
        return np.divide(weighted, weights, out=np.zeros_like(weighted), where=weights > 0), arrives
