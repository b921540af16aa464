"""How NanoVDB lays out nodes of each type of value: sizes, and what is where in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tfm_cl.files.volume_io.tree_shape import LEAF_VOXELS, UPPER_EDGE

_Form = Literal["values", "codes", "bits", "mask", "index", "on-index"]


@dataclass(frozen=True)
class Layout:
    """Memory layout of a grid with a given value type."""

    name: str
    value: np.dtype[Any]
    """Type of a value; for quantised types, that of background and tiles."""
    statistic: int = 4
    """Size of a mean in bytes."""
    form: _Form = "values"
    """Kind of data in the leaves."""
    code_bits: int = 0
    """Bits of a quantised voxel; -1 if it differs between leaves."""

    @property
    def is_vector(self) -> bool:
        """Whether a value is three numbers."""
        return self.value.names is not None

    @property
    def _alignment(self) -> int:
        """Alignment of a value in bytes."""
        return self.value["x"].itemsize if self.is_vector else self.value.itemsize

    def _behind(self, at: int, *, values: int) -> int:
        """First byte after the values and two statistics that follow ``at``."""
        end = _aligned(at, self._alignment) + values * self.value.itemsize
        return _aligned(end, self.statistic) + 2 * self.statistic

    @property
    def background_at(self) -> int:
        """Byte of the root where the background lies."""
        return _aligned(28, self._alignment)

    @property
    def root_size(self) -> int:
        """Bytes of the root before its tiles."""
        return _aligned(self._behind(28, values=3), 32)

    @property
    def root_tile(self) -> np.dtype[Any]:
        """One tile of the root."""
        value_at = _aligned(20, self._alignment)
        return np.dtype(
            {
                "names": ["key", "child", "active", "value"],
                "formats": ["<u8", "<i8", "<u4", self.value],
                "offsets": [0, 8, 16, value_at],
                "itemsize": _aligned(value_at + self.value.itemsize, 32),
            }
        )

    @property
    def entry(self) -> np.dtype[Any]:
        """One entry of a node's table: where a child begins, or the value of a tile."""
        return np.dtype(
            {
                "names": ["child", "value"],
                "formats": ["<i8", self.value],
                "offsets": [0, 0],
                "itemsize": _aligned(self.value.itemsize, 8),
            }
        )

    def table_at(self, edge: int) -> int:
        """Byte of an upper or lower node where its table begins."""
        return _aligned(self._behind(32 + 2 * entries_of_node(edge) // 8, values=2), 32)

    def node_size(self, edge: int) -> int:
        """Bytes of an upper or lower node."""
        return self.table_at(edge) + entries_of_node(edge) * self.entry.itemsize

    @property
    def leaf_values_at(self) -> int:
        """Byte of a leaf where its voxels begin."""
        at = {"bits": 80, "mask": 16, "index": 80, "on-index": 80}.get(self.form)
        return _aligned(self._behind(80, values=2), 32) if at is None else at

    @property
    def least_leaf_size(self) -> int:
        """Bytes of a leaf; the minimum if leaves differ."""
        size = {"bits": 160, "mask": 96, "index": 96, "on-index": 96}.get(self.form)
        bits = abs(self.code_bits) or 8 * self.value.itemsize
        return self.leaf_values_at + LEAF_VOXELS // 8 * bits if size is None else size


def _aligned(at: int, alignment: int) -> int:
    return -(-at // alignment) * alignment


def entries_of_node(edge: int) -> int:
    """Entries of the node whose children are ``edge`` voxels wide."""
    return (32**3) if edge == UPPER_EDGE else (16**3)
