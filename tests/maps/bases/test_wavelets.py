"""Haar wavelets of the extinction: the space of an opacity shadow map, in another basis."""

import numpy as np
import pytest
from light_rays import light_rays, scene_of, slabs, transmittance
from tolerances import ROUNDED

pytestmark = pytest.mark.lanes

SAME = 1e-5
"""T of two maps of the same function: each is rounded in its own way."""
COUNTS = (1, 2, 8, 32)


@pytest.mark.parametrize("coeffs", [1, pytest.param(8, marks=pytest.mark.slow)])
def test_device_equals_the_model(check_series, coeffs):
    check_series(basis="wavelets", coeffs=coeffs)


@pytest.mark.parametrize("n", COUNTS)
def test_they_are_haar_s(plain_functions, n):
    # The mother wavelet, moved and scaled; the integrals' slopes between the points where they bend.
    edges = np.arange(2 * n + 1) / (2 * n)
    found = np.diff(plain_functions("wavelets", n).values(edges), axis=0) * 2 * n
    v = (edges[1:] + edges[:-1]) / 2

    def mother(x):
        return np.where((x >= 0) & (x < 0.5), 1.0, 0.0) - np.where((x >= 0.5) & (x < 1), 1.0, 0.0)

    expected = [np.ones(2 * n)]
    expected += [
        2 ** (level / 2) * mother(2**level * v - place)
        for level in range(int(np.log2(n)))
        for place in range(2**level)
    ]
    assert found == pytest.approx(np.stack(expected, axis=1), abs=ROUNDED)
    assert found.T @ found / (2 * n) == pytest.approx(np.eye(n), abs=ROUNDED)  # orthonormal


@pytest.mark.parametrize("n", COUNTS)
def test_they_span_what_is_piecewise_constant(plain_functions, rng, n):
    depths, v = rng.uniform(0, 1, (20, 37)) ** 4, np.linspace(0, 1, 77)
    wavelets, parts = (plain_functions(name, n) for name in ("wavelets", "piecewise"))

    found, expected = (
        depths @ functions.analysis(37) @ functions.values(v).T for functions in (wavelets, parts)
    )

    assert found == pytest.approx(expected, abs=100 * ROUNDED)


def test_what_lies_in_one_place_has_few_numbers(plain_functions):
    depths = np.zeros(64)
    depths[20] = 1

    numbers = depths @ plain_functions("wavelets", 32).analysis(64)

    assert np.count_nonzero(np.abs(numbers) > ROUNDED) == 6  # 1, and one for each of the 5 levels


def test_equal_piecewise_constant_extinction_on_the_device(renderer):
    scene = scene_of(slabs(8), basis="wavelets", coeffs=8)
    maps = [
        renderer.build_maps(scene.replace(map=scene.map.replace(basis=name)))[0]
        for name in ("wavelets", "piecewise")
    ]
    rays, v = light_rays(scene), np.linspace(0, 1, 60)[1:-1]

    found, expected = (transmittance(one, rays, v) for one in maps)

    assert np.abs(found - expected).max() <= SAME
    assert expected.min() < 0.5
