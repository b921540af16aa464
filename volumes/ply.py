"""Binary PLY files of triangles or quadrilaterals."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def write_ply(path: Path, vertices: NDArray[np.generic], faces: NDArray[np.int64]) -> None:
    """Write a mesh.

    Parameters
    ----------
    path
        Where to.
    vertices
        [n, 3]; written as float32, or int16 if that is what they are.
    faces
        [m, 3] or [m, 4]: rows of ``vertices``.
    """
    number, kind = ("short", "<i2") if vertices.dtype == np.int16 else ("float", "<f4")
    # Small meshes need but two bytes for a row.
    row, width = ("ushort", "<u2") if number == "short" and len(vertices) <= 1 << 16 else ("int", "<i4")
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        + "".join(f"property {number} {axis}\n" for axis in "xyz")
        + f"element face {len(faces)}\nproperty list uchar {row} vertex_indices\nend_header\n"
    )
    corners = faces.shape[1]
    rows = np.zeros(len(faces), [("count", "u1"), ("corners", width, corners)])
    rows["count"], rows["corners"] = corners, faces
    path.write_bytes(header.encode() + vertices.astype(kind).tobytes() + rows.tobytes())
