"""The sun: what its map covers, where it begins, and that it is a spot from far away."""

import copy
import itertools
import pickle

import numpy as np
import pytest
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.scene.lights import SunLight, parse_light

BOUNDS = np.array([[-1.0, 0.5, 2.0], [1.5, 1.0, 7.0]])
CASTERS = np.array([[-9.0, -5.0, 1.0], [-3.0, 12.0, 3.0]])


def corners(bounds):
    return np.array(list(itertools.product(*bounds.T)))


def some_suns():
    rng = np.random.default_rng(5)
    directions = [*rng.normal(size=(20, 3)), *np.eye(3), *-np.eye(3), (1e-5, -1, 0)]
    return [SunLight(from_=(0, 0, 0), to=tuple(direction)) for direction in directions]


@pytest.mark.parametrize("moved", [0.0, 1e6])
def test_the_map_covers_the_bounds_and_no_more(moved):
    bounds = BOUNDS + moved
    for sun in some_suns():
        arrival = sun.fitted(bounds).arrival(corners(bounds))
        low, high = arrival.position.min(axis=0), arrival.position.max(axis=0)
        assert (low > 0).all()
        assert (high < 1).all()
        # The margin is 1e-5 of the diagonal, 5.6, and the narrowest side of the map 0.5.
        assert (low < 2e-4).all()
        assert (high > 1 - 2e-4).all()
        assert arrival.distance.min() > 0


def test_it_begins_before_the_medium():
    for sun in some_suns():
        distance = sun.fitted(BOUNDS).arrival(corners(BOUNDS)).distance
        assert 0 < distance.min() < 0.02 * np.linalg.norm(np.diff(BOUNDS, axis=0))


def test_rays_and_arrival_agree(rng):
    for sun in some_suns():
        sun = sun.fitted(BOUNDS)  # noqa: PLW2901
        position, distance = rng.uniform(0, 1, (50, 2)), rng.uniform(0, 9, 50)
        origins, directions = sun.rays(position)
        points = origins + distance[:, None] * directions
        arrival = sun.arrival(points)
        axis = np.subtract(sun.to, sun.from_)
        np.testing.assert_allclose(directions, np.tile(axis / np.linalg.norm(axis), (50, 1)), atol=ROUNDED)
        np.testing.assert_allclose(arrival.direction, directions)
        np.testing.assert_allclose(arrival.position, position, atol=100 * ROUNDED)
        np.testing.assert_allclose(arrival.distance, distance, atol=100 * ROUNDED)
        np.testing.assert_allclose(sun.begins(points), origins, atol=100 * ROUNDED)
        assert np.isinf(sun.source_distance(points)).all()
        assert sun.reaches(points).all()


def test_only_the_direction_counts():
    one = SunLight(from_=(0, 0, 0), to=(1, -2, 3)).fitted(BOUNDS)
    other = SunLight(from_=(7, 5, 3), to=(8, 3, 6)).fitted(BOUNDS)

    assert one.map_key() == other.map_key()
    assert one.map_key() != one.replace(to=(1, -2, 3.1)).map_key()
    assert one.map_key() == one.replace(intensity=(5, 6, 7)).map_key()


@pytest.mark.parametrize(
    "use",
    [
        lambda sun: sun.frame(),
        lambda sun: sun.map_key(),
        lambda sun: sun.rays(np.zeros((1, 2))),
        lambda sun: sun.footprint(1.0),
    ],
    ids=["frame", "map_key", "rays", "footprint"],
)
def test_without_bounds_there_is_no_map(use):
    sun = SunLight(from_=(0, 1, 0), to=(0, 0, 0))

    assert sun.needs_fitting
    with pytest.raises(SceneError, match="fit the sun's map to the medium first"):
        use(sun)
    assert not sun.fitted(BOUNDS).needs_fitting
    assert sun.needs_fitting  # nothing happened to it


def test_a_copy_stays_fitted():
    sun = SunLight(from_=(0, 1, 0), to=(0.2, 0, 0)).fitted(BOUNDS)

    for again in (sun.replace(intensity=3), copy.deepcopy(sun), pickle.loads(pickle.dumps(sun))):
        assert again.map_key() == sun.map_key()
    assert sun.to_dict() == {
        "type": "sun",
        "from": [0, 1, 0],
        "to": [0.2, 0, 0],
        "intensity": [1, 1, 1],
        "falloff": "none",
        "name": None,
    }
    assert parse_light(sun.to_dict()).fitted(BOUNDS).map_key() == sun.map_key()


def test_a_far_spot_tends_to_the_sun(rng):
    points = rng.uniform(*BOUNDS, (200, 3))
    axis = np.array([0.6, -0.64, 0.48])
    sun = SunLight(from_=(0, 0, 0), to=tuple(axis)).fitted(BOUNDS)
    middle = np.asarray(sun.frame().world_from_light[:3, 3])
    parallel, errors = sun.arrival(points), []
    for far in (1e3, 1e4, 1e5):
        # Its square is as wide as the sun's map, where that begins.
        cone = np.degrees(np.arctan(sun.frame().shape[0] / far))
        spot = tfm.SpotLight(from_=middle - far * axis, to=middle, cone=cone, falloff="inverse-square")
        arrival = spot.arrival(points)
        x, y = (parallel.position - 0.5).T
        y = y * sun.frame().shape[1] / sun.frame().shape[0]
        errors.append(
            [
                np.abs(arrival.direction - parallel.direction).max(),
                np.abs(arrival.position - 0.5 - np.column_stack([x, y])).max(),
                np.abs(arrival.distance - far - parallel.distance).max(),
                np.abs(arrival.strength * far**2 - parallel.strength).max(),
            ]
        )
    errors = np.array(errors)
    assert (errors[0] < 0.05).all()
    # A tenth with ten times the distance, up to the digits that 1e5 leaves.
    assert (errors[1:] < 0.11 * errors[:-1] + 1e-9).all()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"to": (1, 2, 3)}, "light: from and to are the same point"),
        ({"falloff": "inverse-square"}, "light.falloff = 'inverse-square': should be 'none'"),
        ({"cone": 20.0}, "unknown key 'cone' in [light]"),
    ],
)
def test_impossible_values_are_one_line(keys, message):
    with pytest.raises(SceneError) as raised:
        SunLight(**{"from_": (1, 2, 3), "to": (0, 0, 0), **keys})

    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)
