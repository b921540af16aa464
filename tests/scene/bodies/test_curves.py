"""Strands as bodies of a scene: what they are made from, where rays cross them, what cannot be."""

import numpy as np
import pytest
from scenes import turned
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.constants import BEND_UNIT
from tfm_cl.device.structs.declared import SOURCE
from tfm_cl.errors import VolumeError
from tfm_cl.reference.primitives import tangents_of

POINTS = np.array([[0.0, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 2], [0, 0, 3]])
"""Of a strand of two segments and one of one."""
COUNTS = [3, 2]
ALONG = np.array([0.0, 0.0, 1.0])


def curves(**changes):
    given = {"points": POINTS, "counts": COUNTS, "width": 0.2, **changes}
    return tfm.Curves(**given)


def across(width=0.2, **changes):
    """One segment along x from -1 to 1."""
    return tfm.Curves([[-1.0, 0, 0], [1, 0, 0]], [2], width, **changes)


# --- construction ----------------------------------------------------------------------------------------


def test_segments_stay_within_their_strand():
    made = curves()
    np.testing.assert_array_equal(made.corners, POINTS[[[0, 1], [1, 2], [3, 4]]])
    np.testing.assert_array_equal(made.lengths, [1, 1, 1])
    assert made.colour is None
    assert made.own_medium is None


@pytest.mark.parametrize(
    ("width", "expected"),
    [
        (0.2, [[0.2, 0.2]] * 3),
        ([0.1, 0.2, 0.3, 0.4, 0.5], [[0.1, 0.2], [0.2, 0.3], [0.4, 0.5]]),
        ([0.1, 0.3], [[0.1, 0.1], [0.1, 0.1], [0.3, 0.3]]),
        (0, [[0, 0]] * 3),
    ],
    ids=["one", "of each point", "of each strand", "none"],
)
def test_width(width, expected):
    np.testing.assert_array_equal(curves(width=width).widths, expected)


@pytest.mark.parametrize(
    ("opacity", "expected"),
    [(0.5, [0.5, 0.5, 0.5]), ([0.5, 0.8], [0.5, 0.5, 0.8]), ([0.3, 0.3, 0.3, 0.6, 0.6], [0.3, 0.3, 0.6])],
    ids=["one", "of each strand", "of each point"],
)
def test_opacity_is_what_one_crossing_takes(opacity, expected):
    np.testing.assert_allclose(-np.expm1(-curves(opacity=opacity).densities), expected, rtol=ROUNDED)


def test_an_opacity_of_1_is_as_good_as_opaque():
    assert (curves().densities > 15).all()
    assert (curves().densities < 17).all()
    assert 0.999999 < curves().opacity <= 1


def test_density_times_width_is_the_optical_depth_of_a_crossing():
    made = curves(width=[0.1, 0.1, 0.1, 0.2, 0.4], density=[3, 5])
    np.testing.assert_allclose(made.densities, [0.3, 0.3, 1.5])


