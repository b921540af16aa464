"""``map.max_error``: the picture keeps it, and the error reported is the picture's."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import blobs, make_scene

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.metrics import compare
from tfm_cl.plan import accuracy

HONEST = 1.5
"""The error reported over the true one, and the other way round."""
TRUTH = 500
"""Steps of the dual march that is the truth here: twice what the scenes' thinnest voxels ask for and more."""

VOLUME = tfm.Volume(blobs((28, 24, 32)), voxel_size=1 / 16, origin=(-1, -0.75, -0.875), density_scale=8.0)
FLAT = tfm.Volume(
    blobs((14, 24, 32)), voxel_size=(1 / 16, 1 / 16, 1 / 8), origin=(-1, -0.75, -0.875), density_scale=25.0
)
CUBE = tfm.Volume(np.ones((10, 10, 10)), voxel_size=0.12, origin=(-0.6,) * 3, density_scale=10.0)
CAMERA = tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=38, res=(48, 36))
SPOT = tfm.SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=24, intensity=(3, 2.5, 2))
SOLIDS = [
    tfm.SphereSolid(centre=(0.5, 0.9, 0.2), radius=0.3),
    tfm.PlaneSolid(point=(0, -1, 0), normal=(0, 1, 0)),
]


def scene_of(volume=VOLUME, error=0.01, *, of_map=None, **changes):
    return tfm.Scene(
        **{
            "volume": volume,
            "camera": CAMERA,
            "lights": [SPOT],
            "map": tfm.MapSettings(max_error=error, **(of_map or {})),
            **changes,
        }
    )


SCENES = {
    "spot": scene_of(),
    "loosely": scene_of(error=0.2),
    "thick and flat voxels": scene_of(FLAT),
    "a hard cube": scene_of(CUBE),
    "wide spot": scene_of(lights=[SPOT.replace(cone=89.5)]),
    "point within": scene_of(lights=[tfm.PointLight(from_=(0.2, 0.1, 0.3), falloff="inverse-square")]),
    "sun, coloured": scene_of(
        lights=[tfm.SunLight(from_=(1, 2, 0.5), to=(0, 0, 0))],
        medium=tfm.Medium(sigma_s=(1, 0.6, 0.3), phase=tfm.HenyeyGreenstein(0.5)),
    ),
    "solids": scene_of(solids=SOLIDS),
    "two volumes": scene_of([VOLUME, CUBE]),
    "colour in each voxel": scene_of(
        tfm.Volume(
            blobs((14, 12, 16)),
            voxel_size=1 / 8,
            origin=(-1, -0.75, -0.875),
            density_scale=6.0,
            colour=np.random.default_rng(2).uniform(0.3, 1, (14, 12, 16, 3)),
        )
    ),
    "fourier": scene_of(error=0.05, of_map={"basis": "fourier"}),
}


def truth_of(renderer, scene, crop=None):
    settings = tfm.MapSettings(steps=TRUTH), tfm.MarchSettings(steps=TRUTH)
    return renderer.render(scene.replace(map=settings[0], march=settings[1]), method="dual", crop=crop).image


def check(renderer, scene, **options):
    result = renderer.render(scene, **options)
    true = compare(result.image, truth_of(renderer, scene, options.get("crop"))).lit.rmse

    assert true <= HONEST * scene.map.max_error
    assert result.stats.error_estimate <= scene.map.max_error
    assert true / HONEST <= result.stats.error_estimate <= true * HONEST
    return result


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_the_picture_keeps_it_and_says_what_it_errs_by(renderer, name):
    result = check(renderer, SCENES[name])

    numbers = result.stats.map
    assert all(type(n) is int for n in (numbers.res, numbers.steps, numbers.coeffs, result.scene.march.steps))


