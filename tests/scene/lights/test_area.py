"""Area lights: the points of the disk, the lights made of them, and what they say in a scene file."""

import tomllib
from itertools import chain

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.plan import options
from tfm_cl.scene.lights import Light, LightFrame
from tfm_cl.scene.lights.area import disk_points
from tfm_cl.scene.lights.spot import MOST_SAMPLES
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.scene_file_writer import to_toml

ROUNDING = 1e-12
"""Sums of up to 256 float64 numbers near 1, and a rotation."""

QUADRATURE = 0.6
"""Error of the mean of a smooth function over k points, times k, relative to its range: the spiral's rings
have equal areas."""

COUNTS = [1, 2, 3, 4, 5, 16, 100, MOST_SAMPLES]
PLACES = {
    "oblique": {"from_": (3, 4, 2), "to": (0.5, -1, 0)},
    "straight down": {"from_": (0, 5, 0), "to": (0, 0, 0)},
    "far away": {"from_": (1e6, 20, -7), "to": (1e6, 0, 0)},
}


def area_light(**keys):
    values = {"from_": (3, 4, 2), "to": (0.5, -1, 0), "radius": 0.75, "samples": 16, **keys}
    return tfm.SpotLight(**{"cone": 20, "blend": 0.25, "intensity": (1, 2, 3), **values})


def origins(lights):
    return np.array([light.from_ for light in lights])


@pytest.mark.parametrize("count", COUNTS)
def test_points_lie_in_the_disk_around_its_centre(count):
    points = disk_points(count)

    assert points.shape == (count, 2)
    assert np.abs(points.mean(axis=0)).max() < ROUNDING
    assert np.hypot(*points.T).max() < 1
    assert (points == disk_points(count)).all()


@pytest.mark.parametrize("count", [16, 64, MOST_SAMPLES])
def test_points_are_spread_by_area(count):
    points = disk_points(count)
    radii = np.hypot(*points.T)

    # As of a uniform disk: the mean of r² is 1/2, half the points are within 1/√2, quarters have their share.
    assert (radii**2).mean() == pytest.approx(0.5, abs=QUADRATURE / count)
    assert (radii < np.sqrt(0.5)).mean() == pytest.approx(0.5, abs=1.5 / count)
    quarters = np.histogram(np.arctan2(points[:, 1], points[:, 0]), 4, (-np.pi, np.pi))[0]
    assert np.abs(quarters - count / 4).max() <= 2
    # None clump: circles of a tenth of the area that falls to each do not overlap.
    distances = np.linalg.norm(points[:, None] - points, axis=2) + 9 * np.eye(count)
    assert distances.min() > 2 * np.sqrt(0.1 / count)


@pytest.mark.parametrize("count", [1, 2, 16, MOST_SAMPLES])
@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_lights_lie_on_a_disk_that_faces_the_axis(place, count):
    light = area_light(samples=count, **place)

    lights = light.parts()

    offsets = origins(lights) - light.from_
    axis = np.subtract(light.to, light.from_)
    rounding = ROUNDING * np.abs([light.from_, light.to]).max()
    assert len(lights) == count
    assert np.abs(offsets.mean(axis=0)).max() < rounding
    assert np.abs(offsets @ axis).max() / np.linalg.norm(axis) < rounding
    assert np.linalg.norm(offsets, axis=1).max() <= light.radius
    assert count < 16 or np.linalg.matrix_rank(offsets, tol=0.1) == 2
    assert all(other.to == light.to for other in lights)


@pytest.mark.parametrize("count", [1, 3, 16, MOST_SAMPLES])
def test_intensities_add_up(count):
    light = area_light(samples=count)

    total = np.sum([other.intensity for other in light.parts()], axis=0)

    np.testing.assert_allclose(total, light.intensity, rtol=ROUNDING)


def test_everything_else_is_the_lights_own():
    light = area_light(falloff="inverse-square")

    for other in light.parts():
        restored = other.replace(from_=light.from_, intensity=light.intensity, radius=light.radius)
        assert restored == light
        assert other.parts() == (other,)


def test_always_the_same_lights():
    assert area_light().parts() == area_light().parts()
    assert area_light().parts() != area_light(radius=0.5).parts()


def test_a_point_is_itself():
    light = area_light(radius=0)

    assert light.parts() == (light,)
    assert light.parts()[0] is light


class Candle(Light):
    """A light without a radius."""

    HEADER = "light/candle.h"

    def frame(self):
        return LightFrame(np.eye(4), ())

    def footprint(self, distance):
        return distance

    def fitted(self, bounds):
        del bounds
        return self

    def rays(self, positions):
        return positions, positions

    def begins(self, points):
        return points

    def arrival(self, points, nearest=0.0):
        return points, nearest


def test_a_light_of_another_type_is_itself():
    light = Candle(type="candle")

    assert light.parts() == (light,)


