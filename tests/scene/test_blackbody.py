"""Colours of black bodies, against tabulated chromaticities and radiometry."""

import numpy as np
import pytest

from tfm_cl.scene.blackbody import COLDEST, PEAK, WAVELENGTHS, Table, observer, rgb_of, xyz_of

CHROMATICITY = {
    1500: (0.5857, 0.3931, 0.005),
    2000: (0.5267, 0.4133, 0.003),
    3000: (0.4369, 0.4041, 0.003),
    5000: (0.3451, 0.3516, 0.003),
    6500: (0.3135, 0.3237, 0.003),
    10000: (0.2807, 0.2884, 0.003),
}
"""Kelvin -> CIE 1931 x and y of the Planckian locus (Wyszecki and Stiles), and what the fit of the colour
matching functions errs by at most: the redder the light, the more."""
TABLE = 1e-4
"""Of the strongest channel: linear between temperatures a thousandth apart, rising like e^(-c / λT)."""


@pytest.mark.parametrize("kelvin", CHROMATICITY)
def test_chromaticities_are_those_of_the_planckian_locus(kelvin):
    x, y, tolerance = CHROMATICITY[kelvin]
    (xyz,) = xyz_of(np.array([float(kelvin)]))
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), (x, y), rtol=0, atol=tolerance)


def test_spectra_are_relative_to_their_peak():
    # Where the peak is in the middle of what is seen, nearly all of that is near the peak.
    (xyz,) = xyz_of(np.array([PEAK / 555]))
    assert 0.97 < xyz[1] < 1
    # A body of 1500 K against one of 3000 K by Planck's law at the eye's 590 nm, or so.
    dark, bright = xyz_of(np.array([1500.0, 3000.0]))[:, 1]
    c = 1.438776877e7 / 590
    planck = np.expm1(c / 3000) / np.expm1(c / 1500) * (3000 / 1500) ** 5
    assert dark / bright == pytest.approx(planck, rel=0.2)


def test_the_observer_sees_equal_energy_as_white():
    sums = observer(WAVELENGTHS).sum(axis=1)
    np.testing.assert_allclose(sums / sums[1], 1, atol=2e-3)
    assert sums[1] == pytest.approx(106.857, rel=1e-3)  # the CIE's own table


def test_what_rec_709_lacks_is_left_out():
    rgb = rgb_of(np.array([1200.0, 2000.0, 6500.0, 20000.0]))
    assert (rgb >= 0).all()
    assert rgb[0, 2] == 0
    assert np.ptp(rgb[2]) < 0.06 * rgb[2].max()
    assert (np.diff(rgb[:, 2] / rgb[:, 0]) > 0).all()


def test_a_table_gives_the_same_colours():
    kelvin = np.geomspace(1000, 30000, 400)
    rgb = Table(30000).rgb(kelvin.reshape(20, 20)).reshape(3, -1).T
    expected = rgb_of(kelvin)
    assert (np.abs(rgb - expected) <= TABLE * expected.max(axis=1, keepdims=True)).all()
    assert not Table(300).rgb(np.array([-5.0, 0.0, 300.0, COLDEST])).any()
