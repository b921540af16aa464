"""Black pictures: is the reason told the one that made them black?"""

import io
import re

import numpy as np
import PIL.Image
import pytest
from scenes import blobs, make_scene

import tfm_cl as tfm
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.files.image_io.png import png_bytes
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.render.diagnosis import EIGHT_BIT_STEP, FAINTEST, is_black, too_dark, too_thin
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.lights import EnvironmentLight, PointLight, SunLight
from tfm_cl.scene.solids import BoxSolid, PlaneSolid, SphereSolid

SCENE = make_scene()
CAMERA, LIGHT, MEDIUM, VOLUME = SCENE.camera, SCENE.lights[0], SCENE.medium, SCENE.bodies[0]
AWAY = (9.0, 9.0, 9.0)
DARK = LIGHT.replace(intensity=0)


@pytest.fixture(scope="session")
def renderer(one_lane_renderer):
    return one_lane_renderer


def told(renderer, scene, method="dual", **options):
    """Render what must be black; return the one reason told."""
    result = renderer.render(scene, method=method, **options)
    assert is_black(result.image)
    (warning,) = result.warnings
    start, _, reason = warning.partition(": ")
    assert start.startswith("the picture is black")
    assert "\n" not in warning
    return reason


def assert_told(line, reason):
    assert re.match(reason, line), line


def lit_by(*lights, **changes):
    return SCENE.replace(lights=lights, **changes)


def coloured(*rgb):
    colour = np.broadcast_to(np.float32(rgb), (*VOLUME.shape, 3))
    return tfm.Volume(VOLUME.data, colour=colour, world_from_index=VOLUME.world_from_index)


def specks():
    """Two voxels far apart."""
    density = np.zeros((60, 60, 60), np.float32)
    density[0, 0, 0] = density[-1, -1, -1] = 1
    return tfm.Volume(density, voxel_size=0.04, origin=(-1.2, -1.2, -1.2), density_scale=100)


AT_SPECK = CAMERA.replace(from_=(1.18, 1.18, 4.0), to=(1.18, 1.18, 1.18), fov=10)
"""Sees one of `specks` in its middle."""

OF_MEDIUM = {
    "density_scale 0": (SCENE.replace(volume=VOLUME.with_density_scale(0)), "array: density_scale is 0"),
    "an empty grid": (
        SCENE.replace(volume=tfm.Volume(np.zeros((4, 5, 6)), name="flame")),
        "flame: all voxels are 0",
    ),
    "several volumes": (
        SCENE.replace(volume=([tfm.Volume(np.zeros((4, 5, 6)), name="flame"), VOLUME.with_density_scale(0)])),
        "volume.0 \\(flame\\): all voxels are 0; volume.1 \\(array\\): density_scale is 0",
    ),
    "colours of 0": (SCENE.replace(volume=coloured(0, 0, 0)), "array: all voxels times their colours are 0"),
    "density 0": (SCENE.replace(volume=tfm.BoxVolume(density=0)), "box: density is 0"),
    "absorbs only": (
        SCENE.replace(medium=MEDIUM.replace(sigma_s=0)),
        "medium.sigma_s is 0: the medium absorbs light and scatters none",
    ),
    "no medium": (
        SCENE.replace(medium=MEDIUM.replace(sigma_s=0, sigma_a=0)),
        "medium.sigma_s and sigma_a are 0: there is nothing to be seen",
    ),
    "absorbs what the colours have": (
        SCENE.replace(volume=coloured(1, 0, 0), medium=MEDIUM.replace(sigma_s=(0, 1, 1))),
        "medium.sigma_s is 0 in all channels that the volume's colours have",
    ),
    "thin": (
        SCENE.replace(volume=VOLUME.with_density_scale(1e-38)),
        "the medium is too thin to be seen, its optical depth at most .*: raise volume.density_scale",
    ),
}

