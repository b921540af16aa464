"""A diffuse sphere before, within and behind a cloud, against Mitsuba 3.

As in `test_mitsuba`, what is left is Mitsuba's Monte Carlo noise, known from independent batches. The pixels
that show the sphere and those that show the medium alone are judged apart: the first hold direct light that
the medium dims twice, the second the sphere's shadow in the medium.
"""

import logging
from functools import cache

import numpy as np
import pytest
from oracles.mitsuba_scene import MitsubaScene, mitsuba_variant, write_exr
from scenes import blobs, turned

import tfm_cl as tfm
from tfm_cl.scene.lights import PointLight, SunLight
from tfm_cl.scene.settings import ShadowSettings
from tfm_cl.scene.solids import SphereSolid

LOG = logging.getLogger(__name__)
STEPS = 400
BATCHES = 16
QUICK, SLOW = 96, 640
"""Samples per pixel and batch."""
SCALAR_SHARE = 8
"""The scalar variant takes so many times fewer samples."""

# All are parts of a channel's mean over the pixels concerned.
OF_THE_MEDIUM = 1e-2
OF_THE_SPHERE = 2e-2
NOISE = 3.0
"""Standard errors beyond which a mean is wrong."""
STANDARD_ERROR = {QUICK: 1.2e-2, SLOW: 5e-3}
"""Most that a mean's standard error may be, for the test to say something."""
SYSTEMATIC = 2e-3
"""Bias of a mean beyond noise, asked of the larger budget: the shadow map's texels, and Mitsuba's float32."""
FLOOR = 2e-2
"""Of the mean, added to a pixel's standard error; few samples tell little of their own spread."""
OUTLIERS = 0.03
"""Share of the pixels beyond four such errors: single samples are skewed, and a ray at the sphere's rim may
meet it in one renderer only."""

MEDIUM = tfm.Medium(sigma_s=(1.0, 0.8, 0.5), sigma_a=(0.1, 0.5, 0.9), phase=tfm.HenyeyGreenstein(0.4))
ALBEDO = (0.9, 0.6, 0.3)
SPHERES = {
    "before": SphereSolid(centre=(0.3, 0.35, 1.5), radius=0.28, albedo=ALBEDO),
    "within": SphereSolid(centre=(0.05, 0.15, 0.2), radius=0.35, albedo=ALBEDO),
    "behind": SphereSolid(centre=(-0.35, -0.5, -1.2), radius=0.5, albedo=ALBEDO),
}
FROM = (2.2, 3.0, 2.2)
LIGHTS = {
    "spot": tfm.SpotLight(
        from_=FROM, to=(0, 0, 0), cone=22, intensity=(30, 25, 20), falloff="inverse-square"
    ),
    "point": PointLight(from_=FROM, intensity=(30, 25, 20), falloff="inverse-square"),
    "sun": SunLight(from_=FROM, to=(0, 0, 0), intensity=(3, 2.5, 2)),
}


def scene_of(sphere, light, **changes):
    placed = turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9))
    scene = tfm.Scene(
        tfm.Volume(blobs(), world_from_index=placed, density_scale=2.5),
        MEDIUM,
        camera=tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=30, res=(24, 18)),
        lights=[LIGHTS[light]],
        map=tfm.MapSettings(steps=STEPS),
        march=tfm.MarchSettings(method="dual", steps=STEPS),
        solids=[SPHERES[sphere]],
        shadow=ShadowSettings(res=2048),
    )
    return scene.replace(**changes)


@pytest.fixture(scope="module")
def mitsuba():
    """Batches of a scene by Mitsuba, ``[batches, height, width, RGB]``; each rendered once."""
    with mitsuba_variant() as variant:

        @cache
        def batches(sphere, light, samples):
            samples = samples if "llvm" in variant else samples // SCALAR_SHARE
            return MitsubaScene(scene_of(sphere, light)).batches(BATCHES, samples, seed=1)

        batches.is_scalar = variant.startswith("scalar")
        yield batches


def failures(result, batches, samples, scalar=False):
    """Say what differs from independent estimates; ``pytest --log-cli-level=INFO`` shows the figures."""
    image, shown = result.image[..., :3].astype(np.float64), result.aovs["normal"].any(axis=-1)
    mean, error = batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(BATCHES)
    found = []
    for name, pixels, limit in (
        ("sphere", shown, OF_THE_SPHERE),
        ("medium", ~shown, OF_THE_MEDIUM),
    ):
        totals = batches[:, pixels].mean(axis=1)
        level = totals.mean(axis=0)
        bias = image[pixels].mean(axis=0) / level - 1
        noise = totals.std(axis=0, ddof=1) / np.sqrt(BATCHES) / level
        z = (image - mean)[pixels] / (error[pixels] + FLOOR * level)
        outliers = float((np.abs(z) > 4).mean())
        LOG.info("%s: bias %s, standard error %s, outliers %.3f", name, bias, noise, outliers)
        allowed = NOISE * noise + SYSTEMATIC
        if (np.abs(bias) > (np.minimum(allowed, limit) if samples == SLOW else limit)).any():
            found.append(f"{name}: bias {bias}, standard error {noise}")
        if (noise > STANDARD_ERROR[samples]).any() and not scalar:
            found.append(f"{name}: standard error {noise} says nothing")
        if outliers > OUTLIERS:
            found.append(f"{name}: {outliers:.3f} of the pixels are beyond four standard errors")
    return found


CASES = [
    pytest.param("within", "sun", QUICK, id="within, sun"),
    *(
        pytest.param(sphere, light, SLOW, id=f"{sphere}, {light}, more", marks=pytest.mark.slow)
        for sphere in SPHERES
        for light in LIGHTS
    ),
]


@pytest.mark.parametrize(("sphere", "light", "samples"), CASES)
def test_dual_march(renderer, mitsuba, tmp_path, sphere, light, samples):
    expected, result = mitsuba(sphere, light, samples), renderer.render(scene_of(sphere, light))

    shown = result.aovs["normal"].any(axis=-1)
    assert shown.sum() > 15
    assert result.image[shown][:, 0].max() > 0.05
    wrong = failures(result, expected, samples, mitsuba.is_scalar)
    if wrong:
        write_exr(tmp_path / "ours.exr", result.image[..., :3])
        write_exr(tmp_path / "mitsuba.exr", expected.mean(axis=0))
    assert not wrong, f"{wrong}; see ours.exr, mitsuba.exr in {tmp_path}"


@pytest.mark.parametrize("spoil", ["a denser medium", "a brighter sphere"])
def test_the_check_sees_a_wrong_scene(renderer, mitsuba, spoil):
    scene = scene_of("within", "sun")
    if spoil == "a denser medium":
        wrong = scene.replace(volume=scene.volume.with_density_scale(1.05 * scene.volume.density_scale))
    else:
        wrong = scene.replace(solids=[SPHERES["within"].replace(albedo=tuple(1.05 * np.array(ALBEDO)))])

    expected = mitsuba("within", "sun", QUICK)
    found = failures(renderer.render(wrong), expected, QUICK, mitsuba.is_scalar)
    assert any("bias" in line for line in found), found
