"""The elementary functions of the kernels and the steps of a march, over their whole domains, in float64."""

import numpy as np
import pytest
from kernel_calls import Calls
from tolerances import DEVICE_FUNCTION, EXPONENT, FAST_MATH, FLOAT32, STEP

from tfm_cl import reference

pytestmark = pytest.mark.lanes

SMALLEST = float(np.finfo(np.float32).tiny)
"""The least normal float32."""
LARGEST = float(np.finfo(np.float32).max)
SPREADS = [1.0, 4.0, 50.0, 1e9]
"""The settings' max_stretch; 10⁹ is as good as the paper's, which has none."""


@pytest.fixture
def call(launcher):
    """``call(name, items, *shape, …)`` runs a kernel of ``math_functions.cl``."""
    return Calls(launcher, "math_functions.cl")


def float32s(*parts):
    """Numbers as the device gets them, without repeats, and their neighbours."""
    values = np.unique(np.concatenate([np.ravel(part) for part in parts]).astype(np.float32))
    with np.errstate(over="ignore"):
        above = np.nextafter(values, np.float32(np.inf))
    below = np.nextafter(values, np.float32(-np.inf))
    return np.unique(np.concatenate([below, values, above]))


DEPTHS = float32s(
    np.linspace(0, 90, 40_000),
    np.logspace(-37.9, 1, 20_000),
    np.log(2) * (np.arange(252) / 2),  # where the power of two changes
)
DEPTHS = DEPTHS[DEPTHS >= SMALLEST]


FUNCTIONS = (
    "transmittance_of",
    "opacity_of",
    "log_of",
    "cos_pi",
    "sin_pi",
    "reciprocal_sqrt",
    "arctangent_of",
    "exp2_of",
)


def value_of(call, name, numbers):
    """What one of the device's functions makes of numbers."""
    return call("call_fast_math", numbers, len(FUNCTIONS))[:, FUNCTIONS.index(name)]


def test_transmittance(call):
    found = value_of(call, "transmittance_of", DEPTHS)

    depths = DEPTHS.astype(np.float64)
    expected = np.exp(-np.minimum(depths, 87.0))
    inside = depths <= 87
    error = np.abs(found - expected) / expected
    assert (error[inside] <= FAST_MATH + EXPONENT * depths[inside]).all()
    # Beyond, float32 would soon have denormal numbers: one tiny number serves.
    assert found[~inside].min() >= 0
    assert found[~inside].max() <= 2 * SMALLEST


def test_opacity_keeps_all_digits_however_thin_the_medium(call):
    found = value_of(call, "opacity_of", DEPTHS)

    expected = -np.expm1(-DEPTHS.astype(np.float64))
    # Of numbers near FLT_MIN the series' terms lose digits to denormal numbers, or are 0.
    normal = DEPTHS > 2 * SMALLEST
    assert (np.abs(found - expected) <= FAST_MATH * expected)[normal].all()
    assert np.abs(found - expected)[~normal].max() <= SMALLEST
    assert found.max() == 1


def test_arctangent(call):
    tangents = float32s(np.logspace(-37, 8, 20_000), np.linspace(0, 4, 20_000))
    tangents = tangents[tangents >= 0]

    found = value_of(call, "arctangent_of", tangents)

    expected = np.arctan(tangents.astype(np.float64))
    # The polynomial's own error, and rounding.
    assert (np.abs(found - expected) <= 2e-8 * np.minimum(tangents, 1) + FAST_MATH * expected).all()


def test_transmittance_and_opacity_at_the_ends_of_the_domain(call):
    depths = np.array([0.0, 1e-45, SMALLEST / 3, 87.0, 87.5, 126.0, 128.0, 1e4, 1e30, LARGEST, np.inf])

    transmittance, opacity = (value_of(call, name, depths) for name in ("transmittance_of", "opacity_of"))

    assert transmittance[0] == 1
    assert opacity[0] == 0
    assert (transmittance[:3] == 1).all()
    assert opacity[1:3].min() >= 0
    assert opacity[1:3].max() <= SMALLEST
    assert (opacity[3:] == 1).all()
    assert transmittance[4:].min() >= 0
    assert transmittance[4:].max() <= 2 * SMALLEST


def test_transmittance_and_opacity_sum_to_1(call):
    total = value_of(call, "transmittance_of", DEPTHS) + value_of(call, "opacity_of", DEPTHS)

    assert np.abs(total - 1).max() <= 4 * FLOAT32


def test_a_thicker_medium_is_not_clearer(call):
    # To a rounding: neighbouring floats may swap.
    transmittance, opacity = (value_of(call, name, DEPTHS) for name in ("transmittance_of", "opacity_of"))

    assert (np.diff(transmittance) <= 2 * (FAST_MATH + 87 * EXPONENT) * transmittance[1:]).all()
    assert (np.diff(opacity) >= -2 * FAST_MATH * opacity[1:]).all()
    assert 0 <= opacity.min() <= opacity.max() <= 1
    assert 0 <= transmittance.min() <= transmittance.max() <= 1