OF_CAMERA = {
    "looks away": (
        SCENE.replace(camera=CAMERA.replace(to=(0.6, 0.8, 9))),
        "the medium, around .*, is behind the camera",
    ),
    "looks to the right": (
        SCENE.replace(camera=CAMERA.replace(to=(9, 0.8, 4))),
        "the medium lies left of the picture",
    ),
    "looks down": (
        SCENE.replace(camera=CAMERA.replace(to=(0.6, -9, 0))),
        "the medium lies above the picture",
    ),
    "far away": (
        SCENE.replace(camera=CAMERA.replace(from_=(0, 0, 1e5))),
        "the camera sees the medium only 0.0008 pixels wide, .*: bring the camera nearer",
    ),
    "voxels between pixels": (
        SCENE.replace(volume=specks()),
        "the camera's rays meet no density within .* between the pixels or between the 30 steps",
    ),
    "away from a box": (
        SCENE.replace(volume=tfm.BoxVolume(), camera=CAMERA.replace(to=(0, 0, 9))),
        "the medium, around 0,0,0, is behind the camera",
    ),
}

OF_LIGHTS = {
    "intensity 0": (lit_by(DARK), "light.intensity is 0"),
    "all intensities 0": (
        lit_by(DARK, PointLight(from_=(0, 3, 0), intensity=0)),
        "all 2 lights have intensity 0",
    ),
    "no colour in common": (
        lit_by(LIGHT.replace(intensity=(1, 0, 1)), medium=MEDIUM.replace(sigma_s=(0, 1, 0))),
        "the medium scatters green only, of which there is no light",
    ),
    "no colour in common with the ambient": (
        lit_by(DARK, medium=MEDIUM.replace(sigma_s=(0, 1, 1)), ambient=Ambient(radiance=(1, 0, 0))),
        "the medium scatters green and blue only, of which there is no light",
    ),
    "no colour in common with the volume": (
        lit_by(LIGHT.replace(intensity=(0, 1, 1)), volume=coloured(1, 0, 0)),
        "the medium scatters red only, of which there is no light",
    ),
    "misses": (
        lit_by(LIGHT.replace(to=AWAY)),
        "no light reaches the medium: the cone of light 1 misses it",
    ),
    "misses a coloured volume": (
        lit_by(LIGHT.replace(to=AWAY), volume=coloured(1, 0, 0)),
        "no light reaches the medium: the cone of light 1 misses it",
    ),
    "misses a ball": (
        lit_by(LIGHT.replace(to=AWAY), volume=tfm.SphereVolume()),
        "no light reaches the medium: the cone of light 1 misses it",
    ),
    "thin beside a dark one": (
        lit_by(DARK, LIGHT.replace(cone=1e-3)),
        "the cone of light 2 is only 0.00099 pixels wide",
    ),
    "dark ones are not told of": (
        lit_by(DARK, LIGHT.replace(to=AWAY)),
        "no light reaches the medium: the cone of light 2 misses it",
    ),
    "ends before": (
        lit_by(LIGHT.replace(reach=0.5), PointLight(from_=(0, 5, 0), reach=1)),
        "no light reaches the medium: light 1 ends at its reach of 0.5, .*; light 2 .* begins 3.28 away",
    ),
    "thinner than a pixel": (
        lit_by(LIGHT.replace(cone=1e-3)),
        "the cone of light 1 is only 0.00099 pixels wide where it meets the medium, and falls between them",
    ),
    "smaller than a pixel": (
        lit_by(PointLight(from_=(0.0123, 0.0234, 0.1), reach=1e-4)),
        "the reach of light 1 is only 0.0012 pixels wide",
    ),
    "thinner than a pixel, everywhere": (
        lit_by(LIGHT.replace(cone=1e-3), volume=tfm.EverywhereVolume(density=0.1)),
        "the cone of light 1 is only .* pixels wide",
    ),
    "behind the camera": (
        lit_by(
            LIGHT.replace(from_=(0, 0, 9), to=(0, 0, 20), cone=10), volume=tfm.EverywhereVolume(density=0.1)
        ),
        "the lights reach the medium only outside of what the picture shows",
    ),
    "behind the medium": (
        lit_by(LIGHT, volume=tfm.EverywhereVolume(density=1e8)),
        r"what the lights reach of the medium lies behind more of it \(lower volume.density\)",
    ),
    "between specks": (
        lit_by(
            LIGHT.replace(from_=(-3, 0, 3), to=(1.18, 1.18, 0.3), cone=2),
            volume=specks(),
            camera=AT_SPECK,
            march=tfm.MarchSettings(steps=400),
        ),
        "what the lights reach of the medium has no density",
    ),
    "swallowed": (
        lit_by(PointLight(from_=(0, 0, -0.1)), volume=VOLUME.with_density_scale(1e6)),
        "the medium swallows the light before it gets to what the camera sees: lower volume.density_scale",
    ),
    "too faint": (
        lit_by(LIGHT.replace(from_=(2.2e4, 3e4, 1.2e4), cone=1, intensity=1e-32, falloff="inverse-square")),
        "too little light for float32 numbers arrives at .*: raise light.intensity",
    ),
}