@pytest.mark.parametrize(
    ("colour", "expected"),
    [
        ((1, 0.5, 0), [[1, 0.5, 0]] * 3),
        ([[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 0, 0], [0, 1, 0]]),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [0, 0, 0]], [[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5] * 3]),
    ],
    ids=["one", "of each strand", "of each point"],
)
def test_colour(colour, expected):
    np.testing.assert_array_equal(curves(colour=colour).colour, expected)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"points": POINTS[:, :2]}, r"points should be \[n, 3\] with n ≥ 1; got the shape \[5, 2\]"),
        ({"points": "hair"}, "points should be numbers"),
        ({"points": POINTS * np.nan}, r"points\[0\] = \[nan, nan, nan\]: should be finite"),
        ({"counts": [3]}, "counts add up to 3, but there are 5 points"),
        ({"counts": [3, 3]}, "counts add up to 6, but there are 5 points"),
        ({"counts": [2**62, 2**62, 2**62]}, "counts add up to 13,835,058,055,282,163,712, but there are 5"),
        ({"counts": [4, 1]}, r"counts\[1\] = 1: a strand has 2 points or more"),
        ({"counts": [5, 0]}, r"counts\[1\] = 0: a strand has 2 points or more"),
        ({"counts": [7, -2]}, r"counts\[1\] = -2: a strand has 2 points or more"),
        ({"counts": [2.0, 3.0]}, r"counts should be integers \[strands\]"),
        ({"counts": 5}, r"counts should be integers \[strands\]"),
        ({"counts": []}, r"counts should be integers \[strands\]"),
        ({"width": -0.1}, "width = -0.1: should be 0 or more"),
        ({"width": [0.1, np.nan]}, r"width\[3\] = nan: should be 0 or more"),
        ({"width": np.inf}, "width = inf: should be 0 or more"),
        ({"width": [0.1] * 3}, r"width should be one number or one for each of 5; got the shape \[3\]"),
        ({"width": "thin"}, "width should be numbers"),
        ({"opacity": 1.5}, "opacity = 1.5: should be 0 or more, up to 1"),
        ({"opacity": [0.5, -0.5]}, r"opacity\[3\] = -0.5: should be 0 or more, up to 1"),
        ({"density": -1}, "density = -1: should be 0 or more"),
        ({"density": 1, "opacity": 0.5}, "both density and opacity are given; keep one"),
        ({"colour": (1, -1, 0)}, "colour should be finite and 0 or more"),
        (
            {"colour": [[1, 0, 0]] * 3},
            r"colour should be RGB, .* for each of 5; got the shape \[3, 3\]",
        ),
        ({"colour": [1, 1]}, r"colour should be RGB, one or one for each of 5; got the shape \[2\]"),
        ({"medium": "smoke"}, "medium should be a Medium, or None; got 'smoke'"),
    ],
)
def test_what_cannot_be_is_one_line(changes, message):
    with pytest.raises(VolumeError, match=message) as error:
        curves(**changes)
    assert str(error.value).startswith("curves: ")
    assert "\n" not in str(error.value)


def test_messages_name_the_file(tmp_path):
    with pytest.raises(VolumeError, match=r"^.*tuft\.hair: width = -1"):
        curves(width=-1, source=tmp_path / "tuft.hair")


def test_arrays_are_copied():
    points = POINTS.copy()
    made = curves(points=points)
    points[:] = 7
    np.testing.assert_array_equal(made.corners[0], POINTS[:2])


# --- where rays cross them -------------------------------------------------------------------------------


def test_a_ray_crosses_the_axis_within_the_width():
    strand = across(width=[0.2, 0.6])
    for x, y in [(0, 0), (0, 0.19), (0, -0.19), (0.9, 0.28), (-1, 0.09), (0.999, 0)]:
        met, distance = strand.crossed(np.array([x, y, -3.0]), ALONG)
        assert met.all(), (x, y)
        np.testing.assert_allclose(distance, [3])
    for x, y in [(0, 0.21), (0.9, 0.3), (-1.01, 0), (1, 0), (1.1, 0)]:
        met, distance = strand.crossed(np.array([x, y, -3.0]), ALONG)
        assert not met.any(), (x, y)
        assert distance.shape == (0,)


def test_a_ribbon_faces_every_ray(rng):
    """Turned about its axis it is as wide."""
    for angle in rng.uniform(0, 2 * np.pi, 20):
        direction = np.array([0, np.cos(angle), np.sin(angle)])
        beside = np.array([0, -np.sin(angle), np.cos(angle)])
        for offset, expected in [(0.09, True), (-0.09, True), (0.11, False)]:
            met, distance = across().crossed(offset * beside - 2 * direction, direction)
            assert met.all() == expected
            np.testing.assert_allclose(distance, [2] * expected)


def test_a_slanting_strand_is_crossed_at_its_depth():
    slanting = tfm.Curves([[-1.0, 0, -1], [1, 0, 1]], [2], 0.2)
    _, distance = slanting.crossed(np.array([0.5, 0.05, -3.0]), ALONG)
    np.testing.assert_allclose(distance, [3.5])


