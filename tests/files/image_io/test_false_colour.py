"""Colour maps and the ranges that they span."""

import numpy as np
import pytest

from tfm_cl.files.image_io.false_colour import (
    COLOURS,
    coloured,
    range_around_zero,
    range_from_zero,
    range_of,
)

BETWEEN = 6
"""Of 255: between stops colours are interpolated, which Matplotlib's are within 5 of; and a rounding."""


@pytest.mark.parametrize("name", ["viridis", "magma"])
def test_colours_are_matplotlib_s(name):
    matplotlib = pytest.importorskip("matplotlib")
    numbers = np.linspace(0, 1, 256)
    expected = 255 * matplotlib.colormaps[name](numbers)[:, :3]
    assert np.abs(coloured(numbers, (0, 1), name) - expected).max() < BETWEEN


def test_what_is_beyond_the_ends_has_the_last_colours():
    first, last = COLOURS["viridis"][0], COLOURS["viridis"][-1]
    found = coloured(np.array([[-np.inf, 2, 3, np.inf, np.nan]], np.float32), (2, 3), "viridis")
    np.testing.assert_array_equal(found, [[first, first, last, last, first]])
    np.testing.assert_array_equal(coloured(np.array([1.0, 5]), (5, 5), "viridis"), [first, first])


def test_signed_colours_are_black_in_the_middle():
    low, middle, high = coloured(np.array([-1.0, 0, 1]), (-1, 1), "signed").astype(int)
    np.testing.assert_array_equal(middle, [0, 0, 0])
    assert low[2] > low[0]  # blue
    assert high[0] > high[2]  # orange


def test_a_range_is_that_of_most_numbers():
    numbers = np.zeros((100, 100), np.float32)
    numbers[20:80] = np.random.default_rng(3).uniform(4, 6, (60, 100))
    low, high = range_of(numbers)
    assert low == pytest.approx(4, abs=0.05)
    assert high == pytest.approx(6, abs=0.05)
    # A horizon: a tenth of all is a thousand times as far away.
    numbers[74:80] *= 1000
    assert range_of(numbers)[0] == pytest.approx(low, abs=0.05)
    assert 6 < range_of(numbers)[1] < 12
    numbers[:2] = [[np.nan], [np.inf]]
    assert np.isfinite(range_of(numbers)).all()


@pytest.mark.parametrize("choose", [range_of, range_from_zero])
def test_where_there_is_nothing_the_range_is_that_of_parts(choose):
    assert choose(np.zeros((3, 4), np.float32)) == (0, 1)
    assert choose(np.full((3, 4), np.nan, np.float32)) == (0, 1)


def test_errors_begin_at_none_and_signed_numbers_are_centred():
    numbers = np.linspace(0, 0.2, 201)
    assert range_from_zero(numbers) == pytest.approx((0, 0.2), rel=0.01)
    assert range_around_zero(-numbers) == pytest.approx((-0.2, 0.2), rel=0.01)
    assert range_of(np.full(5, 7.0)) == (7, 7)