def test_power_of_two(call):
    powers = float32s(
        np.arange(-252, 253) / 2, np.linspace(-126, 126, 60_000), [-0.0]
    )  # where the scale changes
    powers = powers[np.abs(powers) <= 126]

    found = value_of(call, "exp2_of", powers)

    expected = np.exp2(powers.astype(np.float64))
    assert (np.abs(found - expected) <= FAST_MATH * expected).all()
    whole = powers == np.rint(powers)
    assert (found == expected)[whole].all()


def test_powers_of_two_beyond_float32_stay_at_its_ends(call):
    found = value_of(call, "exp2_of", np.array([-1e30, -127, 127, 1e30, -np.inf, np.inf]))

    assert found.tolist() == [2.0**-126] * 2 + [2.0**126] * 2 + [2.0**-126, 2.0**126]


def test_logarithm_of_every_power_and_near_1(call):
    numbers = float32s(
        2.0 ** np.arange(-126, 128),
        np.exp2(np.linspace(-125.9, 127.9, 60_000)),
        1 + np.linspace(-0.6, 1.2, 40_000),
        1 + np.logspace(-7, 0, 2000),
        1 - np.logspace(-7, -0.01, 2000),
        np.sqrt([0.5, 2.0]),
        [1.0, LARGEST],
    )
    numbers = numbers[(numbers >= SMALLEST) & np.isfinite(numbers)]

    found = value_of(call, "log_of", numbers)

    expected = np.log(numbers.astype(np.float64))
    assert (np.abs(found - expected) <= FAST_MATH * np.abs(expected)).all()
    assert found[numbers == 1] == 0


def test_cosine_over_half_a_period(call):
    parts = float32s(np.linspace(0, 1, 100_000), np.logspace(-37, -1, 500), 1 - np.logspace(-7, -1, 500))
    parts = parts[(parts >= 0) & (parts <= 1)]

    found = value_of(call, "cos_pi", parts)

    # As sin(π (1/2 - u)), which keeps its digits where it goes through 0.
    exact = np.sin(np.pi * (0.5 - parts.astype(np.float64)))
    assert (np.abs(found - exact) <= FAST_MATH * np.abs(exact)).all()
    assert found[parts == 0] == -found[parts == 1]
    # The recurrence of the cosines grows beyond |1|.
    assert np.abs(found).max() <= 1 + 2 * FLOAT32


def test_sine_over_half_a_period(call):
    parts = float32s(np.linspace(0, 1, 100_000), np.logspace(-37, -1, 500), 1 - np.logspace(-7, -1, 500))
    parts = parts[(parts >= 0) & (parts <= 1)]

    found = value_of(call, "sin_pi", parts)

    exact = np.sin(np.pi * np.minimum(parts.astype(np.float64), 1 - parts.astype(np.float64)))
    # Of numbers near FLT_MIN the series' terms lose digits to denormal numbers, or are 0.
    assert (np.abs(found - exact) <= FAST_MATH * exact + SMALLEST).all()
    assert found[parts == 0] == found[parts == 1] == 0
    assert found.max() <= 1 + 2 * FLOAT32


def test_reciprocal_square_root(call):
    numbers = float32s(2.0 ** np.arange(-126, 128), np.exp2(np.linspace(-125.9, 127.9, 60_000)), [LARGEST])
    numbers = numbers[(numbers >= SMALLEST) & np.isfinite(numbers)]

    found = value_of(call, "reciprocal_sqrt", numbers)

    exact = 1 / np.sqrt(numbers.astype(np.float64))
    assert (np.abs(found - exact) <= FAST_MATH * exact).all()


def test_reciprocal_square_root_of_0_is_large_and_finite(call):
    found = value_of(call, "reciprocal_sqrt", np.array([0.0, 1e-45, SMALLEST / 2]))

    assert np.isfinite(found).all()
    assert found.min() > 1e18  # with x ≤ FLT_MIN, x times it is near 0: the light's distance


# ---------------------------------------------------------------------------------------- warped steps


def segments(rng):
    """Depths at the two ends of segments, equal ones and ends at the light among them."""
    depths = rng.uniform(0, 3, (200, 2))
    depths[::4] *= 10.0 ** rng.uniform(-6, 6, (50, 2))
    depths[:6] = (0, 1), (1, 0), (1e-6, 3), (3, 1e-6), (0, 0), (2, 2)
    return depths.astype(np.float32)


def steps_of(call, depths, max_stretch, steps):
    """Middles and lengths, [segments, steps] each, as fractions of the segment."""
    placed = call("call_warped_step", depths, steps, 2, max_stretch=max_stretch, steps=steps)
    return placed[..., 0], placed[..., 1]


@pytest.mark.parametrize("steps", [1, 2, 7, 41, 100, 1000])
@pytest.mark.parametrize("max_stretch", SPREADS)
def test_warped_steps_fill_the_segment_and_hold_their_middles(call, rng, max_stretch, steps):
    middles, lengths = steps_of(call, segments(rng), max_stretch, steps)

    ends = np.cumsum(lengths, axis=1)
    assert lengths.min() > 0
    assert np.abs(ends[:, -1] - 1).max() <= STEP
    assert (middles >= ends - lengths - STEP).all()
    assert (middles <= ends + STEP).all()
    assert (np.diff(middles, axis=1) >= -STEP).all()