@pytest.mark.slow
def test_it_takes_what_it_needs(renderer):
    chosen = [renderer.render(scene_of(error=error)).scene for error in (0.2, 0.02, 0.005)]
    effort = [scene.map.res**2 * scene.map.coeffs for scene in chosen]
    steps = [scene.march.steps for scene in chosen]
    assert effort[0] < effort[1] < effort[2]
    assert steps[0] <= steps[1] <= steps[2]
    assert steps[0] < steps[2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "march"),
    [
        ({"res": 256, "coeffs": 8}, {"steps": 222}),
        ({"res": 256}, {}),
        ({"steps": 300}, {}),
        ({"coeffs": 16}, {}),
        ({}, {"steps": 222}),
        ({"basis": "dct"}, {}),
    ],
    ids=str,
)
def test_what_is_given_stays(renderer, given, march):
    scene = scene_of(of_map=given, march=tfm.MarchSettings(**march))
    result = check(renderer, scene)
    assert given.items() <= result.stats.map.to_dict().items()
    assert march.items() <= result.scene.march.to_dict().items()


@pytest.mark.slow
def test_what_cannot_be_is_one_line(renderer):
    scene = scene_of(error=0.002, of_map={"res": 16, "steps": 16, "coeffs": 3})
    with pytest.raises(SceneError) as raised:
        renderer.render(scene.replace(march=tfm.MarchSettings(steps=16)))
    message = str(raised.value)
    assert message.startswith("map.max_error = 0.002: the picture reaches 0.")
    assert "remove map.res = 16, map.steps = 16, march.steps = 16, or allow a larger error" in message
    assert "\n" not in message


def test_of_the_dual_march(renderer):
    result = check(renderer, scene_of(FLAT, error=0.004), method="dual")
    assert result.stats.map is None
    rough = renderer.render(scene_of(FLAT, error=0.1), method="dual").scene
    assert rough.march.steps < result.scene.march.steps


def test_of_fog(renderer):
    fog = tfm.SphereVolume(density=2.0, radius=0.9)
    rough, fine = (renderer.render(scene_of(fog, error=error)) for error in (0.05, 0.0005))
    assert rough.scene.march.steps < fine.scene.march.steps
    truth = renderer.render(scene_of(fog).replace(map=tfm.MapSettings(), march=tfm.MarchSettings(steps=5000)))
    assert compare(rough.image, truth.image).lit.rmse <= 0.05 * HONEST
    assert compare(fine.image, truth.image).lit.rmse <= 0.0005 * HONEST


@pytest.mark.slow
def test_of_a_crop(renderer):
    crop = (20, 10, 40, 30)
    result = check(renderer, scene_of(), crop=crop)
    assert result.image.shape == (20, 20, 4)


@pytest.mark.slow
def test_a_sample_of_the_pixels_is_honest(renderer, monkeypatch):
    monkeypatch.setattr(accuracy, "PIXELS", 400)
    monkeypatch.setattr(accuracy, "LEAST_PIXELS", 400)
    scene = scene_of()
    check(renderer, scene.replace(camera=CAMERA.replace(res=(240, 180))))


@pytest.mark.slow
def test_maps_are_built_for_it_and_serve(renderer):
    scene = scene_of()
    maps = renderer.build_maps(scene)
    own, given = renderer.render(scene), renderer.render(scene, maps=maps)
    np.testing.assert_array_equal(own.image, given.image)
    assert given.stats.error_estimate <= scene.map.max_error


@pytest.mark.slow
def test_the_choice_is_kept_for_the_next_frame(renderer, monkeypatch):
    scene = scene_of()
    first = renderer.render(scene)

    def fail(*_):
        raise AssertionError("chosen again")

    monkeypatch.setattr(accuracy.Chooser, "choice", fail)
    again = renderer.render(scene)
    np.testing.assert_array_equal(first.image, again.image)
    assert first.stats.error_estimate == again.stats.error_estimate
    with pytest.raises(AssertionError, match="chosen again"):
        renderer.render(scene_of())


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        scene_of(camera=CAMERA.replace(to=(0.6, 0.8, 9))),
        scene_of(of_map={"coeffs": 4}, medium=tfm.Medium(sigma_s=0.0, sigma_a=1.0)),
        scene_of(tfm.Volume(np.zeros((4, 4, 4)))),
    ],
    ids=["looks away", "black", "empty"],
)
def test_a_picture_without_light_errs_by_nothing(renderer, scene):
    result = renderer.render(scene)
    assert result.stats.error_estimate == 0
    assert not result.image[..., :3].any()