WALL = BoxSolid(from_=(-3, -3, 2.5), to=(3, 3, 2.6), albedo=0)
OF_SOLIDS = {
    "hides the medium": (
        SCENE.replace(solids=(WALL,)),
        "solids hide the medium from the camera; the solids in view have the albedo 0",
    ),
    "surrounds the light": (
        SCENE.replace(solids=(SphereSolid(centre=LIGHT.from_, radius=0.3),)),
        "solids keep the light from the medium",
    ),
    "ceiling": (
        lit_by(
            SunLight(from_=(0, 1, 0), to=(0, 0, 0)), solids=(PlaneSolid(point=(0, 3, 0), normal=(0, 1, 0)),)
        ),
        "solids keep the light from the medium; no light reaches the solids in view",
    ),
    "in view, unlit": (
        lit_by(DARK, solids=(SphereSolid(centre=(0, 0, 0), radius=0.5),)),
        "light.intensity is 0; no light reaches the solids in view",
    ),
}

BOX, BALL = tfm.BoxVolume(), tfm.SphereVolume(centre=(0, 0.5, 0))
ABSORBING = tfm.Medium(sigma_s=0, sigma_a=1)
FLAME = tfm.Volume(np.zeros((4, 5, 6)), name="flame")
ASIDE = tfm.SphereVolume(centre=(9, 0, 0))
BEHIND = tfm.BoxVolume(from_=(-1, -1, 8), to=(1, 1, 9))


def of_bodies(*bodies, **changes):
    return SCENE.replace(volume=bodies, **changes)


