"""The filter that fits deep samples: its guarantees, on curves of any shape."""

import math

import numpy as np
import pytest
from tolerances import ROUNDED

from tfm_cl.reference.deep import KEPT, MOST, WHOLE, Curve, fit


def curve_of(distance, depth, solid=math.inf):
    return Curve(np.asarray(distance, float), np.asarray(depth, float), solid)


def left(samples, z):
    through = np.ones_like(z)
    for front, back, alpha in samples:
        through *= (1 - alpha) ** np.clip((z - front) / (back - front), 0, 1)
    return through


def test_constant_extinction_is_one_sample():
    z = np.linspace(1, 3, 40)
    ((front, back, alpha),) = fit(curve_of(z, 0.7 * (z - 1)), 1e-3, math.inf)
    assert (front, back) == (1, 3)
    assert alpha == pytest.approx(-math.expm1(-1.4), rel=ROUNDED)


@pytest.mark.parametrize("tolerance", [0.1, 0.01, 1e-3])
@pytest.mark.parametrize("seed", range(20))
def test_any_curve_is_followed_to_the_tolerance(seed, tolerance):
    rng = np.random.default_rng(seed)
    steps = rng.exponential(rng.choice([0.01, 0.2, 2]), 60) * (rng.random(60) > 0.5)
    z = 1 + np.concatenate([[0], rng.uniform(0.05, 1, 60).cumsum()])
    depth = np.minimum(np.concatenate([[0], steps.cumsum()]), MOST)
    curve = curve_of(z, depth)
    samples = [*fit(curve, tolerance, math.inf)]
    at = np.linspace(0, z[-1], 5001)
    above = left(samples, at) - curve.transmittance(at)
    assert above.max() < tolerance
    assert above.min() > -WHOLE  # never deeper, but for what a whole ray may be off
    assert abs(above[-1]) < WHOLE
    assert len(samples) < 3 + 2 / (KEPT * tolerance)


def test_what_the_march_leaves_counts_as_nothing_and_solids_end_a_ray():
    z = np.linspace(0, 4, 50)
    *_, last, solid = fit(curve_of(z, 3 * z, solid=4.5), 0.01, cutoff=9.0)
    assert last[1] == 4
    assert solid == (4.5, 4.5, 1.0)
    assert [*fit(curve_of([], []), 0.01, 9.0)] == []
