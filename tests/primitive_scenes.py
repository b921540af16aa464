"""What tests of points, strands and polygons have in common: scenes, maps of a light, how results compare."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from scenes import make_scene
from tolerances import LANES, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.reference.geometry import Rays
from tfm_cl.scene.lights import PointLight, SpotLight, SunLight
from tfm_cl.scene.lights.base import texel_positions
from tfm_cl.scene.settings import ShadowSettings
from tfm_cl.scene.solids import PlaneSolid, SphereSolid

WHITE = tfm.Medium(sigma_s=1.0)
BROWN = tfm.Medium(sigma_s=(0.8, 0.5, 0.25), sigma_a=(0.2, 0.4, 0.6), phase=tfm.HenyeyGreenstein(-0.3))
BLUE = tfm.Medium(sigma_s=(0.2, 0.5, 1.0), sigma_a=0.1, phase=tfm.HenyeyGreenstein(0.6))
FIBRES = tfm.Medium(sigma_s=(0.8, 0.5, 0.25), sigma_a=0.2, phase={"type": "kajiya-kay", "exponent": 12})
SCENE = make_scene()
CAMERA = SCENE.camera.replace(res=(96, 72))
LIGHT = SCENE.lights[0].replace(intensity=(60, 50, 40))
GRID = SCENE.volume
FOG = tfm.EverywhereVolume(density=0.12, medium=WHITE)
BALLS = tfm.Points([[0.3, 0.2, 0.1], [-0.4, 0.1, -0.3]], [0.5, 0.4], 1.5)

SIZES = [1 / 50, 0.4, 0.9, 1.1, 3, 8, 50]
"""Of a thin one, in the widths of texels or pixels below which it is widened."""
CORNERS = np.array([[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]])
"""Of what hardly anything holds: so that what a map looks at does not depend on what is in it."""
HARDLY = 1e-9
"""Opacity of that."""
DEPTH_OF_ONE = 5e-6
"""Optical depth of one crossing, of an opacity that is rounded to float32 before its logarithm is taken."""
SAMPLED = 0.01
"""Of what is widened: the area that it covers, or what it holds, sampled at the middles of pixels."""
BORDER = 4e-6
"""World units by which float32 places a ray at a distance of some units."""

LIGHTS = {
    "spot": SpotLight(from_=(0, 0.5, 8), to=(0, 0, 0), cone=18),
    "sun": SunLight(from_=(0.5, 1, 8), to=(0, 0, 0)),
    "point": PointLight(from_=(0.5, 0, 6)),
}
"""That see `CORNERS`."""
every_light = pytest.mark.parametrize("light", LIGHTS)
both_methods = pytest.mark.parametrize("method", ["tfm", "dual"])


def colours(count, seed=5):
    return np.random.default_rng(seed).uniform(0, 1.5, (count, 3))


def opaque_at_last(opacity, covered):
    """Optical depth of what covers a part, which stays below 1."""
    return -np.log1p(-np.minimum(opacity * covered, 1 - 2.0**-23))


@dataclass(frozen=True)
class LightMap:
    """What a light's map says of whole rays."""

    depth: np.ndarray
    """[texels]"""
    rays: Rays
    lit: np.ndarray
    light: object
    """Fitted."""

    def texel_at(self, place):
        """Width of a texel there: what is widened at the bounds makes these, and texels, wider."""
        away = np.linalg.norm(self.light.frame().world_from_light[:3, 3] - place)
        return self.light.footprint(away) / len(self.depth) ** 0.5

    @property
    def areas(self):
        """World area across a sun's rays, or solid angle, that each texel stands for, at its middle."""
        res = int(len(self.depth) ** 0.5)
        middles, step = texel_positions(res), 0.25 / res
        around = [self.light.rays(middles + step * np.array(to)) for to in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        left, right, up, down = (rays[0 if isinstance(self.light, SunLight) else 1] for rays in around)
        return np.linalg.norm(np.cross(left - right, up - down), axis=1) / (2 * step * res) ** 2

    @property
    def covered(self):
        """Area that is dark, of `areas`."""
        return (-np.expm1(-self.depth) * self.areas).sum()


def map_of(renderer, body, light, res):
    """Map whose first coefficient, the integral of the extinction, is the optical depth of whole rays."""
    settings = tfm.MapSettings(
        basis="fourier", coeffs=3, target="extinction", fit="l2", range="box", res=res, steps=32
    )
    (light_map,) = renderer.build_maps(tfm.Scene(body, WHITE, lights=[light], map=settings))
    rays = reference.texel_rays(light_map.light, res)
    begin, end = reference.march_bounds(body, *rays, margin=light_map.medium.margin)
    lit = (end > begin) & light_map.light.reaches(rays.at(end))
    depth = np.where(lit, light_map.coefficients[..., 0].astype(float).ravel(), 0)
    return LightMap(depth, rays, lit, light_map.light)


def depth_in_picture(renderer, body, camera):
    """Optical depth of each pixel, in rows, and its opacity."""
    scene = tfm.Scene(body, WHITE, camera, (), march=tfm.MarchSettings(steps=40))
    result = renderer.render(scene)
    depths = -np.log(np.maximum(result.aovs["transmittance"].astype(float), 1e-30))
    assert (depths == depths[..., :1]).all()
    return depths[..., 0].ravel(), result.image[..., 3].ravel()


def solid_angles(camera):
    """Of each pixel: the same area of a plane, seen from farther away and aslant."""
    forward = np.subtract(camera.to, camera.from_)
    cosine = camera.rays()[1] @ forward / np.linalg.norm(forward)
    return camera.pixel_width**2 * cosine**3


def scene_of(*bodies, **changes):
    settings = {
        "march": tfm.MarchSettings(steps=30, cutoff=0.0),
        "map": SCENE.map.replace(density_weighting=10.0, res=160, steps=24),
        "lights": [LIGHT],
        "camera": CAMERA,
    }
    return SCENE.replace(volume=bodies, **(settings | changes))


LIGHT_KINDS = {
    "spot": LIGHT,
    "sun": SunLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), intensity=(60, 50, 40)),
    "point light": PointLight(from_=(2.2, 3.0, 1.2), intensity=(60, 50, 40)),
    "soft spot": LIGHT.replace(cone=12, blend=0.5, falloff="inverse-square", intensity=(800, 600, 400)),
}
SOLIDS = {
    "solids": (SphereSolid(centre=(0.1, 0.1, 0.2), radius=0.35), PlaneSolid(point=(0, -0.7, 0))),
    "shadow": ShadowSettings(res=64),
    "ambient": tfm.Ambient(radiance=(0.1, 0.2, 0.3)),
}


