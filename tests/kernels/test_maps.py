"""A basis and the storage of maps: device functions against float64."""

import numpy as np
import pytest
from kernel_calls import ONE_GRID, Calls
from tolerances import DEVICE_FUNCTION, FLOAT32, RECURRENCE

import tfm_cl as tfm
from tfm_cl.device.structs.map import map_struct
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.cosine import Cosines
from tfm_cl.maps.light_pass import map_variant
from tfm_cl.maps.resolved import resolve

pytestmark = pytest.mark.lanes

STORED = {32: np.float32, 16: np.uint16, 8: np.uint8}


def cosines(launcher, coeffs, density_weighting=1.0, storage="f32"):
    """The functions of the basis dct for the transmittance, fitted by L2."""
    settings = tfm.MapSettings(
        basis="dct", coeffs=coeffs, target="transmittance", fit="l2", storage=storage, steps=max(coeffs, 8)
    )
    return calls_of(launcher, settings, density_weighting)


def calls_of(launcher, settings, density_weighting=1.0):
    """The functions of a basis, and of the storage of its maps."""
    header, defines = map_variant(resolve(settings))
    struct = map_struct(
        res=1,
        steps=8,
        density_weighting=density_weighting,
        extinction=1.0,
        number_unit=1.0,
        ranges=np.zeros((1, 1, 4), np.float32),
    )
    return Calls(launcher, "map_functions.cl", [header], ONE_GRID | defines, {"map": struct})


@pytest.mark.parametrize("alpha", [1.0, 10.0])
def test_dct_of_an_exponential_has_the_closed_form(launcher, alpha):
    coeffs, steps, taus = 16, 1000, np.array([1e-3, 0.5, 4.0, 30.0])
    u = (np.arange(steps) + 0.5) / steps
    settings = resolve(tfm.MapSettings(basis="dct", coeffs=coeffs, steps=steps))
    table = BASES["dct"].table(Cosines(coeffs, of_extinction=False), settings, steps)

    found = cosines(launcher, coeffs, alpha)(
        "call_basis_project", taus[:, None] * u, coeffs, steps=steps, table=table
    )

    for tau, c in zip(taus, found, strict=True):
        # bases/dct.py: the closed form for e^{-τu}, with τ/α for the weighted transmittance.
        k, j = tau / alpha, np.arange(coeffs)
        expected = 2 * k * (1 - (-1.0) ** j * np.exp(-k)) / (k**2 + (j * np.pi) ** 2)
        expected[0] = (1 - np.exp(-k)) / k
        # Each addition may round by half an ulp of the sum, and the midpoint rule is off by τ²/24 M² per τ.
        rounding, midpoints = steps * FLOAT32, (k**2 + (coeffs * np.pi) ** 2) / (24 * steps**2)
        assert np.abs(c - expected).max() < (rounding + 2 * midpoints) * min(1, k)


@pytest.mark.parametrize("coeffs", [1, 2, 3, 8, 16, 31, 32])
def test_basis_evaluates_every_size(launcher, rng, coeffs):
    c = rng.normal(size=(400, coeffs)).astype(np.float32) * 0.1 / coeffs
    c[:, 0] = rng.uniform(0.3, 0.7, 400)
    u = rng.uniform(0, 1, 400).astype(np.float32)
    u[:2] = 0, 1

    depths = cosines(launcher, coeffs, 3.0)("call_basis_optical_depth", c, us=u)

    f = (c * np.cos(np.pi * np.arange(coeffs) * u[:, None].astype(np.float64))).sum(axis=1)
    assert 0 < f.min() < f.max() < 1
    assert np.abs(depths - -3.0 * np.log(f)).max() < 3.0 * RECURRENCE / f.min()


def test_basis_clamps_before_the_power(launcher):
    c = np.float32([[-0.05, 0], [1.2, 0], [0, 0], [np.float32(1e-30), 0]])

    depths = cosines(launcher, 2, 10.0)("call_basis_optical_depth", c, us=np.zeros(4, np.float32))

    assert np.isfinite(depths).all()
    assert depths[0] == depths[2] > 800  # below 0: dark, not a bright ghost
    assert depths[1] == 0  # above 1: clear


SHEETS = 1e-3
"""Of c_0, where a distribution of few nodes makes the matrix of its moments singular but for the bias, of
which rounding is a few hundredths: the most of some thousand such rays is 7e-4."""


def trigonometric_moments(places, weights, order):
    """The numbers of thin sheets, [rays, 2 order + 1]."""
    waves = np.exp(1j * np.pi * places[:, :, None] * np.arange(order + 1))
    moments = (weights[:, :, None] * waves).sum(axis=1)
    parts = np.stack([moments.real, moments.imag], axis=-1).reshape(len(places), -1)
    return np.delete(parts, 1, axis=1).astype(np.float32)  # c_0 is real


