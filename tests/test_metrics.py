"""Image metrics against values computed by hand and against scikit-image's own reading."""

import json
import sys
from types import ModuleType

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from tfm_cl.errors import ImageError, InputError
from tfm_cl.metrics import compare, flip

RNG = np.random.default_rng(7)


def grey(value, height=16, width=16, alpha=None):
    """A constant image."""
    image = np.full((height, width, 3), value, dtype=np.float32)
    return image if alpha is None else np.dstack([image, np.full((height, width), alpha, np.float32)])


def srgb_byte(value):
    """Linear value that the sRGB standard encodes as value / 255 (above the linear toe)."""
    return ((value / 255 + 0.055) / 1.055) ** 2.4


@pytest.fixture
def cloud():
    """A soft disc of alpha on a black background, 40 rows by 48 columns."""
    y, x = np.mgrid[:40, :48]
    alpha = np.clip(1.2 - np.hypot(y - 20, x - 24) / 12, 0, 1)
    image = alpha[..., None] * np.array([0.9, 0.7, 0.5, 1.0]) * (1 + 0.2 * np.sin(x / 3))[..., None]
    image[..., 3] = alpha
    return image.astype(np.float32)


def test_identical_images(cloud):
    found = compare(cloud, cloud)

    assert (found.ssim, found.psnr, found.rmse) == pytest.approx((1.0, np.inf, 0.0))
    assert (found.lit.ssim, found.lit.psnr, found.lit.rmse) == pytest.approx((1.0, np.inf, 0.0))


def test_psnr_of_a_known_step():
    # The brightest pixels are the white; elsewhere sRGB 128 against 118: an error of 10/255 over 15/16.
    truth, shown = grey(srgb_byte(128)), grey(srgb_byte(118))
    truth[0] = shown[0] = 1.0

    expected = 20 * np.log10(25.5) - 10 * np.log10(15 / 16)

    assert compare(shown, truth).psnr == pytest.approx(expected, abs=1e-4)


def test_psnr_in_the_linear_toe_of_srgb():
    truth, shown = grey(0.002), grey(0.001)
    truth[0] = shown[0] = 1.0

    expected = -10 * np.log10((12.92 * 0.001) ** 2 * 15 / 16)

    assert compare(shown, truth).psnr == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("channel", "weight"), [(0, 0.2126), (1, 0.7152), (2, 0.0722)])
def test_luma_weights(channel, weight):
    truth = grey(1.0)
    shown = truth.copy()
    shown[..., channel] = 0.0

    assert compare(shown, truth).psnr == pytest.approx(-20 * np.log10(weight), abs=1e-4)


def test_rmse_is_relative_to_the_reference_mean():
    assert compare(grey(2.5), grey(2.0)).rmse == pytest.approx(0.25)
    assert compare(grey(2.0), grey(2.5)).rmse == pytest.approx(0.2)


def test_display_metrics_ignore_a_common_exposure(cloud):
    shown = cloud * np.array([0.9, 0.9, 0.9, 1], np.float32)
    dark = compare(shown * 1e-3, cloud * 1e-3 + np.array([0, 0, 0, 1e-2], np.float32) * cloud[..., 3:])
    bright = compare(shown, cloud)

    assert (dark.ssim, dark.psnr, dark.rmse) == pytest.approx((bright.ssim, bright.psnr, bright.rmse), 1e-4)


def test_a_few_bright_pixels_do_not_set_the_white():
    truth, shown = grey(1.0, 64, 64), grey(0.8, 64, 64)
    # 4 of 4096 pixels lie above the 99.9th percentile.
    bright_truth, bright_shown = truth.copy(), shown.copy()
    bright_truth[0, :4] = bright_shown[0, :4] = 1e4

    assert compare(bright_shown, bright_truth).psnr == pytest.approx(compare(shown, truth).psnr, abs=0.01)


def test_values_above_white_are_clipped():
    found = compare(grey(5.0), grey(1.0))

    assert found.psnr == np.inf
    assert found.ssim == pytest.approx(1.0)
    assert found.rmse == pytest.approx(4.0)


def test_ssim_is_scikit_images_on_encoded_luma():
    truth = RNG.uniform(0.2, 1.0, (24, 32, 3))
    shown = truth + RNG.normal(0, 0.05, truth.shape)
    white = np.percentile(truth @ [0.2126, 0.7152, 0.0722], 99.9)

    def luma(image):
        linear = np.clip(image / white, 0, 1)
        return (1.055 * linear ** (1 / 2.4) - 0.055) @ [0.2126, 0.7152, 0.0722]

    expected = structural_similarity(
        luma(truth),
        luma(shown),
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1,
    )

    assert compare(shown, truth).ssim == pytest.approx(expected, abs=1e-12)


def test_more_noise_is_worse(cloud):
    noise = RNG.normal(0, 1, cloud.shape).astype(np.float32) * cloud[..., 3:]
    found = [compare(cloud + level * noise, cloud) for level in (0.01, 0.03, 0.1)]

    for one in (found, [each.lit for each in found]):
        assert one[0].ssim > one[1].ssim > one[2].ssim
        assert one[0].psnr > one[1].psnr > one[2].psnr
        assert one[0].rmse < one[1].rmse < one[2].rmse


def test_lit_mask_leaves_the_background_out():
    truth, shown = grey(0.0, 20, 20, alpha=0.0), grey(0.0, 20, 20, alpha=0.0)
    truth[5:10, :] = 1.0
    shown[5:10, :] = (0.5, 0.5, 0.5, 1.0)
    shown[15:] = 0.3  # light where the reference has none
    encoded = 1.055 * 0.5 ** (1 / 2.4) - 0.055

    found = compare(shown, truth)

    assert found.lit.psnr == pytest.approx(-20 * np.log10(1 - encoded), abs=1e-4)
    assert found.lit.rmse == pytest.approx(0.5)
    assert found.rmse == pytest.approx(np.sqrt(0.25 * (0.25 + 0.09)) / 0.25)