OF_BODIES = {
    "all are empty": (
        of_bodies(FLAME, BOX.replace(density=0)),
        r"volume.0 \(flame\): all voxels are 0; volume.1 \(box\): density is 0$",
    ),
    "one is empty, one absorbs": (
        of_bodies(FLAME, BOX.with_medium(ABSORBING)),
        r"volume.0 \(flame\): all voxels are 0; volume.1.medium.sigma_s is 0: the medium absorbs light and",
    ),
    "all absorb": (
        of_bodies(VOLUME, BOX, medium=ABSORBING),
        "medium.sigma_s is 0: the medium absorbs light and scatters none$",
    ),
    "the one of a colour of its own has no other": (
        of_bodies(coloured(1, 0, 0).with_medium(tfm.Medium(sigma_s=(0, 1, 1))), BOX.replace(density=0)),
        r"volume.0.medium.sigma_s is 0 in all channels .* colours have; volume.1 \(box\): density is 0$",
    ),
    "thin": (
        of_bodies(VOLUME.with_density_scale(1e-38), BOX.replace(density=1e-38), FLAME),
        "the medium is too thin .*: raise volume.0.density_scale or volume.1.density$",
    ),
    "away to both sides": (
        of_bodies(ASIDE, BEHIND),
        r"volume.0 \(sphere\) lies right of the picture; volume.1 \(box\), around 0,0,8.5, is behind the",
    ),
    "both on one side": (
        of_bodies(ASIDE, ASIDE.replace(radius=0.5)),
        "the medium lies right of the picture$",
    ),
    "the one that scatters is behind": (
        of_bodies(BOX.with_medium(ABSORBING), BEHIND),
        r"volume.1 \(box\), around 0,0,8.5, is behind the camera$",
    ),
    "the light misses the one that scatters": (
        of_bodies(BOX.with_medium(ABSORBING), BALL, lights=[LIGHT.replace(to=AWAY)]),
        r"no light reaches volume.1 \(sphere\): the cone of light 1 misses it$",
    ),
    "the light misses both": (
        of_bodies(VOLUME, BALL, lights=[LIGHT.replace(to=AWAY)]),
        "no light reaches the medium: the cone of light 1 misses it$",
    ),
    "the light ends before the nearest": (
        of_bodies(BALL, VOLUME, lights=[PointLight(from_=(0, 5, 0), reach=1)]),
        r"no light reaches the medium: light 1 ends at its reach of 1, and volume.1 \(array\) begins .* away",
    ),
    "the light passes between": (
        of_bodies(
            BALL.replace(centre=(-1.3, 0, 0), radius=0.4),
            BALL.replace(centre=(1.3, 0, 0), radius=0.4),
            lights=[LIGHT.replace(from_=(0, 5, 0), to=(0, 0, 0), cone=2)],
        ),
        "no light reaches the medium: the cone of light 1 misses it$",
    ),
    "the one that is lit is not in the picture": (
        of_bodies(BALL, ASIDE, lights=[LIGHT.replace(from_=(9, 5, 0), to=(9, 0, 0), cone=5)]),
        "the lights reach the medium only outside of what the picture shows$",
    ),
    "no colour in common": (
        of_bodies(
            BALL.with_medium(tfm.Medium(sigma_s=(1, 0, 0))),
            BOX.with_medium(tfm.Medium(sigma_s=(0, 1, 0))),
            lights=[LIGHT.replace(intensity=(0, 0, 1))],
        ),
        "the medium scatters red and green only, of which there is no light$",
    ),
    "no colour in common with the one that scatters": (
        of_bodies(
            BALL.with_medium(ABSORBING),
            BOX,
            lights=[LIGHT.replace(intensity=(0, 0, 1))],
            medium=tfm.Medium(sigma_s=(1, 0, 0)),
        ),
        r"volume.1 \(box\) scatters red only, of which there is no light$",
    ),
    "dark fog before a cloud": (
        of_bodies(
            tfm.EverywhereVolume(density=20).with_medium(ABSORBING),
            VOLUME,
            lights=[PointLight(from_=CAMERA.from_)],
        ),
        r"what scatters light lies behind volume.0 \(everywhere\), which only absorbs it: lower volume.0.",
    ),
    "swallowed by the denser": (
        of_bodies(
            VOLUME,
            BALL.replace(centre=(0, 0, 0), radius=2, density=1e4),
            lights=[PointLight(from_=(0, 0, -0.1))],
        ),
        "the medium swallows the light before it gets to what the camera sees: lower volume.1.density$",
    ),
}

WITHOUT_LIGHT = {
    "a grid": lit_by(),
    "a box": lit_by(volume=BOX),
    "a coloured grid": lit_by(volume=coloured(1, 0.5, 0.2)),
    "bodies": of_bodies(VOLUME, BOX, lights=[]),
    "solids in view": lit_by(solids=(SphereSolid(centre=(0, 0, 0), radius=0.5),)),
    "nothing in view": lit_by(camera=CAMERA.replace(to=(0.6, 0.8, 9))),
    "no density": lit_by(volume=FLAME),
}


@pytest.mark.quick("density_scale 0", "an empty grid", "absorbs only", "thin", "looks away")
@pytest.mark.parametrize(
    ("scene", "reason"), [*OF_MEDIUM.values(), *OF_CAMERA.values()], ids=[*OF_MEDIUM, *OF_CAMERA]
)
def test_of_medium_and_camera(renderer, scene, reason):
    assert_told(told(renderer, scene), reason)


