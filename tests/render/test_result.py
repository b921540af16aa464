"""What a render returns, without rendering."""

import io
from dataclasses import replace

import numpy as np
import OpenEXR
import PIL.Image
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.files.image_io import exr, load_image
from tfm_cl.render.result import RenderResult, RenderStats
from tfm_cl.scene.background import radiance_behind

ROUNDED = 3e-7
"""Of float32: a product and a sum."""


@pytest.fixture
def result():
    box = tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1), density=1)
    scene = tfm.Scene(box, camera=tfm.Camera(from_=(0, 0, 5), to=(0, 0, 0), res=(30, 20)), lights=[])
    image = np.random.default_rng(0).random((8, 9, 4), np.float32)
    image[..., :3] *= image[..., 3:]
    return RenderResult(image, {}, RenderStats("none"), scene, crop=(3, 5, 12, 13))


def test_a_notebook_is_shown_what_is_saved(result, tmp_path):
    for options in ({}, {"exposure": "auto", "view": "agx", "transparent": True, "png_bits": 16}):
        result.save(tmp_path / "a.png", **options)
        assert result._repr_png_(**options) == (tmp_path / "a.png").read_bytes()
    with PIL.Image.open(io.BytesIO(result._repr_png_())) as picture:
        assert (picture.mode, picture.size) == ("RGB", (9, 8))


def test_options_of_a_png_mean_nothing_to_other_files(result, tmp_path):
    for name in ("a.exr", "a.npy"):
        result.save(tmp_path / name, exposure="auto", view="aces", transparent=True, dither=False)
        np.testing.assert_array_equal(load_image(tmp_path / name), result.image)


def test_layers_of_lights_are_saved_by_their_names(result, tmp_path):
    scene = result.scene.replace(
        lights=[tfm.PointLight(from_=(0, 2, 0), name="key"), tfm.PointLight(from_=(0, 3, 0))]
    )
    layers = {f"light.{name}": result.image[..., :3] * share for name, share in (("key", 0.25), ("2", 0.75))}
    result = replace(result, scene=scene, aovs=layers)
    result.save(tmp_path / "a.exr", aovs=("lights",))
    for name, layer in layers.items():
        np.testing.assert_array_equal(exr.read_aov(tmp_path / "a.exr", name), layer)
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        names = set(file.channels())
    assert names == {*"RGBA", *(f"light.{name}.{c}" for name in ("key", "2") for c in "RGB")}
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr"), result.image)


@pytest.fixture
def through(result):
    """The result with its layers: what its camera's rays let through, and a solid in the first row."""
    layers = {
        "transmittance": np.random.default_rng(1).random((8, 9, 3), np.float32),
        "solid_distance": np.zeros((8, 9), np.float32),
    }
    layers["solid_distance"][0] = 3
    return replace(result, aovs=layers)


def test_a_background_is_seen_through_the_medium_but_not_through_solids(through):
    over = through.over((0.5, 1, 2))
    expected = through.image.copy()
    expected[1:, :, :3] += (0.5, 1, 2) * through.aovs["transmittance"][1:]
    np.testing.assert_allclose(over.image, expected, rtol=ROUNDED)
    # Another one takes its place.
    np.testing.assert_array_equal(over.over(1).over((0.5, 1, 2)).image, over.image)
    assert over.over(0).image is through.image
    assert through.over(0.25).background == (0.25, 0.25, 0.25)
    with pytest.raises(SceneError, match=r"^image\.background = -1: should be ≥ 0"):
        through.over(-1)


def test_surroundings_are_seen_through_each_channel_where_the_crop_is(through):
    light = tfm.SkyLight(elevation=20)
    result = replace(through, scene=through.scene.replace(lights=[light]))
    over = result.over("environment")
    behind = radiance_behind([light], result.scene.camera)[5:13, 3:12]
    behind[0] = 0  # a solid
    expected = result.image[..., :3] + behind * result.aovs["transmittance"]
    np.testing.assert_allclose(over.image[..., :3], expected, rtol=ROUNDED)
    np.testing.assert_array_equal(over.image[..., 3], result.image[..., 3])
    assert over.background == "environment"
    assert over.picture(transparent=True) is result.image
    with pytest.raises(SceneError, match=r"^image\.background = 'environment': no light of the scene"):
        through.over("environment")


def test_a_transparent_picture_has_no_background(through, tmp_path):
    over = through.over((0.5, 1, 2))
    for name, options in (("a.png", {}), ("b.png", {"transparent": True, "exposure": "auto"})):
        over.save(tmp_path / name, **options)
        assert over._repr_png_(**options) == (tmp_path / name).read_bytes()
    assert over._repr_png_() != through._repr_png_()
    assert over._repr_png_(**options) == through._repr_png_(**options)
    over.save(tmp_path / "a.exr", transparent=True)
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr"), over.image)
