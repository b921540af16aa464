"""Legendre polynomials of each target."""

import numpy as np
import pytest
from tolerances import ROUNDED

pytestmark = pytest.mark.lanes

RNG = np.random.default_rng(6)


@pytest.mark.parametrize(
    "settings",
    [
        {"coeffs": 6},
        {"coeffs": 16, "target": "extinction", "fit": "l2"},
        {"coeffs": 1, "target": "extinction", "fit": "l2"},
        {"coeffs": 6, "target": "transmittance", "fit": "l2", "density_weighting": 3.0},
    ],
    ids=str,
)
def test_device_equals_the_model(check_series, settings):
    check_series(basis="legendre", **settings)


def test_polynomials_are_those_of_the_book(plain_functions):
    v = np.linspace(0, 1, 11)
    x = 2 * v - 1

    values = plain_functions("legendre", 5, "optical-depth").values(v)

    expected = [1 + 0 * x, x, (3 * x**2 - 1) / 2, (5 * x**3 - 3 * x) / 2, (35 * x**4 - 30 * x**2 + 3) / 8]
    assert values == pytest.approx(np.array(expected).T, abs=ROUNDED)


def test_integrals_are_those_of_the_polynomials(plain_functions):
    edges = np.arange(20_001) / 20_000
    polynomials = plain_functions("legendre", 8, "optical-depth").values((edges[1:] + edges[:-1]) / 2)

    integrals = plain_functions("legendre", 8, "extinction").values(edges)

    assert np.abs(integrals[0]).max() < ROUNDED
    assert np.abs(integrals[1:] - np.cumsum(polynomials, axis=0) / 20_000).max() < 1e-7


@pytest.mark.parametrize("coeffs", [1, 2, 9, 16])
@pytest.mark.parametrize("steps", [5, 64])
def test_both_ends_of_the_extinction_s_series_are_exact(plain_functions, coeffs, steps):
    functions = plain_functions("legendre", coeffs, "extinction")
    depths = RNG.uniform(0, 1, steps)

    begin, end = functions.values(np.array([0.0, 1.0])) @ (depths @ functions.analysis(steps))

    assert abs(begin) < 1e-12
    assert end == pytest.approx(depths.sum(), rel=1e-12)


def test_a_polynomial_optical_depth_is_exact(plain_functions):
    # Of degree 4, five polynomials; its extinction has degree 3.
    v = (np.arange(50) + 0.5) / 50
    functions = plain_functions("legendre", 5, "optical-depth")

    numbers = (v + 2 * v**4) @ functions.analysis(50)

    at = np.linspace(0, 1, 9)
    assert functions.values(at) @ numbers == pytest.approx(at + 2 * at**4, abs=ROUNDED)


def test_a_homogeneous_medium_needs_one_number(plain_functions):
    numbers = np.full(24, 0.1) @ plain_functions("legendre", 9, "extinction").analysis(24)

    assert numbers == pytest.approx([2.4, *[0] * 8], abs=ROUNDED)
