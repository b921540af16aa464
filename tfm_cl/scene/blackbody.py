"""The light of black bodies as linear Rec. 709: Planck's law seen by the CIE 1931 2° observer.

As in pbrt-v4, spectra are relative to their peak, wherever that is: a body of 1500 K, which glows in the
infrared most of all, is dark beside one of 3000 K. A spectrum of 1 has the luminance 1.

The observer is the multi-lobe fit of Wyman, Sloan and Shirley ("Simple Analytic Approximations to the CIE XYZ
Color Matching Functions", JCGT 2013). With it the chromaticities x and y of black bodies are within 0.003 of
those by the CIE's tables from 2000 to 10000 K, and within 0.005 at 1500 K.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

COLDEST = 500.0
"""Kelvin; up to that less than 1e-12 of the peak is seen, and counts as nothing."""
HOTTEST = 1e6
"""Kelvin; beyond, the colour hardly changes."""
SECOND_RADIATION = 1.438776877e7
"""h c / k, nm K."""
PEAK = 2.897771955e6
"""Wien's displacement: wavelength of the peak times temperature, nm K."""
WAVELENGTHS = np.arange(360.0, 831.0)
"""nm: those of the CIE's tables."""
LOBES = (
    ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
    ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
    ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
)
"""Of x, y and z: height, wavelength of the middle, and widths below and above it, nm."""
RGB_FROM_XYZ = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
"""Rec. 709's primaries and D65."""
TABLE_RATIO = 1.001
"""From one temperature of the table to the next; in between, colours err by less than 1e-4 of themselves."""


def observer(wavelengths: Floats) -> Floats:
    """Return the colour matching functions x, y and z, [3, n], at wavelengths in nm."""
    found = np.zeros((3, len(wavelengths)))
    for i, lobes in enumerate(LOBES):
        for height, middle, below, above in lobes:
            width = np.where(wavelengths < middle, below, above)
            found[i] += height * np.exp(-0.5 * ((wavelengths - middle) / width) ** 2)
    return found


def xyz_of(kelvin: Floats) -> Floats:
    """Return CIE XYZ, [n, 3], of black bodies relative to their peaks; kelvin [n] > 0."""
    exponent = SECOND_RADIATION / (WAVELENGTHS * kelvin[:, None])
    at_peak = SECOND_RADIATION / PEAK
    # The ratio of two values of 1 / (λ⁵ (e^{c/λT} - 1)), whose exponentials may be beyond any number.
    shape = (exponent / at_peak) ** 5 * np.exp(at_peak - exponent)
    spectrum = shape * np.expm1(-at_peak) / np.expm1(-exponent)
    functions = observer(WAVELENGTHS)
    xyz: Floats = spectrum @ functions.T / functions[1].sum()
    return xyz


def rgb_of(kelvin: Floats) -> Floats:
    """Return linear Rec. 709, [n, 3], likewise; what its gamut lacks (blue below 1900 K) is 0."""
    rgb: Floats = np.maximum(xyz_of(kelvin) @ RGB_FROM_XYZ.T, 0)
    return rgb


class Table:
    """The colours of black bodies up to some temperature, to be looked up for millions of voxels."""

    def __init__(self, hottest: float) -> None:
        steps = int(np.ceil(np.log(max(hottest / COLDEST, TABLE_RATIO)) / np.log(TABLE_RATIO)))
        self._kelvin: Floats = COLDEST * TABLE_RATIO ** np.arange(steps + 1.0)
        self._rgb = rgb_of(self._kelvin)

    def rgb(self, kelvin: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return [3, …], float32, at temperatures of any shape; 0 up to `COLDEST`."""
        rgb = np.zeros((3, *kelvin.shape), np.float32)
        hot = kelvin > COLDEST
        for channel, known in zip(rgb, self._rgb.T, strict=True):
            channel[hot] = np.interp(kelvin[hot], self._kelvin, known)
        return rgb
