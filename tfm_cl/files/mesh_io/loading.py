"""Mesh files, read by trimesh; nothing that a file declares is trusted.

Colours become linear albedo per vertex, face or part; textures are sampled at the vertices.

- glTF: base colour factor and vertex colours are linear according to its specification, textures sRGB; they
  are multiplied.
- OBJ: the material's Kd is taken as linear, as Blender does; its texture is sRGB; they are multiplied.
- Other 8-bit colours (PLY, OBJ vertices) are sRGB.
"""

import contextlib
import logging
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh, load_scene
from trimesh.resolvers import FilePathResolver
from trimesh.scene import Scene
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from tfm_cl.errors import SceneError
from tfm_cl.files.mesh_io.gltf_limits import check_gltf
from tfm_cl.files.mesh_io.triangles import DEFAULT_ALBEDO, MAX_CORNERS, MAX_FACES, Triangles, checked
from tfm_cl.files.paths import check_readable, is_file, real_path
from tfm_cl.files.srgb import linear_from_srgb

MAX_BYTES = 1 << 30
"""Largest number of bytes of a mesh file, and of all the files it refers to together."""

MAX_PARTS = 1_000_000
"""Largest number of parts in a file."""

LONGEST_REASON = 160
"""Number of characters to which messages of other libraries are shortened."""

_GLTF = (".glb", ".gltf")


class _NeighbourResolver(FilePathResolver):
    """Opens the files that a mesh refers to: plain files in its folder or below, up to `MAX_BYTES` in all."""

    def __init__(self, source: str) -> None:
        super().__init__(source)
        self._left = MAX_BYTES

    def get(self, name: str) -> bytes:
        path = self.absolute(name)
        if not is_file(path):
            raise FileNotFoundError(f"it names '{name}', which is not there")
        with path.open("rb") as stream:
            data = stream.read(self._left + 1)
        self._left -= len(data)
        if self._left < 0:
            raise ValueError(f"the files it names hold more than {MAX_BYTES:,} bytes")
        return data


def read_mesh(path: Path, albedo: tuple[float, float, float] | None = None) -> Triangles:
    """Read a mesh file as one set of triangles; scene graphs are flattened.

    Parameters
    ----------
    path
        The file; its extension determines the format.
    albedo
        Replaces the colours of the file, which are then not read.

    Raises
    ------
    SceneError
        The file is missing, damaged, too large, or has no triangles.
    """
    _check_file(path)
    try:
        with path.open("rb") as stream, _quietly():
            extension = path.suffix.lower()
            if extension in _GLTF:
                check_gltf(path, stream, MAX_BYTES, MAX_FACES)
            triangles = _flatten(path, _scene(stream, extension, path, colours=albedo is None), albedo)
    except SceneError:
        raise
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or _reason(error)})") from error
    except Exception as error:  # trimesh passes on any error of its parsers
        raise SceneError(f"{path}: not a readable {extension} mesh ({_reason(error)})") from error
    return triangles


def _check_file(path: Path) -> None:
    size = check_readable(path, SceneError)
    if size > MAX_BYTES:
        raise SceneError(f"{path}: {size:,} bytes; the limit for meshes is {MAX_BYTES:,}")


def _reason(error: Exception) -> str:
    """Shorten an error's message to one printable line."""
    text = "".join(letter if letter.isprintable() else " " for letter in str(error))
    text = " ".join(text.split())[:LONGEST_REASON]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@contextlib.contextmanager
def _quietly() -> Iterator[None]:
    """Silence trimesh's log and the warnings of its dependencies: errors say everything."""
    logger = logging.getLogger("trimesh")
    handler, propagate = logging.NullHandler(), logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.propagate = propagate
        logger.removeHandler(handler)


def _scene(stream: IO[bytes], extension: str, path: Path, *, colours: bool) -> Scene:
    options: dict[str, Any] = {} if colours or extension in {".off", ".stl"} else {"skip_materials": True}
    # A stream and not a name: trimesh would try a name as a URL or as JSON.
    return load_scene(
        file_obj=stream,
        file_type=extension[1:],
        resolver=_NeighbourResolver(str(real_path(path))),
        allow_remote=False,
        process=False,  # merging vertices is slow and useless here
        **options,
    )


