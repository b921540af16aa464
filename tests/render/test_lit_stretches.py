"""Stretches that are all lit or all dark: pictures are those of looking up every sample."""

import numpy as np
import pytest
from scenes import blobs
from tolerances import PASS, STRETCHES

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.files import image_io
from tfm_cl.files.image_io.image import Image
from tfm_cl.render import batches, visibility
from tfm_cl.render.shadow_pyramid import bounds_size, shadow_bounds
from tfm_cl.render.visibility import Visibility
from tfm_cl.scene.lights import EnvironmentLight, PointLight, SpotLight, SunLight
from tfm_cl.scene.settings import ShadowSettings
from tfm_cl.scene.solids import BoxSolid, PlaneSolid, SphereSolid

pytestmark = pytest.mark.lanes

GREY = tfm.Medium(sigma_s=0.6, sigma_a=0.1)
NARROW = tfm.Medium(sigma_s=0.6, sigma_a=0.1, phase=tfm.HenyeyGreenstein(0.9))
TINTED = tfm.Medium(sigma_s=(1.0, 0.7, 0.4), sigma_a=(0.1, 0.2, 0.5), phase=tfm.HenyeyGreenstein(-0.6))
ROOM = tfm.BoxVolume(from_=(-2, -1.2, -2), to=(2, 1.8, 2), density=0.5)
BALL = tfm.SphereVolume(centre=(0, 0.2, 0), radius=2.2, density=0.4)
FOG = tfm.EverywhereVolume(density=0.2)
SOLIDS = [
    SphereSolid(centre=(0.3, 0.1, 0.2), radius=0.35),
    SphereSolid(centre=(-0.7, 0.4, -0.5), radius=0.2),
    BoxSolid(from_=(0.6, -1, -0.9), to=(0.9, 0.5, -0.6)),
    PlaneSolid(point=(0, -1.1, 0)),
]
SPOT = SpotLight(from_=(-1.4, 2.6, -1.1), to=(0.1, 0, 0.1), cone=32, intensity=(6, 5, 4))
INSIDE = PointLight(from_=(0.2, 1.1, -0.4), falloff="inverse-square", intensity=(2, 2, 2))
LIGHTS = {
    "spot": SPOT,
    "spot inside, soft": SpotLight(from_=(0.5, 1.2, 0.2), to=(0, -1, 0), cone=55, blend=0.4),
    "spot, wide": SPOT.replace(from_=(-0.2, 1.5, 0), cone=88),
    "spot with a reach": SPOT.replace(reach=3.0, falloff="inverse-square", intensity=(50, 50, 50)),
    "point": PointLight(from_=(2.6, 2.9, 1.2), intensity=(3, 3, 3)),
    "point inside": INSIDE,
    "point with a reach": INSIDE.replace(reach=1.3),
    "sun": SunLight(from_=(1, 2, 0.5), to=(0, 0, 0), intensity=(1, 0.5, 2)),
}
CAMERA = tfm.Camera(from_=(0.8, 0.9, 5), to=(0, 0.1, 0), fov=42, res=(72, 54))
STEPS = 107
"""Long stretches, short ones, and what is left of them."""


def scene_of(lights, volume=ROOM, medium=GREY, **changes):
    settings = {
        "solids": SOLIDS,
        "shadow": ShadowSettings(res=256),
        "march": tfm.MarchSettings(steps=STEPS),
    } | changes
    return tfm.Scene(volume, medium, settings.pop("camera", CAMERA), lights, **settings)


