"""What a render returns, without rendering."""

import io

import numpy as np
import PIL.Image
import pytest

import tfm_cl as tfm
from tfm_cl.files.image_io import load_image
from tfm_cl.render.result import RenderResult, RenderStats


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
