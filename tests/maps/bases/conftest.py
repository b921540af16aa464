"""The bases on the device, with one lane and with the device's, against float64 models."""

import numpy as np
import pytest
from light_rays import exact, light_rays, numbers, of_series, scene_of, slabs, stored, transmittance
from tolerances import FIT, PASS

from tfm_cl.maps.bases import BASES
from tfm_cl.maps.resolved import resolve
from tfm_cl.plan.maps import functions_of


@pytest.fixture
def check_series(renderer):
    """``check_series(basis=…, **settings)`` compares numbers and T of a map with the model; returns both and
    T."""

    def check(seed=3, **settings):
        scene = scene_of(slabs(seed), **settings)
        light_map = renderer.build_maps(scene)[0]
        resolved, functions = light_map.settings, light_map.functions
        rays = light_rays(scene)
        depths = rays.depths(scene.volume)
        v = np.linspace(0, 1, 23)[1:-1]
        model = numbers(functions, resolved, depths)
        said = of_series(functions, resolved, model, v)
        found = transmittance(light_map, rays, v)
        tolerance = PASS if resolved.fit == "l2" else FIT
        assert np.abs(found - said).max() <= 4 * tolerance
        if resolved.fit == "l2":
            scale = max(1, np.abs(model).max())
            assert np.abs(stored(light_map, rays) - model).max() <= 4 * PASS * scale
        assert np.ptp(said) > 0.4  # the medium is in the map
        return found, exact(depths, v)

    return check


@pytest.fixture
def plain_functions():
    """``plain_functions(basis, n, target)`` makes the functions that need no light rays."""

    def make(name, coeffs, target="auto"):
        from tfm_cl import MapSettings  # noqa: PLC0415

        return functions_of(resolve(MapSettings(basis=name, coeffs=coeffs, target=target)), None)

    return make


@pytest.fixture(params=sorted(BASES))
def any_basis(request):
    """Every basis in turn."""
    return BASES[request.param]