@pytest.mark.parametrize("storage", ["f32", "f16"])
@pytest.mark.parametrize("coeffs", [5, 7, 9])
def test_trigonometric_moments_of_thin_sheets_rise(launcher, rng, coeffs, storage):
    u = np.linspace(0, 1, 65)
    calls = calls_of(launcher, tfm.MapSettings(basis="trig-moments", coeffs=coeffs, storage=storage))
    for sheets in (1, 2, 3, 5, 9):
        places, weights = rng.uniform(0, 1, (100, sheets)), rng.uniform(0, 1, (100, sheets)) ** 2 + 1e-3
        c = trigonometric_moments(places, weights, coeffs // 2)
        if storage == "f16":
            c = c.astype(np.float16).astype(np.float32)

        depths = calls(
            "call_basis_optical_depth", np.repeat(c, 65, axis=0), us=np.tile(u, 100).astype(np.float32)
        )

        before = depths.reshape(100, 65) / c[:, :1]
        assert before.min() >= 0
        assert before.max() <= 1 + FLOAT32
        assert (np.maximum.accumulate(before, axis=1) - before).max() <= SHEETS
        if sheets == 1:  # nothing before it, everything behind
            away = u - places
            assert before[away < -0.2].max() <= 0.1
            assert before[away > 0.2].min() >= 0.9


@pytest.mark.parametrize("storage", ["f32", "f16", "u8"])
@pytest.mark.parametrize("coeffs", [5, 7, 9])
def test_trigonometric_moments_of_nothing_are_numbers_all_the_same(launcher, rng, coeffs, storage):
    # No distribution has these moments: what is left where storage, interpolation and blur have rounded.
    c = rng.normal(size=(2000, coeffs)) * 10 ** rng.uniform(-40, 37, (2000, 1))
    c[1000:] *= 10 ** rng.uniform(-20, 0, (1000, coeffs))
    c[:3] = 0
    c[1:3, 0] = 1e-38, 3e38
    c = c.astype(np.float32)
    calls = calls_of(launcher, tfm.MapSettings(basis="trig-moments", coeffs=coeffs, storage=storage))

    depths = calls("call_basis_optical_depth", c, us=rng.uniform(0, 1, 2000).astype(np.float32))

    assert np.isfinite(depths).all()
    assert depths.min() >= 0
    assert (depths <= np.maximum(c[:, 0], 0) * (1 + 2 * FLOAT32)).all()
    assert depths.max() > 0


def bilinear(values, positions):
    """Of [res, res, n] texels between their centres, clamped at the edges."""
    res = len(values)
    at = np.clip(positions * res - 0.5, 0, res - 1)
    low = np.minimum(at.astype(int), max(res - 2, 0))
    (fx, fy), (x, y) = (at - low).T, low.T
    right, upper = np.minimum(x + 1, res - 1), np.minimum(y + 1, res - 1)
    fx, fy = fx[:, None], fy[:, None]
    lower = values[y, x] + fx * (values[y, right] - values[y, x])
    return lower + fy * (values[upper, x] + fx * (values[upper, right] - values[upper, x]) - lower)


@pytest.mark.parametrize(("storage", "error"), [("f32", 0.0), ("f16", 2.0**-11), ("u8", 0.51 / 255)])
@pytest.mark.parametrize(("res", "coeffs"), [(1, 4), (2, 1), (9, 4), (9, 8), (9, 15)], ids=str)
def test_what_is_stored_comes_back_between_texels(launcher, rng, storage, error, res, coeffs):
    bits = {"f32": 32, "f16": 16, "u8": 8}[storage]
    values = rng.uniform(-1, 1, (res, res, coeffs)).astype(np.float32)
    values[..., -1] = 0.25  # a coefficient that does not vary
    lowest = values.min(axis=(0, 1))
    limits = np.stack([lowest, values.max(axis=(0, 1)) - lowest], axis=1)
    positions = rng.uniform(-0.1, 1.1, (500, 2)).astype(np.float32)
    positions[:4] = (0, 0), (1, 1), (0, 1), (1, 0)
    centres = (np.indices((res, res))[::-1].reshape(2, -1).T + 0.5) / res
    positions[4 : 4 + res**2] = centres
    # Two neighbours are read at once: there is room for one texel more.
    numbers = launcher.zeros("numbers", (res**2 + 1) * coeffs * bits // 8)
    calls = cosines(launcher, coeffs, storage=storage)
    launcher.run(
        calls.kernel("call_map_store"),
        (1,),
        {
            "values": launcher.upload("values", values),
            "limits": launcher.upload("limits", limits),
            "numbers": numbers,
            "texels": res**2,
        },
    )

    found = calls("call_map_coefficients", positions, coeffs, numbers=numbers, limits=limits, res=res)

    # f16 rounds to 11 bits, relative to at most 1; u8 to half a step of 1/255 of the extent (≤ 2).
    difference = np.abs(found - bilinear(values.astype(np.float64), positions.astype(np.float64)))
    place = 2 * res * DEVICE_FUNCTION  # texels that differ by up to 2, res of them in [0, 1]
    assert difference.max() <= error * (2 if bits == 8 else 1) + place
    at_centres = difference[4 : 4 + res**2]
    assert bits == 32 or res < 9 or at_centres.max() > 0
    assert at_centres.max() <= error * (2 if bits == 8 else 1) + FLOAT32 * (1 + 2 * res)
