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

FAST_MATH = 4 * FLOAT32
"""An elementary function without calls: its polynomial, whose last steps round, and what follows it."""

EXPONENT = 2 * FLOAT32
"""Of e^-t, for each unit of t: log2(e), and t log2(e), are rounded before the power is taken."""

STEP = 8 * FLOAT32
"""Place and length of a warped step, in parts of the segment: ten float32 operations without cancellation."""

SKIPPING = 2 * FLOAT32
"""Steps that are jumped over would have added 0: the sums are the same, but for factors e^-0 that round."""

LANES = PASS
"""The same march in vectors of another width, of colours relative to the brightest: operations are fused in
another way, in both passes."""

LIGHTS = 2 * PASS
"""Sum of the pictures of dozens of lights, relative to its brightest: each addition rounds the sum so far."""

ROUNDED = 1e-12
"""Closed forms in float64: some dozen operations on numbers near 1."""

FIT = 2e-5
"""T of a weighted fit in float32: normal equations of a few functions magnify what rounds some ten times
more than sums do; the ridge bounds it."""

STRETCHES = 40 * FLOAT32
"""Of the brightest: lit stretches summed from a few values, to rounding, against a sum over every step."""

OCTAVES_MEAN = 0.2
"""Mean brightness of octaves beside all orders of scattering: one more volume, lit from three sides, differs
from those that their numbers are from by up to 15 %."""

OCTAVES_PSNR = 30.0
"""Of their pictures, in decibels: at most 3 % of the display's range is missed, on the root mean square."""

OCTAVES_MEAN_DEEP, OCTAVES_PSNR_DEEP = 0.25, 28.0
"""The same in a medium that is four times as deep: up to 22 %, and 29 dB. Numbers for shallow media are up to
35 % too bright there, at 27 dB."""

BAKED = 1e-4
"""Of T: what decoders of baked maps make of them, in float64 or float32, at an extinction of 4. Cosines of 8
half-waves are off by 0.00008 between the 1025 rows of their table at most."""
BAKED_ON_GPU = 3e-3
"""The same where a texture unit interpolates: by a fraction of 8 bits between two texels, of coefficients,
ranges and functions."""
BAKED_IN_CYCLES = 1e-4
"""As `BAKED`: a shader's numbers are float32, and rays lie within a hundredth of a pixel of its centre."""
CYCLES_EMISSION = 5e-4
"""Cycles' picture of a homogeneous medium that glows, mean difference relative to the mean: at silhouettes
its rays, within a hundredth of a pixel of the centre, see other lengths."""
CYCLES_ORDERS, CYCLES_ORDERS_RMSE = 0.01, 0.02
"""The same of one that also scatters: of the means of each channel, and of single pixels on the root mean
square, of which half is the noise of Cycles' 4096 samples, the rest that of a lattice."""

FILM_CODES = 6
"""Of 255: colours of a film's patches against those of its frames. Films hold seven bits of differences of
colours and brightness from 16 to 235, GIFs five bits of each primary in the search for their palette."""

ADVECTED = 5e-6
"""A density near 1 moved by up to ten voxels: velocity, its turn into voxels and the place that they lead to
round as float32, and the density changes by up to 1 from one voxel to the next."""

BLURRED = 2 * FLOAT32
"""A mean of pictures near 1, each rounded as float32, against their mean in float64."""

MOVED_STEPS = 5e-5
"""Of the brightest: a grid that has moved has a wider box than one that was put there, and the steps of
marches through either, 640 of the camera and 200 of light, lie elsewhere."""

LEARNT_TOGETHER = 0.01
"""RMSE, in means of a picture, between functions of its own and those that serve another frame too."""

LEARNT = 1e-3
"""Of a projection onto learnt functions: their normal equations are summed in float32, six rounds long."""

PXR24 = 2.0**-15
"""EXR's PXR24 keeps 16 bits of a float's significand, relative."""

DWA = 0.02
"""EXR's DWAA and DWAB on smooth colours near 1: they drop what the eye does not see at 45, the
default level."""
