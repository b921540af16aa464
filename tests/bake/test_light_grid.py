"""Light on voxels: what a renderer says at their centres is what the files hold there."""

import json

import numpy as np
import pytest
from scenes import make_scene
from tolerances import FLOAT32

import tfm_cl as tfm
from tfm_cl.bake.light_grid import LightGridBake
from tfm_cl.cli import main
from tfm_cl.errors import SceneError
from tfm_cl.files.volume_io import open_grids
from tfm_cl.maps.light_at_points import LightAtPoints

PLACED = 20 * FLOAT32
"""Of sines of places near 1 that a file's transform and the lattice give."""


def transmittance_at(points):
    """Something of the two lights: the first is grey."""
    wave = 0.5 + 0.4 * np.sin(points @ np.array([[1.0, 2.0, -1.0], [0.5, -1.0, 2.0], [2.0, 0.3, 0.1]]))
    return np.stack([np.repeat(wave[..., :1], 3, axis=-1), wave]).astype(np.float32)


def silent(_stage, _part):
    """Tell nobody."""


class Fake:
    """A renderer that knows what light there is, and counts the points."""

    def __init__(self):
        self.points = 0

    def light_at(self, _scene, points, *, progress=None):
        assert progress is None
        self.points += len(points)
        found = transmittance_at(points)
        return LightAtPoints(("1", "key"), found, 3 * found)


SCENE = make_scene(
    lights=[tfm.SunLight(from_=(0, 1, 0), to=(0, 0, 0)), tfm.PointLight(from_=(0, 3, 0), name="key")]
)


def baked(tmp_path, name="light.vdb", scene=SCENE, **options):
    """Return the grids of a file, their values and where their voxels are in the world."""
    renderer = Fake()
    path = tmp_path / name
    bake = LightGridBake(**options)
    bake.check(path)
    bake.bake(renderer, scene, path, silent)
    found = []
    for grid in open_grids(path):
        values = grid.read() if grid.read_colour is None else grid.read_colour()
        z, y, x = np.indices(grid.shape)
        places = np.stack([x, y, z], axis=-1) @ grid.world_from_index[:3, :3].T + grid.world_from_index[:3, 3]
        found.append((grid, values, places))
    return found, renderer


@pytest.mark.parametrize("name", ["light.vdb", "light.nvdb"])
def test_voxels_hold_the_light_at_their_centres(tmp_path, name):
    found, renderer = baked(tmp_path, name)
    assert [grid.name for grid, _, _ in found] == ["light_1", "key"]
    volume = SCENE.grids[0]
    for number, (grid, values, places) in enumerate(found):
        assert grid.active_voxels == renderer.points
        expected = transmittance_at(places)[number]
        if number == 0:
            assert values.ndim == 3
            expected = expected[..., 0]
        active = values != 0 if number == 0 else values.any(axis=-1)
        assert np.count_nonzero(active) == renderer.points
        np.testing.assert_allclose(values[active], expected[active], atol=PLACED)
        # All that a density is interpolated from has light, and nothing far from it.
        index = np.linalg.solve(
            volume.world_from_index, np.concatenate([places, np.ones((*grid.shape, 1))], axis=-1)[..., None]
        )
        x, y, z = np.rint(index[..., :3, 0]).astype(int).reshape(-1, 3).T
        padded = np.pad(volume.data, 16)
        near = np.zeros(padded.shape, dtype=bool)
        for dz, dy, dx in np.ndindex(3, 3, 3):
            near |= np.roll(padded > 0, (dz - 1, dy - 1, dx - 1), axis=(0, 1, 2))
        np.testing.assert_array_equal(near[z + 16, y + 16, x + 16].reshape(grid.shape), active)


def test_lattices_of_their_own(tmp_path):
    (first, *_), renderer = baked(tmp_path, quantity="light", grid_res=10)
    grid, values, places = first
    assert renderer.points == grid.active_voxels
    np.testing.assert_allclose(
        values[values > 0], 3 * transmittance_at(places)[0, ..., 0][values > 0], atol=3 * PLACED
    )
    low, high = SCENE.occupied_bounds
    lit = places[values > 0]
    edge = (high - low).max() / 10
    np.testing.assert_allclose(np.ptp(lit, axis=0).max() + edge, (high - low).max(), rtol=1e-6)
    np.testing.assert_allclose((lit.min(axis=0) + lit.max(axis=0)) / 2, (low + high) / 2, atol=1e-6)
    same, _ = baked(tmp_path, quantity="light", voxel_size=float(edge))
    np.testing.assert_array_equal(same[0][1], values)
    everywhere, _ = baked(tmp_path, everywhere=True)
    z, y, x = SCENE.grids[0].shape
    assert everywhere[0][0].active_voxels == (z + 2) * (y + 2) * (x + 2)


def test_numpy_file_says_what_it_holds(tmp_path):
    path = tmp_path / "light.npy"
    written = LightGridBake().bake(Fake(), SCENE, path, silent)
    assert written == [path, tmp_path / "light.json"]
    facts = json.loads(written[1].read_text())
    assert [grid["name"] for grid in facts["grids"]] == ["light_1", "key"]
    assert {grid["tfm:quantity"] for grid in facts["grids"]} == {"transmittance"}
    assert [grid["tfm:light"] for grid in facts["grids"]] == ["sun", "point"]
    assert np.load(path).shape[0] == 2


def test_scenes_without_such_voxels_are_refused(tmp_path):
    def message(scene, **options):
        with pytest.raises(SceneError) as caught:
            baked(tmp_path, scene=scene, **options)
        assert not list(tmp_path.iterdir())
        return str(caught.value)

    volume, box = SCENE.volume, tfm.BoxVolume(from_=(0, 0, 0), to=(1, 1, 1), density=1)
    assert "the scene has no lights" in message(SCENE.replace(lights=[]))
    assert "no volume of voxels" in message(SCENE.replace(volume=box))
    assert "2 volumes of voxels" in message(SCENE.replace(volume=[volume, volume]))
    empty = tfm.Volume(np.zeros((3, 3, 3)))
    assert "all voxels are 0" in message(SCENE.replace(volume=empty))
    fog = tfm.EverywhereVolume(density=0.1)
    assert "everywhere" in message(SCENE.replace(volume=[volume, fog]), grid_res=9)
    assert "the limit is 268,435,456" in message(SCENE, grid_res=100_000)
    assert "give --voxel-size or --grid-res, not both" in message(SCENE, grid_res=9, voxel_size=0.1)


@pytest.mark.slow
def test_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.savez("cloud.npz", density=SCENE.volume.data, voxel_size=0.1)
    assert main(["bake", "cloud.npz", "-o", "light.nvdb", "--what", "light-grid", "--grid-res", "12"]) == 0
    assert capsys.readouterr().out == "light.nvdb\n"
    (grid,) = open_grids(tmp_path / "light.nvdb")
    assert grid.name == "light_1"
    assert grid.active_voxels > 0
    for arguments, message in (
        (("-o", "light.exr"), "cannot be written as '.exr'; known: .npy .nvdb .vdb"),
        (("-o", "l.vdb", "--grid-res", "0"), "grid_res"),
        (("-o", "cloud.npz"), "is the input itself"),
    ):
        assert main(["bake", "cloud.npz", "--what", "light-grid", *arguments]) == 2
        assert message in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cloud.npz", "light.nvdb"]