APART = {"dual": 0.02, "tfm": 0.12}
"""Share of the pixels that show something where the last digit may decide otherwise; of a map four texels."""


def assert_agrees_with_reference(renderer, scene, method):
    """All but some pixels are the same, and so is the mean.

    Edges, and which step a crossing goes to, are decided by the last digit in float32 and in float64.
    """
    result = renderer.render(scene, method=method)
    expected, layers = reference.render_with_aovs(scene, method, shadows="map")
    brightest = max(1.0, float(expected[..., :3].max()))
    shown = (expected[..., 3] > 0) | (result.image[..., 3] > 0)
    assert shown.mean() > 0.05
    assert expected[..., :3].max() > 0.3
    difference = np.abs(result.image - expected).max(axis=-1)
    assert (difference[shown] > 40 * PASS * brightest).mean() < APART[method]
    assert (difference[~shown] < PASS).all()
    # Of what is opaque only these pixels are lit.
    means = result.image.mean(axis=(0, 1)), expected.mean(axis=(0, 1))
    np.testing.assert_allclose(*means, rtol=0.01, atol=2e-4 * brightest)
    through = np.abs(result.aovs["transmittance"] - layers["transmittance"]).max(axis=-1)
    assert (through[shown] > 20 * PASS).mean() < 0.01


def assert_same(result, expected, tolerance):
    brightest = float(expected.image[..., :3].max())
    assert brightest > 0.1
    np.testing.assert_allclose(result.image, expected.image, atol=tolerance * max(1, brightest))
    for name in ("transmittance", "depth"):
        np.testing.assert_allclose(result.aovs[name], expected.aovs[name], atol=20 * tolerance, err_msg=name)


def assert_makes_numbers(result):
    """Whatever the scene: finite, none of them negative, and no more than opaque."""
    for picture in (result.image, *result.aovs.values()):
        assert np.isfinite(picture).all()
        assert picture.min() >= 0
    assert result.image[..., 3].max() <= 1


def assert_lanes_agree(new_renderer, device_name, scene, method):
    """However many rays a work-item carries."""
    pictures = []
    for lanes in Launcher(choose_device(device_name)).lanes_possible:
        with new_renderer(lanes=lanes) as renderer:
            pictures.append(renderer.render(scene, method=method))
    for one, other in pairwise(pictures):
        assert_same(one, other, LANES)
