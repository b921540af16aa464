"""Blurs of maps against float64 convolutions, and what a blur of coefficients means."""

import numpy as np
import pytest
from tolerances import FLOAT32

from tfm_cl.device.launch import Launcher
from tfm_cl.errors import DeviceMemoryError
from tfm_cl.maps import prefilter
from tfm_cl.maps.prefilter import Prefilter, windows

BOX_PASS = 5 * FLOAT32
"""One box along one axis, relative to the largest value: sum and error, weighted ends, scale."""

BOX = 2 * BOX_PASS
"""Along both axes."""

RESIDUE = 100 * FLOAT32**2
"""What some hundred additions to a compensated sum leave behind, of the largest value gone."""

GAUSSIAN = prefilter.GAUSSIAN_BOXES * BOX
"""The boxes that make it."""

GAUSSIAN_STEP = 0.012
"""Of a step's height, between three boxes and a Gaussian: documented (0.0113 at width 8.5)."""

GAUSSIAN_RANGE = 0.032
"""Of a signal's range, likewise: half the absolute difference of the weights (0.0314 at width 5)."""

GAUSSIAN_WIDE = 0.065
"""Both, for widths of several maps: margins are no wider than the map."""

WIDTHS = [0.4, 1, 1.5, 2, 3, 4, 4.75, 20, 33, 36.5, 37, 73, 74, 75.5, 333, 1e6, 1e12, 1e30]


def blur(launcher, values, width, kernel="box"):
    """Blur [res, res, n] on the device."""
    res, _, n = values.shape
    blurred, seconds = Prefilter(launcher).blur(
        launcher.upload("the map", values.astype(np.float32)), res, n, width, kernel
    )
    assert seconds >= 0
    return launcher.download(blurred, values.shape, np.float32)


def box_weights(res, width):
    """[res, res]: part of a box around each texel that lies in each texel; the outermost go on for ever."""
    width, at = max(width, 1e-3), np.arange(res)[:, None]
    edges = np.r_[-np.inf, np.arange(res - 1) + 0.5, np.inf]
    return np.diff(np.clip(edges, at - width / 2, at + width / 2), axis=1) / width


def weights_of(kernel, res):
    """[res, res] of a symmetric kernel of odd length; texels beyond the border are the border's."""
    matrix, half = np.zeros((res, res)), len(kernel) // 2
    for i in range(res):
        np.add.at(matrix[i], np.clip(np.arange(i - half, i + half + 1), 0, res - 1), kernel)
    return matrix


def boxes_kernel(width):
    """The boxes of a Gaussian as one kernel."""
    kernel = np.ones(1)
    for window in windows(width, "gaussian"):
        box = np.r_[window.part, np.ones(2 * window.reach + 1), window.part]
        kernel = np.convolve(kernel, box / box.sum())
    return kernel


def gaussian_kernel(width):
    sigma = width / np.sqrt(12)
    x = np.arange(np.ceil(9 * sigma)) + 1
    kernel = np.exp(-((np.r_[-x[::-1], 0, x] / sigma) ** 2) / 2)
    return kernel / kernel.sum()


def along_both(weights, values):
    """Apply the weights along y and x of [y, x, n]."""
    return np.einsum("ij,jkn,lk->iln", weights, values.astype(np.float64), weights, optimize=True)