@pytest.mark.parametrize("steps", [1, 7, 41, 100])
@pytest.mark.parametrize("max_stretch", SPREADS)
def test_warped_steps_are_the_reference_s(call, rng, max_stretch, steps):
    depths = segments(rng)
    middles, lengths = steps_of(call, depths, max_stretch, steps)

    begin, end = np.zeros(len(depths)), np.ones(len(depths))
    w = tuple(depths.T.astype(np.float64))
    bounds, expected = reference.edges(begin, end, steps, w, max_stretch)
    assert np.abs(middles - expected).max() <= STEP
    assert np.abs(lengths - np.diff(bounds, axis=1)).max() <= STEP


@pytest.mark.parametrize("max_stretch", SPREADS)
def test_lanes_with_steps_of_their_own_place_them_as_all_together(call, rng, max_stretch):
    depths, most = segments(rng), 41
    counts = rng.integers(1, most + 1, len(depths))
    counts[:6] = 1, 2, most, most, 3, 7

    placed = call(
        "call_warped_step_of_lanes",
        np.column_stack([depths, counts]),
        most,
        2,
        max_stretch=max_stretch,
        most=most,
    )

    for count in np.unique(counts):
        ours = np.flatnonzero(counts == count)
        middles, lengths = steps_of(call, depths[ours], max_stretch, int(count))
        assert np.abs(placed[ours, :count, 0] - middles).max() <= STEP
        assert np.abs(placed[ours, :count, 1] - lengths).max() <= STEP
    # What lanes that are done compute is used, times 0: it has to be finite.
    last = placed[np.arange(len(depths)), counts - 1]
    beyond = np.arange(most) >= counts[:, None]
    assert (placed == last[:, None])[beyond].all()


@pytest.mark.parametrize("max_stretch", SPREADS[:3])
def test_unwarp_undoes_the_warp(call, rng, max_stretch):
    depths = np.repeat(segments(rng), 50, axis=0)
    parts = rng.uniform(0, 1, len(depths)).astype(np.float32)
    parts[:100:2], parts[1:100:2] = 0, 1

    found = call("call_warp", np.column_stack([depths, parts]), 2, max_stretch=max_stretch)[:, 1]

    # What the warp rounds, its inverse stretches.
    assert np.abs(found - parts).max() <= max_stretch * 8 * FLOAT32
    assert (found[parts == 0] == 0).all()
    assert (found[parts == 1] == 1).all()


def test_warp_is_exactly_projective_and_ends_exactly(call, rng):
    depths = rng.uniform(0.5, 1.5, (1000, 2)).astype(np.float32)
    s = rng.uniform(0, 1, 1000).astype(np.float32)
    s[:4] = 0, 1, 0, 1

    t = call("call_warp", np.column_stack([depths, s]), 2, max_stretch=4)[:, 0]

    # A point at fraction t has depth w(t) = (1-t) wA + t wB; its projection lies at s = t wB / w(t).
    w_a, w_b = depths.T.astype(np.float64)
    assert np.allclose(t * w_b / ((1 - t) * w_a + t * w_b), s, atol=DEVICE_FUNCTION)
    assert t[:4].tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize("max_stretch", [1.0, 4.0, 50.0])
@pytest.mark.parametrize("depths", [(0, 1), (1, 0), (1e-6, 3), (0, 0), (2, 2)])
def test_no_step_is_longer_than_max_stretch_mean_steps(call, max_stretch, depths):
    s = np.linspace(0, 1, 1001)

    t = call("call_warp", np.column_stack([np.tile(depths, (1001, 1)), s]), 2, max_stretch=max_stretch)[:, 0]

    steps = np.diff(t) * 1000
    assert t[0] == 0
    assert t[-1] == 1
    assert steps.min() >= 0
    assert steps.max() <= max_stretch * 1.001


@pytest.mark.parametrize(("first", "nodes", "points", "clearance"), [(0, 6, 32, 4), (6, 4, 8, 8)])
def test_few_values_sum_a_smooth_function_over_equal_steps(call, first, nodes, points, clearance):
    places, weights = call("call_gauss_rules", np.arange(first, first + nodes), 2).T

    x = (np.arange(points) - (points - 1) / 2) / (points / 2)
    few = (places - (points - 1) / 2) / (points / 2)
    for degree in range(2 * nodes):
        assert abs((weights * few**degree).sum() - (x**degree).sum()) < 4 * FLOAT32 * points
    # 1 / r^5 is what a narrow phase function and an inverse square make of the distance from a light.
    for angle in np.linspace(0, np.pi, 50):
        for power in (1, 2, 5):
            far = [np.abs(at - clearance * np.exp(1j * angle)) ** -power for at in (few, x)]
            assert abs((weights * far[0]).sum() / far[1].sum() - 1) < 6 * FLOAT32
