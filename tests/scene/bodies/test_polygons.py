"""Polygons as bodies of a scene: what they are made from, where rays cross them, what cannot be."""

import numpy as np
import pytest
from scenes import turned
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import VolumeError

VERTICES = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 1, 2]])
FACES = np.array([[0, 1, 2], [1, 3, 2]])
ALONG = np.array([0.0, 0.0, 1.0])


def polygons(**changes):
    return tfm.Polygons(**{"vertices": VERTICES, "faces": FACES, **changes})


# --- construction ----------------------------------------------------------------------------------------


def test_corners_are_those_of_the_faces():
    made = polygons()
    np.testing.assert_array_equal(made.corners, VERTICES[FACES])
    np.testing.assert_allclose(made.areas, [1, np.sqrt(5)])
    assert made.colour is None
    assert made.own_medium is None
    assert (made.densities > 15).all()


@pytest.mark.parametrize(
    ("opacity", "expected"), [(0.5, [0.5, 0.5]), ([0.25, 0.75], [0.25, 0.75])], ids=["one", "of each"]
)
def test_opacity_is_what_one_crossing_takes(opacity, expected):
    np.testing.assert_allclose(-np.expm1(-polygons(opacity=opacity).densities), expected, rtol=ROUNDED)


def test_colour_of_each_and_of_all():
    np.testing.assert_array_equal(polygons(colour=(1, 0.5, 0)).colour, [[1, 0.5, 0]] * 2)
    np.testing.assert_array_equal(polygons(colour=[[1, 0, 0], [0, 1, 0]]).colour, [[1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vertices": VERTICES[:, :2]}, r"vertices should be \[n, 3\] with n ≥ 1; got the shape \[4, 2\]"),
        ({"vertices": np.full((4, 3), np.inf)}, r"vertices\[0\] = \[inf, inf, inf\]: should be finite"),
        ({"vertices": "leaf"}, "vertices should be numbers"),
        ({"faces": FACES.astype(float)}, r"faces should be integers \[F, 3\] with F ≥ 1"),
        ({"faces": [[0, 1, 2, 3]]}, r"faces should be integers \[F, 3\] with F ≥ 1; got the shape \[1, 4\]"),
        ({"faces": np.zeros((0, 3), int)}, r"faces should be integers .* got the shape \[0, 3\]"),
        ({"faces": [[0, 1, 4]]}, "faces should be rows of the 4 vertices, from 0; got 0 to 4"),
        ({"faces": [[0, 1, -1]]}, "faces should be rows of the 4 vertices, from 0; got -1 to 1"),
        ({"opacity": 1.1}, "opacity = 1.1: should be 0 or more, up to 1"),
        ({"opacity": [0.5, np.nan]}, r"opacity\[1\] = nan: should be 0 or more, up to 1"),
        ({"opacity": [0.5] * 3}, r"opacity should be one number or one for each of 2; got the shape \[3\]"),
        ({"colour": (1, np.inf, 0)}, "colour should be finite and 0 or more"),
        (
            {"colour": [[1, 0, 0]] * 3},
            r"colour should be RGB, .* for each of 2; got the shape \[3, 3\]",
        ),
        ({"medium": 3}, "medium should be a Medium, or None; got 3"),
    ],
)
def test_what_cannot_be_is_one_line(changes, message):
    with pytest.raises(VolumeError, match=message) as error:
        polygons(**changes)
    assert str(error.value).startswith("polygons: ")
    assert "\n" not in str(error.value)


def test_messages_name_the_file(tmp_path):
    with pytest.raises(VolumeError, match=r"^.*tree\.ply: opacity = 2"):
        polygons(opacity=2, source=tmp_path / "tree.ply")


# --- where rays cross them -------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1, -1], ids=["front", "back"])
def test_a_ray_crosses_a_triangle_from_either_side(side):
    leaf = polygons(faces=FACES[:1])
    for x, y in [(0.1, 0.1), (1.9, 0.01), (0.01, 0.98), (0.9, 0.5)]:
        met, distance = leaf.crossed(np.array([x, y, -3.0 * side]), side * ALONG)
        assert met.all(), (x, y)
        np.testing.assert_allclose(distance, [3])
    for x, y in [(-0.01, 0.5), (0.5, -0.01), (1.1, 0.5), (2.1, 0)]:
        met, _ = leaf.crossed(np.array([x, y, -3.0 * side]), side * ALONG)
        assert not met.any(), (x, y)


def test_a_plane_of_triangles_has_no_gap_and_no_double_cover(rng):
    square = tfm.Polygons([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [2, 3, 0]])
    for place in rng.uniform(0, 1, (300, 2)):
        met, _ = square.crossed(np.array([*place, -1.0]), ALONG)
        assert met.sum() == 1, place


@pytest.mark.parametrize(
    "corners",
    [[[0, 0, 0], [0, 0, 1], [0, 1, 0]], [[0, 0, 0], [1, 1, 0], [2, 2, 0]], [[0, 0, 0]] * 3],
    ids=["along the ray", "a line", "a point"],
)
def test_what_shows_no_area_is_not_crossed(corners):
    met, _ = tfm.Polygons(corners, [[0, 1, 2]]).crossed(np.array([0.0, 0, -3.0]), ALONG)
    assert not met.any()


def test_depths_go_to_the_steps_that_hold_the_crossing():
    stack = tfm.Polygons(
        np.concatenate([VERTICES[:3] + np.array([0, 0, z]) for z in (0.5, 0.7, 2.5)]),
        np.arange(9).reshape(3, 3),
        [0.5, 0.5, 0.2],
        colour=(1, 0, 2),
    )
    found = stack.depths_along(np.array([0.3, 0.3, 0]), ALONG, np.array([0.0, 1, 2, 3]))
    np.testing.assert_allclose(found, np.outer([np.log(4), 0, -np.log(0.8)], [1, 0, 2]))


# --- what they are ---------------------------------------------------------------------------------------


def test_bounds_contain_all_corners(rng):
    vertices = rng.normal(0, 1, (30, 3))
    low, high = tfm.Polygons(vertices, np.arange(30).reshape(10, 3)).bounds
    assert (low <= vertices.min(axis=0)).all()
    assert (high >= vertices.max(axis=0)).all()


def test_masses_are_what_rays_of_all_directions_meet(rng):
    leaf = polygons(faces=FACES[1:], opacity=0.7)
    directions = rng.normal(0, 1, (200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    a, b, c = leaf.corners[0]
    seen = np.abs(directions @ np.cross(b - a, c - a)).mean() / 2
    assert leaf.masses[0] == pytest.approx(seen * -np.log(0.3), rel=3e-3)


def test_what_has_no_density_says_why():
    assert polygons().why_empty == ""
    assert polygons(opacity=0.0).why_empty == "all densities are 0"
    assert polygons(colour=(0, 0, 0)).why_empty == "all densities times their colours are 0"


# --- the same ones otherwise -----------------------------------------------------------------------------


def test_transformed():
    matrix = turned(30, (1, 2, 3), (2, 2, 2), (1, -1, 0.5))
    medium = tfm.Medium(sigma_s=2.0)
    before = polygons(opacity=[0.4, 0.6], colour=(1, 0.5, 0.2), medium=medium)
    after = before.transformed(matrix)
    np.testing.assert_allclose(after.corners, before.corners @ matrix[:3, :3].T + matrix[:3, 3])
    np.testing.assert_allclose(after.radii, 2 * before.radii)
    np.testing.assert_allclose(after.areas, 4 * before.areas)
    np.testing.assert_array_equal(after.densities, before.densities)
    np.testing.assert_array_equal(after.colour, before.colour)
    assert after.own_medium == medium
    assert not before.same_density(after)


def test_a_mirror_image_is_allowed():
    after = polygons().transformed(np.diag([-1, 1, 1, 1]))
    np.testing.assert_array_equal(after.corners, polygons().corners * (-1, 1, 1))


def test_with_density():
    made = polygons(opacity=0.4).with_density(0.5)
    np.testing.assert_allclose(-np.expm1(-made.densities), 1 - np.sqrt(0.6))


def test_the_density_is_the_same_whatever_the_medium():
    first = polygons()
    dyed = first.with_medium(tfm.Medium(sigma_s=(1, 2, 3)))
    assert dyed.own_medium == tfm.Medium(sigma_s=(1, 2, 3))
    assert first.own_medium is None
    assert dyed.same_density(first)
    assert not first.same_density(polygons())


def test_text_tells_what_they_are():
    assert repr(polygons(opacity=0.5)) == "Polygons(polygons, 2 in all, opacity up to 0.5)"
    assert "coloured" in repr(polygons(colour=(1, 1, 0)))
