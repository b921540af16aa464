"""Sources of a volume's velocity: a grid of vectors, an array [z, y, x, 3], or three scalar grids."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tfm_cl.errors import VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.paths import source_of
from tfm_cl.files.volume_io import numpy_array
from tfm_cl.files.volume_io.grid import Grid, shown, shown_names
from tfm_cl.files.volume_io.leaves import Index, Leaves
from tfm_cl.files.volume_io.limits import too_large
from tfm_cl.files.volume_io.stored_velocity import Component, StoredVelocity, VelocitySource, components_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

NAMES = ("v", "vel", "velocity")
"""Of the grid of vectors, in any case, that is found by itself; the first that there is."""
PARTS = (".{}", "_{}", "{}")
"""What three grids of numbers have after such a name, of x, y and z: ``vel.x``, ``vel_x``, ``velx``."""
AXES = ("x", "y", "z")
STAGGERED = "staggered"
"""Class of a grid of vectors whose components lie on the faces of voxels: half a voxel lower along their
axes."""


def read_velocity(path: Path, shape: Index, source: VelocitySource) -> StoredVelocity | None:
    """Read the velocity for a grid of ``path``.

    Parameters
    ----------
    path
        The grid's file.
    shape
        Its voxels (z, y, x), which arrays without a place of their own have too.
    source
        As of `tfm_cl.scene.bodies.volume.Volume.with_velocity`.

    Returns
    -------
    None if there is none, and none was named.

    Raises
    ------
    VolumeError
        What is named does not exist, is damaged, too large, or no velocity of such voxels.
    """
    if source is False:
        return None
    if source is not None and not isinstance(source, str | Path):
        return _of_parts(path, shape, volume_io.open_grids(path), list(source))
    in_file, name = path, None if source is None else str(source)
    if source is not None and volume_io.is_volume_file(source):
        in_file, name = source_of(source, error=VolumeError), None
    found = _found(in_file, shape, name, any_name=in_file != path)
    if found is None and source is not None:
        names = shown_names([grid.name for grid in volume_io.open_grids(in_file)]) or "none"
        raise VolumeError(
            f"{in_file}: velocity = {shown(str(source))}: no grid of vectors, and no three grids 'vel.x', "
            f"'vel.y', 'vel.z'; its grids: {names}"
        )
    return found


def _found(path: Path, shape: Index, name: str | None, *, any_name: bool) -> StoredVelocity | None:
    """Find the velocity that is named, or called as such are; ``any_name``: the file's only one too."""
    if path.suffix.lower() in numpy_array.EXTENSIONS:
        found = _of_array(path, shape, name, any_name=any_name)
        if found is not None or path.suffix.lower() == ".npy":
            return found
    grids = volume_io.open_grids(path)
    if (grid := _vectors_among(path, grids, name, any_name=any_name)) is not None:
        return _of_vectors(path, shape, grid)
    parts = _parts_among(grids) if name is None else []
    return _of_parts(path, shape, grids, parts[0]) if parts else None


def _of_array(path: Path, shape: Index, name: str | None, *, any_name: bool) -> StoredVelocity | None:
    """Find an array [z, y, x, 3] of a ``.npy`` or ``.npz`` file."""
    if path.suffix.lower() == ".npz":
        arrays = numpy_array.open_arrays(path)
        by_name = {key.lower(): key for key in arrays}
        keys = [by_name[usual] for usual in NAMES if usual in by_name] if name is None else [name]
        keys = [key for key in keys if key in arrays and (name or len(arrays[key].header.shape) == 4)]  # noqa: PLR2004 - z, y, x, vector
        if not keys:
            return None
        stored = numpy_array.open_colour(path, keys[0])
    elif not any_name:
        return None  # it is the density
    else:
        stored = numpy_array.open_colour(path)
    if stored.header.shape != (*shape, 3):
        raise VolumeError(
            f"{stored.label} has the shape {list(stored.header.shape)}; a velocity is [z, y, x, 3] of the "
            f"volume, {[*shape, 3]}"
        )
    z, y, x = shape
    if reason := too_large((z, y, 3 * x), sparse=False):
        raise VolumeError(f"{stored.label}, a velocity, {reason}, components counted")
    return StoredVelocity(stored.label, components_of(stored.read()))


