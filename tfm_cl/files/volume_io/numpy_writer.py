"""Writes grids as one NumPy array, and a JSON file beside it that says what is where.

The array is float32 [grid, z, y, x], or [grid, z, y, x, RGB] where any grid has colours; voxels that are not
active are 0. ``light.npy`` has ``light.json`` beside it, with the grids' names in their order.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io.written_grid import WrittenGrid


def write(path: Path, grids: Sequence[WrittenGrid]) -> None:
    """Write the array; may leave it incomplete if it raises."""
    coloured = any(grid.is_vector for grid in grids)
    first = grids[0]
    with path.open("wb") as stream:
        shape = (len(grids), *first.active.shape, *[3] * coloured)
        np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
        for grid in grids:
            values = grid.dense
            if coloured and not grid.is_vector:
                values = np.repeat(values[..., None], 3, axis=-1)
            stream.write(values.astype("<f4", copy=False).data)


def describe(grids: Sequence[WrittenGrid]) -> str:
    """Return the text of the JSON file.

    Raises
    ------
    VolumeError
        The grids have different voxels: they do not make one array.
    """
    first = grids[0]
    for grid in grids:
        same = np.array_equal(grid.world_from_index, first.world_from_index)
        if grid.active.shape != first.active.shape or not same:
            raise VolumeError("grids with different voxels do not make one array; write .vdb or .nvdb")
    axes = ["grid", "z", "y", "x", *["rgb"] * any(grid.is_vector for grid in grids)]
    facts = {
        "axes": axes,
        "world_from_index": np.asarray(first.world_from_index).tolist(),
        "index": "voxel (x, y, z) of the array; whole numbers are voxel centres",
        "grids": [{"name": grid.name, **grid.metadata} for grid in grids],
    }
    return json.dumps(facts, indent=2) + "\n"
