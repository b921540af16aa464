"""Write the test files of ``tests/files/volume_io/data`` with OpenVDB, or describe a ``.vdb`` file.

Needs OpenVDB's Python module (Debian: python3-openvdb, for the system's Python)::

    /usr/bin/python3 scripts/make_vdb_fixtures.py write tests/files/volume_io/data
    /usr/bin/python3 scripts/make_vdb_fixtures.py describe cloud.vdb ...

``write`` describes its files as well. The description ``cloud.npz`` beside ``cloud.vdb`` holds ``grids``
(JSON: name, class, background, active voxels of each grid) and per grid N ``N_matrix`` (4×4 world-from-index,
column vectors) and, for grids that are not empty, ``N_low`` (index x, y, z) and ``N_values`` (float32
[z, y, x], for vectors [z, y, x, 3]): all leaves and active values with a margin of 24 voxels, as OpenVDB
reads them.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyopenvdb as vdb  # type: ignore[import-not-found]

MARGIN = 24


def main() -> None:
    """Run the command on the command line."""
    match sys.argv[1:]:
        case ["write", folder]:
            for name, grids in fixtures().items():
                path = Path(folder) / f"{name}.vdb"
                vdb.write(str(path), grids, metadata={"creator": "scripts/make_vdb_fixtures.py"})
                describe(path, save=np.savez_compressed)
        case ["describe", *paths]:
            for name in paths:
                describe(Path(name))
        case _:
            sys.exit(__doc__)


def fixtures() -> dict[str, list[Any]]:
    """Grids of each file."""
    return {
        "negative": [negative()],
        "tiles": [tiles()],
        "half": [half()],
        "sphere": [sphere()],
        "several": several(),
    }


def negative() -> Any:
    """Return a fog volume on both sides of the origin, under a rotated, anisotropic transform."""
    grid = vdb.FloatGrid()
    grid.name = "density"
    grid.gridClass = vdb.GridClass.FOG_VOLUME
    values = np.random.default_rng(1).random((5, 6, 7), dtype=np.float32)
    values[values < 0.4] = 0  # noqa: PLR2004 - most voxels, with zeros in between
    grid.copyFromArray(values, ijk=(-13, -30, -9))
    grid.getAccessor().setValueOn((3, 4, 5), 0.75)
    grid.transform.scale((0.5, 0.25, 2.0))
    grid.transform.rotate(0.3, vdb.Axis.Y)
    grid.transform.translate((10.0, -20.0, 30.0))
    return grid


def tiles() -> Any:
    """Return active tiles, and inactive values in every number and kind that a node can have."""
    grid = vdb.FloatGrid(0.5)
    grid.name = "tiles"
    grid.fill((0, 0, 0), (23, 15, 7), 2.0)
    grid.fill((40, 0, 0), (47, 7, 7), -0.5, active=False)
    grid.prune()
    access = grid.getAccessor()
    for leaf, inactive in enumerate(
        [(), (-0.5,), (3.0,), (-0.5, 0.5), (3.0, 0.5), (3.0, 4.0), (3.0, 4.0, 5.0)]
    ):
        y = 32 + 8 * leaf
        for place in range(512):
            if inactive and place % 5:
                ijk = (place >> 6, y + (place >> 3 & 7), place & 7)
                access.setValueOff(ijk, inactive[place % 5 % len(inactive)])
        access.setValueOn((1, y, 2), 10.0 + leaf)
    grid.transform = vdb.createLinearTransform([[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 3, 0], [5, 6, 7, 1]])
    return grid


def half() -> Any:
    """Return values that half floats round, with a background that is rounded as well."""
    grid = vdb.FloatGrid(0.1)
    grid.name = "density"
    grid.saveFloatAsHalf = True
    values = np.random.default_rng(2).normal(size=(9, 4, 4)).astype(np.float32)
    grid.copyFromArray(values, ijk=(100, 200, 300))
    grid.getAccessor().setValueOff((101, 201, 305), 0.3)
    grid.transform = vdb.createLinearTransform(0.1)
    return grid


def sphere() -> Any:
    """Return a level set with interior tiles of minus the background."""
    grid = vdb.createLevelSetSphere(radius=12.0, center=(40.0, 40.0, 40.0), voxelSize=1.0, halfWidth=2.0)
    grid.name = "sphere"
    return grid


def several() -> list[Any]:
    """Return grids of several types: two share a name, one has none, one shares the tree of another."""
    first = vdb.FloatGrid()
    first.name = "density"
    first.fill((0, 0, 0), (3, 3, 3), 1.0)
    second = vdb.FloatGrid()
    second.name = "density"
    second.fill((8, 0, 0), (11, 3, 3), 2.0)
    shared = first.copy()
    shared.name = "shared"
    shared.transform = vdb.createLinearTransform(0.5)
    shared.transform.translate((1.0, 2.0, 3.0))
    mask = vdb.BoolGrid()
    mask.name = "mask"
    mask.fill((0, 0, 0), (2, 4, 6), value=True)
    velocity = vdb.Vec3SGrid()
    velocity.name = "velocity"
    velocity.fill((0, 0, 0), (7, 7, 7), (1.0, 2.0, 3.0))
    nameless = vdb.FloatGrid()
    nameless.transform = vdb.createFrustumTransform((0, 0, 0), (10, 10, 10), 0.5, 10.0)
    return [first, second, shared, mask, velocity, nameless]


def describe(path: Path, save: Callable[..., None] = np.savez) -> None:
    """Write what OpenVDB reads from a file to a description beside it."""
    grids, _ = vdb.readAll(str(path))
    facts = []
    arrays: dict[str, Any] = {}
    for index, grid in enumerate(grids):
        arrays[f"{index}_matrix"] = matrix_of(grid.transform)
        fact = {"name": grid.name, "class": grid.gridClass, "active": grid.activeVoxelCount()}
        if grid.valueTypeName in ("float", "bool", "vec3s"):
            fact["background"] = np.asarray(grid.background, float).tolist()
            if grid.leafCount() or grid.activeVoxelCount():
                arrays[f"{index}_low"], arrays[f"{index}_values"] = dense(grid)
        facts.append(fact)
    save(path.with_suffix(".npz"), grids=np.array(json.dumps(facts)), **arrays)


def matrix_of(transform: Any) -> np.ndarray[Any, Any]:
    """World-from-index, 4×4."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    origin, *axes = (np.array(transform.indexToWorld(corner)) for corner in corners)
    matrix = np.eye(4)
    matrix[:3] = np.stack([*(axis - origin for axis in axes), origin], axis=1)
    return matrix


def dense(grid: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Low corner (x, y, z) and float32 [z, y, x(, 3)] of the box around all leaves and active values."""
    boxes = np.array([grid.evalLeafBoundingBox(), grid.evalActiveVoxelBoundingBox()])
    low = boxes[:, 0].min(axis=0) - MARGIN
    shape = boxes[:, 1].max(axis=0) + MARGIN + 1 - low
    components = [3] if grid.valueTypeName == "vec3s" else []
    values = np.empty([*shape, *components], bool if grid.valueTypeName == "bool" else np.float32)
    grid.copyToArray(values, ijk=tuple(int(i) for i in low))
    return low, values.swapaxes(0, 2).astype(np.float32)


if __name__ == "__main__":
    main()
