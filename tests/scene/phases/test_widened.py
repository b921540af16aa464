"""Phase functions as light from a part of the sky shows them."""

import numpy as np
import pytest
from numpy.polynomial.legendre import legval

import tfm_cl as tfm
from tfm_cl.scene.phases.base import OVERLAP

ANGLES = np.linspace(0, np.pi, 200_001)
TABLE = 2e-3
"""Of the mean cosine and the integral: a table of 1024 values is linear between them."""
NARROW = tfm.Mie(diameter=20)


def over_the_sphere(values):
    return 2 * np.pi * float(np.trapezoid(values * np.sin(ANGLES), ANGLES))


@pytest.mark.parametrize("spread", [0.1, 0.35, 1.0])
@pytest.mark.parametrize("phase", [NARROW, tfm.HenyeyGreenstein(-0.6)], ids=lambda phase: phase.type)
def test_each_moment_is_that_of_a_gaussian_on_the_sphere(phase, spread):
    cosines, found = np.cos(ANGLES), phase.widened(spread)
    variance = OVERLAP * spread**2
    assert over_the_sphere(found.evaluate(cosines)) == pytest.approx(1, abs=TABLE)
    for order in (1, 2, 5):
        polynomial = legval(cosines, np.eye(order + 1)[order])
        before, after = (over_the_sphere(p.evaluate(cosines) * polynomial) for p in (phase, found))
        assert after == pytest.approx(before * np.exp(-order * (order + 1) * variance / 2), abs=TABLE)


def test_what_is_even_or_comes_from_one_direction_stays():
    assert NARROW.widened(0.0) is NARROW
    assert tfm.Isotropic().widened(1.0) == tfm.Isotropic()
    strands = tfm.KajiyaKay()
    assert strands.widened(0.5) is strands


def test_parts_of_the_sky_are_as_wide_as_they_are_large():
    parts = tfm.EnvironmentLight(samples=32).parts()
    radius = parts[0].spread
    assert 2 * np.pi * (1 - np.cos(radius)) == pytest.approx(4 * np.pi / 32)
    box = np.array([[-1.0, -1, -1], [1, 1, 1]])
    assert parts[0].fitted(box).replace(intensity=2).spread == radius
    *sky, sun = tfm.SkyLight(elevation=45, samples=16).parts()
    assert sun.spread == 0
    assert min(part.spread for part in sky) > radius
