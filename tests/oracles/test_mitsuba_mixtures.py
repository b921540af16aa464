"""Bodies of several media that share space, against Mitsuba 3's sum of their media.

As in `test_mitsuba`, what is left is Mitsuba's Monte Carlo noise, known from independent batches. 1600 × 1600
steps instead of 400 × 400 move the means of these pictures by less than 2e-5.
"""

import numpy as np
import pytest
from oracles.mitsuba_agreement import (
    SLOW,
    SYSTEMATIC,
    agreement,
    failures,
    image_of,
    mitsuba_batches,
    write_report,
)
from scenes import blobs, turned

import tfm_cl as tfm
from tfm_cl.scene.lights import SunLight

STEPS = 400
METHODS = ("dual", "tfm")
QUICK = 24
"""Samples per pixel and batch: the mean's standard error is 0.3 %."""
OF_THE_MAPS = 1e-3
"""Part of the mean by which maps of 16 coefficients and 128² texels darken a mixture, beyond `SYSTEMATIC`:
1e-5 to 6e-4 against the dual march, and by 2e-3 root mean square; n = 8 and 64² by up to 5e-3."""
ALLOWED = {"dual": SYSTEMATIC, "tfm": SYSTEMATIC + OF_THE_MAPS}
"""Bias of the mean beyond noise, for each method."""
WIDE = 5.0
"""A wrong scene is off by so many times what is allowed of a right one, noise included; not asked of the
scalar variant, whose few samples allow much."""

FORWARD = tfm.HenyeyGreenstein(0.4)
WHITE = tfm.Medium(sigma_s=1.0, phase=FORWARD)
BROWN = tfm.Medium(sigma_s=(0.8, 0.5, 0.25), sigma_a=(0.2, 0.4, 0.6), phase=FORWARD)
BLUE = tfm.Medium(sigma_s=(0.3, 0.7, 1.0), sigma_a=(0.5, 0.3, 0.1), phase=FORWARD)
HAZE = tfm.Medium(sigma_s=(1.0, 0.9, 0.8), sigma_a=0.05, phase=tfm.HenyeyGreenstein(-0.2))

FIRST = turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9))
SECOND = turned(-40, (0.3, 1, 2), (0.1, 0.1, 0.16), (0.0, -1.0, -0.3))
SHAPE = (9, 20, 11)


def grid(medium, matrix=FIRST, seed=7, shape=(14, 12, 16), **changes):
    return tfm.Volume(
        blobs(shape, seed), world_from_index=matrix, density_scale=3.0, medium=medium, **changes
    )


def tint(shape):
    """A colour that differs from voxel to voxel, 0.4 to 1.2 in every channel."""
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
    return np.stack([1.2 - 0.8 * x, 0.8 + 0.4 * np.sin(7 * y + 2 * z), 0.4 + 0.8 * x * z], axis=-1)


FOG = tfm.BoxVolume(from_=(-1.3, -1.2, -1.1), to=(1.2, 1.3, 1.0), density=0.3, medium=HAZE)
MIXTURES = {
    # The albedo differs by place.
    "white in brown": (grid(WHITE), grid(BROWN, SECOND, 11, SHAPE)),
    # The phase function as well; the cloud has corners outside of the fog.
    "a tinted cloud in fog": (grid(BLUE), FOG),
    # The extinction of each channel has a shape of its own.
    "a coloured cloud in fog": (grid(BROWN, SECOND, 11, SHAPE, colour=tint(SHAPE)), FOG),
}

FROM = (2.2, 3.0, 1.2)
LIGHTS = {
    "spot": tfm.SpotLight(
        from_=FROM, to=(0, 0, 0), cone=14, intensity=(30, 25, 20), falloff="inverse-square"
    ),
    "sun": SunLight(from_=FROM, to=(0, 0, 0), intensity=(3, 2.5, 2)),
}


def scene_of(bodies, light, method="dual"):
    return tfm.Scene(
        bodies,
        camera=tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0, 0, 0), fov=28, res=(24, 18)),
        lights=[LIGHTS[light]],
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, coeffs=16, res=128, steps=STEPS),
        march=tfm.MarchSettings(method=method, steps=STEPS),
    )


def mixture_scene(mixture, light):
    return scene_of(MIXTURES[mixture], light)


@pytest.fixture(scope="module")
def mitsuba():
    with mitsuba_batches() as batches:
        yield batches


