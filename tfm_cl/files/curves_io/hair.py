"""Hair models of Cem Yuksel, ``.hair``: polylines with width, transparency and colour.

Little-endian (http://www.cemyuksel.com/research/hairmodels, "HAIR file format")::

    char[4]     "HAIR"
    uint32      strands, points of all strands
    uint32      which arrays follow: 1 segments | 2 points | 4 thickness | 8 transparency | 16 colour
    uint32      segments of every strand, where there is no array of them
    float32     thickness and transparency, where there are no arrays
    float32[3]  colour, likewise
    char[88]    about the file
    uint16[strands]     segments of each strand: its points less one
    float32[points, 3]  points
    float32[points]     thickness
    float32[points]     transparency: 1 - opacity
    float32[points, 3]  colour
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io.attributes import curves_of
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.points_io.attributes import check_count
from tfm_cl.files.volume_io.binary import Cursor, map_file

MAGIC = b"HAIR"
SEGMENTS, POINTS, THICKNESS, TRANSPARENCY, COLOUR = 1, 2, 4, 8, 16
NUMBERS = {POINTS: 3, THICKNESS: 1, TRANSPARENCY: 1, COLOUR: 3}
"""Of a point, in each array of float32."""
ABOUT = 88
"""Bytes."""


def read(path: Path) -> StoredCurves:
    """Read all strands of a file.

    Raises
    ------
    VolumeError
        Not such a file, damaged, or too large.
    """
    data = Cursor(map_file(path), str(path))
    if bytes(data.take(len(MAGIC), "the header")) != MAGIC:
        raise VolumeError(f"{path}: not a .hair file: it does not begin with {MAGIC.decode()}")
    strands, points, arrays, segments = data.numbers("4I", "the header")
    thickness, transparency, *colour = data.numbers("5f", "the header")
    data.take(ABOUT, "the header")
    check_count(path, points)
    if not arrays & POINTS:
        raise VolumeError(f"{path}: holds no points")
    # Before anything is made of the numbers in the header.
    following = 2 * strands * bool(arrays & SEGMENTS) + 4 * points * sum(
        numbers for flag, numbers in NUMBERS.items() if arrays & flag
    )
    if following > len(data.data) - data.at:
        raise data.damaged(f"{following:,} bytes should follow; {len(data.data) - data.at:,} do")
    if arrays & SEGMENTS:
        counts = data.array(np.dtype("<u2"), strands, "the segments").astype(np.int64) + 1
    elif strands * (segments + 1) == points:
        counts = np.full(strands, segments + 1, np.int64)
    else:
        raise data.damaged(f"{strands:,} strands of {segments:,} segments have not {points:,} points")

    def each(flag: int, default: float | list[float]) -> NDArray[np.float32]:
        """Read an array, or repeat what the header has for all."""
        width = NUMBERS[flag]
        if arrays & flag:
            return data.array(np.dtype("<f4"), points * width, "the points").reshape(points, width)
        return np.broadcast_to(np.asarray(default, np.float32), (points, width))

    positions, attributes = each(POINTS, 0), {"width": each(THICKNESS, thickness)}
    with np.errstate(invalid="ignore"):  # signalling NaN
        attributes["opacity"] = 1 - each(TRANSPARENCY, transparency)
    attributes["colour"] = each(COLOUR, colour)
    return curves_of(path, positions, counts, attributes)