def test_every_point_has_a_map_of_its_own():
    lights = area_light(samples=32).parts()

    assert len({light.map_key() for light in lights}) == 32


def test_radius_and_samples_are_not_in_the_map():
    light = area_light()

    assert light.map_key() == light.replace(radius=0.0, samples=1).map_key()
    assert light.frame().shape == light.replace(radius=9.0).frame().shape


@pytest.mark.parametrize("count", [16, 64, MOST_SAMPLES])
@pytest.mark.parametrize("radius", [0.2, 1.0, 2.0])
def test_light_on_the_axis_is_that_of_a_disk(count, radius):
    # The mean of 1/d² over a disk, at distance z on its axis: ln(1 + R²/z²) / R².
    light, z = area_light(radius=radius, samples=count), 2.0
    axis = np.subtract(light.to, light.from_)
    point = light.from_ + z * axis / np.linalg.norm(axis)
    lights = light.parts()

    squares = ((origins(lights) - point) ** 2).sum(axis=1)
    received = sum(other.intensity[0] / square for other, square in zip(lights, squares, strict=True))

    expected = light.intensity[0] * np.log1p(radius**2 / z**2) / radius**2
    spread_of = 1 / z**2 - 1 / (z**2 + radius**2)
    assert received == pytest.approx(expected, abs=QUADRATURE / count * spread_of)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_penumbra_is_the_part_of_the_disk_that_is_seen(share):
    # A screen with a straight edge, clear on one side, e^-3 on the other: the mean of T, not T of the mean.
    light = area_light(radius=1.0, samples=MOST_SAMPLES, from_=(0, 0, 4), to=(0, 0, 0))
    x = origins(light.parts())[:, 0]
    edge = np.linspace(-1, 1, 20_001)
    seen = (np.arccos(edge) - edge * np.sqrt(1 - edge**2)) / np.pi  # part of the disk with x > edge
    edge = edge[np.argmin(np.abs(seen - share))]

    transmittance = np.where(x > edge, 1.0, np.exp(-3)).mean()

    expected = share + (1 - share) * np.exp(-3)
    assert transmittance == pytest.approx(expected, abs=0.02)
    assert transmittance > np.exp(-3 * (1 - share)) + 0.05  # what a blurred density lets through


# --------------------------------------------------------------------------- the keys


def test_defaults():
    light = tfm.SpotLight(from_=(1, 2, 3), to=(0, 0, 0))

    assert (light.radius, light.samples) == (0.0, 16)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"radius": -0.1}, "light.radius = -0.1: should be greater than or equal to 0"),
        ({"radius": np.inf}, "light.radius = inf: should be a finite number"),
        ({"radius": 1e15}, "light: radius = 1e+15: the disk should lie within 1e+15"),
        ({"samples": 0}, "light.samples = 0: should be greater than or equal to 1"),
        ({"samples": 257}, "light.samples = 257: should be less than or equal to 256"),
        ({"samples": 4.0}, "light.samples = 4.0: should be a valid integer"),
    ],
)
def test_impossible_values_are_one_line(keys, message):
    with pytest.raises(SceneError) as raised:
        area_light(**keys)

    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)


def test_the_largest_disk_can_be_spread():
    light = area_light(from_=(0, 0, 1), to=(0, 0, 0), radius=9e14, samples=MOST_SAMPLES)

    assert len(light.parts()) == MOST_SAMPLES


def test_a_scene_file_and_back(tmp_path):
    np.save(tmp_path / "cloud.npy", blobs())
    (tmp_path / "scene.toml").write_text(
        '[volume]\nfile = "cloud.npy"\n'
        "[[light]]\nfrom = [3, 4, 2]\nto = [0, 0, 0]\nradius = 0.5\nsamples = 7\n"
        "[[light]]\nfrom = [-3, 4, 2]\nto = [0, 0, 0]\n"
    )
    file = SceneFile.read(tmp_path / "scene.toml")
    scene = file.make(tfm.Scene)
    written = tmp_path / "written.toml"
    written.write_text(to_toml(options.table(file, scene)), encoding="utf-8")

    again = SceneFile.read(written).make(tfm.Scene)

    assert [(light.radius, light.samples) for light in again.lights] == [(0.5, 7), (0.0, 16)]
    assert again.lights == scene.lights
    assert len(list(chain.from_iterable(light.parts() for light in again.lights))) == 8
    table = tomllib.loads(written.read_text(encoding="utf-8"))["light"][0]
    assert (table["radius"], table["samples"]) == (0.5, 7)


def test_the_placed_light_may_have_a_radius(tmp_path):
    np.save(tmp_path / "cloud.npy", blobs())
    overrides = [("light.radius", 0.25), ("light.samples", 4)]

    lights = SceneFile.read(tmp_path / "cloud.npy", overrides).make(tfm.Scene).lights

    assert [(light.radius, light.samples) for light in lights] == [(0.25, 4)]
