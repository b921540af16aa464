"""Layers of what each light adds: the float64 reference, and their sum, which is the picture."""

import numpy as np
import pytest
from scenes import make_scene
from tolerances import FLOAT32, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError
from tfm_cl.plan import orders
from tfm_cl.render import buffers
from tfm_cl.render import orders as of_orders

pytestmark = pytest.mark.lanes

SUMS = 20 * FLOAT32
"""Of the brightest: each light is added to the picture and to its layer in another order."""
HELD = 5e-3
"""Of the brightest: a lattice interpolates logarithms of the sum of its lights, or those of each."""

SMALL = make_scene()
GLOWING = SMALL.medium.replace(emission=(0.5, 1.0, 2.0))
SUN = tfm.SunLight(from_=(1, 2, 1), to=(0, 0, 0))
SKY = tfm.EnvironmentLight(samples=3, name="sky", intensity=0.3)
SCENE = SMALL.replace(
    medium=GLOWING,
    lights=[SMALL.lights[0].replace(name="key"), SUN, SKY],
    solids=[tfm.SphereSolid(centre=(0.5, 0.6, 0.3), radius=0.3), tfm.PlaneSolid(point=(0, -0.8, 0))],
    ambient=tfm.Ambient(radiance=(0.1, 0.2, 0.3)),
    shadow=tfm.ShadowSettings(res=64),
)
OF_LIGHTS = ("light.key", "light.2", "light.sky")
BOX = tfm.BoxVolume(from_=(-0.9, -0.5, -0.6), to=(0.4, 0.7, 0.3), density=0.7, medium=GLOWING)
CASES = {
    "maps": (SCENE, "tfm"),
    "two media, of which one glows": (
        SCENE.replace(volume=[SMALL.volume.with_medium(SMALL.medium), BOX]),
        "dual",
    ),
    "lights that share samples, octaves": (
        SCENE.replace(
            lights=[SUN.replace(name="key"), SUN.replace(from_=(-1, 2, 3)), SKY],
            medium=GLOWING.replace(octaves=2),
            march=SCENE.march.replace(sampling="world"),
        ),
        "tfm",
    ),
    "what media emit lights others": (SCENE.replace(medium=GLOWING.replace(emission_lights=3)), "tfm"),
    "later orders": (SCENE.replace(medium=GLOWING.replace(orders=3)), "tfm"),
}


def assert_adds_up(result, *names):
    """The layers of some names sum to the picture."""
    total = sum(result.aovs[name].astype(np.float64) for name in names)
    image = result.image[..., :3]
    assert np.abs(total - image).max() < SUMS * image.max()


def assert_equals_reference(result, scene, method, names):
    _, expected = reference.render_with_aovs(scene, method, shadows="map")
    for name in names:
        assert expected[name].max() > 1e-2, name
        assert np.abs(result.aovs[name] - expected[name]).max() < 10 * PASS, name


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["isotropic", "hg:0.6"])
@pytest.mark.parametrize("samples", [1, 4])
def test_layers_of_orders_equal_the_reference_and_sum_to_the_picture(renderer, monkeypatch, phase, samples):
    """Those up to some order are all of a scene that has no more."""
    monkeypatch.setattr(orders, "WORK", 1)
    monkeypatch.setattr(orders, "WORK_OF_LOBE", 1)
    scene = SMALL.replace(
        medium=GLOWING.replace(phase=phase, orders=4), lights=SCENE.lights[:1], ambient=SCENE.ambient
    )
    result = renderer.render(scene, aovs=("orders", "ambient"), samples=samples)
    layers = [f"orders.{order}" for order in (1, 2, 3, 4)]
    assert_adds_up(result, *layers, "emission", "ambient")
    if samples > 1:
        return
    up_to = [
        reference.render_with_aovs(scene.replace(medium=scene.medium.replace(orders=count)))[1]["orders"]
        for count in (2, 3)
    ]
    assert np.abs(result.aovs["orders.3"] - (up_to[1] - up_to[0])).max() < 20 * PASS


