"""What trimesh leaves out of a glTF file's materials, from the file's own header.

trimesh forgets which texture an image came from, and reads texture coordinates and colours in full only
where a triangle has a material. So the header that it gets is changed: materials are called by their
numbers, and what has none gets an empty one. (glTF 2.0, 3.8 and 3.9, and KHR_texture_transform)
"""

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.files.mipmap import Wrap

WRAPS: dict[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
"""By the numbers that OpenGL gives them."""
NOTHING = "-"
"""Name of the material of what has none."""
_MAGIC, _JSON = b"glTF", b"JSON"


@dataclass(frozen=True)
class TextureUse:
    """How a material's base colour uses an image."""

    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    turned: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """[2, 3], applied to u, v and 1, where v points downwards; None: as they are."""

    def coordinates(self, uv: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where texture coordinates [V, 2] lie in the image; v points upwards."""
        if self.turned is None:
            return uv
        downwards = np.column_stack([uv[:, 0], 1 - uv[:, 1], np.ones(len(uv))])
        u, v = np.array(self.turned) @ downwards.T
        return np.stack([u, 1 - v], axis=1)


def texture_uses(path: Path, header: dict[str, Any]) -> dict[str, TextureUse]:
    """Return how materials use their images, by the materials' numbers as names.

    Raises
    ------
    SceneError
        A second set of texture coordinates, which is not read.
    ValueError, KeyError, TypeError, LookupError
        If it is not glTF.
    """
    found = {}
    for number, material in enumerate(header.get("materials", [])):
        texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
        if texture is None:
            continue
        transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
        if transform.get("texCoord", texture.get("texCoord", 0)) != 0:
            raise SceneError(
                f"{path}: the base colour of material {number} uses a second set of texture coordinates; "
                "save the file with one, or give solid.albedo"
            )
        sampler = header["textures"][texture["index"]].get("sampler")
        asked = {} if sampler is None else header["samplers"][sampler]
        u, v = (WRAPS.get(asked.get(key, 10497), "repeat") for key in ("wrapS", "wrapT"))
        found[str(number)] = TextureUse((u, v), _turned(transform) if transform else None)
    return found


def respelled(stream: IO[bytes], header: dict[str, Any]) -> IO[bytes]:
    """Return a .glb or .gltf stream, at its beginning, whose materials are called by their numbers."""
    materials = [material | {"name": str(i)} for i, material in enumerate(header.get("materials", []))]
    nothing = {"material": len(materials)}
    meshes = [
        mesh | {"primitives": [nothing | primitive for primitive in mesh["primitives"]]}
        for mesh in header.get("meshes", [])
    ]
    changed = header | {"materials": [*materials, {"name": NOTHING}], "meshes": meshes}
    text = json.dumps(changed).encode()
    stream.seek(0)
    start = stream.read(20)
    if start[:4] != _MAGIC:
        return io.BytesIO(text)
    text += b" " * (-len(text) % 4)
    stream.seek(20 + int(np.frombuffer(start[12:16], "<u4")[0]))
    first = start[:12] + np.uint32(len(text)).tobytes() + _JSON + text
    return cast("IO[bytes]", _Joined(first, stream))


class _Joined(io.RawIOBase):
    """Some bytes, and after them what is left of a stream."""

    def __init__(self, first: bytes, rest: IO[bytes]) -> None:
        super().__init__()
        self._first, self._rest, self._place = io.BytesIO(first), rest, 0

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1, /) -> bytes:
        data = self._first.read(size)
        if size < 0 or len(data) < size:
            data += self._rest.read(size - len(data) if size >= 0 else -1)
        self._place += len(data)
        return data

    def tell(self) -> int:
        return self._place


def _turned(transform: dict[str, Any]) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    (x, y), (width, height) = transform.get("offset", (0, 0)), transform.get("scale", (1, 1))
    angle = float(transform.get("rotation", 0))
    sine, cosine = float(np.sin(angle)), float(np.cos(angle))
    return (width * cosine, height * sine, x), (-width * sine, height * cosine, y)
