"""Trigonometric moments: Carathéodory's problem on the circle. What they promise is in `test_moments`."""

import numpy as np
import pytest
from light_rays import exact, light_rays, scene_of, slabs, stored, transmittance
from tolerances import PASS

pytestmark = pytest.mark.lanes

COUNTS = (5, 7, 9)
SHARE = 0.375
BIAS = {2: 4e-7, 3: 8e-6, 4: 1.5e-5}
ZONE = 5 * np.pi / 4, 7 * np.pi / 4
"""Where on the circle the share of a node rises from 0 to 1."""
SOLVED = 5e-5
"""T by the Toeplitz matrix in float32: three times what rounding moves here; its least eigenvalues are some
1e-5."""
OUTSIDE = 1e-3
"""Of c_0: the bounds take nodes in the wrapping zone in part, and are no strict ones."""


def moments_of(depths, order):
    """∫ σ e^{imπv} dv of steps of constant density, [rays, order + 1], by the antiderivative."""
    edges = np.arange(depths.shape[1] + 1) / depths.shape[1]
    m = np.arange(1, order + 1)
    means = np.diff(np.exp(1j * np.pi * edges[:, None] * m), axis=0) / (1j * np.pi * m) * depths.shape[1]
    return np.concatenate([depths.sum(axis=1, keepdims=True), depths @ means], axis=1)


def as_numbers(moments):
    """As they are stored, [rays, 2 order + 1]."""
    parts = np.stack([moments[:, 1:].real, moments[:, 1:].imag], axis=-1)
    return np.concatenate([moments[:, :1].real, parts.reshape(len(moments), -1)], axis=1)


def canonical(moments, v):
    """Nodes' angles, their weights, and the weight of v itself; that of all is 1.

    By the moments' own equations, with complex numbers: roots of the kernel from the Toeplitz matrix, weights
    from Vandermonde's. Nothing is shared with the device's code.
    """
    order = len(moments) - 1
    b = moments / moments[0] * (1 - BIAS[order])
    b[0] = 1
    at = np.subtract.outer(np.arange(order + 1), np.arange(order + 1))
    toeplitz = np.where(at < 0, b[np.abs(at)].conj(), b[np.abs(at)])
    point = np.exp(1j * np.pi * v)
    kernel = np.linalg.solve(toeplitz, point ** np.arange(order + 1)).conj()
    nodes = np.concatenate([[point], np.roots(kernel[::-1])])
    weights = np.linalg.solve(np.vander(nodes, increasing=True).T, b)
    assert np.abs(nodes) == pytest.approx(1, abs=1e-6)
    assert np.abs(weights.imag).max() < 1e-6
    return np.angle(nodes[1:]) % (2 * np.pi), weights[1:].real, weights[0].real


def share(angles, v):
    """How much of a node counts as lying before v."""
    begin, end = ZONE
    first, last = np.sin((angles - begin) / 2), np.sin((end - angles) / 2)
    rising = np.clip(first / (first + last), 0, 1)
    return np.where((angles < np.pi * v) | (angles > end), 1.0, np.where(angles < begin, 0.0, rising))


def solved(moments, v):
    """What is before v, and the weight of v itself, of a ray at each v, [2, len(v)]; how many nodes are in
    the zone."""
    found, within = [], 0
    for at in v:
        angles, weights, own = canonical(moments, at)
        found.append((share(angles, at) @ weights, own))
        within += np.count_nonzero((angles > ZONE[0]) & (angles < ZONE[1]))
    return np.array(found).T, within


@pytest.mark.parametrize("coeffs", COUNTS)
def test_numbers_are_the_moments(renderer, coeffs):
    scene = scene_of(slabs(3), basis="trig-moments", coeffs=coeffs)
    rays = light_rays(scene)

    found = stored(renderer.build_maps(scene)[0], rays)

    expected = as_numbers(moments_of(rays.depths(scene.volume), coeffs // 2))
    assert np.abs(found - expected).max() <= 4 * PASS * expected.max()


@pytest.mark.parametrize("coeffs", COUNTS)
def test_device_solves_caratheodory_s_problem(renderer, coeffs):
    scene = scene_of(slabs(3), basis="trig-moments", coeffs=coeffs)
    rays, v = light_rays(scene), np.linspace(0, 1, 19)[1:-1]

    found = transmittance(renderer.build_maps(scene)[0], rays, v)

    depths = rays.depths(scene.volume)
    moments = moments_of(depths, coeffs // 2)
    each = [solved(of_ray, v) for of_ray in moments]
    before, own = np.array([of_ray for of_ray, _ in each]).transpose(1, 0, 2)
    total = depths.sum(axis=1, keepdims=True)
    expected = np.exp(-total * (before + SHARE * own))
    assert np.abs(found - expected).max() <= SOLVED
    # The bounds hold the truth.
    truth = -np.log(exact(depths, v)) / total
    assert (truth >= before - OUTSIDE).all()
    assert (truth <= before + own + OUTSIDE).all()
    assert expected.min() < 0.1
    assert own.mean() < 0.5
    assert sum(within for _, within in each) > 0  # of the nodes that count in part
