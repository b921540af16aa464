"""Writes OpenVDB files: the layout that `tfm_cl.files.volume_io.vdb` describes, of file version 224.

Grids are trees of float or vec3s values with the background 0, packed with zlib, which every OpenVDB reads;
inactive voxels are left out.
"""

from __future__ import annotations

import hashlib
import struct
import uuid
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tfm_cl.files.volume_io.tree_shape import LOWER_EDGE, ROOT_EDGE, UPPER_EDGE
from tfm_cl.files.volume_io.written_grid import WrittenGrid, WrittenLeaves, bits_of, entries_of, nodes_above

_VERSION, _LIBRARY = 224, (10, 0)
_ZLIB, _ACTIVE_MASK = 1, 2
_LEVEL = 6
_ALL_INACTIVE_ARE_BACKGROUND = b"\0"


def write(path: Path, grids: Sequence[WrittenGrid]) -> None:
    """Write a file; may leave it incomplete if it raises."""
    with path.open("wb") as stream:
        stream.write(struct.pack("<q3IB", 0x56444220, _VERSION, *_LIBRARY, 1))
        at_uuid = stream.tell()
        stream.write(
            bytes(36) + _metadata({"creator": ("string", b"tfm_cl")}) + struct.pack("<i", len(grids))
        )
        digest = hashlib.sha256()
        for number, grid in enumerate(grids):
            shared = sum(other.name == grid.name for other in grids) > 1
            name = grid.name + (f"\x1e{number}" if shared else "")
            value = "vec3s" if grid.is_vector else "float"
            head = _text(name) + _text(f"Tree_{value}_5_4_3") + _text("")
            leaves = grid.leaves()
            front = struct.pack("<I", _ZLIB | _ACTIVE_MASK) + _metadata(_facts(grid)) + _transform(grid)
            front += _topology(grid, leaves)
            begin = stream.tell() + len(head) + 24
            blocks = begin + len(front)
            at_positions = stream.tell() + len(head)
            stream.write(head + bytes(24) + front)
            digest.update(head + front)
            for active, values in zip(leaves.active, leaves.values, strict=True):
                block = bits_of(active).tobytes() + _block(values[active])
                digest.update(block)
                stream.write(block)
            end = stream.tell()
            stream.seek(at_positions)
            stream.write(struct.pack("<3q", begin, blocks, end))
            stream.seek(end)
        # The same grids make the same file.
        stream.seek(at_uuid)
        stream.write(str(uuid.UUID(bytes=digest.digest()[:16], version=4)).encode())


def _text(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<I", len(encoded)) + encoded


def _metadata(items: dict[str, tuple[str, bytes]]) -> bytes:
    """Return a metadata map, of names, types and values."""
    parts = [struct.pack("<I", len(items))]
    for name, (kind, value) in items.items():
        parts += [_text(name), _text(kind), struct.pack("<I", len(value)), value]
    return b"".join(parts)


def _facts(grid: WrittenGrid) -> dict[str, tuple[str, bytes]]:
    """Return what a grid's metadata say."""
    low, high = grid.active_box()
    facts = {
        "class": ("string", b"unknown"),
        "file_bbox_max": ("vec3i", struct.pack("<3i", *high)),
        "file_bbox_min": ("vec3i", struct.pack("<3i", *low)),
        "file_compression": ("string", b"zip + active values"),
        "file_voxel_count": ("int64", struct.pack("<q", grid.active_voxels)),
        "is_saved_as_half_float": ("bool", b"\0"),
        "name": ("string", grid.name.encode()),
    }
    if grid.is_vector:
        facts["vector_type"] = ("string", b"invariant")
    return facts | {name: ("string", text.encode()) for name, text in sorted(grid.metadata.items())}


def _transform(grid: WrittenGrid) -> bytes:
    """Return a map; one of scale and translation where there is no more, as some programs want it."""
    matrix = np.asarray(grid.world_from_index, dtype=np.float64)
    scale, translation = np.diag(matrix)[:3], matrix[:3, 3]
    if not np.array_equal(matrix[:3, :3], np.diag(scale)) or (scale <= 0).any():
        return _text("AffineMap") + matrix.T.astype("<f8").tobytes()
    kind = "UniformScaleTranslateMap" if np.ptp(scale) == 0 else "ScaleTranslateMap"
    numbers = [translation, scale, scale, 1 / scale, 1 / scale**2, 0.5 / scale]
    return _text(kind) + np.concatenate(numbers).astype("<f8").tobytes()


def _topology(grid: WrittenGrid, leaves: WrittenLeaves) -> bytes:
    """Return the tree down to the masks of its leaves."""
    lowers, lower_of_leaf = nodes_above(leaves.origins, UPPER_EDGE)
    uppers, upper_of_lower = nodes_above(lowers, ROOT_EDGE)
    in_uppers = entries_of(lowers, uppers[upper_of_lower], UPPER_EDGE, 32)
    in_lowers = entries_of(leaves.origins, lowers[lower_of_leaf], LOWER_EDGE, 16)
    masks = bits_of(leaves.active)
    parts = [struct.pack("<i", 1), bytes(12 if grid.is_vector else 4), struct.pack("<2I", 0, len(uppers))]
    ends_of_uppers = np.searchsorted(upper_of_lower, np.arange(len(uppers) + 1))
    ends_of_lowers = np.searchsorted(lower_of_leaf, np.arange(len(lowers) + 1))
    for upper, origin in enumerate(uppers.tolist()):
        first, end = ends_of_uppers[upper : upper + 2]
        parts += [struct.pack("<3i", *origin), _internal(in_uppers[first:end], 32)]
        for lower in range(first, end):
            begin, stop = ends_of_lowers[lower : lower + 2]
            parts += [_internal(in_lowers[begin:stop], 16), masks[begin:stop].tobytes()]
    return b"".join(parts)


def _internal(children: NDArray[np.int64], dim: int) -> bytes:
    """Return an upper or lower node, without its children: no entry is a tile."""
    has_child = np.zeros(dim**3, dtype=bool)
    has_child[children] = True
    return bits_of(has_child).tobytes() + bytes(dim**3 // 8) + _block(np.zeros(0, np.float32))


def _block(values: NDArray[np.float32]) -> bytes:
    """Return the values of a node's active entries, packed where that is shorter."""
    plain = values.astype("<f4").tobytes()
    packed = zlib.compress(plain, _LEVEL)
    size = len(packed) if len(packed) < len(plain) else -len(plain)
    return _ALL_INACTIVE_ARE_BACKGROUND + struct.pack("<q", size) + (packed if size > 0 else plain)
