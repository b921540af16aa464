"""How much of a file is read: a header may declare more than there can be."""

import math

MAX_LEAVES = 1 << 22
"""Largest number of leaves held in memory (8 GiB of float32)."""
MAX_VOXELS = 1 << 31
"""Largest number of voxels of a grid read densely into memory (8 GiB of float32)."""
MAX_BOX_VOXELS, MAX_BOX_EDGE = 1 << 34, 1 << 24
"""Largest number of voxels, in total and along an axis, of the box around a grid read as leaves: the limit of
the device's table."""


def too_large(shape: tuple[int, int, int], *, sparse: bool) -> str:
    """Reason why a box of (z, y, x) voxels cannot be read, as leaves or densely; empty if it can."""
    z, y, x = shape
    limit = MAX_BOX_VOXELS if sparse else MAX_VOXELS
    if math.prod(shape) > limit:
        return f"spans {x}×{y}×{z} = {x * y * z:,} voxels; the limit is {limit:,}"
    if sparse and max(shape) > MAX_BOX_EDGE:
        return f"spans {x}×{y}×{z} voxels; the limit along an axis is {MAX_BOX_EDGE:,}"
    return ""


def too_many_leaves(count: int) -> str:
    """Reason why this many leaves cannot be read; empty if they can."""
    return f"takes {count:,} leaves of 8³ voxels; the limit is {MAX_LEAVES:,}" if count > MAX_LEAVES else ""
