"""Checks the sizes that a glTF file declares before memory is allocated for them.

Accessors, buffer views and primitives may refer to the same bytes any number of times: a few kilobytes can
ask for terabytes. (glTF 2.0, 3.6: https://registry.khronos.org/glTF/specs/2.0/)
"""

import json
import os
from pathlib import Path
from typing import IO, Any
from urllib.parse import unquote

import numpy as np

from tfm_cl.errors import SceneError
from tfm_cl.files.paths import is_file

COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
WIDEST = 4
"""Bytes of the widest component type."""
MAX_ENTRIES = 1_000_000
"""Largest number of entries in any of the file's lists."""
MAX_BYTES = 1 << 30
"""Largest number of bytes of a mesh file, and of all the files it refers to together."""


def check_gltf(path: Path, stream: IO[bytes], largest: int, most_faces: int) -> dict[str, Any]:
    """Check the sizes that a .glb or .gltf stream declares; returns its header, and rewinds the stream.

    Raises
    ------
    SceneError
        It would need more than ``largest`` bytes, twice, or ``most_faces`` triangles, or it is compressed.
    ValueError, KeyError, TypeError
        If it is not glTF.
    """
    header = _header(stream)
    stream.seek(0)
    lists = (
        "accessors",
        "bufferViews",
        "meshes",
        "nodes",
        "materials",
        "textures",
        "samplers",
        "images",
        "buffers",
    )
    for key in lists:
        if len(header.get(key, [])) > MAX_ENTRIES:
            raise SceneError(f"{path}: {len(header[key]):,} {key}; the limit is {MAX_ENTRIES:,}")
    accessors = header.get("accessors", [])
    for index, accessor in enumerate(accessors):
        if "bufferView" not in accessor:
            raise SceneError(
                f"{path}: accessor {index} has no plain data (compressed or sparse); "
                "save the file without compression"
            )
    counts = [_count(accessor["count"]) for accessor in accessors]
    numbers = sum(
        count * COLUMNS[accessor["type"]] for count, accessor in zip(counts, accessors, strict=True)
    )
    views = sum(_count(view["byteLength"]) for view in header.get("bufferViews", []))
    if max(views, numbers * WIDEST) > 2 * largest:
        raise SceneError(
            f"{path}: announces {max(views, numbers * WIDEST):,} bytes; the limit is {2 * largest:,}"
        )
    corners = _corners(header, counts)
    if corners > 3 * most_faces:
        raise SceneError(f"{path}: announces {corners // 3:,} triangles; the limit is {most_faces:,}")
    return header


def named_files(path: Path) -> list[str]:
    """Return the names of the buffers and images that lie in files of their own.

    Raises
    ------
    OSError, ValueError, KeyError, TypeError
        It cannot be read, or is not glTF.
    """
    with path.open("rb") as stream:
        if stream.seek(0, os.SEEK_END) > MAX_BYTES:
            raise ValueError("it is too large")
        header = _header(stream)
    entries = [*header.get("buffers", []), *header.get("images", [])]
    uris = [entry["uri"] for entry in entries if "uri" in entry and not entry["uri"].startswith("data:")]
    return [uri if is_file(path.parent / uri) else unquote(uri) for uri in uris]


def _corners(header: dict[str, Any], counts: list[int]) -> int:
    """Count the vertices or indices, whichever are more, that each primitive reads, and add them up."""
    return sum(
        max(counts[primitive["attributes"]["POSITION"]], counts[primitive.get("indices", 0)])
        for mesh in header.get("meshes", [])
        for primitive in mesh["primitives"]
    )


def _count(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"a count is a whole number, not {value!r}")
    return value


def _header(stream: IO[bytes]) -> dict[str, Any]:
    """Read the JSON of a .glb or .gltf file."""
    stream.seek(0)
    start = stream.read(20)
    if start[:4] == b"glTF":
        if len(start) < 20:  # noqa: PLR2004 - header, then length and type of the first chunk
            raise ValueError("it is cut short")
        text = stream.read(int(np.frombuffer(start[12:16], "<u4")[0]))
    else:
        text = start + stream.read()
    header = json.loads(text)
    if not isinstance(header, dict):
        raise TypeError("its JSON is not a table")
    return header
