"""Curves to polylines, against SciPy, closed forms and the definitions."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, CubicHermiteSpline

from tfm_cl.files.curves_io.splines import BASES, SEGMENTS, polylines

COUNTS = np.array([7, 4, 10])
VALUES = np.random.default_rng(0).normal(size=(21, 3))
MOST = 1 << 20


def curves(values, counts):
    """The rows of each curve."""
    return np.split(values, np.cumsum(counts)[:-1])


def evaluated(basis, wrap="nonperiodic", values=VALUES, counts=COUNTS):
    lines = polylines(counts, basis, wrap, MOST)
    found = lines.of_vertices(values)
    assert len(found) == lines.counts.sum()
    return curves(found, lines.counts)


def test_lines_are_themselves():
    for line, points in zip(evaluated("linear"), curves(VALUES, COUNTS), strict=True):
        np.testing.assert_array_equal(line, points)


@pytest.mark.parametrize("basis", ["linear", "bspline", "catmullRom"])
def test_closed_curves_end_where_they_begin(basis):
    for line, count in zip(evaluated(basis, "periodic"), COUNTS, strict=True):
        assert len(line) == count * BASES[basis].segments + 1
        np.testing.assert_allclose(line[-1], line[0], rtol=0, atol=1e-15)


def test_closed_bezier():
    values = np.array([[1, 0], [1, 1], [-1, 1], [-1, 0], [-1, -1], [1, -1]], float)
    (line,) = evaluated("bezier", "periodic", values, np.array([6]))
    assert len(line) == 2 * SEGMENTS + 1
    np.testing.assert_allclose(line[[0, SEGMENTS, -1]], [[1, 0], [-1, 0], [1, 0]])
    np.testing.assert_allclose(line[SEGMENTS // 2], [0, 0.75])


def test_bspline_is_that_of_scipy():
    for line, points in zip(evaluated("bspline"), curves(VALUES, COUNTS), strict=True):
        spline = BSpline(np.arange(-3, len(points) + 1), points, 3)
        where = np.arange(len(line)) / SEGMENTS
        np.testing.assert_allclose(line, spline(where), rtol=0, atol=1e-13)


def test_catmull_rom_is_that_of_scipy():
    """It goes through its inner control points, with slopes of half the way between their neighbours."""
    for line, points in zip(evaluated("catmullRom"), curves(VALUES, COUNTS), strict=True):
        inner, slopes = points[1:-1], (points[2:] - points[:-2]) / 2
        spline = CubicHermiteSpline(np.arange(len(inner)), inner, slopes)
        np.testing.assert_allclose(line, spline(np.arange(len(line)) / SEGMENTS), rtol=0, atol=1e-13)


def test_bezier_is_that_of_de_casteljau():
    for line, points in zip(evaluated("bezier"), curves(VALUES, COUNTS), strict=True):
        for index, found in enumerate(line):
            span = min(index // SEGMENTS, (len(points) - 4) // 3)
            u, corner = index / SEGMENTS - span, points[3 * span : 3 * span + 4]
            while len(corner) > 1:
                corner = corner[:-1] * (1 - u) + corner[1:] * u
            np.testing.assert_allclose(found, corner[0], rtol=0, atol=1e-13)


@pytest.mark.parametrize("basis", ["bspline", "catmullRom"])
def test_pinned_curves_begin_and_end_at_their_control_points(basis):
    for line, points in zip(evaluated(basis, "pinned"), curves(VALUES, COUNTS), strict=True):
        assert len(line) == (len(points) - 1) * SEGMENTS + 1
        np.testing.assert_allclose(line[[0, -1]], points[[0, -1]], rtol=0, atol=1e-14)


@pytest.mark.parametrize("basis", ["bspline", "catmullRom"])
def test_two_pinned_points_are_a_line(basis):
    (line,) = evaluated(basis, "pinned", np.array([[0.0, 0, 0], [8, 16, 24]]), np.array([2]))
    np.testing.assert_allclose(line, np.arange(9)[:, None] * [1.0, 2, 3], rtol=0, atol=1e-13)


def test_a_quarter_circle_strays_as_stated():
    k = 4 / 3 * (np.sqrt(2) - 1)
    (line,) = evaluated("bezier", values=np.array([[1, 0], [1, k], [k, 1], [0, 1]]), counts=np.array([4]))
    middles = np.linalg.norm(line[1:] + line[:-1], axis=1) / 2
    assert round(1 - middles.min(), 3) == 0.005


@pytest.mark.parametrize(("basis", "wrap"), [("bspline", "nonperiodic"), ("bezier", "nonperiodic")])
def test_values_of_span_ends_vary_linearly(basis, wrap):
    lines = polylines(COUNTS, basis, wrap, MOST)
    spans = (lines.counts - 1) // SEGMENTS
    assert lines.span_ends == spans.sum() + len(spans)
    values = np.concatenate([np.arange(n + 1.0) for n in spans])
    expected = [np.arange(n * SEGMENTS + 1) / SEGMENTS for n in spans]
    np.testing.assert_allclose(lines.of_span_ends(values), np.concatenate(expected), rtol=0, atol=1e-14)


def test_values_of_closed_span_ends_come_back():
    lines = polylines(np.array([4]), "bspline", "periodic", MOST)
    assert lines.span_ends == 4
    found = lines.of_span_ends(np.array([0.0, 1, 2, 3]))
    np.testing.assert_allclose(found[::SEGMENTS], [0, 1, 2, 3, 0])


@pytest.mark.parametrize(
    ("counts", "basis", "wrap", "message"),
    [
        ([4, 3], "bspline", "nonperiodic", "curve 1 has 3 points, which no nonperiodic bspline curve has"),
        ([4, 5], "bezier", "nonperiodic", "curve 1 has 5 points"),
        ([7], "bezier", "periodic", "curve 0 has 7 points"),
        ([2], "linear", "periodic", "curve 0 has 2 points"),
        ([4], "hermite", "nonperiodic", "'hermite', 'nonperiodic', which is not known"),
        ([4], "bspline", "open", "'open', which is not known"),
        ([1000], "bspline", "nonperiodic", "become 7,977 points; up to 7,000"),
    ],
)
def test_impossible_curves(counts, basis, wrap, message):
    with pytest.raises(ValueError, match=message):
        polylines(np.array(counts), basis, wrap, 7000)
