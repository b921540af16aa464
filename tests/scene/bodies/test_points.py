"""Points as bodies of a scene: what they are made from, their bounds, and what cannot be."""

import numpy as np
import pytest
from scenes import turned
from tolerances import FLOAT32, ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import VolumeError

POSITIONS = np.array([[0.0, 0, 0], [1, 2, 3], [-1, 0.5, 0]])
RADII = np.array([0.5, 1.0, 0.25])
PROFILES = ["ball", "gaussian", "smooth"]
ORIGIN, ALONG = np.array([0.1, 0.05, -9]), np.array([0.0, 0.0, 1.0])

every_profile = pytest.mark.parametrize("profile", PROFILES)


def points(**changes):
    return tfm.Points(**{"positions": POSITIONS, "radius": RADII, "density": [1, 2, 3], **changes})


# --- construction ------------------------------------------------------------------------------------------


def test_one_number_for_all():
    same = tfm.Points(POSITIONS, 0.5)
    np.testing.assert_array_equal(same.radii, [0.5] * 3)
    np.testing.assert_array_equal(same.densities, [1] * 3)
    assert same.colour is None
    assert same.velocity is None
    assert same.own_medium is None
    assert same.density == 1


def test_one_for_each():
    each = points(colour=np.eye(3), velocity=POSITIONS)
    np.testing.assert_array_equal(each.densities, [1, 2, 3])
    np.testing.assert_array_equal(each.colour, np.eye(3))
    np.testing.assert_array_equal(each.velocity, POSITIONS)
    assert each.density == 3
    np.testing.assert_array_equal(points(colour=(1, 0.5, 0)).colour, [[1, 0.5, 0]] * 3)


def test_arrays_are_copied_and_kept_as_they_are():
    positions = POSITIONS.copy()
    made = points(positions=positions)
    positions[0] = 7
    np.testing.assert_array_equal(made.positions, POSITIONS)
    for array in (
        made.positions,
        made.radii,
        made.densities,
        tfm.Points(POSITIONS, 1.0, opacity=0.5).densities,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


@every_profile
def test_opacity_is_what_one_crossing_through_the_middle_takes(profile):
    opaque = tfm.Points([[0, 0, 0]], 0.7, opacity=0.4, profile=profile)
    depth = opaque.depths_along(np.array([0, 0, -5.0]), ALONG, np.array([0.0, 10]))
    assert -np.expm1(-depth[0, 0]) == pytest.approx(0.4, rel=ROUNDED)


def test_an_opacity_of_1_is_as_good_as_opaque():
    opaque = tfm.Points([[0, 0, 0]], 0.7, opacity=[1.0])
    assert 15 < opaque.depths_along(-ALONG, ALONG, np.array([0.0, 9]))[0, 0] < 17


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": [[0, 0]]}, r"positions should be \[n, 3\] with n ≥ 1; got the shape \[1, 2\]"),
        ({"positions": np.zeros((0, 3))}, r"positions should be \[n, 3\] with n ≥ 1; got the shape \[0, 3\]"),
        ({"positions": "plume"}, "positions should be numbers"),
        (
            {"positions": [[0, 0, 0], [0, np.nan, 0], [1, 1, 1]]},
            r"positions\[1\] = \[0.0, nan, 0.0\]: should be finite",
        ),
        (
            {"positions": [[0, 0, 0], [0, 0, 0], [1e30, 0, 0]]},
            r"positions\[2\] = \[1e\+30, 0.0, 0.0\]: should be",
        ),
        ({"radius": 0}, "radius = 0: should be above 0"),
        ({"radius": [1, -1, 1]}, r"radius\[1\] = -1: should be above 0"),
        ({"radius": np.inf}, "radius = inf: should be above 0"),
        ({"radius": [1, 1]}, r"radius should be one number or one for each of 3; got the shape \[2\]"),
        ({"radius": None}, "radius"),
        ({"density": -1}, "density = -1: should be 0 or more"),
        ({"density": [0, 0, np.nan]}, r"density\[2\] = nan: should be 0 or more"),
        ({"density": "much"}, "density should be numbers"),
        ({"density": None, "opacity": 1.5}, "opacity = 1.5: should be 0 or more, up to 1"),
        ({"density": None, "opacity": [0, 0, -0.1]}, r"opacity\[2\] = -0.1: should be 0 or more, up to 1"),
        ({"opacity": 0.5}, "both density and opacity are given; keep one"),
        (
            {"density": None, "opacity": 0.5, "radius": 1e-300},
            r"radius\[0\] is so small that an opacity of 0.5 ",
        ),
        ({"profile": "bal"}, "unknown profile 'bal'; did you mean 'ball'"),
        ({"profile": 3}, "unknown profile '3'"),
        ({"colour": [1, 2]}, r"colour should be RGB, one or one for each of 3; got the shape \[2\]"),
        ({"colour": (1, -1, 0)}, "colour should be finite and 0 or more"),
        ({"colour": (1, np.nan, 0)}, "colour should be finite and 0 or more"),
        ({"colour": "red"}, "colour should be numbers"),
        ({"velocity": POSITIONS[:2]}, r"velocity should be \[3, 3\]; got 2 of them"),
        ({"velocity": POSITIONS * np.nan}, r"velocity\[0\] = \[nan, nan, nan\]: should be finite"),
    ],
)
def test_what_cannot_be_is_one_line(changes, message):
    with pytest.raises(VolumeError, match=message) as error:
        points(**changes)
    assert str(error.value).startswith("points: ")
    assert "\n" not in str(error.value)


