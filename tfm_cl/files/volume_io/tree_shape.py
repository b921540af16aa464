"""The shape of the sparse tree that both VDB formats store: `tfm_cl.files.volume_io.tree` says what it is."""

from typing import Any

import numpy as np

ROOT_EDGE, UPPER_EDGE, LOWER_EDGE = 4096, 128, 8
"""Voxels along an edge of a tile of the root, of an upper node and of a lower node."""
LEAF_VOXELS = LOWER_EDGE**3
COMPONENTS = ("x", "y", "z")
"""Names of the fields of a vector."""


def vector_type(number: str) -> np.dtype[Any]:
    """Structured type of three numbers: compared, it is one value, unlike a row of an array."""
    return np.dtype([(axis, number) for axis in COMPONENTS])