def operator(launcher, res, width, kernel):
    """[res, res]: the weights that the device applies along x, as it blurs every texel's indicator."""
    return blur(launcher, np.broadcast_to(np.eye(res), (res, res, res)), width, kernel)[res // 2]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(("res", "n"), [(1, 3), (2, 1), (37, 1), (37, 5), (16, 8)])
def test_box_is_the_convolution(launcher, rng, res, n, width):
    values = rng.standard_normal((res, res, n)).astype(np.float32)

    blurred = blur(launcher, values, width)

    expected = along_both(box_weights(res, width), values)
    assert np.abs(blurred - expected).max() < BOX * np.abs(values).max()


@pytest.mark.parametrize("width", [0.3, 1, 2, 2.4, 3.3, 5, 12, 20, 60])
@pytest.mark.parametrize(("res", "n"), [(1, 3), (37, 5), (64, 2)])
def test_gaussian_is_its_three_boxes(launcher, rng, res, n, width):
    values = rng.standard_normal((res, res, n)).astype(np.float32)

    blurred = blur(launcher, values, width, "gaussian")

    expected = along_both(weights_of(boxes_kernel(width), res), values)
    assert np.abs(blurred - expected).max() < GAUSSIAN * np.abs(values).max()
    assert res == 1 or np.abs(blurred - values).max() > 100 * GAUSSIAN


@pytest.mark.parametrize("width", [5, 6.4, 8.5, 10, 16, 33, 64, 140])
def test_gaussian_is_nearly_one_up_to_the_border(launcher, width):
    difference = operator(launcher, 37, width, "gaussian") - weights_of(gaussian_kernel(width), 37)

    assert np.abs(difference).sum(axis=1).max() / 2 < GAUSSIAN_RANGE
    assert np.abs(np.cumsum(difference, axis=1)).max() < GAUSSIAN_STEP


@pytest.mark.parametrize("width", [200, 320, 1000, 10_000])
def test_gaussian_wider_than_the_map(launcher, width):
    difference = operator(launcher, 37, width, "gaussian") - weights_of(gaussian_kernel(width), 37)

    assert np.abs(difference).sum(axis=1).max() / 2 < GAUSSIAN_WIDE


@pytest.mark.parametrize("width", [0.5, 1, 2, 3.7, 7, 12.5])
def test_gaussian_has_the_variance_of_a_box(launcher, width):
    weights = operator(launcher, 37, width, "gaussian")[18].astype(np.float64)

    offsets = np.arange(37) - 18
    assert weights.sum() == pytest.approx(1, abs=GAUSSIAN)
    assert weights @ offsets == pytest.approx(0, abs=37 * GAUSSIAN)
    assert weights @ offsets**2 == pytest.approx(width**2 / 12, abs=37 * GAUSSIAN)


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
def test_width_0_is_the_map_itself(launcher, rng, kernel):
    values = rng.standard_normal((5, 5, 2)).astype(np.float32)
    buffer = launcher.upload("the map", values)

    assert Prefilter(launcher).blur(buffer, 5, 2, 0.0, kernel) == (buffer, 0.0)
    assert (blur(launcher, values, 5e-324, kernel) == values).all()


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
def test_the_map_given_stays_as_it_is(launcher, rng, kernel):
    values = rng.standard_normal((9, 9, 4)).astype(np.float32)
    buffer = launcher.upload("the map", values)

    blurred, _ = Prefilter(launcher).blur(buffer, 9, 4, 4.5, kernel)

    assert (launcher.download(buffer, values.shape, np.float32) == values).all()
    assert not (launcher.download(blurred, values.shape, np.float32) == values).all()


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
@pytest.mark.parametrize("width", [2, 5.5, 40, 1e9, 1e300])
def test_a_constant_stays(launcher, kernel, width):
    values = np.broadcast_to(np.float32([0.7, -300, 1e-20]), (23, 23, 3))

    assert np.abs(blur(launcher, values, width, kernel) / values - 1).max() < GAUSSIAN


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
def test_mean_is_preserved_inside(launcher, rng, kernel):
    values = np.zeros((37, 37, 3), np.float32)
    values[12:25, 12:25] = rng.random((13, 13, 3))

    blurred = blur(launcher, values, 9.3, kernel)

    assert (blurred[0] == 0).all()  # nothing has reached the border
    assert (blurred.max(axis=(0, 1)) < 0.8 * values.max(axis=(0, 1))).all()
    means = values.mean(axis=(0, 1), dtype=np.float64)
    np.testing.assert_allclose(blurred.mean(axis=(0, 1), dtype=np.float64), means, rtol=GAUSSIAN)


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
@pytest.mark.parametrize("width", [3, 7.7, 333])
def test_blur_is_linear(launcher, rng, kernel, width):
    one, other = rng.standard_normal((2, 37, 37, 4)).astype(np.float32)

    together = blur(launcher, one + 3 * other, width, kernel)

    apart = blur(launcher, one, width, kernel) + 3 * blur(launcher, other, width, kernel)
    largest = (np.abs(one) + 3 * np.abs(other)).max()
    assert np.abs(together - apart).max() < 3 * GAUSSIAN * largest
    assert np.abs(together).max() > 1000 * GAUSSIAN * largest * (width < 300)


def test_what_has_left_the_window_leaves_no_trace(launcher):
    # An uncompensated sum of 1e6 each would leave some 0.1 a texel behind.
    values = np.full((256, 256, 1), 0.01, np.float32)
    values[:, :40] = 1e6 * np.random.default_rng(3).random((256, 40, 1))

    blurred = blur(launcher, values, 11)

    far = blurred[:, 46:]
    assert np.abs(far - 0.01).max() < RESIDUE * 1e6 + BOX * 0.01
    assert blurred[:, :40].min() > 1e4


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
def test_short_launches_change_nothing(launcher, rng, kernel, monkeypatch):
    values = rng.standard_normal((37, 37, 5)).astype(np.float32)
    whole = blur(launcher, values, 6.2, kernel)

    monkeypatch.setattr(prefilter, "LAUNCH_FLOATS", 1000)

    assert (blur(launcher, values, 6.2, kernel) == whole).all()


def test_too_large_for_the_device(launcher):
    small = Launcher(launcher.device, largest_buffer=1 << 12)
    buffer = small.upload("the map", np.zeros((32, 32, 1), np.float32))

    Prefilter(small).blur(buffer, 32, 1, 5, "box")
    with pytest.raises(DeviceMemoryError, match="the blurred map needs a buffer of"):
        Prefilter(small).blur(buffer, 32, 1, 5, "gaussian")  # its margins are too much


# --------------------------------------------------------------------------- what it means

DEPTHS = 24


def cosines(count, edges):
    """[count, cells]: integrals over the cells between the edges of cos(j π z / 2), j = 0, 1, 2, …"""
    return np.array([np.diff(edges if j == 0 else np.sin(j * np.pi / 2 * edges) / (j * np.pi / 2))
                     for j in range(count)])  # fmt: skip


def columns_of_density(rng, res):
    """Density [z, y, x] that parallel light crosses along z: one column a texel, much of it empty."""
    return rng.gamma(0.5, 4.0, (DEPTHS, res, res)) * (rng.random((DEPTHS, res, res)) < 0.4)


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
@pytest.mark.parametrize("width", [2.5, 9])
def test_blurred_coefficients_are_those_of_the_blurred_density(launcher, rng, kernel, width):
    density, integrals = columns_of_density(rng, 37), cosines(8, np.linspace(0, 1, DEPTHS + 1))
    coefficients = np.einsum("nz,zyx->yxn", integrals, density)

    blurred = blur(launcher, coefficients, width, kernel)

    weights = box_weights(37, width) if kernel == "box" else weights_of(boxes_kernel(width), 37)
    smooth = along_both(weights, density.transpose(1, 2, 0))
    expected = smooth @ integrals.T
    # Half a unit in the last place more: the coefficients themselves were rounded to float32.
    assert np.abs(blurred - expected).max() < (GAUSSIAN + FLOAT32) * np.abs(coefficients).max()
    assert np.abs(blurred - coefficients).max() > 0.1 * np.abs(coefficients).max()


@pytest.mark.parametrize("kernel", ["box", "gaussian"])
def test_filtering_density_darkens(launcher, rng, kernel):
    # Jensen: exp(-mean of τ), the geometric mean of T, is at most the mean of T. Two coefficients: τ and T.
    depth = columns_of_density(rng, 37).sum(axis=0) / DEPTHS
    values = np.stack([depth, np.exp(-depth)], axis=-1)

    mean_depth, mean_transmittance = np.moveaxis(blur(launcher, values, 7.5, kernel), -1, 0)

    filtered = np.exp(-mean_depth.astype(np.float64))
    rounding = GAUSSIAN * (1 + depth.max())
    assert (filtered <= mean_transmittance + rounding).all()
    assert filtered.mean() < mean_transmittance.mean() - 0.01


def test_half_a_hole_is_no_hole(launcher):
    # Every other column is opaque, τ = 8: half the light passes, but a filtered density lets e^-4 through.
    opaque = np.indices((64, 64)).sum(axis=0) % 2
    values = np.stack([8.0 * opaque, np.exp(-8.0 * opaque)], axis=-1)

    depth, transmittance = blur(launcher, values, 32)[32, 32]

    assert np.exp(-depth) == pytest.approx(np.exp(-4), rel=1e-5)
    assert transmittance == pytest.approx((1 + np.exp(-8)) / 2, rel=1e-5)