@pytest.mark.parametrize(
    "ends", [[[0, 0, -1], [0, 0, 1]], [[0, 0, 0], [0, 0, 0]]], ids=["along", "no length"]
)
def test_what_shows_no_length_is_not_crossed(ends):
    met, _ = tfm.Curves(ends, [2], 0.5).crossed(np.array([0.01, 0, -3.0]), ALONG)
    assert not met.any()


def test_depths_go_to_the_steps_that_hold_the_crossing():
    strand = tfm.Curves(
        [[-1.0, 0, 0.5], [1, 0, 0.5], [-1, 0, 2.5], [1, 0, 2.5]], [2, 2], 0.2, opacity=[0.5, 0.2]
    )
    edges = np.array([0.0, 1, 2, 3])
    found = strand.depths_along(np.array([0.3, 0, 0]), ALONG, edges)
    np.testing.assert_allclose(found[:, 0], [np.log(2), 0, -np.log(0.8)])
    assert strand.depths_along(np.array([0.3, 0, 3.0]), ALONG, edges).sum() == 0


def test_a_coloured_strand_leaves_its_colour():
    strand = across(opacity=0.5, colour=(1, 0.5, 0))
    found = strand.depths_along(np.array([0, 0, -1.0]), ALONG, np.array([0, 2.0]))
    np.testing.assert_allclose(found, [np.log(2) * np.array([1, 0.5, 0])])


# --- what they are ---------------------------------------------------------------------------------------


def test_bounds_contain_all_that_is_crossed(rng):
    points = rng.normal(0, 1, (40, 3))
    many = tfm.Curves(points, [4] * 10, rng.uniform(0.1, 0.8, 40))
    low, high = many.bounds
    assert (low <= points.min(axis=0)).all()
    assert (high >= points.max(axis=0)).all()
    for _ in range(300):
        direction = rng.normal(0, 1, 3)
        direction /= np.linalg.norm(direction)
        origin = rng.uniform(2 * low, 2 * high) - 20 * direction
        _, distances = many.crossed(origin, direction)
        at = origin + distances[:, None] * direction
        assert ((at >= low) & (at <= high)).all()


def test_masses_are_what_rays_of_all_directions_meet(rng):
    """Mean over directions of the area that they see, times the optical depth."""
    strand = tfm.Curves([[0.0, 0, 0], [0.3, -0.4, 1.2]], [2], [0.1, 0.3], opacity=0.7)
    directions = rng.normal(0, 1, (200_000, 3))
    cosine = directions @ [0.3, -0.4, 1.2] / np.linalg.norm(directions, axis=1) / 1.3
    area = 1.3 * 0.2 * np.sqrt(1 - cosine**2).mean()
    assert strand.masses[0] == pytest.approx(area * -np.log(0.3), rel=2e-3)


def test_lines_through_them_hold_their_mass(rng):
    many = tfm.Curves(rng.normal(0, 1, (400, 3)), [4] * 100, 0.01, opacity=0.3)
    for axis, depths in enumerate(many.line_depths()):
        sides = np.delete(many.bounds[1] - many.bounds[0], axis)
        assert depths.mean() * sides.prod() == pytest.approx(many.masses.sum(), rel=ROUNDED)


def test_what_has_no_density_says_why():
    assert curves().why_empty == ""
    assert curves(opacity=0.0).why_empty == "all densities are 0"
    assert curves(colour=(0, 0, 0)).why_empty == "all densities times their colours are 0"


# --- tangents --------------------------------------------------------------------------------------------


