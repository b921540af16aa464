"""Images that colour a light: reading, reducing, errors, and which way up they are."""

import os

import numpy as np
import PIL.Image
import pytest
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.files import image_io, texture
from tfm_cl.files.image_io.image import Image
from tfm_cl.files.texture import TEXTURE_RES, reduced
from tfm_cl.scene.lights import EnvironmentLight
from tfm_cl.scene.lights.texels import look_up


def spot(path, **keys):
    return tfm.SpotLight(**{"from_": (0, 0, 4), "to": (0, 0, 0), "cone": 30, "texture": str(path), **keys})


def test_none_without_a_path():
    light = spot("")

    assert light.texture_image() is None
    assert (light.intensity_at(np.zeros((3, 2))) == 1).all()


def test_a_png_is_decoded_and_premultiplied(tmp_path):
    pixels = np.zeros((2, 3, 4), np.uint8)
    pixels[..., 3] = 255
    pixels[0, 0] = (188, 0, 255, 255)
    pixels[1, 2] = (255, 255, 255, 0)  # transparent: dark, whatever its colour
    PIL.Image.fromarray(pixels).save(tmp_path / "slide.png")

    image = spot(tmp_path / "slide.png").texture_image()

    assert image.shape == (2, 3, 3)
    assert image.dtype == np.float32
    assert image[0, 0] == pytest.approx([((188 / 255 + 0.055) / 1.055) ** 2.4, 0, 1], abs=1e-6)
    assert not image[1, 2].any()
    assert not image.flags.writeable


def test_exr_and_npy_are_taken_as_they_are(tmp_path, rng):
    image = rng.uniform(0, 50, (5, 4, 3)).astype(np.float32)
    np.save(tmp_path / "slide.npy", image)
    rgba = np.dstack([image, np.ones((5, 4), np.float32)])
    image_io.save(tmp_path / "slide.exr", Image(rgba=rgba), pixel_type="float")

    for name in ("slide.npy", "slide.exr"):
        assert (spot(tmp_path / name).texture_image() == image).all()


def test_a_path_object_will_do(tmp_path):
    np.save(tmp_path / "slide.npy", np.ones((1, 1, 3)))
    for kind in (spot, lambda path: EnvironmentLight(texture=path)):
        light = kind(tmp_path / "slide.npy")
        assert light.texture == str(tmp_path / "slide.npy")
        assert light.to_dict()["texture"] == light.texture


def test_a_changed_file_is_read_again(tmp_path):
    path = tmp_path / "slide.npy"
    np.save(path, np.ones((2, 2, 3)))
    light = spot(path)
    first = light.texture_image()
    assert light.texture_image() is first  # kept

    np.save(path, np.zeros((2, 2, 3)))
    os.utime(path, ns=(1, 1))

    assert not light.texture_image().any()


@pytest.mark.parametrize("shape", [(3000, 10), (10, 5000), (4096, 2049), (7, 7)], ids=str)
def test_large_images_are_averaged(shape, rng):
    image = rng.uniform(0, 1, (*shape, 3)).astype(np.float32)

    small = reduced(image)

    assert small.shape[:2] == tuple(min(n, TEXTURE_RES) for n in shape)
    np.testing.assert_allclose(small.mean(axis=(0, 1)), image.mean(axis=(0, 1)), rtol=1e-4)


def test_averages_are_over_areas():
    image = np.arange(6, dtype=np.float32).reshape(6, 1, 1).repeat(3, axis=2)

    assert reduced(image, 3)[:, 0, 0].tolist() == [0.5, 2.5, 4.5]
    # 1.5 rows each: (0 + ½·1) / 1.5, (½·1 + 2) / 1.5, …
    np.testing.assert_allclose(reduced(image, 4)[:, 0, 0], [1 / 3, 5 / 3, 10 / 3, 14 / 3], rtol=1e-6)


