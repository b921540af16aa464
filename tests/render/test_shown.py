"""Layers of a picture as people see them, without rendering."""

import io
from dataclasses import replace

import numpy as np
import PIL.Image
import pytest

import tfm_cl as tfm
from tfm_cl.errors import ImageError, InputError
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.render.html import LONGEST_SIDE, MOST_BYTES, MOST_LAYERS
from tfm_cl.render.result import RenderResult, RenderStats
from tfm_cl.render.shown import PICTURE, shown_layer

SIZE = (6, 8)


@pytest.fixture
def result():
    rng = np.random.default_rng(0)
    box = tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1), density=1)
    scene = tfm.Scene(box, camera=tfm.Camera(from_=(0, 0, 5), to=(0, 0, 0), res=(30, 20)), lights=[])
    image = rng.random((*SIZE, 4), np.float32)
    normal = np.zeros((*SIZE, 3), np.float32)
    normal[0] = 0, 1, 0
    depth = np.zeros(SIZE, np.float32)
    depth[1:] = rng.uniform(3, 4, (SIZE[0] - 1, SIZE[1]))
    aovs = {
        "depth": depth,
        "transmittance": rng.random((*SIZE, 3), np.float32),
        "normal": normal,
        "ambient": rng.random((*SIZE, 3), np.float32),
        "light.key": rng.random((*SIZE, 3), np.float32),
        "map_error": rng.random(SIZE, np.float32) / 100,
    }
    return RenderResult(image, aovs, RenderStats("none"), scene, crop=(3, 5, 11, 11))


def png_of(result, **options):
    with PIL.Image.open(io.BytesIO(result._repr_png_(**options))) as picture:
        return np.asarray(picture)


@pytest.mark.parametrize("stops", [0.0, -1.5, "auto"])
def test_the_picture_is_that_of_a_png(result, stops):
    shown = shown_layer(result, PICTURE, exposure=stops, view="agx")
    np.testing.assert_array_equal(shown.pixels, png_of(result, exposure=stops, view="agx"))
    assert shown.exposure == (automatic_exposure(result.image, "agx") if stops == "auto" else stops)
    assert shown.range is None


@pytest.mark.parametrize("name", ["ambient", "light.key"])
def test_light_is_exposed_as_the_picture_is(result, name):
    shown = shown_layer(result, name, exposure="auto", view="filmic")
    alone = replace(result, image=np.dstack([result.aovs[name], result.image[..., 3]]))
    assert shown.exposure == shown_layer(result, PICTURE, exposure="auto", view="filmic").exposure
    np.testing.assert_array_equal(shown.pixels, png_of(alone, exposure=shown.exposure, view="filmic"))


@pytest.mark.parametrize("name", ["transmittance", "normal", "depth", "map_error"])
def test_what_is_no_light_is_not_exposed(result, name):
    shown, brighter = (
        shown_layer(result, name, exposure=stops, view=view).pixels
        for stops, view in ((0, "standard"), (3, "agx"))
    )
    np.testing.assert_array_equal(shown, brighter)


def test_colours_of_layers(result):
    half = replace(result, aovs=result.aovs | {"transmittance": np.full((*SIZE, 3), 0.5, np.float32)})
    assert (shown_layer(half, "transmittance").pixels == 188).all()  # sRGB
    normals = shown_layer(result, "normal").pixels
    assert normals[0, 0].tolist() == [128, 255, 128]
    assert not normals[1:].any()
    depth = shown_layer(result, "depth")
    assert not depth.pixels[0].any()
    assert depth.pixels[1:].any(axis=-1).all()
    assert 3 <= depth.range[0] < depth.range[1] <= 4
    error = shown_layer(result, "map_error")
    assert error.range[0] == 0
    assert (depth.colours, error.colours) == ("viridis", "magma")


def test_two_results_are_shown_alike(result):
    nearer = replace(result, image=result.image / 4, aovs=result.aovs | {"depth": result.aovs["depth"] / 2})
    one, other = (shown_layer(of, "depth", exposure="auto") for of in (result, nearer))
    assert one.range != other.range
    alike = shown_layer(nearer, "depth", exposure="auto", like=one)
    assert (alike.range, alike.exposure) == (one.range, one.exposure)


def test_what_cannot_be_shown_is_told(result):
    with pytest.raises(
        InputError, match=r"unknown layer 'detph'; did you mean 'depth'\? known: beauty, depth"
    ):
        shown_layer(result, "detph")
    with pytest.raises(ImageError, match="unknown view 'raw'"):
        shown_layer(result, PICTURE, view="raw")


def test_a_notebook_has_the_layers_to_choose_from(result):
    page = result._repr_html_()
    assert page.count('type="radio"') == page.count("<img ") == 1 + len(result.aovs)
    assert page.count(" checked>") == 1
    assert "depth: opacity-weighted mean distance" in page
    assert "RenderResult(8×6 pixels" in page
    assert not any(word in page for word in ("<script", "http:", "https:", " id="))


def test_its_size_is_bounded(result):
    rng = np.random.default_rng(1)
    size = 40, 4 * LONGEST_SIDE
    many = {f"light.{n}": rng.random((*size, 3), np.float32) for n in range(2 * MOST_LAYERS)}
    wide = replace(result, image=rng.random((*size, 4), np.float32), aovs=many, crop=(0, 0, *size[::-1]))
    page = wide._repr_html_()
    assert page.count("<img ") == MOST_LAYERS
    assert f"{1 + len(many) - MOST_LAYERS} more layers are in result.aovs" in page
    assert len(page) < 4 / 3 * MOST_BYTES + 1e5