def tangents_of_device(body):
    """At both ends of each segment, [segments, 2, 3], as kernels are told them."""
    structs = np.zeros(len(body.corners), SOURCE.dtype)
    body.fill_sources(structs, np.zeros(3))
    bends = np.ascontiguousarray(structs["c"]).view(np.int16).reshape(-1, 3, 2)
    along = body.corners[:, 1] - body.corners[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    own = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    return own[:, None] + BEND_UNIT * np.swapaxes(bends, 1, 2)


def tangents_of_reference(body):
    number = np.arange(len(body.corners))
    return np.stack([tangents_of(body, number, np.full(len(number), end)) for end in (0.0, 1.0)], axis=1)


HALF = np.sqrt(0.5)
BENT = {
    "a right angle": (
        [[0, 0, 0], [3, 0, 0], [3, 1, 0]],
        [[[1, 0, 0], [HALF, HALF, 0]], [[HALF, HALF, 0], [0, 1, 0]]],
    ),
    "a corner: a point twice": (
        [[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]],
        [[[1, 0, 0], [1, 0, 0]], None, [[0, 1, 0], [0, 1, 0]]],
    ),
    "turning back": (
        [[0, 0, 0], [1, 0, 0], [0.5, 0, 0]],
        [[[1, 0, 0], [1, 0, 0]], [[-1, 0, 0], [-1, 0, 0]]],
    ),
}
every_tangent = pytest.mark.parametrize("tangents", [tangents_of_device, tangents_of_reference])


@every_tangent
@pytest.mark.parametrize("bent", BENT)
def test_a_tangent_is_halfway_between_those_of_the_segments(tangents, bent):
    points, expected = BENT[bent]
    found = tangents(tfm.Curves(points, [len(points)], 0.1))
    for one, wanted in zip(found, expected, strict=True):
        if wanted is not None:  # a segment without a length, which no ray crosses
            np.testing.assert_allclose(one, wanted, atol=BEND_UNIT / 2)


@every_tangent
def test_strands_do_not_bend_towards_each_other(tangents):
    """Though one begins where the other ends."""
    found = tangents(tfm.Curves([[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]], [2, 2], 0.1))
    np.testing.assert_array_equal(found, [[[1, 0, 0]] * 2, [[0, 1, 0]] * 2])


def test_kernels_are_told_the_tangents_of_the_reference(rng):
    points = rng.normal(0, 1, (300, 3))
    body = tfm.Curves(points, [50, 3, 100, 2, 145], 0.1)
    expected = tangents_of_reference(body)
    # Also of others that are made of them.
    matrix = turned(30, (1, 2, 3), (2, 2, 2), (1, -1, 0.5))
    moved = tangents_of_device(body.transformed(matrix).with_density(0.5))
    np.testing.assert_allclose(tangents_of_device(body), expected, atol=0.51 * BEND_UNIT)
    np.testing.assert_allclose(moved, expected @ matrix[:3, :3].T / 2, atol=0.51 * BEND_UNIT)


# --- the same ones otherwise -----------------------------------------------------------------------------


def test_transformed():
    matrix = turned(30, (1, 2, 3), (2, 2, 2), (1, -1, 0.5))
    medium = tfm.Medium(sigma_s=2.0)
    before = curves(width=[0.1, 0.3], opacity=0.4, colour=(1, 0.5, 0.2), medium=medium)
    after = before.transformed(matrix)
    np.testing.assert_allclose(after.corners, before.corners @ matrix[:3, :3].T + matrix[:3, 3])
    np.testing.assert_allclose(after.widths, 2 * before.widths)
    np.testing.assert_allclose(after.radii, 2 * before.radii)
    np.testing.assert_allclose(after.lengths, 2 * before.lengths)
    np.testing.assert_array_equal(after.densities, before.densities)
    np.testing.assert_array_equal(after.colour, before.colour)
    assert after.own_medium == medium
    assert not before.same_density(after)


def test_ribbons_are_not_stretched():
    with pytest.raises(VolumeError, match="one scale for all axes: shapes stay"):
        curves().transformed(np.diag([1, 2, 1, 1]))


def test_with_density():
    made = curves(opacity=0.4).with_density(0.5)
    np.testing.assert_allclose(-np.expm1(-made.densities), 1 - np.sqrt(0.6))
    np.testing.assert_array_equal(made.widths, curves().widths)


def test_the_density_is_the_same_whatever_the_medium():
    first = curves()
    dyed = first.with_medium(tfm.Medium(sigma_s=(1, 2, 3)))
    assert dyed.own_medium == tfm.Medium(sigma_s=(1, 2, 3))
    assert first.own_medium is None
    assert dyed.same_density(first)
    assert not first.same_density(curves())


def test_text_tells_what_they_are():
    assert repr(curves(opacity=0.5)) == "Curves(curves, 3 in all, opacity up to 0.5)"
    assert "coloured" in repr(curves(colour=(1, 1, 0)))
