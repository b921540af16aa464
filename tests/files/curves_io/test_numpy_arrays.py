"""Curves of .npz archives."""

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes

from tfm_cl.files.curves_io import read_curves

POINTS = np.arange(15.0).reshape(5, 3)
COUNTS = np.array([3, 2])


def read(path, **arrays):
    np.savez(path, **arrays)
    return read_curves(path)


@pytest.mark.parametrize("dtype", [np.int64, np.uint8, np.int32])
def test_a_row_for_each_point(tmp_path, dtype):
    widths, colours = np.arange(5.0), np.random.default_rng(0).random((5, 3), np.float32)
    curves = read(
        tmp_path / "a.npz", points=POINTS, counts=COUNTS.astype(dtype), width=widths, colour=colours
    )
    np.testing.assert_array_equal(curves.positions, POINTS)
    np.testing.assert_array_equal(curves.counts, COUNTS)
    assert curves.counts.dtype == np.int64
    np.testing.assert_array_equal(curves.widths, widths)
    np.testing.assert_array_equal(curves.colours, colours)
    assert curves.opacities is None


def test_a_row_for_each_curve_and_one_for_all(tmp_path):
    curves = read(
        tmp_path / "a.npz",
        P=POINTS,
        curveVertexCounts=COUNTS,
        widths=[1, 2],
        Cd=np.uint8([[255, 0, 51], [0, 0, 255]]),
        opacity=0.25,
    )
    np.testing.assert_array_equal(curves.widths, [1, 1, 1, 2, 2])
    np.testing.assert_allclose(curves.colours, [[1, 0, 0.2]] * 3 + [[0, 0, 1]] * 2, rtol=1e-6)
    np.testing.assert_array_equal(curves.opacities, [0.25] * 5)


def test_a_radius_is_half_a_width(tmp_path):
    curves = read(tmp_path / "a.npz", points=POINTS, counts=COUNTS, radius=np.full(5, 0.1, np.float32))
    np.testing.assert_array_equal(curves.widths, np.full(5, 0.2, np.float32))


def test_damaged(tmp_path):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, points=POINTS, counts=COUNTS, width=np.ones(5, np.float32))
    data = path.read_bytes()
    assert_read_or_refused(read_curves, path, truncated(data, every=7))
    assert_read_or_refused(read_curves, path, with_other_bytes(data))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"points": POINTS}, r"'points' \[n, 3\] and 'counts' \[curves\]; its arrays: 'points'"),
        ({"counts": COUNTS}, "its arrays: 'counts'"),
        ({"points": POINTS[:, :2], "counts": COUNTS}, r"array 'points' is 5×2; expected \[n, 3\]"),
        ({"points": POINTS, "counts": COUNTS[:1]}, "the curves have 3 points; the file has 5"),
        ({"points": POINTS, "counts": [4, 1]}, "curve 1 has 1 points"),
        ({"points": POINTS, "counts": [6, -1]}, "curve 0 has 6 points, of 5"),
        ({"points": POINTS, "counts": [2**31, 2]}, "curve 0 has 2,147,483,648 points"),
        ({"points": POINTS, "counts": [-(2**63), 2]}, "curve 0 has -9,223,372,036,854,775,808 points"),
        ({"points": POINTS, "counts": [1] * 5}, "'counts' holds 5 numbers; at most 2"),
        ({"points": POINTS, "counts": [2.5, 2.5]}, "an array of whole numbers"),
        ({"points": POINTS, "counts": 5}, "an array of whole numbers"),
        ({"points": POINTS, "counts": COUNTS, "width": np.ones(4)}, "'width' is 4; expected 5"),
        ({"points": POINTS, "counts": COUNTS, "width": [1, -1]}, "'width' of point 3 is -1.0"),
        ({"points": POINTS[:0], "counts": COUNTS[:0]}, "holds no curves"),
    ],
)
def test_impossible_arrays(tmp_path, arrays, message):
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    assert_refused(read_curves, path, path.read_bytes(), message)
