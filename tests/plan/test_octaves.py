"""Numbers of octaves, where they are left open."""

import numpy as np
import pytest
from scenes import blobs, make_scene

import tfm_cl as tfm
from tfm_cl.plan import octaves
from tfm_cl.plan.plan import plan

WHITE = tfm.Medium(octaves=4)
SLAB = tfm.Volume(np.ones((9, 9, 9)), voxel_size=0.1)


def number(medium, volume=SLAB, key="contribution"):
    (found,) = (
        found.number
        for found in octaves.numbers(make_scene(volume=volume, medium=medium))
        if found.key == key
    )
    return found


def test_it_grows_with_the_optical_depth_and_falls_with_absorption():
    by_depth = [number(WHITE, SLAB.with_density_scale(scale)) for scale in (0.01, 0.1, 1)]
    assert by_depth == sorted(set(by_depth))
    by_albedo = [number(WHITE.replace(sigma_s=1 - a, sigma_a=a)) for a in (0, 0.1, 0.5, 1)]
    assert by_albedo == sorted(set(by_albedo), reverse=True)
    assert by_albedo[-1] == 0
    assert number(WHITE.replace(phase="hg:0.9")) < number(WHITE)  # at a depth of about 1


MEASURED = [
    (0.37, 0.0, 0.9, 0.88),
    (3.01, 0.0, 0.9, 0.71),
    (3.01, 0.0, 0.7, 0.40),
    (7.13, 0.0, 0.9, 0.56),
    (0.72, 0.85, 0.9, 0.85),
    (1.42, 0.85, 0.9, 0.66),
    (3.01, 0.85, 0.9, 0.65),
    (3.01, 0.85, 0.7, 0.30),
    (3.97, 0.85, 0.9, 0.56),
    (7.83, 0.85, 0.9, 0.42),
    (7.13, 0.85, 0.9, 0.39),
    (7.13, 0.85, 0.99, 0.89),
]
"""Mean depth, g, albedo, and what absorption leaves of the second to 40th orders of scattering (64th, of
0.99): three clouds, lit from the side or from behind the camera."""


@pytest.mark.parametrize(("depth", "g", "albedo", "left"), MEASURED)
def test_absorption_takes_of_octaves_what_it_takes_of_orders(depth, g, albedo, left):
    def brightness(albedo):
        medium = WHITE.replace(phase=f"hg:{g}", sigma_s=albedo, sigma_a=1 - albedo)
        return sum(octaves.KEYS["contribution"](depth, medium) ** i for i in (1, 2, 3))

    assert brightness(albedo) / brightness(1) == pytest.approx(left, abs=0.11)


def test_what_is_deeper_is_more_even_up_to_a_depth():
    scales = (0.1, 1, 10, 1000, 2000)
    *eccentricity, deepest, still = (
        number(WHITE, SLAB.with_density_scale(s), "eccentricity") for s in scales
    )
    assert [*eccentricity, deepest] == sorted({*eccentricity, deepest}, reverse=True)
    assert still == deepest


def test_deep_media_are_dimmed_by_their_phase_function():
    def attenuation(scale, mean_cosine):
        medium = WHITE.replace(phase=f"hg:{mean_cosine}")
        return number(medium, SLAB.with_density_scale(scale), "attenuation")

    assert [attenuation(1, g) for g in (-0.5, 0, 0.5, 0.9)] == [octaves.ATTENUATION] * 4
    evenly, half, ahead = (attenuation(20, g) for g in (0, 0.5, 0.9))
    assert evenly < half == octaves.ATTENUATION < ahead <= 1


def test_numbers_have_no_steps():
    for key in octaves.KEYS:
        below, above = (octaves.KEYS[key](octaves.AT_DEPTH * x, WHITE) for x in (1 - 1e-6, 1 + 1e-6))
        assert below == above, key  # of three digits


def test_it_does_not_depend_on_units_nor_on_how_density_and_extinction_share_them():
    assert number(WHITE.replace(sigma_s=4.0), SLAB.with_density_scale(0.25)) == number(WHITE)
    assert number(WHITE, tfm.Volume(np.ones((9, 9, 9)), voxel_size=10, density_scale=0.01)) == number(WHITE)


@pytest.mark.parametrize(
    "body",
    [
        tfm.BoxVolume(from_=(0, 0, 0), to=(1, 1, 1), density=2.0),
        tfm.Points(np.random.default_rng(1).random((50, 3)), 0.2, density=2.0),
        tfm.Volume(np.zeros((3, 3, 3))),
        tfm.Volume(1e-30 * blobs((8, 8, 8))),
    ],
    ids=["box", "points", "empty", "faint"],
)
def test_every_body_has_one(body):
    assert 0 <= number(WHITE, body) <= 1


def test_each_medium_has_its_own_and_a_number_that_is_given_stays():
    thin = SLAB.with_density_scale(0.1).with_medium(WHITE)
    given = SLAB.with_medium(WHITE.replace(contribution=0.125))
    scene = make_scene(volume=(SLAB, thin, given), medium=WHITE)
    planned = plan(scene)
    decided = {key: found.value for key, found in planned.decisions.items() if key.endswith("contribution")}
    assert list(decided) == ["medium.contribution", "volume.1.medium.contribution"]
    assert not set(planned.decisions) & set(planned.told)  # to be fixed by hand
    media = [planned.scene.medium_of(body) for body in planned.scene.bodies]
    assert [medium.contribution for medium in media] == [*decided.values(), 0.125]


def test_a_medium_without_extinction_has_one():
    nothing = WHITE.replace(sigma_s=0.0, emission=1.0)
    found = octaves.numbers(make_scene(volume=SLAB, medium=nothing))
    assert [one.key for one in found] == list(octaves.KEYS)
    assert all(0 <= one.number <= 1 for one in found)


def test_single_scattering_needs_none():
    scene = make_scene(volume=SLAB)
    assert octaves.numbers(scene) == []
    assert octaves.resolved(scene, []) is scene
    assert scene.medium.octave_terms.shape == (3, 1)
