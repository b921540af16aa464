"""Affine transforms as scene files write them."""

from collections.abc import Sequence
from itertools import product
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator

from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model_fields import Accepts, Numbers, accepts, numbers

Float = TypeVar("Float", bound=np.floating)

FLATTEST = 1e-6
"""Least volume of a transform's axes, each brought to length 1: below, it is flat within float32."""

IDENTITY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@accepts(numbers(16), {"type": "array", "items": numbers(4), "minItems": 4, "maxItems": 4})
def affine(value: Any) -> tuple[tuple[float, ...], ...]:
    """Return four rows of four numbers; raises `ValueError` for what is no transform or cannot be undone."""
    numbers = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(numbers, list | tuple) and len(numbers) == 4:  # noqa: PLR2004 - rows
        if not all(isinstance(row, list | tuple) and len(row) == 4 for row in numbers):  # noqa: PLR2004
            raise ValueError("should be 16 numbers, row by row, or 4 rows of 4")
        numbers = [item for row in numbers for item in row]
    if (
        not isinstance(numbers, list | tuple)
        or len(numbers) != 16  # noqa: PLR2004 - 4 x 4
        or not all(isinstance(item, int | float) and not isinstance(item, bool) for item in numbers)
    ):
        raise ValueError("should be 16 numbers, row by row, or 4 rows of 4")
    if not all(abs(item) <= LARGEST_COORDINATE for item in numbers):  # NaN is not
        raise ValueError(f"should be finite numbers, at most {LARGEST_COORDINATE:g}")
    matrix = np.array(numbers, dtype=np.float64).reshape(4, 4)
    if not np.array_equal(matrix[3], (0, 0, 0, 1)):
        hint = "; transpose it" if np.array_equal(matrix[:, 3], (0, 0, 0, 1)) else ""
        raise ValueError(f"should be affine: its last row is 0 0 0 1, not {matrix[3].tolist()}{hint}")
    axes = matrix[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    if lengths.min() < 1 / LARGEST_COORDINATE or abs(np.linalg.det(axes / lengths)) < FLATTEST:
        raise ValueError("cannot be inverted: it makes all flat")
    return tuple(map(tuple, matrix.tolist()))


Matrix = Annotated[tuple[tuple[float, ...], ...], BeforeValidator(affine)]
Rows = Numbers | Sequence[Sequence[float]]
Transform = Accepts[Rows, Matrix]
"""4×4, affine and invertible; 16 numbers row by row, 4 rows or an array are accepted."""


def turned(vectors: NDArray[Float], axes: NDArray[Float]) -> NDArray[Float]:
    """Return vectors [N, 3] times a matrix [3, n], by rows: ``vectors @ axes``.

    Without a BLAS, whose threads go on spinning when they are done and take the cores from the device.
    """
    product: NDArray[Float] = np.einsum("ij,jk->ik", vectors, axes)
    return product


def dots(one: NDArray[Float], other: NDArray[Float]) -> NDArray[Float]:
    """Return the scalar products [N] of vectors, both [N, 3] or one of them [3].

    Component by component: along so short an axis NumPy's sums are several times as slow.
    """
    product: NDArray[Float] = one[..., 0] * other[..., 0]
    product += one[..., 1] * other[..., 1]
    product += one[..., 2] * other[..., 2]
    return product


def lengths_of(vectors: NDArray[Float]) -> NDArray[Float]:
    """Return the lengths [N] of vectors [N, 3]."""
    lengths: NDArray[Float] = np.sqrt(dots(vectors, vectors))
    return lengths


def corners_of(bounds: NDArray[np.float64] | Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """Corners [8, 3] of a box [2, 3]."""
    return np.array(list(product(*np.asarray(bounds, dtype=np.float64).T)))