@pytest.mark.quick("intensity 0", "misses", "ends before", "thinner than a pixel", "swallowed")
@pytest.mark.parametrize(("scene", "reason"), OF_LIGHTS.values(), ids=OF_LIGHTS)
def test_of_lights(renderer, scene, reason):
    assert_told(told(renderer, scene), reason)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "reason"), OF_BODIES.values(), ids=OF_BODIES)
def test_of_several_bodies(renderer, scene, reason):
    assert_told(told(renderer, scene), reason)


@pytest.mark.quick("a grid-tfm", "a box-dual")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("scene", WITHOUT_LIGHT.values(), ids=WITHOUT_LIGHT)
def test_without_any_light(renderer, scene, method):
    assert told(renderer, scene, method) == "the scene has no light and no ambient"


def test_ambient_light_of_a_colour_that_nothing_scatters_is_not_enough(renderer):
    scene = lit_by(medium=MEDIUM.replace(sigma_s=(0, 1, 0)), ambient=Ambient(radiance=(1, 0, 0)))
    assert told(renderer, scene) == "the medium scatters green only, of which there is no light"


def test_a_scene_without_lights_asks_for_more_ambient_light(renderer):
    scene = lit_by(ambient=Ambient(radiance=1e-37))
    assert told(renderer, scene).endswith("of the medium: raise ambient.radiance")


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "reason"), OF_SOLIDS.values(), ids=OF_SOLIDS)
def test_of_solids(renderer, scene, reason):
    assert_told(told(renderer, scene), reason)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["misses", "swallowed", "thinner than a pixel", "intensity 0"])
def test_from_maps_it_is_the_same_reason(renderer, name):
    scene, reason = OF_LIGHTS[name]
    assert_told(told(renderer, scene, method="tfm"), reason)
    maps = renderer.build_maps(scene)
    assert_told(told(renderer, scene, method="tfm", maps=maps), reason)


@pytest.fixture
def textures(tmp_path):
    """``textures(pixels)`` is the path of an image."""

    def save(pixels):
        path = tmp_path / "slide.png"
        PIL.Image.fromarray(np.asarray(pixels, np.uint8)).save(path)
        return str(path)

    return save


@pytest.mark.slow
def test_of_black_textures(renderer, textures):
    path = textures(np.zeros((4, 4, 3)))
    black = f"the texture of light 1 is black: {path}"
    assert told(renderer, lit_by(LIGHT.replace(texture=path))) == black
    assert told(renderer, lit_by(EnvironmentLight(texture=path, samples=2))) == black


@pytest.mark.slow
def test_of_a_texture_that_is_black_where_it_is_needed(renderer, textures):
    pixels = np.zeros((64, 64, 3))
    pixels[0, 0] = 255
    scene = lit_by(LIGHT.replace(texture=textures(pixels), cone=60.0))
    assert told(renderer, scene) == (
        "the texture of light 1 is black where the camera sees it fall on the medium"
    )


def test_within_a_crop(renderer):
    result = renderer.render(SCENE, method="dual", crop=(0, 0, 2, 2))
    assert result.warnings == (
        "the picture is black within the crop 0,0,2,2: the camera's rays meet no density there",
    )
    small = SCENE.replace(camera=CAMERA.replace(fov=120))
    result = renderer.render(small, method="dual", crop=(0, 0, 2, 2))
    assert result.warnings == (
        "the picture is black within the crop 0,0,2,2: the medium lies right of the crop",
    )


@pytest.mark.slow
@pytest.mark.parametrize("volume", [VOLUME, coloured(1, 0, 0), tfm.SphereVolume()], ids=str)
def test_a_picture_with_light_is_not_asked(renderer, monkeypatch, volume):
    monkeypatch.setattr("tfm_cl.render.diagnosis.why_black", None)
    assert renderer.render(SCENE.replace(volume=volume), method="dual").warnings == ()


