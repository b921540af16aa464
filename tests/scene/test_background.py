"""Surroundings behind the picture: which pixel shows what, and how it is filtered."""

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.scene.background import radiance_behind
from tfm_cl.scene.lights.environment import directions_of
from tfm_cl.scene.lights.panorama import means
from tfm_cl.scene.lights.texels import look_up

ROUNDED = 1e-6
"""Of float32, in which pictures are."""
SKY = 1e-5
"""Of radiance in float32: exponentials near the horizon, cosines near the sun; of the sun's, at its edge."""
SUMS = 1e-9
"""Differences of sums over an image, in float64."""


def camera(to, fov=60.0, res=(24, 16), up=(0.0, 1.0, 0.0)):
    return tfm.Camera(from_=(3, 4, 5), to=np.add((3, 4, 5), to), fov=fov, res=res, up=up)


@pytest.fixture
def image(tmp_path):
    """A function that writes an image, and returns its light."""

    def write(pixels, **keys):
        np.save(tmp_path / "sky.npy", np.asarray(pixels, np.float32))
        return tfm.EnvironmentLight(texture=str(tmp_path / "sky.npy"), **keys)

    return write


def test_close_up_it_is_bilinear_and_goes_on_at_the_sides(rng):
    picture = rng.random((12, 20, 3)).astype(np.float32)
    u, v = rng.random((2, 200))
    v = 1 / 24 + v * 11 / 12  # beyond the poles' middles rows end
    directions = np.array(
        [directions_of(np.array([row]), np.array([column]))[0, 0] for row, column in zip(v, u, strict=True)]
    )
    tiled = np.concatenate([picture] * 3, axis=1)
    expected = look_up(tiled, np.column_stack([(u + 1) / 3, 1 - v]))
    np.testing.assert_allclose(means(picture, directions, np.full(200, 1e-4)), expected, rtol=SUMS)


def test_from_afar_it_is_the_mean(rng):
    fine = np.indices((180, 360)).sum(axis=0) % 2  # as fine as can be: half of it is lit
    picture = np.repeat(fine[..., None], 3, axis=2).astype(np.float32)
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # Pixels of 10° hold 10 × 10 and more of the image's: what is cut off at their edges is left.
    assert np.abs(means(picture, directions, np.full(300, np.radians(10))) - 0.5).max() < 0.02
    wide = means(picture, np.array([[0.0, 1, 0], [0, 0, 1]]), np.full(2, 10.0))
    np.testing.assert_allclose(wide, 0.5, rtol=SUMS)


def test_a_camera_sees_the_image_upright_and_not_mirrored(image):
    pixels = np.zeros((64, 128, 3))
    pixels[:32, :64, 0] = 1  # up and to the left of +z
    pixels[32:, 64:, 1] = 2
    picture = radiance_behind([image(pixels, intensity=3)], camera((0, 0, 1)))
    np.testing.assert_allclose(picture[:7, :11], np.broadcast_to((3, 0, 0), (7, 11, 3)), rtol=ROUNDED)
    np.testing.assert_allclose(picture[9:, 13:], np.broadcast_to((0, 6, 0), (7, 11, 3)), rtol=ROUNDED)
    assert max(picture[:7, 13:].max(), picture[9:, :11].max()) < SUMS


def test_surroundings_add_up_in_every_part_of_the_frame(image, monkeypatch):
    lights = [
        image(np.full((4, 8, 3), 0.5)),
        tfm.PointLight(from_=(0, 0, 0)),
        tfm.EnvironmentLight(intensity=2),
    ]
    view = camera((1, 9, 0.2))
    np.testing.assert_allclose(radiance_behind(lights, view), 2.5, rtol=ROUNDED)
    sky = [tfm.SkyLight()]
    whole = radiance_behind(sky, view)
    monkeypatch.setattr("tfm_cl.scene.background.BLOCK", 50)  # some rows at a time
    np.testing.assert_array_equal(radiance_behind(sky, view, (2, 3, 17, 15)), whole[3:15, 2:17])


@pytest.mark.parametrize("up", ["y", (0.3, 1, -0.2)])
def test_a_sky_that_is_seen_is_that_in_every_direction_in_float64(up):
    view = camera((0.3, 0.1, 1), fov=40.0, res=(240, 160))
    _, directions = view.rays((0, 20, 240, 150))
    seen, cosines = view.directions((0, 20, 240, 150))
    np.testing.assert_allclose(seen, directions, atol=ROUNDED)
    np.testing.assert_allclose(cosines, directions @ view.world_from_camera[:3, 2], rtol=ROUNDED)
    width = view.pixel_width * np.asarray(cosines, np.float64) ** 1.5
    for sun in (False, True):
        sky = tfm.SkyLight(elevation=4, azimuth=18, up=up, sun=sun)
        expected = sky.radiance(directions, width).reshape(130, 240, 3)
        least = SKY * expected.max() if sun else 0
        found = radiance_behind([sky], view, (0, 20, 240, 150))
        np.testing.assert_allclose(found, expected, rtol=SKY, atol=least)
        assert (expected.max() > 1000 * np.median(expected)) == sun  # it is in the picture
