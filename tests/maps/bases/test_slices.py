"""Opacity shadow maps: planes, what lies between them, and the three slicings."""

import numpy as np
import pytest
from light_rays import RES, light_rays, scene_of, slabs, transmittance
from tolerances import PASS, ROUNDED

from tfm_cl import MapSettings
from tfm_cl.maps.bases.curves import CELLS, Curves
from tfm_cl.maps.resolved import resolve
from tfm_cl.plan.maps import functions_of

pytestmark = pytest.mark.lanes


def sliced(coeffs, slicing="uniform", curves=None, basis="slices"):
    return functions_of(resolve(MapSettings(basis=basis, coeffs=coeffs, slicing=slicing)), curves)


def curves_of(density):
    """One light ray of the given density in each of the cells."""
    return Curves(np.concatenate([[0.0], np.cumsum(density)])[None], 1.0)


@pytest.mark.parametrize(
    "settings",
    [
        {"basis": "slices", "coeffs": 1},
        {"basis": "slices", "coeffs": 60},
        {"basis": "slices", "coeffs": 7, "slicing": "density"},
        {"basis": "slices", "coeffs": 8, "slicing": "gamma", "fit": "visibility"},
        {"basis": "slices-cubic", "coeffs": 9},
        {"basis": "slices-cubic", "coeffs": 6, "slicing": "gamma"},
        {"basis": "slices-cubic", "coeffs": 1},
    ],
    ids=str,
)
def test_device_equals_the_model(check_series, settings):
    check_series(**settings)


def test_uniform_and_gamma_planes():
    assert sliced(4).planes == pytest.approx([0.25, 0.5, 0.75, 1])
    assert sliced(4, "gamma").planes == pytest.approx([0.0625, 0.25, 0.5625, 1])


def test_density_planes_halve_the_fullest_interval():
    density = np.zeros(CELLS)
    density[: CELLS // 4] = 1

    planes = sliced(5, "density", curves_of(density)).planes

    # All is in the first quarter: 1/2, 1/4, 1/8, and one half of either half of the quarter.
    assert planes == pytest.approx([0.0625, 0.125, 0.25, 0.5, 1])


def test_density_planes_of_even_or_no_density_are_uniform():
    even = sliced(8, "density", curves_of(np.ones(CELLS))).planes
    nothing = sliced(8, "density", Curves(np.zeros((0, CELLS + 1)), 1.0)).planes

    assert even == pytest.approx(np.arange(1, 9) / 8)
    assert nothing == pytest.approx(even)


def test_density_planes_of_a_thin_sheet_stay_apart():
    density = np.full(CELLS, 1e-30)
    density[40] = 1e6

    planes = sliced(32, "density", curves_of(density)).planes

    assert np.diff(planes, prepend=0).min() > 1e-4
    assert planes[-1] == 1
    assert ((planes > 40 / CELLS) & (planes < 41 / CELLS)).sum() > 16


@pytest.mark.parametrize("basis", ["slices", "slices-cubic"])
@pytest.mark.parametrize("slicing", ["uniform", "gamma"])
@pytest.mark.parametrize("coeffs", [1, 5, 32])
def test_planes_both_ends_and_homogeneous_media_are_exact(rng, basis, slicing, coeffs):
    functions = sliced(coeffs, slicing, basis=basis)
    depths, steps = rng.uniform(0, 1, 32), np.arange(33) / 32
    reached = np.concatenate([[0], depths.cumsum()])

    found = functions.values(np.array([0, *functions.planes])) @ (depths @ functions.analysis(32))
    even = functions.values(steps) @ (np.full(32, 0.1) @ functions.analysis(32))

    assert found == pytest.approx(np.interp([0, *functions.planes], steps, reached), abs=ROUNDED)
    assert even == pytest.approx(3.2 * steps, abs=ROUNDED)


def test_a_slab_between_planes_is_exact(rng):
    # Homogeneous pieces that begin and end at planes are what lines can draw.
    functions = sliced(8)
    depths = np.repeat(rng.uniform(0, 1, 8) * [0, 0, 1, 1, 1, 0, 0, 1], 5)
    v = np.linspace(0, 1, 41)

    found = functions.values(v) @ (depths @ functions.analysis(40))

    assert found == pytest.approx([0, *depths.cumsum()], abs=ROUNDED)


@pytest.mark.parametrize(("basis", "order"), [("slices", 2), ("slices-cubic", 3)])
def test_error_falls_with_the_order_that_is_claimed(basis, order):
    steps = 3072
    edges = np.arange(steps + 1) / steps
    # Odd about either end, as the intervals there take their own slopes.
    reached = edges - np.sin(2 * np.pi * edges) / (2 * np.pi)

    def error(n):
        functions = sliced(n, basis=basis)
        return np.abs(
            functions.values(edges) @ (np.diff(reached) @ functions.analysis(steps)) - reached
        ).max()

    assert error(12) / error(24) == pytest.approx(2**order, rel=0.25)


def test_cubic_slices_of_a_line_that_bends_are_hermite_s():
    # Two intervals: slope 1 at the begin, 3/2 in the middle, 2 at the end, all times 1/2.
    functions = sliced(2, basis="slices-cubic")

    found = functions.values(np.array([0.25, 0.75])) @ [0.5, 1.5]

    # h01 rise + h10 m0 + h11 m1 at the middle: 1/2 rise + (m0 - m1) / 8.
    assert found == pytest.approx([0.25 + (0.5 - 0.75) / 8, 1 - 0.5 + 0.5 + (0.75 - 1) / 8])


def test_linear_slices_never_rise_back_on_the_device(renderer):
    scene = scene_of(slabs(4), basis="slices", coeffs=9, slicing="gamma")
    rays = light_rays(scene)

    found = transmittance(renderer.build_maps(scene)[0], rays, np.linspace(0, 1, 100)[1:-1])

    assert (np.diff(found, axis=1) <= PASS).all()
    assert found.max() <= 1
    assert len(found) > RES**2 / 2
