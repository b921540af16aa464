"""Moment-based transparency: power moments, Hamburger's problem, and what both kinds of moments promise."""

import numpy as np
import pytest
from light_rays import STEPS, exact, light_rays, scene_of, slabs, stored, transmittance
from tolerances import FLOAT32, PASS

from tfm_cl.maps.bases.base import middles

pytestmark = pytest.mark.lanes

KINDS = [("moments", 5), ("moments", 7), *(("trig-moments", coeffs) for coeffs in (5, 7, 9))]
both_kinds = pytest.mark.parametrize(("basis", "coeffs"), KINDS)

SHARE = 0.4
BIAS = {4: 5e-7, 6: 5e-6}
BIASED = {4: np.array([1, 0, 0.375, 0, 0.375]), 6: np.array([1, 0, 0.48, 0, 0.451, 0, 0.45])}
"""Moments that the bias mixes in, of the supplement of Münstermann et al."""
SOLVED = 5e-5
"""T by Hankel's matrix in float32: ten times what rounding moves here; least eigenvalues are some 1e-4."""


def moments_of(depths):
    """∫ x^j σ dv of steps of constant density, x = 2v - 1, [rays, 7], by the binomial theorem about their
    middles."""
    x, h = 2 * middles(depths.shape[1]) - 1, 1 / depths.shape[1]
    mean = [
        x**0,
        x,
        x**2 + h**2 / 3,
        x**3 + x * h**2,
        x**4 + 2 * x**2 * h**2 + h**4 / 5,
        x**5 + 10 / 3 * x**3 * h**2 + x * h**4,
        x**6 + 5 * x**4 * h**2 + 3 * x**2 * h**4 + h**6 / 7,
    ]
    return depths @ np.array(mean).T


def canonical(moments, x, bias=True):
    """Parts of a distribution before x: the least, and the weight of x itself.

    By the moments' own equations: roots of det(H with a row (1, z …) beside (1, x …)), weights from
    Vandermonde's matrix. Nothing is shared with the kernel.
    """
    order = len(moments) // 2
    b = moments / moments[0]
    if bias:
        b = (1 - BIAS[2 * order]) * b + BIAS[2 * order] * BIASED[2 * order]
    hankel = np.array([[b[i + j] for j in range(order + 1)] for i in range(order + 1)])
    dual = np.linalg.solve(hankel, x ** np.arange(order + 1))
    nodes = np.concatenate([[x], np.roots(dual[::-1]).real])
    weights = np.linalg.solve(np.vander(nodes, increasing=True).T, b[: order + 1])
    return weights[1:][nodes[1:] < x].sum(), weights[0]


@pytest.mark.parametrize("coeffs", [5, 7])
def test_numbers_are_the_moments(renderer, coeffs):
    scene = scene_of(slabs(3), basis="moments", coeffs=coeffs)
    rays = light_rays(scene)

    found = stored(renderer.build_maps(scene)[0], rays)

    expected = moments_of(rays.depths(scene.volume))[:, :coeffs]
    assert np.abs(found - expected).max() <= 4 * PASS * expected.max()


@pytest.mark.parametrize("coeffs", [5, 7])
def test_device_solves_hamburger_s_problem(renderer, coeffs):
    scene = scene_of(slabs(3), basis="moments", coeffs=coeffs)
    rays, v = light_rays(scene), np.linspace(0, 1, 19)[1:-1]
    light_map = renderer.build_maps(scene)[0]

    found = transmittance(light_map, rays, v)

    depths = rays.depths(scene.volume)
    moments = moments_of(depths)[:, :coeffs]
    solved = np.array([[canonical(of_ray, 2 * at - 1) for at in v] for of_ray in moments])
    before = solved[..., 0] + SHARE * solved[..., 1]
    expected = np.exp(-moments[:, :1] * before)
    assert np.abs(found - expected).max() <= SOLVED
    # And the bounds hold the truth.
    truth = -np.log(exact(depths, v)) / moments[:, :1]
    assert (truth >= solved[..., 0] - 1e-4).all()
    assert (truth <= solved.sum(axis=-1) + 1e-4).all()
    assert expected.min() < 0.1
    assert solved[..., 1].mean() < 0.6


@both_kinds
def test_rises_with_depth_within_its_bounds(renderer, basis, coeffs):
    scene = scene_of(slabs(9), basis=basis, coeffs=coeffs)
    rays, v = light_rays(scene), np.linspace(0, 1, 120)[1:-1]

    found = transmittance(renderer.build_maps(scene)[0], rays, v)

    total = exact(rays.depths(scene.volume), np.array([1.0]))
    assert (np.diff(found, axis=1) <= PASS).all()
    assert found.max() <= 1
    assert (found >= total - PASS).all()


@pytest.mark.parametrize(("basis", "coeffs"), [kind for kind in KINDS if kind != ("moments", 7)])
def test_few_layers_are_told_apart(renderer, basis, coeffs):
    # Two thin sheets are two nodes: four power moments know them, or two trigonometric ones, but for their
    # thickness.
    density = np.zeros((64, 9, 9), np.float32)
    density[14], density[44] = 20, 40
    scene = scene_of(density, basis=basis, coeffs=coeffs, steps=64)
    rays = light_rays(scene)
    depths = rays.depths(scene.volume, 64)
    v = np.array([0.02, 0.15, 0.5, 0.85, 0.98])

    found = transmittance(renderer.build_maps(scene)[0], rays, v)

    assert np.abs(found - exact(depths, v)).max() < 5e-3
    assert np.ptp(exact(depths, v), axis=1).min() > 0.5


@pytest.mark.quick("f16-moments-7", "u8-trig-moments-9")
@both_kinds
@pytest.mark.parametrize("storage", ["f32", "f16", "u8"])
def test_whatever_the_density_it_is_a_number(renderer, basis, coeffs, storage):
    # A sheet, one column, next to nothing, and a great deal.
    density = np.zeros((16, 9, 9), np.float32)
    density[7, :4], density[:, 6, 6], density[3, 4:, :3], density[12:, 5:, :5] = 1e-3, 5, 1e-30, 1e6
    scene = scene_of(density, basis=basis, coeffs=coeffs, storage=storage)
    rays = light_rays(scene)

    found = transmittance(renderer.build_maps(scene)[0], rays, np.linspace(0, 1, STEPS + 2)[1:-1])

    assert np.isfinite(found).all()
    assert found.min() >= 0
    assert found.max() <= 1


@pytest.mark.parametrize(("basis", "coeffs"), [("moments", 7), ("trig-moments", 9)])
def test_no_density_is_clear(renderer, basis, coeffs):
    density = np.zeros((16, 9, 9), np.float32)
    density[:, :3] = density[:, :, :2] = 1
    scene = scene_of(density, basis=basis, coeffs=coeffs)
    rays = light_rays(scene)
    clear = rays.depths(scene.volume).sum(axis=1) == 0

    found = transmittance(renderer.build_maps(scene)[0], rays, [0.1, 0.5, 0.9])

    assert clear.any()
    # A centre's place, rounded, leaves a trace of the neighbours.
    assert found[clear] == pytest.approx(1, abs=4 * FLOAT32)
