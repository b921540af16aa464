"""Velocities beside a density: found by their names, or named, in every format that has vectors."""

import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.volume_io.velocity import read_velocity
from tfm_cl.files.volume_io.writing import write_grids
from tfm_cl.files.volume_io.written_grid import WrittenGrid

SHAPE = (10, 9, 12)
PLACE = np.diag([0.5, 0.5, 0.5, 1.0])


def vectors(seed=5):
    return np.random.default_rng(seed).normal(size=(*SHAPE, 3)).astype(np.float32)


def written(path, **grids):
    """A file of grids that hold something everywhere."""
    if path.suffix == ".npz":
        np.savez(path, **grids)
        return path
    grids = {name.replace("__", "."): values for name, values in grids.items()}
    active = np.ones(SHAPE, bool)
    write_grids(path, [WrittenGrid(name, values, active, PLACE) for name, values in grids.items()])
    return path


def dense(component):
    """Its values at the density's voxels: boxes of trees begin at 0 here, and are longer."""
    z, y, x = SHAPE
    return component.leaves.to_dense()[:z, :y, :x]


@pytest.mark.parametrize("extension", [".vdb", ".nvdb", ".npz"])
@pytest.mark.parametrize("name", ["v", "vel", "velocity"])
def test_a_grid_of_vectors_is_found_by_its_name(tmp_path, extension, name):
    density, velocity = np.ones(SHAPE, np.float32), vectors()
    path = written(tmp_path / f"a{extension}", density=density, **{name: velocity})
    assert volume_io.choose_grid(path).name == "density"
    found = read_velocity(path, SHAPE, None)
    for axis, component in enumerate(found.components):
        assert np.array_equal(dense(component), velocity[..., axis])
        where = component.world_from_index
        assert where is None if extension == ".npz" else np.allclose(where, PLACE)


@pytest.mark.parametrize("extension", [".vdb", ".npz"])
def test_three_grids_are_one_velocity(tmp_path, extension):
    velocity = vectors()
    names = [f"vel{'__' if extension == '.vdb' else '.'}{axis}" for axis in "xyz"]
    grids = dict(zip(names, np.moveaxis(velocity, -1, 0).copy(), strict=True))
    path = written(tmp_path / f"a{extension}", density=np.ones(SHAPE, np.float32), **grids)
    for source in (None, ["vel.x", "vel.y", "vel.z"]):
        found = read_velocity(path, SHAPE, source)
        assert all(np.array_equal(dense(one), velocity[..., i]) for i, one in enumerate(found.components))


def test_another_file_may_hold_it(tmp_path):
    path = written(tmp_path / "a.npz", density=np.ones(SHAPE, np.float32))
    velocity = vectors()
    np.save(tmp_path / "flow.npy", velocity)
    written(tmp_path / "flow.vdb", flow=velocity)
    for name in ("flow.npy", "flow.vdb"):
        found = read_velocity(path, SHAPE, tmp_path / name)
        assert np.array_equal(dense(found.components[2]), velocity[..., 2])


def test_components_on_faces_lie_half_a_voxel_lower(tmp_path, monkeypatch):
    path = written(tmp_path / "a.vdb", vel=vectors())
    (grid,) = volume_io.open_grids(path)
    object.__setattr__(grid, "grid_class", "staggered")
    monkeypatch.setattr(volume_io, "open_grids", lambda _: [grid])
    found = read_velocity(path, SHAPE, "vel")
    for axis, component in enumerate(found.components):
        low = component.world_from_index[:3, 3]
        assert low == pytest.approx(np.where(np.arange(3) == axis, -0.25, 0.0))


def test_nothing_is_found_where_nothing_is_called_so(tmp_path):
    path = written(tmp_path / "a.npz", density=np.ones(SHAPE, np.float32), Cd=vectors())
    assert read_velocity(path, SHAPE, None) is None
    assert read_velocity(path, SHAPE, False) is None
    assert read_velocity(path, SHAPE, "Cd") is not None


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("flow", "no grid named 'flow'; it has 'density', 'heat', 'vel'"),
        ("heat", "'heat', of .* values, is no velocity with three values per voxel"),
        (["heat", "density", "vel"], "'vel', a component of the velocity, has three values per voxel"),
        (["heat", "density"], r"three names of grids, for x, y and z; got 2"),
    ],
)
def test_what_is_no_velocity_is_refused(tmp_path, source, message):
    ones = np.ones(SHAPE, np.float32)
    path = written(tmp_path / "a.vdb", density=ones, heat=ones, vel=vectors())
    with pytest.raises(VolumeError, match=message):
        read_velocity(path, SHAPE, source)


def test_an_array_of_another_shape_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, density=np.ones(SHAPE), velocity=np.ones((3, 4, 5, 3)))
    with pytest.raises(VolumeError, match=r"array 'velocity' has the shape \[3, 4, 5, 3\]; a velocity is"):
        read_velocity(path, SHAPE, None)
