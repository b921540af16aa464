"""Small files of points, strands and triangles, of every format that a scene is made from alone."""

import struct

import numpy as np
from scenes import blobs

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]], np.float32)
RADII = np.array([0.5, 0.25, 1], np.float32)
STRANDS = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 2], [0, 0, 3]], np.float32)
"""One of two segments, one of one."""

HAIR = (
    b"HAIR"
    + struct.pack("<4I5f", 2, 5, 3, 0, 0.25, 0.5, 1, 0.5, 0)
    + b"\0" * 88
    + struct.pack("<2H", 2, 1)
    + STRANDS.astype("<f4").tobytes()
)
"""`STRANDS`, 0.25 wide, half transparent, coloured."""
PLY_POINTS = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property float radius
end_header
0 0 0 0.5
1 0 0 0.25
0 2 0 1
"""
PLY_LEAVES = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 1 1
3 0 1 2
3 1 3 2
"""


def write_bgeo(path):
    """`POSITIONS`, with radii."""
    header = b"BgeoV" + struct.pack(">9i", 5, 3, 0, 0, 0, 1, 0, 0, 0)
    attribute = struct.pack(">H", 6) + b"pscale" + struct.pack(">Hi", 1, 0) + b"\0" * 4
    points = [struct.pack(">5f", *place, 1, radius) for place, radius in zip(POSITIONS, RADII, strict=True)]
    path.write_bytes(header + attribute + b"".join(points) + b"\0\xff")


def write_files(folder):
    """Write one of each kind and format."""
    np.savez(folder / "plume.npz", positions=POSITIONS, radius=RADII)
    widths = np.array([0.1, 0.2, 0.3, 0.4, 0.5], np.float32)
    np.savez(folder / "tuft.npz", points=STRANDS, counts=[3, 2], width=widths, opacity=np.full(5, 0.5))
    np.savez(folder / "cloud.npz", density=blobs())
    (folder / "tuft.hair").write_bytes(HAIR)
    (folder / "points.ply").write_bytes(PLY_POINTS)
    (folder / "leaves.ply").write_bytes(PLY_LEAVES)
    write_bgeo(folder / "plume.bgeo")
