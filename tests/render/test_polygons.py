"""Polygons as opacity in maps and pictures, against closed forms, the float64 reference and each other."""

from itertools import pairwise

import numpy as np
import pytest
from primitive_scenes import (
    BALLS,
    BLUE,
    BORDER,
    BROWN,
    CAMERA,
    CORNERS,
    DEPTH_OF_ONE,
    FIBRES,
    FOG,
    GRID,
    HARDLY,
    LIGHT_KINDS,
    LIGHTS,
    SAMPLED,
    SIZES,
    SOLIDS,
    assert_agrees_with_reference,
    assert_lanes_agree,
    assert_makes_numbers,
    assert_same,
    both_methods,
    colours,
    depth_in_picture,
    every_light,
    map_of,
    opaque_at_last,
    scene_of,
    solid_angles,
)
from tolerances import FAST_MATH

import tfm_cl as tfm

LEAST = 2.0
"""Distance of the farthest corner from the middle, in texels or pixels, below which a triangle is a disc."""

# --- one triangle, in closed form --------------------------------------------------------------------------

MIDDLE = np.array([0.1, -0.07, -0.2])
SHAPE = np.array([[-0.9, -0.5, 0.0], [0.85, -0.55, 0.1], [0.05, 1.05, -0.1]])
"""Corners from the middle; the last is the farthest."""
FARTHEST = np.linalg.norm(SHAPE[2])
OPACITY = 0.6


def alone(size, opacity=OPACITY):
    """One triangle of so large a `SHAPE`; with the corners."""
    small = 0.05 * np.eye(3)
    vertices = np.concatenate([MIDDLE + size * SHAPE, CORNERS[0] + small, CORNERS[1] - small])
    return tfm.Polygons(vertices, np.arange(9).reshape(3, 3), [opacity, HARDLY, HARDLY])


def triangle_along(rays, size, width):
    """Optical depth of the triangle along rays so wide; how far it may be rounded, infinite at its edges."""
    origins, directions = rays
    corners = MIDDLE + size * SHAPE
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    if size * FARTHEST < LEAST * width:
        seen = np.abs(directions @ normal) / 2
        square = max((LEAST * width) ** 2, 9 / 2 / np.pi * np.linalg.norm(normal) / 2)
        away = MIDDLE - origins
        apart = np.linalg.norm(np.cross(away, directions), axis=1)

        def depth(apart):
            covered = 9 / 2 / np.pi * seen / square * np.maximum(1 - apart**2 / square, 0) ** 3.5
            return opaque_at_last(OPACITY, covered)

        moved = np.abs(depth(np.maximum(apart - BORDER, 0)) - depth(apart + BORDER))
        return depth(apart), DEPTH_OF_ONE + moved
    t = ((corners[0] - origins) @ normal) / (directions @ normal)
    places = origins + t[:, None] * directions
    inside = np.full(len(places), np.inf)
    for a, b in pairwise([*corners, corners[0]]):
        inwards = np.cross(normal, b - a)
        inside = np.minimum(inside, (places - a) @ inwards / np.linalg.norm(inwards))
    # A place on a plane seen aslant moves by more than the ray does.
    slant = BORDER / np.abs(directions @ normal / np.linalg.norm(normal))
    rounded = np.where(np.abs(inside) < slant, np.inf, DEPTH_OF_ONE)
    return np.where(inside > 0, opaque_at_last(OPACITY, 1.0), 0), rounded


@pytest.mark.lanes
def test_one_triangle_in_the_picture(renderer):
    camera = tfm.Camera(from_=(0.3, 0.2, 9), to=(0, 0, 0), fov=20, res=(64, 48))
    width = camera.pixel_width * np.linalg.norm(MIDDLE - camera.from_)
    for size in SIZES:
        size_of = size * LEAST * width / FARTHEST / (3 if size > 10 else 1)
        depth, opacity = depth_in_picture(renderer, alone(size_of), camera)
        expected, rounded = triangle_along(camera.rays(), size_of, width)
        assert expected.max() > 1e-4
        assert np.isinf(rounded).mean() < 0.01
        assert (np.abs(depth - expected) <= rounded).all(), size
        assert (np.abs(opacity + np.expm1(-expected)) <= rounded).all(), size