CASES = [
    pytest.param("white in brown", "spot", "tfm", QUICK, id="white in brown, spot, tfm"),
    pytest.param("a tinted cloud in fog", "sun", "dual", QUICK, id="a tinted cloud in fog, sun, dual"),
    *(
        pytest.param(
            mixture, light, method, SLOW, id=f"{mixture}, {light}, {method}, more", marks=pytest.mark.slow
        )
        for mixture, light in (
            ("white in brown", "spot"),
            ("a tinted cloud in fog", "sun"),
            ("a coloured cloud in fog", "spot"),
            ("a coloured cloud in fog", "sun"),
        )
        for method in METHODS
    ),
]


@pytest.mark.parametrize(("mixture", "light", "method", "samples"), CASES)
def test_picture(renderer, mitsuba, tmp_path, mixture, light, method, samples):
    expected = mitsuba(mixture_scene, samples, mixture, light)
    image = image_of(renderer, scene_of(MIXTURES[mixture], light, method))
    found = agreement(image, expected)
    wrong = failures(found, mitsuba.is_scalar, ALLOWED[method])
    assert not wrong, f"{wrong}: {write_report(tmp_path, found, image, expected)}"


@pytest.mark.slow
@pytest.mark.parametrize("mixture", MIXTURES)
def test_transmittance(renderer, mitsuba, tmp_path, mixture):
    expected = mitsuba(mixture_scene, QUICK, mixture, "spot", backlit=True)
    result = renderer.render(mixture_scene(mixture, "spot"))
    image = result.aovs["transmittance"].astype(np.float64)
    found = agreement(image, expected)
    wrong = failures(found, mitsuba.is_scalar)
    assert not wrong, f"{wrong}: {write_report(tmp_path, found, image, expected)}"


def media_swapped(bodies):
    """The shapes keep their places; all else is the other's."""
    first, second = bodies
    return first.with_medium(second.own_medium), second.with_medium(first.own_medium)


def one_left_out(bodies):
    return bodies[:1]


def one_albedo(bodies):
    """The extinction is right, the albedo everywhere the mean of both."""
    media = [body.own_medium for body in bodies]
    albedo = np.mean([np.array(medium.sigma_s) / medium.sigma_t for medium in media], axis=0)
    return tuple(
        body.with_medium(
            medium.replace(sigma_s=albedo * medium.sigma_t, sigma_a=(1 - albedo) * medium.sigma_t)
        )
        for body, medium in zip(bodies, media, strict=True)
    )


def phases_swapped(bodies):
    first, second = (body.own_medium for body in bodies)
    return (
        bodies[0].with_medium(first.replace(phase=second.phase)),
        bodies[1].with_medium(second.replace(phase=first.phase)),
    )


SPOILT = [
    ("white in brown", media_swapped),
    ("white in brown", one_left_out),
    ("white in brown", one_albedo),
    ("a tinted cloud in fog", media_swapped),
    ("a tinted cloud in fog", one_left_out),
    ("a tinted cloud in fog", one_albedo),
    ("a tinted cloud in fog", phases_swapped),
    ("a coloured cloud in fog", one_left_out),
]


def assert_wrong(found, method, scalar):
    """The mean of some channel is off by far."""
    times_allowed = np.abs(found.bias) / (3 * found.standard_error + ALLOWED[method])
    assert times_allowed.max() > (1.0 if scalar else WIDE)
    assert "bias" in failures(found, scalar, ALLOWED[method])


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize(("mixture", "spoil"), SPOILT)
def test_the_check_sees_a_wrong_mixture(renderer, mitsuba, mixture, light, method, spoil):
    spoilt = image_of(renderer, scene_of(spoil(MIXTURES[mixture]), light, method))
    found = agreement(spoilt, mitsuba(mixture_scene, QUICK, mixture, light))
    assert_wrong(found, method, mitsuba.is_scalar)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("mixture", MIXTURES)
def test_the_check_sees_bodies_that_do_not_shade_each_other(renderer, mitsuba, mixture, light, method):
    alone = (scene_of((body,), light, method) for body in MIXTURES[mixture])
    spoilt = sum(image_of(renderer, scene) for scene in alone)
    found = agreement(spoilt, mitsuba(mixture_scene, QUICK, mixture, light))
    assert_wrong(found, method, mitsuba.is_scalar)
