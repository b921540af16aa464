"""Orders of scattering against Mitsuba's volumetric path tracer, which follows as many."""

from functools import partial

import numpy as np
import pytest
from oracles.mitsuba_agreement import agreement, image_of, mitsuba_batches, write_report
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.plan import orders

SAMPLES = 128
"""Per pixel and batch."""
BIAS = 1e-2
"""Of the mean: measured up to 0.7 % with 16 orders, besides Mitsuba's own 0.2 %."""
RMS = 4e-2
"""Root mean square over all pixels, noise taken out: measured up to 2.5 %, of small lumps."""
BIAS_OF_LOBE = 5e-2
"""Of a lobe, of which a few moments are known: measured up to 2.1 %, of 8 orders at 0.85."""
RMS_OF_LOBE = 15e-2
"""Of all pixels, relative to the mean of a picture most of which is black: measured 12 %."""


def scene_of(count, phase="isotropic"):
    volume = tfm.Volume(
        blobs((30, 28, 32)), voxel_size=2.4 / 32, origin=(-1.2, -1.1, -1.2), density_scale=4.0
    )
    light = tfm.SpotLight(from_=(2.2, 3, 1.2), to=(0, 0, 0), cone=25, intensity=20, falloff="inverse-square")
    return tfm.Scene(
        volume,
        tfm.Medium(phase=phase, orders=count),
        camera=tfm.Camera(from_=(0.6, 0.8, 5), to=(0, 0, 0), fov=30, res=(24, 18)),
        lights=[light],
        map=tfm.MapSettings(coeffs=24, res=256, steps=200),
        march=tfm.MarchSettings(steps=200),
    )


FLOOR_BIAS, FLOOR_RMS = 2e-2, 3e-2
"""Of an even fog over a floor: measured 0.4 % and 0.9 %."""
FLOOR_BIAS_OF_LOBE = 3e-2
"""Of one with a lobe: measured 1.9 %."""


def over_floor(count, phase="isotropic"):
    """A thin fog that reaches below a white floor, which a spot lights; seen from the side."""
    light = tfm.SpotLight(from_=(0.3, 3, 0.2), to=(0, 0, 0), cone=12, intensity=20, falloff="inverse-square")
    return tfm.Scene(
        tfm.BoxVolume(from_=(-1, -0.06, -1), to=(1, 1, 1), density=0.4),
        tfm.Medium(phase=phase, orders=count),
        camera=tfm.Camera(from_=(0, 0.6, 6), to=(0, 0.6, 0), fov=8, res=(24, 18)),
        lights=[light],
        solids=[tfm.PlaneSolid(point=(0, 0, 0), albedo=1.0)],
        map=tfm.MapSettings(coeffs=24, res=256, steps=200),
        march=tfm.MarchSettings(steps=200),
    )


@pytest.fixture(scope="module")
def mitsuba():
    with mitsuba_batches() as batches:
        yield batches


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4, 16])
def test_orders(renderer, mitsuba, tmp_path, count):
    expected, image = mitsuba(scene_of, SAMPLES, count), image_of(renderer, scene_of(count))
    found = agreement(image, expected)
    report = partial(write_report, tmp_path)
    assert np.abs(found.bias).max() < BIAS + 3 * found.standard_error.max(), report(found, image, expected)
    assert found.rms.max() < RMS, report(found, image, expected)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "phase"), [(2, "hg:0.5"), (8, "hg:0.85"), (64, "hg:0.5")])
def test_orders_of_a_lobe(renderer, mitsuba, tmp_path, count, phase):
    expected = mitsuba(scene_of, SAMPLES, count, phase)
    image = image_of(renderer, scene_of(count, phase))
    found = agreement(image, expected)
    report = partial(write_report, tmp_path)
    assert np.abs(found.bias).max() < BIAS_OF_LOBE + 3 * found.standard_error.max(), report(
        found, image, expected
    )
    assert found.rms.max() < RMS_OF_LOBE, report(found, image, expected)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "phase"), [(8, "isotropic"), (4, "hg:0.5")])
def test_light_that_a_floor_reflects(renderer, mitsuba, tmp_path, monkeypatch, count, phase):
    """A quarter of the light in the fog comes from the floor, and more by later orders."""
    monkeypatch.setattr(orders, "OF_SMALLEST_BODY", 1 / 24)
    expected = mitsuba(over_floor, SAMPLES // 2, count, phase)
    image = image_of(renderer, over_floor(count, phase))
    found = agreement(image, expected)
    report = partial(write_report, tmp_path)
    bias, rms = (FLOOR_BIAS, FLOOR_RMS) if phase == "isotropic" else (FLOOR_BIAS_OF_LOBE, RMS_OF_LOBE)
    assert np.abs(found.bias).max() < bias + 3 * found.standard_error.max(), report(found, image, expected)
    assert found.rms.max() < rms, report(found, image, expected)
    dark = over_floor(count, phase)
    dark = dark.replace(solids=[dark.solids[0].replace(albedo=0.0)])
    assert image_of(renderer, dark).mean() < 0.8 * image.mean()