@pytest.mark.lanes
@pytest.mark.quick("spot")
@every_light
def test_one_triangle_in_a_map(renderer, light):
    fitted = LIGHTS[light].fitted(alone(0.01).bounds)
    wide = fitted.footprint(np.linalg.norm(fitted.frame().world_from_light[:3, 3] - MIDDLE))
    for size in SIZES:
        res = 250 if size > 10 else 48  # so that the triangle is within the corners
        size_of = size * LEAST * wide / res / FARTHEST
        found = map_of(renderer, alone(size_of), LIGHTS[light], res)
        expected, rounded = triangle_along(found.rays, size_of, found.texel_at(MIDDLE))
        expected = np.where(found.lit, expected, 0)
        assert expected.max() > 1e-4
        assert (np.abs(found.depth - expected) <= rounded).all(), size


def solid_angle(size, middle):
    """Of the triangle, as seen from a place: Van Oosterom, Strackee 1983."""
    a, b, c = MIDDLE + size * SHAPE - middle
    lengths = [np.linalg.norm(corner) for corner in (a, b, c)]
    below = np.prod(lengths) + (a @ b) * lengths[2] + (a @ c) * lengths[1] + (b @ c) * lengths[0]
    return 2 * np.arctan2(np.abs(a @ np.cross(b, c)), below)


@pytest.mark.parametrize("opacity", [0.3, 1.0])
def test_what_a_triangle_hides_does_not_depend_on_the_resolution(renderer, opacity):
    """Its area times its opacity, up to where it is no disc any more."""
    size = 0.03
    for res in (12, 48, 100, 150, 200):
        camera = tfm.Camera(from_=(0.3, 0.2, 9), to=MIDDLE, fov=20, res=(res, res))
        _, found = depth_in_picture(renderer, alone(size, opacity), camera)
        hidden = (found * solid_angles(camera)).sum()
        expected = opacity * solid_angle(size, camera.from_)
        assert hidden == pytest.approx(expected, rel=2 * SAMPLED), res


@pytest.mark.slow
@every_light
def test_what_a_triangle_hides_of_a_light_does_not_depend_on_the_resolution(renderer, light):
    size = 0.02
    for res in (32, 64, 160):
        found = map_of(renderer, alone(size), LIGHTS[light], res)
        if light == "sun":
            first, other = SHAPE[1] - SHAPE[0], SHAPE[2] - SHAPE[0]
            expected = size**2 * np.abs(found.rays.directions[0] @ np.cross(first, other)) / 2
        else:
            expected = solid_angle(size, LIGHTS[light].from_)
        assert found.covered == pytest.approx(OPACITY * expected, rel=2 * SAMPLED), res


def test_a_veil_of_many_triangles_is_as_one(renderer, rng):
    """Each ray crosses one of them: neither gaps nor double cover at their edges."""
    count = 9
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, count + 1)] * 2), axis=-1).reshape(-1, 2)
    inner = (np.abs(grid) < 0.49).all(axis=1)
    grid[inner] += rng.uniform(-0.02, 0.02, (inner.sum(), 2))
    vertices = np.concatenate([grid, 0.3 * grid[:, :1]], axis=1)
    a = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    first = np.stack([a, a + 1, a + count + 2], axis=1)
    other = np.stack([a, a + count + 2, a + count + 1], axis=1)
    veil = tfm.Polygons(vertices, np.concatenate([first, other]), OPACITY)
    camera = tfm.Camera(from_=(0.1, 0.2, 9), to=(0, 0, 0), fov=5, res=(150, 150))
    depth, _ = depth_in_picture(renderer, veil, camera)
    origins, directions = camera.rays()
    # The plane z = 0.3 x.
    t = (0.3 * origins[:, 0] - origins[:, 2]) / (directions[:, 2] - 0.3 * directions[:, 0])
    places = (origins + t[:, None] * directions)[:, :2]
    inside, outside = (np.abs(places) < 0.4999).all(axis=1), (np.abs(places) > 0.5001).any(axis=1)
    assert inside.sum() > 5000
    np.testing.assert_allclose(depth[inside], -np.log1p(-OPACITY), atol=DEPTH_OF_ONE)
    assert (depth[outside] == 0).all()


