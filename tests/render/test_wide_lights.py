"""A map is as good whatever the light's cone: it is fitted to what the light meets."""

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm

pytestmark = pytest.mark.lanes

FROM = (2.2, 3.0, 1.2)
NEAR, WITHIN = (-0.4, 1.25, 0.3), (0.15, 0.1, 0.2)
LIGHTS = {
    **{f"spot {cone}": tfm.SpotLight(from_=FROM, to=(0, 0, 0), cone=cone) for cone in (60.0, 89.0, 89.9)},
    "spot 89.9 that looks past": tfm.SpotLight(from_=FROM, to=(3, 1, -2), cone=89.9),
    "spot 80 near": tfm.SpotLight(from_=NEAR, to=(0, 0, 0), cone=80.0),
    "spot 89 within": tfm.SpotLight(from_=WITHIN, to=(1, -1, 0.5), cone=89.0),
    "point": tfm.PointLight(from_=FROM),
    "point near": tfm.PointLight(from_=NEAR),
    "point within": tfm.PointLight(from_=WITHIN),
    "sun": tfm.SunLight(from_=FROM, to=(0, 0, 0)),
}
AS_GOOD = 1.5
"""The error of a map over that of a cone that just holds the medium, which is 40° across from afar. Near or
within the medium as many texels show 120° to all around; measured 0.8 to 1.3."""


def scene_of(light, **of_map):
    return tfm.Scene(
        tfm.Volume(blobs((20, 22, 24)), voxel_size=0.1, origin=(-1.2, -1.1, -1.0), density_scale=12.0),
        camera=tfm.Camera(from_=(0.6, 0.8, 5), to=(0, 0, 0), fov=32, res=(48, 40)),
        lights=[light],
        map=tfm.MapSettings(**{"res": 128, "steps": 100, "coeffs": 16, **of_map}),
    )


def error(renderer, scene):
    """RMSE over the lit pixels, relative to their mean."""
    image, dual = renderer.render(scene).image, renderer.render(scene, method="dual").image
    lit = dual[..., 3] > 1e-3
    difference = (image - dual)[lit, :3].astype(np.float64)
    return np.sqrt((difference**2).mean()) / dual[lit, :3].mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("res", [128, "auto"])
def test_is_as_good_as_a_narrow_cone(renderer, name, res):
    narrow = error(renderer, scene_of(tfm.SpotLight(from_=FROM, to=(0, 0, 0), cone=26.0), res=res))

    assert error(renderer, scene_of(LIGHTS[name], res=res)) < AS_GOOD * narrow
