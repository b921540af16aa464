"""Numbers that host and kernels share, each declared once; the kernels' macros are made from them."""

from __future__ import annotations

from math import pi

BRICK_SHIFT = 2
BRICK_EDGE = 1 << BRICK_SHIFT
"""Cells along an edge of a brick, the unit in which marches skip what is empty."""
BLOCK_BRICKS = 2
"""Bricks along an edge of a block, the unit of storage."""
BLOCK_NUMBERS = 12
"""Ints that tell where a record's block is, and which records the blocks after it have."""
MOST_SHARED = {1: 1, 4: 3, 8: 3, 16: 3}
"""Lanes -> cells along an axis within which a tile's lanes share what they read."""
LATTICE_AT_ONCE = {1: 1, 4: 8, 8: 8, 16: 8}
"""Lanes -> how many times as many voxels of a lattice a work-item takes: at most the bits of a byte."""
MARCH_LEVELS = 8
"""Numbers of steps that a light ray may take: an eighth, two eighths ... of the longest range's."""
CURVE_CELLS = 64
"""Cells of the curves of optical depth along light rays that data-driven bases learn from."""
TABULATED_CELLS = 64
"""Cells of functions that are known by their values."""
OWN_DEPTH_ROWS = 1024
"""Steps of a ray's range at whose middles the functionals of a basis are tabulated, for primitives that are
not marched; in between they are interpolated."""
NUMBERS_UNIT = 16
"""Coefficients of a map begin at a multiple of it in their buffer: large buffers are beyond an int."""
SHADOW_FIRST_LEVEL = 2
"""Bounds of a shadow map begin at every 4 texels on their finest level, level 2."""
TARGETS = {"transmittance": 0, "optical-depth": 1, "extinction": 2}
"""What a basis approximates -> its number in the kernels, ``TARGET_TRANSMITTANCE`` and so on."""
STORAGE_BITS = {"f32": 32, "f16": 16, "u8": 8}
"""How a map stores its numbers -> ``TFM_STORAGE_BITS``."""
SUMS_BLOCK = 12
"""Sums over a ray's steps that registers hold at once."""
RIDGE = 1e-6
"""Added to the diagonal of normal equations, as a part of its mean: float32 solves what is left."""
POINT_PROFILES = {"ball": 0, "gaussian": 1, "smooth": 2}
"""Profile of a point -> its number in the kernels, ``POINT_BALL`` and so on."""
MOST_OPACITY = 1 - 2.0**-23
"""Opaque: an optical depth of 16, of which less is left than float32 sees beside 1."""
LEAST_TEXELS = 2.0
"""Radius, in texels or pixels, of the narrowest primitive: what is narrower is widened."""
SMOOTH_MASS = 64 * pi / 315
"""What a smooth point of radius and density 1 holds."""
BEND_UNIT = 2.0**-14
"""Of 16 bits: by how much a strand's tangent at the end of a segment differs from the segment's direction, at
most √2 along an axis. Highlights are where they should be to 5e-5 of a radian."""
MOST_OCTAVES = 8
"""Of a medium."""
OCTAVE_GROWTH = 0.55
"""Power of a camera ray's optical depth with which its light of all octaves but the first grows."""
OCTAVE_LEAST_THROUGH = 1e-4
"""Transmittance of the deepest ray that octaves tell from others: of what the default cutoff leaves."""
OCTAVE_DEPTH_AT_POINTS = 4.0
"""Optical depth of camera rays where these are not known: at the points of a lattice."""
EDGE_MARGIN = 1e-3
"""Of a map's width, far more than positions on its edge are rounded by: what passes it by further than this
meets no medium."""
PHASE_CELLS = 8192
"""Cells of a phase function that is known by its values, half of them from each pole: 0.02° wide at the
poles, where float32 has as many cosines, and 0.03° between them."""
FORWARD_DISK = 5.41e-6
"""sin²(θ/2) at the edge of the disk of the Sun, 0.2665° from its middle: over such a disk a phase function
that is infinite at θ = 0 is averaged."""
MOST_DEGREE = 4
"""Of the spherical harmonics by which the later orders of scattering know light at a point."""
BEYOND_ANGLES, BEYOND_DEPTHS = 256, 64
"""Columns and rows of a table of what a lobe has beyond these."""
BEYOND_HALF = 4.0
"""Optical depth in the middle of its rows."""


def c_definitions() -> str:
    """Return all as OpenCL C macros."""
    macros = {
        "BRICK_SHIFT": BRICK_SHIFT,
        "BRICK_EDGE": BRICK_EDGE,
        "BLOCK_EDGE": BLOCK_BRICKS * BRICK_EDGE,
        "BLOCK_SHIFT": BRICK_SHIFT + BLOCK_BRICKS.bit_length() - 1,
        "BLOCK_NUMBERS": BLOCK_NUMBERS,
        "MARCH_LEVELS": MARCH_LEVELS,
        "CURVE_CELLS": CURVE_CELLS,
        "TABULATED_CELLS": TABULATED_CELLS,
        "OWN_DEPTH_ROWS": OWN_DEPTH_ROWS,
        "NUMBERS_UNIT": NUMBERS_UNIT,
        "SUMS_BLOCK": SUMS_BLOCK,
        "SHADOW_FIRST_LEVEL": SHADOW_FIRST_LEVEL,
        "TFM_RIDGE": f"{RIDGE}f",
        "EDGE_MARGIN": f"{EDGE_MARGIN}f",
        "LEAST_TEXELS": f"{LEAST_TEXELS}f",
        "SMOOTH_MASS": f"{SMOOTH_MASS:.9g}f",
        "BEND_UNIT": f"{BEND_UNIT:.9g}f",
        "MOST_OPACITY": f"{MOST_OPACITY:.9g}f",
        "PHASE_CELLS": PHASE_CELLS,
        "OCTAVE_GROWTH": f"{OCTAVE_GROWTH}f",
        "OCTAVE_LEAST_THROUGH": f"{OCTAVE_LEAST_THROUGH}f",
        "OCTAVE_AT_POINTS": f"{OCTAVE_DEPTH_AT_POINTS**OCTAVE_GROWTH:.9g}f",
        "FORWARD_DISK": f"{FORWARD_DISK}f",
        "BEYOND_ANGLES": BEYOND_ANGLES,
        "BEYOND_DEPTHS": BEYOND_DEPTHS,
        "BEYOND_HALF": f"{BEYOND_HALF}f",
        **{f"POINT_{name.upper()}": number for name, number in POINT_PROFILES.items()},
        **{f"TARGET_{name.upper().replace('-', '_')}": number for name, number in TARGETS.items()},
    }
    lines = [f"#define {name} {value}" for name, value in macros.items()]
    by_lanes = [
        f"#if TFM_LANES == {lanes}\n#define {name} {n}\n#endif"
        for name, numbers in (("MOST_SHARED", MOST_SHARED), ("LATTICE_AT_ONCE", LATTICE_AT_ONCE))
        for lanes, n in numbers.items()
    ]
    return "\n".join([*lines, *by_lanes])
