"""Every numeric tolerance of the tests, with its reason."""

FLOAT32 = 6e-8
"""Half a unit in the last place of float32, relative."""

DEVICE_FUNCTION = 20 * FLOAT32
"""A device function of a few dozen float32 operations against float64."""

RECURRENCE = 2e-5
"""Chebyshev recurrence up to 32 cosines: near u = 0 its error grows as n² ulp / 2 (512 × 4e-8)."""

PASS = 5e-6
"""A light or view pass of some dozen steps in float32 against the float64 reference, on images near 1."""

GRAZING = 1e-3
"""Part of a ray's length by which its entry into the cone may move in float32: at a grazing angle the
root of a small discriminant doubles the relative error of its digits."""