def _vectors_among(path: Path, grids: list[Grid], name: str | None, *, any_name: bool) -> Grid | None:
    """Find the grid of vectors that is named, or called as such are, or is the only one of another file."""
    if name is not None:
        grid = volume_io.find_grid(path, grids, name)
        if grid.read_colour is None:
            raise VolumeError(
                f"{path}: grid {shown(name)}, of {grid.value_type} values, is no velocity with three values "
                "per voxel; name three grids instead, as ['vel.x', 'vel.y', 'vel.z']"
            )
        return grid
    vectors = [grid for grid in grids if grid.read_colour is not None]
    for usual in NAMES:
        for grid in vectors:
            if usual in (grid.name.lower(), (grid.shared_name or "").lower()):
                return grid
    return vectors[0] if any_name and len(vectors) == 1 else None


def _parts_among(grids: list[Grid]) -> list[list[str]]:
    """Find three grids of numbers that are called as the components of a velocity are."""
    by_name = {grid.name.lower(): grid.name for grid in grids if grid.read_colour is None}
    names = ([base + part.format(axis) for axis in AXES] for base in NAMES for part in PARTS)
    return [[by_name[name] for name in three] for three in names if all(name in by_name for name in three)]


def _of_vectors(path: Path, shape: Index, grid: Grid) -> StoredVelocity:
    """Read a grid of vectors."""
    label = f"{path}: grid {shown(grid.name)}"
    sparse = grid.read_vector_leaves is not None
    z, y, x = grid.shape
    if reason := too_large((z, y, x if sparse else 3 * x), sparse=sparse):
        raise VolumeError(f"{label}, a velocity, {reason}")
    place = _place(shape, grid, label)
    if grid.read_vector_leaves is not None:
        try:
            leaves = grid.read_vector_leaves()
        except OSError as error:
            raise VolumeError(f"{path}: cannot be read ({error.strerror or error})") from error
        components = tuple(Component(one, place) for one in leaves)
    else:
        components = tuple(
            one._replace(world_from_index=place) for one in components_of(volume_io.read_vectors(path, grid))
        )
    if grid.grid_class == STAGGERED and place is not None:
        lower = [place - 0.5 * np.outer(place[:, axis], (0, 0, 0, 1)) for axis in range(3)]
        components = tuple(
            one._replace(world_from_index=matrix) for one, matrix in zip(components, lower, strict=True)
        )
    return StoredVelocity(label, components)


def _of_parts(path: Path, shape: Index, grids: list[Grid], names: list[str]) -> StoredVelocity:
    """Read three grids of numbers, each of which may have voxels of its own."""
    if len(names) != len(AXES):
        raise VolumeError(f"{path}: velocity is three names of grids, for x, y and z; got {len(names)}")
    components = []
    for name in names:
        grid = volume_io.find_grid(path, grids, name)
        label = f"{path}: grid {shown(grid.name)}, a component of the velocity,"
        if grid.read_colour is not None:
            raise VolumeError(f"{label} has three values per voxel; name it alone, or three grids of numbers")
        if reason := volume_io.refusal(grid):
            raise VolumeError(f"{label} {reason}")
        stored = volume_io.read_stored(path, grid)
        leaves = stored if isinstance(stored, Leaves) else Leaves.from_dense(stored)
        components.append(Component(leaves, _place(shape, grid, label)))
    return StoredVelocity(f"{path}: grids {shown_names(names)}", tuple(components))


def _place(shape: Index, grid: Grid, label: str) -> NDArray[np.float64] | None:
    """Return where a grid's voxels are; without a transform they are the density's."""
    if grid.has_transform:
        return grid.world_from_index
    if grid.shape != shape:
        raise VolumeError(f"{label} has the shape {list(grid.shape)}; expected {list(shape)}")
    return None