@pytest.mark.slow
def test_layers_of_orders_that_need_too_much_are_refused(renderer, monkeypatch):
    monkeypatch.setattr(of_orders, "MOST_BYTES_APART", 1)
    scene = SMALL.replace(medium=SMALL.medium.replace(orders=2))
    with pytest.raises(SceneError, match=r"image\.aov: 2 layers of orders need .* fewer medium\.orders"):
        renderer.render(scene, aovs=("orders",))


def test_layers_equal_the_reference_and_sum_to_the_picture(renderer):
    result = renderer.render(SCENE, method="dual", aovs=("lights", "ambient"))
    names = (*OF_LIGHTS, "ambient", "emission")
    assert_adds_up(result, *names)
    assert_equals_reference(result, SCENE, "dual", names)
    # Alone, ambient light is the same, and lights have no layers.
    ambient = renderer.render(SCENE, method="dual", aovs=("ambient",)).aovs
    np.testing.assert_array_equal(ambient["ambient"], result.aovs["ambient"])
    assert not set(OF_LIGHTS) & set(ambient)


@pytest.mark.slow
@pytest.mark.parametrize("what", CASES)
def test_they_cost_no_sample_and_change_nothing(renderer, monkeypatch, what):
    monkeypatch.setattr(orders, "WORK", 1)
    scene, method = CASES[what]
    plain = renderer.render(scene, method=method)
    result = renderer.render(scene, method=method, aovs=("lights", "ambient"))
    assert "ambient" not in plain.aovs
    np.testing.assert_array_equal(result.image, plain.image)
    expected = plain.aovs["samples"]
    if scene.medium.octaves > 1:
        # What octaves add to a layer is known when the camera's rays are: these are marched before.
        expected = expected + renderer.render(scene.replace(lights=[]), method=method).aovs["samples"]
    np.testing.assert_array_equal(result.aovs["samples"], expected)
    others = [name for name in ("emission_light", "orders") if name in result.aovs]
    names = (*OF_LIGHTS, "ambient", "emission", *others)
    assert_adds_up(result, *names)
    assert_equals_reference(result, scene, method, names)


@pytest.mark.slow
def test_lights_on_a_lattice(renderer):
    """One march serves all of them, and light that is looked up at each sample besides."""
    scene = SCENE.replace(solids=[], map=SCENE.map.replace(lookup="lattice"))
    plain = renderer.render(scene)
    result = renderer.render(scene, aovs=("lights", "ambient"))
    assert_adds_up(result, *OF_LIGHTS, "ambient", "emission")
    assert np.abs(result.image - plain.image).max() < HELD * plain.image.max()
    np.testing.assert_array_equal(result.aovs["samples"], plain.aovs["samples"])
    for name, light in zip(OF_LIGHTS, scene.lights, strict=True):
        alone = renderer.render(scene.replace(lights=[light], ambient=tfm.Ambient(), medium=SMALL.medium))
        np.testing.assert_allclose(result.aovs[name], alone.image[..., :3], atol=PASS, err_msg=name)


@pytest.mark.slow
def test_a_lattice_holds_so_many_layers(renderer):
    suns = [SUN.replace(from_=(x, 3, 1)) for x in range(9)]
    scene = SCENE.replace(solids=[], lights=suns, map=SCENE.map.replace(lookup="lattice"))
    result = renderer.render(scene, aovs=("lights", "ambient"))
    assert any("a lattice holds layers of 8 lights, and 9 are asked for" in line for line in result.warnings)
    assert_adds_up(result, *(f"light.{number}" for number in range(1, 10)), "ambient", "emission")


def test_layers_are_bounded(renderer, monkeypatch):
    monkeypatch.setattr(buffers, "MOST_LAYER_BYTES", 1000)
    with pytest.raises(SceneError, match=r"^image\.aov: 4 layers of lights need .* GiB at 24×18 pixels"):
        renderer.render(SCENE, aovs=("lights",))


@pytest.mark.slow
def test_lights_of_one_name_have_no_layers(renderer):
    scene = SCENE.replace(lights=[SKY, SKY])
    with pytest.raises(SceneError, match=r'^light 1: light\.name = "sky": light 0 is called so, too'):
        renderer.render(scene, aovs=("lights",))
