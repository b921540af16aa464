import numpy as np
import pytest

from tfm_cl.files.image_io.display import SHOWN_AS, automatic_exposure, shown, straight
from tfm_cl.files.image_io.views import VIEWS


def cloud(side=40):
    """A premultiplied grey blob, brighter on one side, in the middle of nothing."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, side)] * 2)
    alpha = np.clip(2 - 3 * np.hypot(x, y), 0, 1)
    light = alpha * (0.3 + 0.2 * x)
    return np.stack([light, light, light, alpha], axis=2).astype(np.float32)


def test_straight_colours():
    rgba = np.array([[0.2, 0.1, 0, 0.5], [3, 3, 3, 0], [1e-30, 0, 0, 1e-38]], np.float32)
    np.testing.assert_allclose(straight(rgba), [[0.4, 0.2, 0], [0, 0, 0], [1e8, 0, 0]], rtol=1e-6)


@pytest.mark.parametrize("view", VIEWS)
def test_what_is_bright_is_shown_as_bright(view):
    picture = cloud()
    light = shown(picture[..., :3], automatic_exposure(picture, view), view)[..., 0]
    lit = light[picture[..., 3] > 0]
    assert (lit > SHOWN_AS + 0.01).mean() < 0.02
    assert lit.max() > SHOWN_AS


def test_it_follows_the_light():
    picture = cloud()
    stops = automatic_exposure(picture, "agx")
    assert automatic_exposure(8 * picture, "agx") == pytest.approx(stops - 3, abs=0.011)  # both rounded
    assert automatic_exposure(picture[..., :3], "agx") == pytest.approx(stops, abs=0.1)


def test_neither_surroundings_nor_single_pixels_matter():
    picture = cloud()
    stops = automatic_exposure(picture, "standard")
    wide = np.pad(picture, [(200, 200), (200, 200), (0, 0)])
    assert automatic_exposure(wide, "standard") == stops
    wall = wide.copy()
    wall[wide[..., 3] == 0] = [1e-6, 1e-6, 1e-6, 1]  # opaque, and as good as dark
    assert automatic_exposure(wall, "standard") == pytest.approx(stops, abs=0.1)
    picture[20, 20, :3] = 1e6
    assert automatic_exposure(picture, "standard") == pytest.approx(stops, abs=0.05)
    few = np.full((3, 3, 4), 0.1, np.float32)
    few[1, 1, :3] = 1e6
    assert automatic_exposure(few, "standard") == pytest.approx(np.log2(SHOWN_AS / 0.1), abs=0.01)


def test_transparent_pictures_are_exposed_for_their_straight_colours():
    veil = np.full((8, 8, 4), 0.1, np.float32)
    opaque = automatic_exposure(veil, "standard")
    assert automatic_exposure(veil, "standard", transparent=True) == pytest.approx(
        opaque - np.log2(10), abs=0.011
    )


def test_every_picture_has_an_exposure():
    black = np.zeros((4, 5, 4), np.float32)
    assert automatic_exposure(black, "aces") == 0
    assert automatic_exposure(np.full((1, 1, 4), 3e38, np.float32), "aces") == -100
    assert automatic_exposure(np.full((1, 1, 4), 1e-45, np.float32), "aces") == 100
    glow = black.copy()
    glow[..., 0] = 0.5  # without alpha
    assert automatic_exposure(glow, "standard") == pytest.approx(np.log2(SHOWN_AS / (0.5 * 0.2126)), abs=0.01)
