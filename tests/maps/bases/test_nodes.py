"""Adaptive volumetric shadow maps: what is kept, and what is exact."""

import numpy as np
import pytest
from light_rays import exact, light_rays, scene_of, slabs, stored, transmittance
from tolerances import FLOAT32, PASS

from tfm_cl import MapSettings
from tfm_cl.errors import SceneError
from tfm_cl.maps.resolved import resolve

pytestmark = pytest.mark.lanes

DECIDED_ALIKE = 0.95
"""Part of the rays on which float32 and float64 take away the same nodes: near ties are decided by
rounding."""


def compressed(depths, count, lerp_t=False):
    """Nodes (v, τ) of one ray of steps, [count, 2]: Salvi's insertion and removal, from the description
    alone."""
    steps = len(depths)
    nodes = [(0.0, 0.0)]
    reached = 0.0

    def cost(i):
        (v0, t0), (v1, t1), (v2, t2) = nodes[i - 1 : i + 2]
        if lerp_t:
            t0, t1, t2 = np.exp([-t0, -t1, -t2])
            weight = 1.0
        else:
            weight = np.exp(-t1)
        between = t0 + (t2 - t0) * (v1 - v0) / (v2 - v0)
        return weight * abs(t1 - between) * (v2 - v0) / 2

    def insert(v, depth):
        nodes.append((v, depth))
        if len(nodes) > count + 1:
            del nodes[min(range(1, len(nodes) - 1), key=cost)]

    for k, depth in enumerate(depths):
        if depth > 0:
            if nodes[-1][0] < k / steps:
                insert(k / steps, reached)
            reached += depth
            insert((k + 1) / steps, reached)
    return np.array([(0.0, 0.0)] * (count + 1 - len(nodes)) + nodes[1:])


def between(nodes, v, lerp_t=False):
    """T at v of the nodes of one ray."""
    at = np.concatenate([[0], nodes[:, 0]])
    depth = np.concatenate([[0], nodes[:, 1]])
    if lerp_t:
        return np.interp(v, at, np.exp(-depth))
    return np.exp(-np.interp(v, at, depth))


@pytest.mark.parametrize(("basis", "coeffs"), [("nodes", 4), ("nodes", 10), ("nodes-t", 10)])
def test_device_equals_the_model(renderer, basis, coeffs):
    scene = scene_of(slabs(3), basis=basis, coeffs=coeffs)
    rays, v = light_rays(scene), np.linspace(0, 1, 40)[1:-1]
    light_map = renderer.build_maps(scene)[0]

    nodes, found = stored(light_map, rays), transmittance(light_map, rays, v)

    lerp_t = basis == "nodes-t"
    models = [compressed(ray, coeffs // 2, lerp_t) for ray in rays.depths(scene.volume)]
    expected = np.array([between(model, v, lerp_t) for model in models])
    scale = max(model.max() for model in models)
    same_nodes = np.abs(nodes - np.reshape(models, nodes.shape)).max(axis=1) <= 4 * PASS * scale
    assert same_nodes.mean() >= DECIDED_ALIKE
    assert (np.abs(found - expected).max(axis=1) <= 4 * PASS)[same_nodes].all()
    assert expected.min() < 0.1
    assert np.ptp(nodes[:, 0]) > 0.01  # of each ray's own


def test_enough_nodes_are_exact(renderer):
    # 14 steps at most, two gaps: 16 nodes hold the line as it is.
    scene = scene_of(slabs(5), basis="nodes", coeffs=32, steps=14)
    rays, v = light_rays(scene), np.linspace(0, 1, 90)[1:-1]

    found = transmittance(renderer.build_maps(scene)[0], rays, v)

    assert np.abs(found - exact(rays.depths(scene.volume, 14), v)).max() <= 4 * PASS


@pytest.mark.parametrize("basis", ["nodes", "nodes-t"])
def test_nodes_are_in_order_and_end_with_all_of_the_depth(renderer, basis):
    scene = scene_of(slabs(6), basis=basis, coeffs=12)
    rays = light_rays(scene)
    light_map = renderer.build_maps(scene)[0]

    nodes = stored(light_map, rays)

    total = rays.depths(scene.volume).sum(axis=1)
    assert (np.diff(nodes[:, ::2], axis=1) >= 0).all()
    assert (np.diff(nodes[:, 1::2], axis=1) >= 0).all()
    assert nodes[:, -1] == pytest.approx(total, rel=4 * PASS)
    found = transmittance(light_map, rays, [0.001, 0.999])
    assert (found[:, 0] > 0.9).all()
    assert found[:, 1] == pytest.approx(np.exp(-total), abs=0.01)


def test_a_slab_s_edges_stay_sharp(renderer):
    # Even density between two gaps, with a fade of a voxel at either face, is three straight pieces.
    density = np.zeros((40, 9, 9), np.float32)
    density[13:27] = 3
    scene = scene_of(density, basis="nodes", coeffs=16, steps=42)
    rays, v = light_rays(scene), np.linspace(0, 1, 200)[1:-1]

    found = transmittance(renderer.build_maps(scene)[0], rays, v)

    truth = exact(rays.depths(scene.volume, 42), v)
    assert np.abs(found - truth).max() <= 4 * PASS
    assert truth.min() < 0.2


def test_empty_texels_are_clear(renderer):
    density = np.zeros((16, 9, 9), np.float32)
    density[:, :3] = density[:, :, :2] = 1
    scene = scene_of(density, basis="nodes", coeffs=8)
    rays = light_rays(scene)
    clear = rays.depths(scene.volume).sum(axis=1) == 0
    light_map = renderer.build_maps(scene)[0]

    found = transmittance(light_map, rays, [0.1, 0.5, 0.9])

    assert clear.any()
    # A centre's place, rounded, leaves a trace of the neighbours.
    assert found[clear] == pytest.approx(1, abs=4 * FLOAT32)
    assert (stored(light_map, rays)[clear] == 0).all()


@pytest.mark.slow
def test_any_density_and_storage_is_a_number(renderer):
    density = np.zeros((16, 9, 9), np.float32)
    density[7, :4], density[:, 6, 6], density[3, 4:, :3], density[12:, 5:, :5] = 1e-3, 5, 1e-30, 1e20
    for basis, storage in (("nodes", "u8"), ("nodes-t", "f16")):
        scene = scene_of(density, basis=basis, coeffs=6, storage=storage)
        found = transmittance(renderer.build_maps(scene)[0], light_rays(scene), np.linspace(0, 1, 40))
        assert np.isfinite(found).all()
        assert found.min() >= 0
        assert found.max() <= 1


def test_numbers_are_not_interpolated():
    assert resolve(MapSettings(basis="nodes")).lookup == "reconstruct"
    with pytest.raises(SceneError, match="lookup = 'interpolate': the coefficients of basis 'nodes'"):
        MapSettings(basis="nodes", lookup="interpolate")
    with pytest.raises(SceneError, match="coeffs = 7: basis 'nodes'"):
        MapSettings(basis="nodes", coeffs=7)