def test_messages_name_the_file(tmp_path):
    with pytest.raises(VolumeError, match=r"^.*plume\.ply: radius = 0"):
        points(radius=0, source=tmp_path / "plume.ply")


# --- what they are -----------------------------------------------------------------------------------------


def test_bounds_are_around_all_balls():
    np.testing.assert_array_equal(points().bounds, [[-1.25, -0.5, -0.5], [2, 3, 4]])
    np.testing.assert_array_equal(points().occupied_bounds, points().bounds)
    without = points(density=[1, 0, 1])
    np.testing.assert_array_equal(without.bounds, points().bounds)
    np.testing.assert_array_equal(without.occupied_bounds, [[-1.25, -0.5, -0.5], [0.5, 0.75, 0.5]])


def test_what_has_no_density_says_why():
    assert points().why_empty == ""
    assert points(density=0).why_empty == "all densities are 0"
    assert points(colour=0 * np.eye(3)).why_empty == "all densities times their colours are 0"


def test_no_density_is_above_the_largest(rng):
    crowded = tfm.Points(
        rng.uniform(-1, 1, (50, 3)), 1.0, rng.uniform(0, 1, 50), colour=rng.uniform(0, 2, (50, 3))
    )
    edges = np.linspace(0, 20, 2001)
    densest = crowded.depths_along(ORIGIN, ALONG, edges).max(axis=0) / 0.01
    assert (densest > 1).all()
    assert (densest <= crowded.largest_density).all()


def test_where_a_ray_is_within_the_bounds():
    assert points().interval(ORIGIN, ALONG) == pytest.approx((8.5, 13))
    assert points().interval(np.zeros(3), ALONG) == pytest.approx((0, 4))
    begin, end = points().interval(np.array([9.0, 0, 0]), ALONG)
    assert begin >= end


DENSITY = {
    "ball": np.ones_like,
    "gaussian": lambda r: np.exp(-4.5 * r**2),
    "smooth": lambda r: (1 - r**2) ** 3,
}
"""By profile, of the distance from the middle in radii."""


@every_profile
def test_depths_of_steps_against_midpoints(rng, profile):
    positions, radii, densities = (
        rng.uniform(-1, 1, (30, 3)),
        rng.uniform(0.3, 0.6, 30),
        rng.uniform(0, 2, 30),
    )
    many = tfm.Points(positions, radii, densities, profile=profile, colour=rng.uniform(0, 2, (30, 3)))
    edges = np.sort(rng.uniform(7, 11, 6))
    found = many.depths_along(ORIGIN, ALONG, edges)

    tolerance = {"ball": 1e-2, "gaussian": 1e-4, "smooth": 1e-6}[profile]
    for depth, begin, end in zip(found, edges[:-1], edges[1:], strict=True):
        at = ORIGIN + (begin + (end - begin) * (np.arange(20_000)[:, None] + 0.5) / 20_000) * ALONG
        distance = np.linalg.norm(at[:, None] - positions, axis=-1) / radii
        held = np.where(distance < 1, DENSITY[profile](np.minimum(distance, 1)), 0) * densities @ many.colour
        np.testing.assert_allclose(depth, held.mean(axis=0) * (end - begin), atol=tolerance)


