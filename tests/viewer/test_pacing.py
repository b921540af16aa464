"""How large low pictures are."""

import pytest

from tfm_cl.viewer.pacing import FIRST_WIDTH, LEAST_WIDTH, Pacer

FULL = 960, 540


def after(pacer, pictures, seconds, full=FULL):
    """Sizes of some pictures that take ``seconds(pixels)`` each."""
    sizes = []
    for _ in range(pictures):
        width, height = pacer.size(full)
        sizes.append((width, height))
        pacer.took(seconds(width * height), (width, height))
    return sizes


@pytest.mark.parametrize(
    ("pace", "overhead", "least", "most"),
    [(2e-7, 0.01, 0.03, 0.055), (1e-6, 0.0, 0.05, 0.06), (5e-7, 0.035, 0.05, 0.07), (2e-6, 0.02, 0.06, 0.1)],
)
def test_pictures_come_soon_and_slow_ones_at_the_wanted_rate(pace, overhead, least, most):
    pacer = Pacer(10.0)

    sizes = after(pacer, 20, lambda pixels: overhead + pace * pixels)

    width, height = sizes[-1]
    assert least < overhead + pace * width * height <= most
    assert width >= FIRST_WIDTH or pace > 1e-6
    assert width / height == pytest.approx(16 / 9, abs=0.03)
    assert sizes[-5:] == [sizes[-1]] * 5


def test_sizes_do_not_jitter(rng):
    pacer = Pacer(10.0)
    after(pacer, 20, lambda pixels: 1e-6 * pixels)

    sizes = after(pacer, 100, lambda pixels: 1e-6 * pixels * rng.uniform(0.85, 1.15))

    assert len(set(sizes)) == 1


def test_slow_pictures_keep_a_least_width():
    assert after(Pacer(10.0), 20, lambda pixels: 1.0 + 1e-3 * pixels)[-1] == (LEAST_WIDTH, 90)


def test_fast_pictures_are_no_larger_than_the_full_one():
    pacer = Pacer(10.0)
    assert after(pacer, 20, lambda _: 1e-3)[-1] == FULL

    sizes = after(pacer, 5, lambda pixels: 1e-6 * pixels)

    assert sizes[-1][0] < FULL[0] / 2  # what was fast for long is not waited for


def test_small_and_tall_pictures():
    assert Pacer(10.0).size((100, 50)) == (100, 50)
    width, height = Pacer(10.0).size((540, 960))
    assert width / height == pytest.approx(540 / 960, rel=0.02)
