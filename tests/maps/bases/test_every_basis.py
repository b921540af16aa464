"""What all bases promise alike."""

import numpy as np
import pytest
from light_rays import exact, light_rays, scene_of, slabs, stored, transmittance
from tolerances import FIT, LANES, PASS

import tfm_cl as tfm
from tfm_cl.maps.bases import BASES

pytestmark = pytest.mark.lanes

LINEAR = ["fourier", "hcos", "moments", "piecewise", "slices", "slices-cubic", "trig-moments", "wavelets"]
"""Bases whose default numbers are linear in the density."""


@pytest.mark.quick("fourier", "moments", "slices")
@pytest.mark.parametrize("basis", LINEAR)
def test_numbers_of_two_media_add_up(renderer, basis):
    # In any order: what is before and what is behind is not known (FOM section 4.1, OSM note 4).
    one, other = slabs(11), slabs(12)[::-1]
    maps = [
        renderer.build_maps(
            scene_of(density, basis=basis, coeffs=8 if basis == "wavelets" else 7, range="box")
        )[0]
        for density in (one, other, one + other)
    ]
    rays = light_rays(scene_of(one))

    of_one, of_other, of_both = (stored(light_map, rays).astype(float) for light_map in maps)

    assert np.abs(of_one + of_other - of_both).max() <= 4 * PASS * np.abs(of_both).max()
    assert np.abs(of_one - of_other).max() > 0.1


@pytest.mark.quick("fourier", "klt", "moments", "slices")
def test_begin_and_far_end(renderer, any_basis):
    coeffs = 7 if 7 in any_basis.counts else 8
    scene = scene_of(slabs(13), basis=any_basis.name, coeffs=coeffs, range="auto")
    rays = light_rays(scene)
    light_map = renderer.build_maps(scene)[0]

    found = transmittance(light_map, rays, [-0.5, 0.0, 1.0, 1.5])

    # Before and behind the medium nothing changes, and all of it holds the light back.
    truth = exact(rays.depths(scene.volume, 400), np.array([1.0]))
    if any_basis.name != "dct":  # which rings at both ends, and α powers that up
        assert (found[:, 0] == 1).all()
    assert np.abs(found[:, 3] - found[:, 2]).max() <= 1e-3
    assert np.abs(found[:, 2:] - truth).max() < 0.1
    assert np.isfinite(found).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(BASES))
def test_lanes_give_the_same_map(device_name, name):
    basis = BASES[name]
    coeffs = 7 if 7 in basis.counts else 8
    scene = scene_of(slabs(14), basis=name, coeffs=coeffs, range="auto")
    rays, v = light_rays(scene), np.linspace(0, 1, 30)
    found = []
    for lanes in (1, None):
        with tfm.Renderer(device_name, build_options=("-Werror",), lanes=lanes) as renderer:
            found.append(transmittance(renderer.build_maps(scene)[0], rays, v))

    fitted = basis.defaults.fit == "visibility"
    assert np.abs(found[0] - found[1]).max() <= (2 * FIT if fitted else 4 * LANES)
