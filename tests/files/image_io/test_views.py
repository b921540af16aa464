import numpy as np
import pytest

from tfm_cl.files.image_io.display import grey_shown_as, shown
from tfm_cl.files.image_io.views import VIEWS, filmic
from tfm_cl.files.srgb import srgb_from_linear

GREYS = np.concatenate([[0], np.logspace(-10, 10, 5001)])


def on_display(colours, view, stops=0.0):
    return shown(np.asarray(colours, np.float64), stops, view)


def test_the_names_are_those_promised():
    assert list(VIEWS) == ["standard", "filmic", "agx", "aces"]


@pytest.mark.parametrize("view", VIEWS)
def test_greys_stay_grey_and_in_order(view):
    light = on_display(np.repeat(GREYS[:, np.newaxis], 3, axis=1), view)
    assert np.abs(light - light[:, :1]).max() < 1e-12  # rounding
    assert np.diff(light[:, 0]).min() >= 0
    assert light[0].tolist() == [0, 0, 0]
    assert 0.99 < light.max() <= 1


@pytest.mark.parametrize("view", VIEWS)
def test_no_light_is_too_much_or_too_little(view):
    extremes = np.array([0, 1e-45, 1e-20, 1, 3.4e38])
    colours = np.stack(np.meshgrid(extremes, extremes, extremes), axis=-1)
    for stops in (-100, 0, 100):
        light = on_display(colours, view, stops)
        assert light.shape == colours.shape
        assert ((light >= 0) & (light <= 1)).all()
    assert on_display(np.full(3, -1.0), view).tolist() == [0, 0, 0]


@pytest.mark.parametrize("view", VIEWS)
def test_a_grey_is_found_by_what_it_is_shown_as(view):
    for light in (1.5e-4, 0.01, 0.2, 0.9):
        grey = grey_shown_as(light, view)
        assert on_display(np.full(3, grey), view) == pytest.approx(np.full(3, light), rel=1e-6)


def test_standard_is_only_an_exposure_and_a_clip():
    np.testing.assert_allclose(on_display([[0.1, 0.3, 0.9]], "standard", 1), [[0.2, 0.6, 1]], rtol=1e-12)


def test_filmic_is_hables_quotient():
    """As he printed it, for each channel."""

    def printed(x, a=0.15, b=0.50, c=0.10, d=0.20, e=0.02, f=0.30):
        return ((x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f)) - e / f

    values = np.array([[0.02, 0.18, 0.5], [1, 3, filmic.WHITE / 2]])
    np.testing.assert_allclose(on_display(values, "filmic"), printed(2 * values) / printed(11.2), rtol=1e-12)


def test_agx_has_its_middle_grey_and_turns_bright_colours_white():
    # The curve passes through half of the codes at 0.18; the polynomial is within twice 0.002 of it.
    assert on_display(np.full(3, 0.18), "agx") ** (1 / 2.2) == pytest.approx(0.5, abs=0.004)
    saturation = [np.ptp(on_display([x, 0.1 * x, 0.1 * x], "agx")) for x in (0.5, 8, 1e4)]
    assert saturation[0] > 0.3
    assert saturation[2] < 0.01 < saturation[1]


def test_aces_looks_as_with_opencolorio():
    """OpenColorIO 2.6, cg-config v2.2.0, ACES 1.3, "ACES 1.0 - SDR Video" on sRGB: codes."""
    expected = {
        (0.045, 0.045, 0.045): (0.1121, 0.1121, 0.1121),
        (0.18, 0.18, 0.18): (0.356, 0.356, 0.356),
        (1, 1, 1): (0.812, 0.812, 0.812),
        (16, 16, 16): (0.9997, 0.9997, 0.9997),
        (0.8, 0.4, 0.1): (0.7742, 0.5883, 0.2857),
        (0.1, 0.3, 0.9): (0.2634, 0.4979, 0.7913),
        (2, 0.5, 0.2): (0.9375, 0.688, 0.4595),
    }
    codes = srgb_from_linear(on_display(list(expected), "aces"))
    np.testing.assert_allclose(codes, list(expected.values()), atol=0.02)  # Hill's fit, to the eye
