"""Points of .npz archives."""

import zipfile

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes

from tfm_cl.files.points_io import read_points

POSITIONS = np.arange(12.0).reshape(4, 3)


def archive(path, **arrays):
    np.savez(path, **arrays)
    return path.read_bytes()


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("name", ["positions", "position", "points", "P"])
def test_arrays_by_their_names(tmp_path, name, save):
    path, rng = tmp_path / "a.npz", np.random.default_rng(0)
    radius, colour = rng.random(4, np.float32), rng.random((4, 3), np.float32)
    arrays = {name: POSITIONS, "radius": radius, "colour": np.asfortranarray(colour), "about": np.array("us")}
    save(path, **arrays)
    points = read_points(path)
    np.testing.assert_array_equal(points.positions, POSITIONS)
    np.testing.assert_array_equal(points.radii, radius)
    np.testing.assert_array_equal(points.colours, colour)
    assert points.velocities is None


@pytest.mark.parametrize("one", [0.5, [0.5], [[0.5]]])
def test_one_value_for_all(tmp_path, one):
    path = tmp_path / "a.npz"
    archive(path, P=POSITIONS, width=np.array(one), Cd=np.array([[255, 0, 51]], np.uint8))
    points = read_points(path)
    np.testing.assert_array_equal(points.radii, [0.25] * 4)
    np.testing.assert_allclose(points.colours, [[1, 0, 0.2]] * 4, rtol=1e-6)


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_damaged(tmp_path, compression):
    path = tmp_path / "a.npz"
    save = np.savez if compression == zipfile.ZIP_STORED else np.savez_compressed
    save(path, positions=POSITIONS, radius=np.ones(4, np.float32), color=np.ones((4, 3), np.uint8))
    data = path.read_bytes()
    assert_read_or_refused(read_points, path, truncated(data, every=7))
    assert_read_or_refused(read_points, path, with_other_bytes(data))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"radius": np.ones(4)}, r"no array 'positions' \[n, 3\]; its arrays: 'radius'"),
        ({}, "no array 'positions'"),
        ({"P": np.float32(0)}, r"array 'P' is one number; expected \[n, 3\]"),
        ({"P": np.ones((0, 3))}, "holds no points"),
        ({"P": np.ones((4, 3, 2))}, r"array 'P' is 4×3×2; expected \[n, 3\]"),
        ({"P": np.ones((4, 3), complex)}, "not real numbers"),
        ({"P": np.ones((4, 3)), "radius": np.ones((4, 1000))}, "'radius' holds 4,000 numbers; at most 16"),
        ({"P": np.ones((4, 3)), "radius": np.ones(3)}, "'radius' is 3; expected 4"),
        ({"P": np.ones((4, 3)), "Cd": np.ones((4, 2))}, "'Cd' is 4×2; expected 4×3"),
        ({"P": np.full((4, 3), np.nan)}, "'positions' of point 0 is nan"),
    ],
)
def test_impossible_arrays(tmp_path, arrays, message):
    path = tmp_path / "a.npz"
    assert_refused(read_points, path, archive(path, **arrays), message)


def test_pickles_are_never_loaded(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("the pickle was loaded",))

    path, trap = tmp_path / "a.npz", np.full((4, 3), None, object)
    trap[0, 0] = Trap()
    np.savez(path, allow_pickle=True, P=np.ones((4, 3)), radius=trap)
    assert_refused(read_points, path, path.read_bytes(), "pickled Python objects, which are never loaded")