def test_lines_through_it_hold_what_it_holds(rng):
    cloud = tfm.Points(rng.normal(0, 1, (1000, 3)), 0.05, 2.0)
    held = 1000 * 64 * np.pi / 315 * 0.05**3 * 2
    for axis, depths in enumerate(cloud.line_depths()):
        across = np.delete(cloud.bounds[1] - cloud.bounds[0], axis)
        assert depths.mean() * across.prod() == pytest.approx(held, rel=ROUNDED)


# --- the same ones otherwise -------------------------------------------------------------------------------


def test_transformed():
    matrix = turned(30, (1, 2, 3), (2, 2, 2), (1, -1, 0.5))
    medium = tfm.Medium(sigma_s=2.0)
    before = points(velocity=POSITIONS, colour=np.eye(3), medium=medium, profile="ball")
    after = before.transformed(matrix)
    np.testing.assert_allclose(after.positions, POSITIONS @ matrix[:3, :3].T + matrix[:3, 3])
    np.testing.assert_allclose(after.radii, 2 * RADII)
    np.testing.assert_array_equal(after.densities, before.densities)
    np.testing.assert_array_equal(after.colour, before.colour)
    np.testing.assert_allclose(after.velocity, POSITIONS @ matrix[:3, :3].T)
    assert after.own_medium == medium
    assert after.profile == "ball"
    assert not before.same_density(after)


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1, 2, 1, 1]),
        np.array([[1, 0.2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
        np.zeros((4, 4)),
        np.diag([1, 1, 1, 2]),
        np.full((4, 4), np.nan),
        np.eye(3),
    ],
    ids=["stretched", "sheared", "flat", "projective", "not numbers", "3 by 3"],
)
def test_balls_stay_balls(matrix):
    message = "transform should be a rotation, a translation and one scale for all axes: shapes stay"
    with pytest.raises(VolumeError, match=message):
        points().transformed(matrix)


def test_a_mirror_image_is_allowed():
    np.testing.assert_array_equal(
        points().transformed(np.diag([-1, 1, 1, 1])).positions, POSITIONS * (-1, 1, 1)
    )


def test_with_density():
    made = points(profile="gaussian", colour=np.eye(3)).with_density(0.5)
    np.testing.assert_array_equal(made.densities, [0.5, 1, 1.5])
    np.testing.assert_array_equal(made.colour, np.eye(3))
    assert made.profile == "gaussian"
    assert not made.same_density(points())


def test_the_density_is_the_same_whatever_the_medium():
    first, other = points(), points()
    dyed = first.with_medium(tfm.Medium(sigma_s=(1, 2, 3)))
    assert dyed.own_medium == tfm.Medium(sigma_s=(1, 2, 3))
    assert first.own_medium is None
    assert dyed.same_density(first)
    assert first.same_density(dyed)
    assert not first.same_density(other)
    assert hash(first.density_key) == hash(dyed.density_key)
    assert dyed.with_medium(None).own_medium is None


def test_text_tells_what_they_are():
    assert repr(points()) == "Points(points, 3 of profile smooth, density up to 3)"
    assert "coloured" in repr(points(colour=np.eye(3)))


# --- in a scene --------------------------------------------------------------------------------------------


def test_marched_bodies_are_grids_then_primitives():
    grid, ball = tfm.Volume(np.ones((2, 2, 2))), tfm.SphereVolume(centre=(0, 0, 0), radius=1, density=1)
    first, other = points(), points(profile="ball")
    scene = tfm.Scene((first, ball, grid, other))
    assert scene.primitives == (first, other)
    assert scene.marched == (grid, first, other)
    assert scene.homogeneous == (ball,)
    np.testing.assert_array_equal(tfm.Scene(first).bounds, first.bounds)


def test_the_memory_of_many_points():
    many = tfm.Points(np.zeros((1000, 3)), 1.0, colour=np.ones((1000, 3), np.float32))
    assert many.nbytes == 1000 * (8 * 5 + 4 * 3)
    assert many.unit_mass == pytest.approx(64 * np.pi / 315, rel=FLOAT32)