def bounded_by(monkeypatch, low, high):
    """Let all stretches have these bounds."""

    def bounds(maps):
        return [np.tile(np.array([low, high], np.float32), int(bounds_size(len(one))) // 2) for one in maps]

    (unshadowed,) = bounds([batches.UNSHADOWED])
    monkeypatch.setattr(batches, "UNSHADOWED_BOUNDS", unshadowed)
    monkeypatch.setattr(Visibility, "shadow_bounds", lambda *args: bounds(args[-1]))


def check_same(renderer, monkeypatch, scene):
    """Compare with the picture whose every sample is looked up, for all of its layers."""
    found = renderer.render(scene)
    bounded_by(monkeypatch, 0, np.inf)
    expected = renderer.render(scene)
    brightest = expected.image[..., :3].max()
    assert brightest > 0
    assert np.abs(found.image - expected.image).max() < STRETCHES * max(brightest, 1)
    for name in ("transmittance", "depth", "light_transmittance"):
        assert np.abs(found.aovs[name] - expected.aovs[name]).max() < 20 * STRETCHES
    return expected.image


@pytest.mark.quick("pcf-spot")
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("filtering", ["pcf", "nearest"])
def test_pictures_are_those_of_every_sample(renderer, monkeypatch, filtering, light):
    scene = scene_of([light], shadow=ShadowSettings(res=256, filter=filtering))

    image = check_same(renderer, monkeypatch, scene)

    assert np.abs(image - renderer.render(scene.replace(solids=[])).image)[..., :3].max() > 0.01 * image.max()


CASES = {
    "narrow phase function": scene_of([SPOT], medium=NARROW),
    "tinted": scene_of([LIGHTS["point inside"]], medium=TINTED),
    "ball": scene_of([SPOT], BALL),
    "fog, a narrow light": scene_of([SPOT.replace(cone=1.5)], FOG),
    "dense, few steps": scene_of([SPOT], ROOM.replace(density=40.0), march=tfm.MarchSettings(steps=5)),
    "steps in the world": scene_of([SPOT], march=tfm.MarchSettings(steps=STEPS, sampling="world")),
    "several bodies": scene_of([SPOT], [ROOM, BALL.replace(radius=0.9)]),
    "many lights": scene_of([SPOT, *(LIGHTS["sun"].replace(from_=(1, n, 0.5)) for n in (1, 2, 3))]),
    "environment": scene_of([EnvironmentLight(samples=5)]),
    "camera inside": scene_of([INSIDE], camera=CAMERA.replace(from_=(0.6, 0.8, 0.5), fov=90)),
    "shadow map of one texel": scene_of([SPOT], shadow=ShadowSettings(res=1)),
    "uneven shadow map": scene_of([INSIDE], shadow=ShadowSettings(res=93)),
    "a grid in fog": scene_of([SPOT], [tfm.Volume(blobs((12, 12, 12), 5), density_scale=2.0), FOG]),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", CASES.values(), ids=CASES)
def test_other_scenes_are_those_of_every_sample(renderer, monkeypatch, scene):
    check_same(renderer, monkeypatch, scene)


@pytest.mark.slow
def test_textures_are_those_of_every_sample(renderer, monkeypatch, tmp_path, rng):
    pixels = np.ones((6, 9, 4), np.float32)
    pixels[..., :3] = rng.random((6, 9, 3))
    image_io.save(tmp_path / "window.exr", Image(rgba=pixels), pixel_type="float")

    check_same(renderer, monkeypatch, scene_of([SPOT.replace(texture=str(tmp_path / "window.exr"))]))


@pytest.mark.quick("spot")
@pytest.mark.parametrize("light", ["spot", "point inside", "sun"])
def test_bounds_decide(renderer, monkeypatch, light):
    black = [solid.replace(albedo=(0, 0, 0)) for solid in SOLIDS]
    scene = scene_of([LIGHTS[light]], solids=black)
    true = renderer.render(scene).image[..., :3]

    bounded_by(monkeypatch, 0, 0)
    dark = renderer.render(scene).image[..., :3]
    bounded_by(monkeypatch, np.inf, np.inf)
    lit = renderer.render(scene).image[..., :3]

    assert dark.sum() < 0.5 * true.sum()
    assert (lit >= true * (1 - PASS)).all()
    assert (lit - true).max() > 0.005


@pytest.mark.quick("room-spot")
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("volume", [ROOM, FOG], ids=["room", "fog"])
def test_few_values_of_a_smooth_stretch_are_its_sum(renderer, volume, light):
    if volume is FOG and isinstance(light, SunLight):
        pytest.skip("a sun lights no medium without an end")
    camera = CAMERA.replace(res=(24, 18))
    medium = NARROW.replace(phase=tfm.HenyeyGreenstein(0.6))
    scene = scene_of([light], volume, medium, solids=[], camera=camera)

    image, expected = renderer.render(scene).image, reference.render(scene, "tfm")

    assert np.abs(image - expected).max() < 2 * PASS * max(1.0, float(expected[..., :3].max()))


def test_every_texel_is_bounded_once_for_lights_of_several_sizes(monkeypatch, renderer):
    calls = []

    def counted(maps):
        calls.append(maps.shape)
        return shadow_bounds(maps)

    monkeypatch.setattr(visibility, "shadow_bounds", counted)
    near = [
        SPOT.replace(from_=(x, 1.0, 0), to=(x, 0, 0), cone=20, reach=r) for x in (-1, 0, 1) for r in (0.3, 1)
    ]
    made = renderer.render(scene_of(near)).stats.made

    assert sum(count for count, *_ in calls) == made["shadow map"] == made["bounds of a shadow map"] > 1
    assert len(calls) == len({size for _, size, _ in calls})