def _flatten(path: Path, scene: Scene, albedo: tuple[float, float, float] | None) -> Triangles:
    """Place the parts of a scene according to its graph, with their colours."""
    placed = [(scene.graph[node], node) for node in scene.graph.nodes_geometry]
    parts = [(matrix, scene.geometry.get(name)) for (matrix, name), _ in placed]
    meshes = [(matrix, part) for matrix, part in parts if isinstance(part, Trimesh) and len(part.faces)]
    if len(meshes) > MAX_PARTS:
        raise SceneError(f"{path}: {len(meshes):,} parts; the limit is {MAX_PARTS:,}")
    count = sum(len(part.faces) for _, part in meshes)
    if count > MAX_FACES or sum(len(part.vertices) for _, part in meshes) > MAX_CORNERS:
        raise SceneError(f"{path}: {count:,} triangles; the limit is {MAX_FACES:,}")
    if not meshes:
        raise SceneError(f"{path}: holds no triangles")
    paint = _Paint(linear_vertices=path.suffix.lower() in _GLTF)
    colours_of: dict[int, tuple[NDArray[np.float32], NDArray[np.int32]]] = {}
    vertices, faces, colours, colour_of = [], [], [], []
    offset = paint_offset = 0
    for matrix, part in meshes:
        points, rows = np.asarray(part.vertices), np.asarray(part.faces)
        if rows.min() < 0 or rows.max() >= len(points):
            # In the combined mesh this could be a vertex of another part.
            raise SceneError(f"{path}: a triangle names a vertex that its part does not have")
        vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        faces.append(rows + offset)
        offset += len(points)
        if albedo is None:
            if id(part) not in colours_of:
                colours_of[id(part)] = paint.of(part)
            values, index = colours_of[id(part)]
            colours.append(values)
            colour_of.append(np.broadcast_to(index, rows.shape) + np.int32(paint_offset))
            paint_offset += len(values)
    if albedo is not None:
        return checked(str(path), np.concatenate(vertices), np.concatenate(faces)).painted(albedo)
    return checked(
        str(path),
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(colours),
        np.concatenate(colour_of).astype(np.int32),
    )


class _Paint:
    """Linear albedo of a file's parts."""

    def __init__(self, *, linear_vertices: bool) -> None:
        self._linear_vertices = linear_vertices
        self._images: dict[int, NDArray[np.float32]] = {}

    def of(self, part: Trimesh) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return colours [C, 3] and their rows at the triangles' corners [F, 3], or [1, 3] for one colour."""
        visual, vertices, faces = part.visual, len(part.vertices), np.asarray(part.faces, np.int32)
        if isinstance(visual, TextureVisuals):
            colours = self._of_material(visual, vertices)
        elif isinstance(visual, ColorVisuals) and visual.kind == "vertex":
            colours = self._of_vertices(visual.vertex_colors)
        elif isinstance(visual, ColorVisuals) and visual.kind == "face":
            colours = self._of_vertices(visual.face_colors)
            if len(colours) == len(faces):
                return colours, np.repeat(np.arange(len(faces), dtype=np.int32)[:, None], 3, axis=1)
        else:
            colours = np.array([DEFAULT_ALBEDO], np.float32)
        if len(colours) not in {1, vertices}:
            colours = np.array([DEFAULT_ALBEDO], np.float32)
        colours = np.clip(np.nan_to_num(colours), 0, 1).astype(np.float32)
        return colours, faces if len(colours) == vertices else np.zeros((1, 3), np.int32)

    def _of_vertices(self, colours: Any) -> NDArray[np.float32]:
        levels = np.asarray(colours)[:, :3]
        return (levels / 255).astype(np.float32) if self._linear_vertices else _decoded(levels)

    def _of_material(self, visual: TextureVisuals, vertices: int) -> NDArray[np.float32]:
        """Multiply factor, texture and vertex colour, as far as they exist."""
        material, factor, image = visual.material, None, None
        if isinstance(material, PBRMaterial):
            image = material.baseColorTexture
            # Without a factor it is 1 (glTF 2.0, 3.9.2).
            factor = np.ones(3) if material.baseColorFactor is None else material.baseColorFactor[:3] / 255
        elif isinstance(material, SimpleMaterial):
            # An image without a format is a placeholder made by trimesh.
            image = material.image if getattr(material.image, "format", None) else None
            diffuse = np.atleast_1d(np.asarray(material.kwargs.get("kd", ()), np.float64))
            if len(diffuse) in {1, 3}:
                factor = diffuse
            elif image is not None:
                factor = np.ones(3)
        if factor is None:
            return np.array([DEFAULT_ALBEDO], np.float32)
        colours: NDArray[np.float32] = np.broadcast_to(factor, (1, 3)).astype(np.float32)
        if image is not None and visual.uv is not None and np.shape(visual.uv) == (vertices, 2):
            colours = colours * self._texels(image, visual.uv)
        corners = visual.vertex_attributes.get("color", None)
        if corners is not None and len(corners) == vertices:
            colours = colours * _unit(np.asarray(corners)[:, :3])
        return colours

    def _texels(self, image: Any, uv: NDArray[np.float64]) -> NDArray[np.float32]:
        """Look up the nearest texel of a repeated image; v points upwards."""
        if id(image) not in self._images:
            self._images[id(image)] = np.asarray(image.convert("RGB"))
        levels = self._images[id(image)]
        height, width = levels.shape[:2]
        u, v = np.nan_to_num(np.asarray(uv, np.float64)).T % 1.0
        column = np.minimum((u * width).astype(np.int64), width - 1)
        row = np.clip(((1 - v) * height).astype(np.int64), 0, height - 1)
        return _decoded(levels[row, column])


def _unit(levels: NDArray[Any]) -> NDArray[np.float32]:
    """Convert stored colours to 0..1."""
    largest = np.iinfo(levels.dtype).max if levels.dtype.kind in "iu" else 1
    return (levels / largest).astype(np.float32)


def _decoded(levels: NDArray[Any]) -> NDArray[np.float32]:
    """Decode 8-bit sRGB levels to 0..1, linear."""
    table = linear_from_srgb(np.arange(256) / 255)
    decoded: NDArray[np.float32] = table.astype(np.float32)[np.asarray(levels, np.uint8)]
    return decoded