def test_without_it_there_is_no_estimate(renderer):
    assert renderer.render(make_scene()).stats.error_estimate is None


def test_settings_leave_to_it_what_is_not_given():
    settings = tfm.MapSettings(max_error=0.01, steps=77)
    assert (settings.res, settings.steps, settings.coeffs) == ("auto", 77, "auto")
    assert scene_of().march.steps == "auto"
    assert scene_of(march=tfm.MarchSettings(steps=9)).march.steps == 9
    assert scene_of(march=tfm.MarchSettings(sampling="world")).march.steps == "auto"


@pytest.mark.parametrize("error", [0.3, 0.0])
def test_difference_is_the_metric(rng, error):
    truth = rng.uniform(0, 1, (12, 14, 4)).astype(np.float32)
    truth[:4] = 0
    image = truth + error * rng.normal(size=truth.shape).astype(np.float32)
    image[:4] = 7  # is not lit
    expected = compare(image, truth).lit.rmse

    assert accuracy.difference(image, truth) == pytest.approx(expected, rel=1e-6)
    assert accuracy.difference(image, truth, surely=True) >= expected


def test_a_change_ends_at_the_limits(renderer):
    numbers = accuracy.Numbers(steps=8192, light_steps=17, res=3000, coeffs=32)
    chooser = accuracy.Chooser(renderer.render, scene_of(), "tfm", (0, 0, 48, 36), lambda *_: None)
    assert chooser._changed(numbers, "steps", 2) is None
    assert chooser._changed(numbers, "coeffs", 2) is None
    assert chooser._changed(numbers, "res", 2) == dataclasses.replace(numbers, res=4096)
    assert chooser._changed(numbers, "light_steps", 0.5) == dataclasses.replace(numbers, light_steps=16)
    assert chooser._changed(dataclasses.replace(numbers, light_steps=16), "light_steps", 0.5) is None
    assert chooser._changed(numbers, "coeffs", 0.5).coeffs == 24


class Pretended:
    """Renders nothing: pictures that err as a march and a map would, and what was asked of them."""

    def __init__(self):
        self.asked = []

    def __call__(self, scene, method, crop):
        self.asked.append((scene, method))
        width, height = crop[2] - crop[0], crop[3] - crop[1]
        error = 20 / scene.march.steps**2
        if scene.grids and scene.lights:
            error += 20 / scene.map.steps**2
            if method == "tfm":
                error += 3 / scene.map.res + 0.02 / scene.map.coeffs
        return SimpleNamespace(image=np.full((height, width, 4), 1 + error, np.float32))


MIXTURES = {
    "grid": [VOLUME],
    "grid and box": [VOLUME, tfm.BoxVolume()],
    "two media": [VOLUME, CUBE.with_medium(tfm.Medium(sigma_s=3.0))],
    "fog": [tfm.EverywhereVolume()],
    "box and ball": [tfm.BoxVolume(), tfm.SphereVolume()],
}


@pytest.mark.quick("grid and box-lit-tfm", "fog-without lights-dual")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("lights", [[SPOT], []], ids=["lit", "without lights"])
@pytest.mark.parametrize("name", MIXTURES)
def test_every_mixture_is_chosen_for(name, lights, method):
    scene = scene_of(MIXTURES[name], 0.02, lights=lights, of_map={"basis": "moments"})
    render = Pretended()
    choice = accuracy.Chooser(render, scene, method, (0, 0, 48, 36), lambda *_: None).choice()

    assert 0 <= choice.estimate <= 0.02
    assert choice.scene.bodies == scene.bodies
    assert choice.scene.map.max_error is None
    assert type(choice.scene.march.steps) is int
    marched = bool(scene.grids and lights)
    assert (choice.scene.map.steps > 1) is marched
    assert any(asked == "tfm" for _, asked in render.asked) is (method == "tfm")
