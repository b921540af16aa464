"""Voxels that are on the device already."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

from tfm_cl.device.bricks import build_bricks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.device.bricks import BrickGrid, VoxelType
    from tfm_cl.device.launch import Launcher
    from tfm_cl.scene.bodies import Volume


class BrickCache:
    """Keeps the bricks of grids as long as these live.

    Grids are known by their voxels: wherever they lie, and at whatever density scale.
    """

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher
        self._kept: dict[tuple[object, ...], tuple[list[weakref.ref[object]], BrickGrid]] = {}

    def bricks(self, grids: Sequence[Volume], voxels: VoxelType) -> BrickGrid | None:
        """Put the voxels of grids on the device, once for each type; None without grids."""
        if not grids:
            return None
        stores = [store for grid in grids for store in grid.stores]
        key = (voxels, *map(id, stores))
        for other, (refs, _) in list(self._kept.items()):
            if any(ref() is None for ref in refs):
                del self._kept[other]
        if key not in self._kept:
            what = "the volume ({})".format(
                ", ".join("{2}×{1}×{0} voxels".format(*grid.shape) for grid in grids)
            )
            built = build_bricks(self._launcher, [grid.channel_leaves for grid in grids], what, voxels)
            self._kept[key] = [weakref.ref(store) for store in stores], built
        return self._kept[key][1]

    def clear(self) -> None:
        """Forget everything."""
        self._kept.clear()