def test_ambient_light_alone_is_light(renderer):
    result = renderer.render(lit_by(DARK, ambient=Ambient(radiance=0.1)), method="dual")
    assert result.warnings == ()
    assert result.image[..., 0].max() > 0.01


def test_a_picture_that_no_exposure_shows_is_black():
    image = np.zeros((3, 4, 4), np.float32)
    image[2, 3] = 0, FAINTEST / 1.01, 0, 1
    assert is_black(image)
    image[2, 3, 1] = FAINTEST * 1.01
    assert not is_black(image)


def levels(result, exposure, view="standard"):
    """Whether the PNG of a picture shows anything; not dithered, which shows a faint value in few pixels."""
    content = png_bytes(result.image, exposure, view=view, dither=False)
    return np.asarray(PIL.Image.open(io.BytesIO(content))).max()


@pytest.mark.parametrize("intensity", [0.0002, 1e-9])
def test_below_an_8_bit_step(renderer, intensity):
    result = renderer.render(lit_by(LIGHT.replace(intensity=intensity)), method="dual")
    assert result.warnings == ()
    said = too_dark(result, 0.0)
    brightest = result.image[..., :3].max()
    assert said.startswith(
        f"the picture is black: its brightest value, {brightest:.3g}, is less than an 8-bit step: --exposure "
    )
    assert levels(result, 0.0) == 0
    stops = int(said.split("--exposure ")[1].split()[0])
    assert levels(result, stops) > 80
    assert too_dark(result, stops) == ""
    assert too_dark(result, automatic_exposure(result.image, "standard")) == ""


def test_no_more_stops_are_proposed_than_there_are(renderer):
    result = renderer.render(lit_by(LIGHT.replace(intensity=1e-31)), method="dual")
    assert "--exposure 100 shows it" in too_dark(result, 0.0)
    assert levels(result, 100) > 0


def test_just_an_8_bit_step_is_no_warning(renderer):
    result = renderer.render(SCENE, method="dual")
    at_step = np.log2(EIGHT_BIT_STEP / result.image[..., :3].max())
    for exposure in (at_step - 0.01, at_step + 0.01):
        assert (too_dark(result, exposure) == "") is bool(levels(result, exposure))
    for view in VIEWS:  # some show less of the dark
        told = {stops: too_dark(result, at_step + stops, view) for stops in range(8)}
        assert {stops: bool(said) for stops, said in told.items()} == {
            stops: levels(result, at_step + stops, view) == 0 for stops in told
        }
        assert any(told.values()) is (view != "standard")
        for said in filter(None, told.values()):
            assert 80 < levels(result, int(said.split("--exposure ")[1].split()[0]), view) < 255


def test_below_an_8_bit_step_a_thin_medium_is_told_too(renderer):
    scene = SCENE.replace(volume=VOLUME.with_density_scale(1e-6))
    said = too_dark(renderer.render(scene, method="dual"), 0.0)
    assert "; the medium is too thin to be seen, its optical depth at most " in said
    assert said.endswith(": raise volume.density_scale")


def test_what_is_thin_among_several_is_told_by_its_number():
    scene = of_bodies(VOLUME.with_density_scale(1e-9), FLAME, BOX.replace(density=1e-9))
    assert too_thin(scene).endswith(": raise volume.0.density_scale or volume.2.density")
    assert too_thin(scene.replace(volume=(VOLUME, BOX.replace(density=1e-9)))) == ""
    assert too_thin(scene.replace(volume=(FLAME, tfm.EverywhereVolume(density=0)))) == ""
    assert too_thin(of_bodies(VOLUME.with_density_scale(1e-9), tfm.EverywhereVolume(density=1e-9))) == ""


def test_a_density_too_thin_for_the_largest_scale():
    volume = tfm.Volume(1e-40 * blobs(), density_scale=1e25)
    scene = SCENE.replace(volume=volume)
    assert too_thin(scene).endswith(" even with the largest volume.density_scale, 1e+25")
    beside = scene.replace(volume=(*scene.bodies, BOX.replace(density=1e-30)))
    assert too_thin(beside).endswith(": raise volume.1.density")
