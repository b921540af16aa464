"""The point light's octahedral map: every direction once, and no seam."""

import numpy as np
import pytest
from tolerances import ROUNDED

from tfm_cl.errors import SceneError
from tfm_cl.scene.lights import PointLight
from tfm_cl.scene.lights.charts import BORDER, COARSEST, Octahedron
from tfm_cl.scene.lights.texels import look_up

STRETCH = 3.0
"""Radians a unit of the square is at most: in the middle of a face, 1/√3 from the centre and tilted by it."""

LIGHT = PointLight(from_=(0.3, -0.2, 0.5))
CHART = Octahedron.whole()


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def direction_of(square):
    return unit(CHART.lifted(square))


def texel_directions(res):
    at = (np.arange(res) + 0.5) / res
    positions = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    origins, directions = LIGHT.rays(positions)
    assert (origins == LIGHT.from_).all()
    return directions.reshape(res, res, 3)


def seam_directions(rng, count):
    """Directions near where the square's sides meet: z < 0 and x or y near 0; and at the poles."""
    directions = rng.normal(size=(count, 3))
    directions[:, 2] = -np.abs(directions[:, 2])
    near = np.arange(count)
    directions[near, near % 2] *= 10.0 ** -rng.uniform(1, 6, count)
    directions[::10] = (0, 0, -1) + rng.normal(size=(len(directions[::10]), 3)) * 1e-3
    return unit(directions)


def test_there_and_back(rng):
    directions = np.concatenate(
        [unit(rng.normal(size=(5000, 3))), seam_directions(rng, 5000), np.eye(3), -np.eye(3)]
    )
    distance = rng.uniform(0.1, 50, len(directions))

    arrival = LIGHT.arrival(LIGHT.from_ + distance[:, None] * directions)
    _, again = LIGHT.rays(arrival.position)

    np.testing.assert_allclose(again, directions, atol=100 * ROUNDED)
    np.testing.assert_allclose(arrival.direction, directions, atol=100 * ROUNDED)
    np.testing.assert_allclose(arrival.distance, distance, rtol=100 * ROUNDED)
    assert arrival.position.min() >= BORDER - ROUNDED
    assert arrival.position.max() <= 1 - BORDER + ROUNDED


def test_places_in_the_square_are_those_of_their_rays(rng):
    square = rng.uniform(-1, 1, (5000, 2))
    np.testing.assert_allclose(CHART.plane(direction_of(square)), square, atol=ROUNDED)