def test_lit_ssim_is_not_flattered_by_the_background(cloud):
    wide = np.pad(cloud, ((40, 40), (40, 40), (0, 0)))
    tight, padded = (compare(image * np.float32(0.8), image) for image in (cloud, wide))

    assert padded.psnr > tight.psnr + 6
    assert padded.lit.psnr == pytest.approx(tight.lit.psnr, abs=0.1)
    assert padded.lit.rmse == pytest.approx(tight.lit.rmse)
    assert padded.ssim - padded.lit.ssim > 0.005
    assert padded.lit.ssim == pytest.approx(tight.lit.ssim, abs=1e-3)


@pytest.mark.parametrize(("alpha", "is_lit"), [(0.0009, False), (0.0011, True)])
def test_lit_threshold_of_alpha(alpha, is_lit):
    assert (compare(grey(0.5), grey(0.5, alpha=alpha)).lit is not None) is is_lit


def test_without_alpha_lit_is_luminance_above_zero():
    truth = grey(0.0)
    truth[:4] = 1.0

    assert compare(truth * np.float32(0.9), truth).lit.rmse == pytest.approx(0.1)


def test_black_reference():
    found = compare(grey(0.5), grey(0.0))

    assert found.rmse == np.inf
    assert found.psnr < 10
    assert found.lit is None
    assert compare(grey(0.0), grey(0.0)).rmse == 0


def test_to_dict_is_valid_json(cloud):
    found = compare(cloud, cloud).to_dict()

    assert json.loads(json.dumps(found, allow_nan=False)) == {
        "ssim": pytest.approx(1),
        "psnr": None,
        "rmse": 0,
        "lit": {"ssim": pytest.approx(1), "psnr": None, "rmse": 0},
    }
    assert compare(grey(0.5), grey(0.0)).to_dict()["lit"] is None


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (10, 10), (10, 11), (11, 11)])
def test_smaller_than_the_ssim_window(shape):
    truth = RNG.uniform(0.2, 1, (*shape, 3))

    assert compare(truth, truth).ssim == pytest.approx(1)
    assert compare(truth * 0.5, truth).ssim < 0.99


def test_ssim_of_one_pixel():
    # No variance: SSIM is its luminance term, of luma 1 against the encoded half.
    encoded = 1.055 * 0.5 ** (1 / 2.4) - 0.055

    expected = (2 * encoded + 1e-4) / (encoded**2 + 1 + 1e-4)

    assert compare(grey(0.5, 1, 1), grey(1.0, 1, 1)).ssim == pytest.approx(expected)


@pytest.mark.parametrize(
    ("test", "reference", "message"),
    [
        (grey(1.0, 8, 9), grey(1.0, 8, 10), "9×8 pixels and the reference 10×8"),
        (grey(np.nan), grey(1.0), "test image: 768 values are NaN, .* nan in channel R of pixel x=0, y=0"),
        (grey(1.0), grey(np.inf), "reference image: 768 values"),
        (np.ones((4, 4)), grey(1.0), r"shape \(4, 4\)"),
        (np.ones((0, 4, 3)), grey(1.0), r"shape \(0, 4, 3\)"),
        (np.ones((4, 4, 2)), grey(1.0), r"shape \(4, 4, 2\)"),
        (np.ones((16, 16, 3), np.uint8), grey(1.0), "floating-point.*uint8"),
    ],
)
def test_what_cannot_be_compared(test, reference, message):
    with pytest.raises(ImageError, match=message) as caught:
        compare(test, reference)

    assert "\n" not in str(caught.value)


def test_alpha_of_the_test_image_plays_no_part(cloud):
    assert compare(cloud[..., :3] * np.float32(0.9), cloud) == compare(cloud * np.float32(0.9), cloud)


def test_results_are_immutable(cloud):
    with pytest.raises(AttributeError):
        compare(cloud, cloud).ssim = 2.0


def test_flip_says_what_to_install(cloud, monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)

    with pytest.raises(InputError, match=r"pip install 'tfm_cl\[flip\]'"):
        flip(cloud, cloud)


def test_flip_is_given_the_reference_first_and_its_exposures(cloud, monkeypatch):
    calls = []

    def evaluate(reference, test, dynamic_range, **options):
        calls.append((reference, test, dynamic_range, options["parameters"]))
        return None, 0.25, {}

    fake = ModuleType("flip_evaluator")
    fake.evaluate = evaluate
    monkeypatch.setitem(sys.modules, "flip_evaluator", fake)

    assert flip(cloud * np.float32(0.5) - np.float32(0.1), cloud) == 0.25
    reference, test, dynamic_range, exposures = calls[0]
    white = np.percentile(cloud[..., :3].astype(float) @ [0.2126, 0.7152, 0.0722], 99.9)
    np.testing.assert_array_equal(reference, cloud[..., :3])
    assert test.min() == 0
    assert dynamic_range == "HDR"
    assert exposures["startExposure"] == pytest.approx(-np.log2(white))
    assert exposures["stopExposure"] - exposures["startExposure"] == exposures["numExposures"] - 1


def test_flip_of_the_real_package(cloud):
    pytest.importorskip("flip_evaluator", reason="the extra `flip` is not installed")

    assert flip(cloud, cloud) == 0
    assert 0 < flip(cloud * np.float32(0.9), cloud) < flip(cloud * np.float32(0.5), cloud) < 1