# --- against the float64 reference -------------------------------------------------------------------------


def leaves(seed=1, count=9, opacity=0.6, size=0.7, **changes):
    """Larger than what is widened in the scenes below: as the reference has them."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-0.6, 0.6, (count, 1, 3))
    corners = middles + size * rng.uniform(-1, 1, (count, 3, 3))
    return tfm.Polygons(corners.reshape(-1, 3), np.arange(3 * count).reshape(count, 3), opacity, **changes)


LEAVES = leaves()
STRANDS = tfm.Curves([[-0.5, 0.4, 0.2], [0.1, 0.1, 0.3], [0.6, -0.3, 0.1]], [3], 0.25, opacity=0.5)
MIXTURES = {
    "alone": (LEAVES,),
    "opaque": (leaves(opacity=1.0),),
    "coloured": (leaves(colour=colours(9)),),
    "two bodies of their own media": (leaves(medium=BROWN), leaves(4, medium=BLUE)),
    "with a grid": (GRID, LEAVES.with_medium(BROWN)),
    "with points": (BALLS, LEAVES),
    "with strands": (STRANDS.with_medium(FIBRES), LEAVES.with_medium(BLUE)),
    "all kinds": (GRID, BALLS, STRANDS.with_medium(FIBRES), leaves(medium=BLUE, colour=colours(9)), FOG),
}


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("mixture", MIXTURES)
def test_mixtures(renderer, mixture, method):
    assert_agrees_with_reference(renderer, scene_of(*MIXTURES[mixture]), method)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("light", LIGHT_KINDS)
def test_every_kind_of_light(renderer, light, method):
    assert_agrees_with_reference(renderer, scene_of(LEAVES, lights=[LIGHT_KINDS[light]]), method)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize(
    "bodies", [(LEAVES,), (LEAVES, GRID, BALLS)], ids=["leaves", "with a grid and points"]
)
def test_leaves_around_an_opaque_ball(renderer, bodies, method):
    assert_agrees_with_reference(renderer, scene_of(*bodies, **SOLIDS), method)


# --- against each other ------------------------------------------------------------------------------------

ROUNDED = 50 * FAST_MATH
"""Of the brightest: sums of hundreds of leaves in another order."""


def many(count=300, **changes):
    """Large ones, and those that are widened."""
    return leaves(3, count, 0.3, np.random.default_rng(2).uniform(0.001, 0.15, (count, 1, 1)), **changes)


def some(polygons, numbers):
    colour = None if polygons.colour is None else polygons.colour[numbers]
    faces = np.arange(3 * len(numbers)).reshape(-1, 3)
    return tfm.Polygons(polygons.corners[numbers].reshape(-1, 3), faces, 0.3, colour=colour)


@pytest.mark.slow
@both_methods
def test_order_and_splitting_change_nothing(renderer, method):
    whole = many(colour=colours(300))
    mixed = np.random.default_rng(8).permutation(300)
    expected = renderer.render(scene_of(whole), method=method)
    for bodies in ((some(whole, mixed),), (some(whole, mixed[:90]), some(whole, mixed[90:]))):
        assert_same(renderer.render(scene_of(*bodies), method=method), expected, ROUNDED)


EXTREMES = {"of no area": np.zeros((3, 3)), "tiny": 1e-30 * np.eye(3), "huge": 1e6 * SHAPE}


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("extreme", EXTREMES)
def test_extreme_triangles_make_numbers(renderer, extreme, method):
    vertices = np.concatenate([EXTREMES[extreme], 0.4 * SHAPE])
    body = tfm.Polygons(vertices, [[0, 1, 2], [3, 4, 5]], [1.0, 0.5])
    result = renderer.render(scene_of(body), method=method)
    assert_makes_numbers(result)
    assert result.image[..., 3].max() > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bodies", "method"),
    [((many(),), "dual"), ((many(), GRID, STRANDS, FOG), "tfm")],
    ids=["leaves", "mixed"],
)
def test_lanes_agree(new_renderer, device_name, bodies, method):
    scene = scene_of(*bodies, camera=CAMERA.replace(res=(45, 31)))
    assert_lanes_agree(new_renderer, device_name, scene, method)
