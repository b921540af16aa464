"""Fourier opacity maps: eq. 1 to 6 of their paper."""

import numpy as np
import pytest
from tolerances import ROUNDED

from tfm_cl import MapSettings
from tfm_cl.errors import SceneError

pytestmark = pytest.mark.lanes

RNG = np.random.default_rng(5)


@pytest.mark.parametrize(
    "settings",
    [
        {"coeffs": 7},
        {"coeffs": 31},
        {"coeffs": 5, "target": "transmittance", "density_weighting": 3.0},
        {"coeffs": 7, "fit": "visibility"},
    ],
    ids=str,
)
def test_device_equals_the_model(check_series, settings):
    check_series(basis="fourier", **settings)


def test_numbers_of_a_thin_primitive_are_eq_5_and_6(plain_functions):
    steps, at = 100_000, 31_459
    depth, d = 0.7, (at + 0.5) / steps

    row = depth * plain_functions("fourier", 7).analysis(steps)[at]

    k = np.arange(1, 4)
    assert row[0] == pytest.approx(depth, abs=ROUNDED)  # a_0 / 2
    assert row[1::2] == pytest.approx(2 * depth * np.cos(2 * np.pi * k * d), abs=1e-8)
    assert row[2::2] == pytest.approx(2 * depth * np.sin(2 * np.pi * k * d), abs=1e-8)


def test_functions_are_the_integrals_of_eq_3(plain_functions):
    v = (np.arange(20_000) + 0.5) / 20_000
    k = np.array([1, 1, 2, 2, 3, 3])
    waves = np.where(
        np.arange(6) % 2 == 0, np.cos(2 * np.pi * np.outer(v, k)), np.sin(2 * np.pi * np.outer(v, k))
    )
    integrals = np.cumsum(waves, axis=0) / 20_000

    values = plain_functions("fourier", 7).values(v + 0.5 / 20_000)

    assert np.abs(values[:, 1:] - integrals).max() < 1e-8
    assert values[:, 0] == pytest.approx(v + 0.5 / 20_000)


@pytest.mark.parametrize("coeffs", [1, 3, 15, 31])
@pytest.mark.parametrize("steps", [5, 13, 64])
def test_both_ends_are_exact_for_any_count(plain_functions, coeffs, steps):
    # Also where there are more functions than steps.
    functions = plain_functions("fourier", coeffs)
    depths = RNG.uniform(0, 1, steps)

    begin, end = functions.values(np.array([0.0, 1.0])) @ (depths @ functions.analysis(steps))

    assert abs(begin) < ROUNDED
    assert end == pytest.approx(depths.sum(), rel=ROUNDED)


def test_a_homogeneous_medium_needs_one_number(plain_functions):
    numbers = np.full(24, 0.1) @ plain_functions("fourier", 9).analysis(24)

    assert numbers == pytest.approx([2.4, *[0] * 8], abs=ROUNDED)


def test_a_density_of_its_own_kind_is_exact(plain_functions):
    steps, functions = 4000, plain_functions("fourier", 5)
    edges = np.arange(steps + 1) / steps
    depth = 2 * edges + 0.3 * np.sin(2 * np.pi * edges) / np.pi + 0.2 * (1 - np.cos(4 * np.pi * edges))

    numbers = np.diff(depth) @ functions.analysis(steps)

    # σ = 2 + 0.6 cos 2πv + 0.8 π sin 4πv, but for steps of constant density
    assert numbers == pytest.approx([2, 0.6, 0, 0, 0.8 * np.pi], abs=1e-5)
    assert functions.values(edges) @ numbers == pytest.approx(depth, abs=1e-5)


def test_turning_the_ray_round_mirrors_the_waves(plain_functions):
    analysis = plain_functions("fourier", 9).analysis(40)
    depths = RNG.uniform(0, 1, 40)

    there, back = depths @ analysis, depths[::-1] @ analysis

    assert back[1::2] == pytest.approx(there[1::2], abs=ROUNDED)
    assert back[2::2] == pytest.approx(-there[2::2], abs=ROUNDED)


def test_counts_are_odd():
    with pytest.raises(SceneError, match="coeffs = 8: basis 'fourier'"):
        MapSettings(basis="fourier", coeffs=8)
