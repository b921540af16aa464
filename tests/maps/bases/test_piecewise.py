"""Piecewise constant extinction: FOM section 5.1, which is an opacity shadow map."""

import numpy as np
import pytest
from light_rays import light_rays, scene_of, slabs, stored, transmittance
from tolerances import PASS, ROUNDED

pytestmark = pytest.mark.lanes

SAME = 1e-5
"""T of two maps of the same function: each is rounded in its own way."""


@pytest.mark.parametrize("settings", [{"coeffs": 1}, {"coeffs": 10}], ids=str)
def test_device_equals_the_model(check_series, settings):
    check_series(basis="piecewise", **settings)


def test_functions_are_the_paper_s(plain_functions):
    # f_k = H(z - k/n) - H(z - (k+1)/n), g_k as section 5.1 writes it.
    n, z = 10, np.linspace(0, 1, 201)
    k = np.arange(n)

    values = plain_functions("piecewise", n).values(z)

    def ramp(x):
        return x * (x > 0)

    assert values == pytest.approx(
        n * (ramp(z[:, None] - k / n) - ramp(z[:, None] - (k + 1) / n)), abs=ROUNDED
    )


@pytest.mark.parametrize(("coeffs", "steps"), [(1, 7), (6, 40), (16, 10), (32, 13)])
def test_equals_uniform_slices(plain_functions, rng, coeffs, steps):
    depths, v = rng.uniform(0, 1, (20, steps)) ** 4, np.linspace(0, 1, 77)
    parts, slices = plain_functions("piecewise", coeffs), plain_functions("slices", coeffs)

    of_parts, of_slices = depths @ parts.analysis(steps), depths @ slices.analysis(steps)

    assert of_parts.cumsum(axis=1) == pytest.approx(of_slices, abs=ROUNDED)
    assert of_parts @ parts.values(v).T == pytest.approx(of_slices @ slices.values(v).T, abs=ROUNDED)


def test_equals_uniform_slices_on_the_device(renderer):
    scene = scene_of(slabs(8), basis="piecewise", coeffs=10)
    parts = renderer.build_maps(scene)[0]
    slices = renderer.build_maps(scene.replace(map=scene.map.replace(basis="slices")))[0]
    rays, v = light_rays(scene), np.linspace(0, 1, 60)[1:-1]

    assert np.abs(transmittance(parts, rays, v) - transmittance(slices, rays, v)).max() <= SAME
    summed = stored(parts, rays).cumsum(axis=1)
    assert np.abs(summed - stored(slices, rays)).max() <= 4 * PASS * summed.max()


def test_ends_of_parts_are_exact(plain_functions, rng):
    # 40 steps, 8 parts: parts end where steps do.
    depths = rng.uniform(0, 1, 40)
    functions = plain_functions("piecewise", 8)

    found = functions.values(np.arange(9) / 8) @ (depths @ functions.analysis(40))

    assert found == pytest.approx([0, *depths.cumsum()[4::5]], abs=ROUNDED)