@pytest.mark.parametrize("res", [16, 32, 33, 100, 512])
def test_neighbouring_texels_have_neighbouring_rays(res):
    directions = texel_directions(res)
    step = 2 / (1 - 2 * BORDER) / res
    for across in (directions[1:] - directions[:-1], directions[:, 1:] - directions[:, :-1]):
        angle = 2 * np.arcsin(np.linalg.norm(across, axis=-1) / 2)
        assert angle.max() < STRETCH * step
    # Within the octahedron no two have the same; across the seam those that mirror each other do.
    inner = directions[1 + res // 32 : -1 - res // 32, 1 + res // 32 : -1 - res // 32]
    for across in (np.diff(inner, axis=0), np.diff(inner, axis=1)):
        assert np.linalg.norm(across, axis=-1).min() > 0.4 * step


def test_the_border_repeats_what_is_across_the_seam(rng):
    beyond, along = 1 + rng.uniform(0, 2 * BORDER, 500), rng.uniform(-1, 1, 500)
    for outside, inside in (
        ((beyond, along), (2 - beyond, -along)),
        ((-beyond, along), (beyond - 2, -along)),
        ((along, beyond), (-along, 2 - beyond)),
        ((along, -beyond), (-along, beyond - 2)),
    ):
        np.testing.assert_allclose(
            direction_of(np.column_stack(outside)), direction_of(np.column_stack(inside)), atol=ROUNDED
        )


def test_the_corner_is_one_point():
    around = 1 + 1e-9 * np.column_stack([np.cos(np.arange(12)), np.sin(np.arange(12))])
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        assert np.abs(direction_of(around * signs) - (0, 0, -1)).max() < 1e-8


@pytest.mark.parametrize("res", [16, 32, 64, 256])
def test_bilinear_look_ups_see_no_seam(rng, res):
    def value(directions):
        return (directions @ [1.0, -0.7, 0.4])[..., None]

    # A map's first row is its lowest v; an image's is its highest.
    image = value(texel_directions(res))[::-1]
    errors = []
    for directions in (unit(rng.normal(size=(4000, 3))), seam_directions(rng, 4000)):
        position = LIGHT.arrival(np.asarray(LIGHT.from_) + directions).position
        errors.append(np.abs(look_up(image, position) - value(directions)).max())

    step = 2 / (1 - 2 * BORDER) / res
    # Between texels a bilinear look-up of a cosine errs by about the square of their distance, at the
    # octahedron's edges, where the map bends, by a part of the distance.
    assert errors[1] < 1.3 * step
    assert errors[1] < 1.5 * errors[0]


def test_without_its_border_the_map_would_have_a_seam(rng):
    # The same look-up in a map that ends where the octahedron does.
    res = 64
    at = (np.arange(res) + 0.5) / res * 2 - 1
    square = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    image = (direction_of(square) @ [1.0, -0.7, 0.4]).reshape(res, res, 1)[::-1]
    directions = seam_directions(rng, 4000)
    directions[:, :2] += 1e-9
    mirrored = directions * (-1, 1, 1)
    close = np.abs(directions[:, 0]) < 1e-5

    without = [look_up(image, (1 + CHART.plane(each)) / 2) for each in (directions, mirrored)]
    jumps = [np.abs(np.subtract(*without))]
    with_border = texel_directions(res) @ [1.0, -0.7, 0.4]
    places = [LIGHT.arrival(np.asarray(LIGHT.from_) + d).position for d in (directions, mirrored)]
    jumps.append(np.abs(np.subtract(*(look_up(with_border[::-1, :, None], place) for place in places))))

    assert np.count_nonzero(close) > 100
    assert jumps[0][close].max() > 0.01
    assert jumps[1][close].max() < 1e-4


def test_inverse_square_falloff():
    light = PointLight(from_=(0, 0, 0), falloff="inverse-square")
    points = np.array([[2.0, 0, 0], [0, -4, 0], [0, 0, 0]])

    np.testing.assert_allclose(light.arrival(points, 0.5).strength, [1 / 4, 1 / 16, 4])
    assert (PointLight(from_=(0, 0, 0)).arrival(points).strength == 1).all()


def test_a_sphere_of_light_is_its_points():
    light = PointLight(from_=(1, 2, 3), radius=0.5, samples=64, intensity=(1, 2, 4))

    parts = light.parts()

    offsets = np.array([part.from_ for part in parts]) - light.from_
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 0.5, rtol=ROUNDED)
    assert np.abs(offsets.mean(axis=0)).max() < 0.01
    np.testing.assert_allclose(np.sum([part.intensity for part in parts], axis=0), light.intensity)
    assert all(part.parts() == (part,) for part in parts)
    assert len({part.map_key() for part in parts}) == 64


def test_the_footprint_is_that_of_the_widest_texels(rng):
    light, res = PointLight(from_=(0, 0, 0)), 64
    # Root of the solid angle that a piece of the square shows.
    square, step = rng.uniform(-1, 1, (20000, 2)), 1e-4
    across, up = (direction_of(square + shift) - direction_of(square) for shift in ((step, 0), (0, step)))
    widest = np.sqrt(np.linalg.norm(np.cross(across, up), axis=1).max()) / step
    texel = 2 / (1 - 2 * BORDER) / res
    assert light.footprint(3) / res == pytest.approx(3 * widest * texel, rel=0.01)
    assert widest == pytest.approx(COARSEST, rel=0.01)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "light.from is missing"),
        ({"to": (0, 0, 0)}, "unknown key 'to' in [light]"),
        ({"cone": 20.0}, "unknown key 'cone' in [light]"),
        ({"from_": (9e14, 0, 0), "radius": 2e14}, "light: radius = 2e+14: the sphere should lie within"),
    ],
)
def test_impossible_values_are_one_line(keys, message):
    with pytest.raises(SceneError) as raised:
        PointLight(**({"from_": (0, 0, 0)} | keys if keys else {}))

    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)
