"""How later orders know of lobes: exact in what they keep, and near in what they leave out."""

import math

import numpy as np
import pytest
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.constants import BEYOND_ANGLES, BEYOND_DEPTHS, BEYOND_HALF, MOST_DEGREE
from tfm_cl.plan import lobes
from tfm_cl.scene.phases import parse_phase

WINDOWED = 2e-4
"""Per steradian, as the table's remainder fades out: by 1 % at degree 20, where little is left."""
QUADRATURE = 1e-5
"""Of Legendre moments, by midpoints in `tfm_cl.scene.phases.base.ANGLES` angles."""


def test_directions_integrate_products_of_harmonics():
    """Of all that are kept: energy, and every moment, is kept by the sum over directions."""
    ways, weights = lobes.quadrature()
    known = lobes.harmonics(ways, MOST_DEGREE)
    assert np.abs(np.linalg.norm(ways, axis=1) - 1).max() < ROUNDED
    assert np.abs((known.T * weights) @ known - np.eye(known.shape[1])).max() < ROUNDED


def test_harmonics_add_up_to_zonal_functions(rng):
    one, other = (way / np.linalg.norm(way, axis=1, keepdims=True) for way in rng.normal(size=(2, 20, 3)))
    moments = np.array([1, 0.7, 0.6, -0.2, 0.3])
    weights = np.repeat(moments, 2 * np.arange(MOST_DEGREE + 1) + 1)
    found = (lobes.harmonics(one, MOST_DEGREE) * weights * lobes.harmonics(other, MOST_DEGREE)).sum(axis=1)
    np.testing.assert_allclose(found, lobes.zonal(moments, (one * other).sum(axis=1)), atol=ROUNDED)


@pytest.mark.parametrize(
    ("phase", "degree", "straight"),
    [
        ("isotropic", 0, 0),
        ("kajiya-kay", 0, 0),
        ("rayleigh", 2, 0),
        ("hg:0.5", 2, 0.5**3),
        ("hg:-0.5", 2, 0),
        ("hg:0.55", 3, 0.55**4),
        ("hg:0.85", 4, 0.85**5),
    ],
)
def test_the_degree_follows_from_the_moments(phase, degree, straight):
    lobe = lobes.lobe_of(parse_phase(phase))
    assert lobe.degree == degree
    assert lobe.straight == pytest.approx(straight, abs=QUADRATURE)
    assert lobe.moments[0] == pytest.approx(1, abs=ROUNDED)


def test_moments_of_henyey_and_greenstein():
    found = tfm.HenyeyGreenstein(0.85).legendre_moments(40)
    np.testing.assert_allclose(found, 0.85 ** np.arange(40), atol=QUADRATURE)


def test_beyond_and_moments_make_the_whole(rng):
    """Of light that was scattered k times in a small angle, together they are a lobe of g^(k+1)."""
    g, count = 0.7, 4
    phase = tfm.HenyeyGreenstein(g)
    lobe = lobes.lobe_of(phase)
    table = lobes.beyond(phase, lobe, count)
    rows, columns = rng.integers(BEYOND_DEPTHS - 1, size=30), rng.integers(BEYOND_ANGLES, size=30)
    part, mu = rows / (BEYOND_DEPTHS - 1), 1 - 2 * (columns / (BEYOND_ANGLES - 1)) ** 4
    depth = BEYOND_HALF * part / (1 - part)
    expected = np.zeros(30)
    for k in range(1, count):
        chance = np.exp(-depth) * depth**k / math.factorial(k)
        seen = lobes.zonal(lobe.trusted * np.array(lobe.moments) ** (k + 1), mu)
        expected += chance * (tfm.HenyeyGreenstein(g ** (k + 1)).evaluate(mu) - seen)
    np.testing.assert_allclose(table[rows, columns], expected, atol=WINDOWED)
    assert not table[-1].any()


def test_what_turns_light_back_has_nothing_beyond():
    phase = tfm.HenyeyGreenstein(-0.6)
    assert not lobes.beyond(phase, lobes.lobe_of(phase), 5).any()