def test_it_is_upright_and_not_mirrored_from_behind_the_light(tmp_path):
    image = np.zeros((2, 2, 3))
    image[0, 0], image[0, 1], image[1, 0] = (
        (1, 0, 0),
        (0, 1, 0),
        (0, 0, 1),
    )  # top left, top right, bottom left
    np.save(tmp_path / "slide.npy", image)
    light = spot(tmp_path / "slide.npy")  # looks along -z: right is +x, up +y

    points = np.array([[-1.0, 1, 0], [1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    colours = light.intensity_at(light.arrival(points).position)

    assert colours.argmax(axis=1).tolist()[:3] == [0, 1, 2]
    assert (colours[:3].max(axis=1) > 0.7).all()
    assert colours[3].max() < 0.2


def test_look_up_is_bilinear_and_clamps():
    image = np.array([[[0.0], [1.0]], [[2.0], [4.0]]])  # top row first
    positions = np.array([[0.25, 0.75], [0.75, 0.75], [0.5, 0.5], [0, 0], [2, -3], [0.5, 1]])

    np.testing.assert_allclose(look_up(image, positions)[:, 0], [0, 1, 1.75, 2, 4, 0.5], atol=ROUNDED)


def test_the_square_meets_the_cone(tmp_path):
    # A ramp in u: at the cone's right edge its last texel.
    np.save(tmp_path / "ramp.npy", np.tile(np.linspace(0, 1, 256)[None, :, None], (1, 1, 3)))
    light = spot(tmp_path / "ramp.npy", intensity=(2, 2, 2))
    edge = 4 * np.tan(np.radians(30))
    position = light.arrival(np.array([[-edge, 0, 0], [0, 0, 0], [edge, 0, 0]])).position

    np.testing.assert_allclose(light.intensity_at(position)[:, 0], [0, 1, 2], atol=1e-6)


def test_a_texture_is_not_in_the_map(tmp_path):
    assert spot("").map_key() == spot(tmp_path / "any.png").map_key()
    parts = spot("a.png", radius=0.5, samples=3).parts()
    assert [part.texture for part in parts] == ["a.png"] * 3


BAD = {
    "negative": np.full((2, 2, 3), -1.0),
    "nan": np.full((2, 2, 3), np.nan),
    "infinite": np.full((2, 2, 3), np.inf),
}


@pytest.mark.parametrize("kind", BAD)
def test_impossible_pixels_are_one_line(tmp_path, kind):
    np.save(tmp_path / "bad.npy", BAD[kind])
    for use in (
        spot(tmp_path / "bad.npy").texture_image,
        EnvironmentLight(texture=tmp_path / "bad.npy").parts,
    ):
        with pytest.raises(SceneError) as raised:
            use()
        assert f"light.texture: {tmp_path / 'bad.npy'}: should hold finite numbers" in str(raised.value)
        assert "x=0, y=0" in str(raised.value)
        assert "\n" not in str(raised.value)


def test_unusable_files_are_one_line(tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "a.jpg").write_text("")
    (tmp_path / "folder.png").mkdir()
    for name, message in (
        ("missing.png", "cannot be read (No such file or directory)"),
        ("text.png", "not a readable PNG"),
        ("a.jpg", "not a known image format '.jpg'; known: .deep.exr .exr .npy .png"),
        ("folder.png", "is not a file"),
        ("nul\0.png", "without control characters"),
    ):
        with pytest.raises(SceneError) as raised:
            spot(tmp_path / name).texture_image()
        assert message in str(raised.value)
        assert str(raised.value).startswith("light.texture")
        assert "\n" not in str(raised.value)
    with pytest.raises(SceneError, match=r"light\.texture = 3: should be the name of an image file"):
        tfm.SpotLight(from_=(0, 0, 1), to=(0, 0, 0), texture=3)


def test_light_too_bright_for_float32_is_refused(tmp_path):
    np.save(tmp_path / "bright.npy", np.full((1, 1, 3), 1e20))

    assert spot(tmp_path / "bright.npy", intensity=9e4).texture_image() is not None
    with pytest.raises(SceneError, match=r"1e\+20 times the intensity 1e\+06 should be at most 1e\+25"):
        spot(tmp_path / "bright.npy", intensity=1e6).texture_image()
    with pytest.raises(SceneError, match="should be at most"):
        EnvironmentLight(texture=tmp_path / "bright.npy", intensity=1e6).parts()


def test_memory_of_kept_images_is_bounded():
    assert texture.KEPT * TEXTURE_RES**2 * 3 * 4 < 256 * 2**20
