"""What pages show of results, errors and maps."""

from types import SimpleNamespace

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import ImageError, InputError
from tfm_cl.viewer.messages import Show
from tfm_cl.viewer.pictures import (
    LARGEST_GAIN,
    beside,
    error_picture,
    figures,
    seen_depth,
    shown,
    shown_map,
)

SIZE = (24, 32)


def result_of(image, **aovs):
    lights = [tfm.PointLight(from_=(0, 2, 0), name="key"), tfm.PointLight(from_=(0, 3, 0))]
    camera = SimpleNamespace(res=SIZE[::-1])
    return SimpleNamespace(
        image=image, aovs=aovs, crop=(0, 0, *SIZE[::-1]), scene=SimpleNamespace(lights=lights, camera=camera)
    )


@pytest.fixture
def result():
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in SIZE), indexing="ij")
    alpha = np.clip(1.5 - 2 * np.hypot(x, y), 0, 1).astype(np.float32)
    image = np.stack([0.7 * alpha, 0.5 * alpha, 0.3 * alpha, alpha], axis=-1)
    return result_of(
        image, depth=4 * alpha, **{"light.key": image[..., :3] / 2, "light.2": image[..., :3] / 4}
    )


def test_a_group_shows_its_light(result):
    one, other = (shown(result, Show(layer="lights", light=light)).pixels for light in (0, 1))
    assert one.max() > other.max() > 0
    with pytest.raises(InputError, match=r"layer 'lights' of light 2: the scene has 2"):
        shown(result, Show(layer="lights", light=2))
    with pytest.raises(InputError, match="unknown layer 'ambient'"):
        shown(result, Show(layer="ambient"))


def test_of_numbers_the_range_is_told(result):
    found = shown(result, Show(layer="depth"))
    assert found.pixels.shape == (*SIZE, 3)
    assert 0 < found.range[0] < found.range[1] <= 4
    assert shown(result, Show()).range is None


def test_a_pixel_shows_what_is_seen_most():
    through = np.array([[[0.9] * 3, [0.9] * 3, [0.2] * 3, [1] * 3]], np.float32)
    depth, solid = np.array([[3, 3, 3, 0]], np.float32), np.array([[0, 5, 5, 5]], np.float32)
    layers = {"depth": depth, "transmittance": through}
    np.testing.assert_array_equal(seen_depth(layers), depth)
    np.testing.assert_array_equal(seen_depth(layers | {"solid_distance": solid}), [[3, 5, 3, 5]])


def test_an_error_is_blue_where_it_is_too_dark():
    right = np.full((10, 20, 3), 100, np.uint8)
    test = right.copy()
    test[0], test[1] = 90, 110
    pixels, gain = error_picture(test, right)
    assert gain == pytest.approx(255 / 10, rel=0.05)
    dark, bright = pixels[0, 0].astype(int), pixels[1, 0].astype(int)
    assert dark[2] > dark[0]
    assert bright[0] > bright[2]
    assert not pixels[2:].any()
    # A few that stand out do not hide the rest.
    test[2, 0] = 255
    assert error_picture(np.tile(test, (20, 1, 1)), np.tile(right, (20, 1, 1)))[1] < gain
    test = np.tile(test, (1, 20, 1))
    test[2, 1:] = 100
    assert error_picture(test, np.full_like(test, 100))[1] == gain


def test_pictures_that_are_equal_have_no_error():
    same = np.full((4, 5, 3), 7, np.uint8)
    pixels, gain = error_picture(same, same)
    assert gain == 1
    assert not pixels.any()
    other = same.copy()
    other[0, 0, 2] = 8  # of luma .0722/255
    assert error_picture(other, same)[1] == LARGEST_GAIN
    with pytest.raises(ImageError, match="5×4 and 4×4 pixels cannot be compared"):
        error_picture(same, same[:, 1:])


def test_pictures_beside_each_other_are_shown_alike(result):
    darker = result_of(result.image * np.array([0.5, 0.5, 0.5, 1], np.float32), **result.aovs)
    found = beside(darker, result, Show(exposure="auto"))
    assert found.a.exposure == found.b.exposure
    assert found.a.pixels.max() > found.b.pixels.max() / 2
    assert (found.error[..., 2] >= found.error[..., 0]).all()
    assert found.error.any()
    assert beside(darker, result, Show(layer="depth")).gain == 1


def test_figures_are_those_of_lit_pixels(result):
    assert figures(result, result) == {"ssim": 1, "psnr": None, "rmse": 0}
    darker = result_of(result.image * np.array([0.9, 0.9, 0.9, 1], np.float32))
    found = figures(darker, result)
    lit = tfm.compare(darker.image, result.image).lit
    assert found == {"ssim": lit.ssim, "psnr": lit.psnr, "rmse": lit.rmse}
    black = result_of(np.zeros_like(result.image))
    assert figures(black, black) == {"ssim": 1, "psnr": None, "rmse": 0}


def test_maps_are_seen_as_their_light_sees():
    numbers = np.zeros((8, 8, 3), np.float32)
    numbers[0, :, 0] = 5  # the lowest v
    numbers[0, :, 1], numbers[7, :, 1] = -2, 2
    light_map = SimpleNamespace(coefficients=numbers)
    pixels = shown_map(light_map, 0).pixels
    assert pixels[7].sum() > pixels[0].sum()
    signed = shown_map(light_map, 1)
    assert signed.range == (-2, 2)
    assert not signed.pixels[1:7].any()
    assert signed.pixels[7, 0, 2] > signed.pixels[7, 0, 0]
    assert not np.ptp(shown_map(light_map, 2).pixels, axis=(0, 1)).any()
    for number in (-1, 3):
        with pytest.raises(InputError, match=f"coefficient {number}: the map has 3"):
            shown_map(light_map, number)
