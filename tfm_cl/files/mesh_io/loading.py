"""Mesh files, read by trimesh; nothing that a file declares is trusted.

Colours become linear albedo per vertex, face or part; textures keep their texture coordinates.

- glTF: base colour factor and vertex colours are linear according to its specification, textures sRGB; they
  are multiplied.
- OBJ: the material's Kd is taken as linear, as Blender does; its texture is sRGB; they are multiplied.
- Other 8-bit colours (PLY, OBJ vertices) are sRGB.

Vertex normals of glTF, OBJ and PLY are kept.
"""

import contextlib
import logging
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh, load_scene
from trimesh.resolvers import FilePathResolver
from trimesh.scene import Scene
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.color import to_rgba
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from tfm_cl.errors import SceneError
from tfm_cl.files.mesh_io.gltf_limits import MAX_BYTES, check_gltf
from tfm_cl.files.mesh_io.gltf_materials import NOTHING, TextureUse, respelled, texture_uses
from tfm_cl.files.mesh_io.triangles import (
    DEFAULT_ALBEDO,
    MAX_CORNERS,
    MAX_FACES,
    Textures,
    Triangles,
    checked,
)
from tfm_cl.files.mipmap import Mipmap
from tfm_cl.files.paths import check_readable, is_file, real_path
from tfm_cl.files.srgb import decoded, linear_from_srgb

MAX_PARTS = 1_000_000
"""Largest number of parts in a file."""

MAX_TEXELS = 1 << 28
"""Largest number of texels of all images of a file together."""

IMAGES = ("BMP", "JPEG", "PNG", "TGA", "TIFF", "WEBP")
"""Kinds of images that are decoded; Pillow would start other programs for some others."""

FURTHEST = 1e6
"""Texture coordinates beyond this, or that are no numbers, are 0."""

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
            path = self.absolute(unquote(name))  # glTF names files by URI
        if not is_file(path):
            raise FileNotFoundError(f"it names '{name}', which is not there")
        with path.open("rb") as stream:
            data = stream.read(self._left + 1)
        self._left -= len(data)
        if self._left < 0:
            raise ValueError(f"the files it names hold more than {MAX_BYTES:,} bytes")
        return data


def read_mesh(path: Path, albedo: tuple[float, float, float] | Mipmap | None = None) -> Triangles:
    """Read a mesh file as one set of triangles; scene graphs are flattened.

    Parameters
    ----------
    path
        The file; its extension determines the format.
    albedo
        Replaces the colours of the file, which are then not read; an image lies where the file's texture
        coordinates put it.

    Raises
    ------
    SceneError
        The file is missing, damaged, too large, or has no triangles; or it has no texture coordinates for an
        image.
    """
    _check_file(path)
    extension = path.suffix.lower()
    try:
        with path.open("rb") as stream, _quietly():
            paint = _Paint(albedo, linear_vertices=extension in _GLTF)
            source: IO[bytes] = stream
            if extension in _GLTF:
                header = check_gltf(path, stream, MAX_BYTES, MAX_FACES)
                if paint.reads_materials:
                    paint.uses = texture_uses(path, header) if albedo is None else {}
                    source = respelled(stream, header)
            triangles = _flatten(
                path, _scene(source, extension, path, materials=paint.reads_materials), paint
            )
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


def _scene(stream: IO[bytes], extension: str, path: Path, *, materials: bool) -> Scene:
    options: dict[str, Any] = {} if materials or extension in {".off", ".stl"} else {"skip_materials": True}
    # A stream and not a name: trimesh would try a name as a URL or as JSON.
    return load_scene(
        file_obj=stream,
        file_type=extension[1:],
        resolver=_NeighbourResolver(str(real_path(path))),
        allow_remote=False,
        process=False,  # merging vertices is slow and useless here
        **options,
    )


def _flatten(path: Path, scene: Scene, paint: "_Paint") -> Triangles:
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
    coats: dict[int, _Coat] = {}
    normals_of = {id(part): _normals(part) for _, part in meshes}
    is_smooth = any(found is not None for found in normals_of.values())
    vertices, faces, normals, used = [], [], [], []
    offset = 0
    for matrix, part in meshes:
        points, rows = np.asarray(part.vertices), np.asarray(part.faces)
        if rows.min() < 0 or rows.max() >= len(points):
            # In the combined mesh this could be a vertex of another part.
            raise SceneError(f"{path}: a triangle names a vertex that its part does not have")
        vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
        faces.append(rows + offset)
        offset += len(points)
        if is_smooth:
            normals.append(_placed_normals(normals_of[id(part)], len(points), matrix))
        if id(part) not in coats:
            coats[id(part)] = paint.of(part)
        used.append(coats[id(part)])
    if isinstance(paint.albedo, Mipmap) and not any(coat.image >= 0 for coat in used):
        raise SceneError(
            f"{path}: has no texture coordinates, which an image as solid.albedo needs; give one colour"
        )
    rows = np.concatenate(faces)
    counts = [len(part.faces) for _, part in meshes]
    colours, colour_of = _joined_colours(used, counts)
    textures = None
    if paint.images:
        uv = [
            coat.uv if coat.uv is not None else np.zeros((len(part.vertices), 2))
            for coat, (_, part) in zip(used, meshes, strict=True)
        ]
        image_of = np.repeat(np.array([coat.image for coat in used], np.int32), counts)
        textures = Textures(np.concatenate(uv), rows.astype(np.int32), image_of, tuple(paint.images))
    all_normals = np.concatenate(normals) if is_smooth else None
    return checked(str(path), np.concatenate(vertices), rows, colours, colour_of, all_normals, textures)


def _normals(part: Trimesh) -> NDArray[np.float64] | None:
    """Return the normals of a file's vertices; None without: trimesh would compute them when asked."""
    if "vertex_normals" not in part._cache:  # noqa: SLF001 - nothing else tells
        return None
    normals = np.asarray(part.vertex_normals, np.float64)
    return normals if normals.shape == np.shape(part.vertices) and normals.any() else None


def _placed_normals(
    normals: NDArray[np.float64] | None, count: int, matrix: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn a part's normals with it; 0 where it has none, or is squeezed flat."""
    if normals is None:
        return np.zeros((count, 3))
    # The cofactors are the inverse transpose times the determinant, and exist where there is no inverse.
    rows = matrix[:3, :3]
    cofactors = np.stack([np.cross(rows[1], rows[2]), np.cross(rows[2], rows[0]), np.cross(rows[0], rows[1])])
    turned: NDArray[np.float64] = normals @ cofactors.T * (-1.0 if np.linalg.det(rows) < 0 else 1.0)
    return turned


@dataclass(frozen=True, eq=False)
class _Coat:
    """What a part is painted with."""

    colours: NDArray[np.float32]
    """[C, 3]."""
    colour_of: NDArray[np.int32]
    """[F, 3], or [1, 3]: rows of ``colours`` at the corners."""
    image: int = -1
    """Its number; -1 without."""
    uv: NDArray[np.float64] | None = None
    """[V, 2], where there is an image."""


def _joined_colours(coats: list[_Coat], counts: list[int]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Join the colours of parts of so many triangles; one row for all if there is one colour."""
    colours = np.concatenate([coat.colours for coat in coats])
    if (colours == colours[0]).all():
        return colours[:1], np.zeros((1, 3), np.int32)
    starts = np.cumsum([0, *(len(coat.colours) for coat in coats)])
    rows = [
        np.broadcast_to(coat.colour_of, (count, 3)) + np.int32(start)
        for coat, count, start in zip(coats, counts, starts[:-1], strict=True)
    ]
    return colours, np.concatenate(rows).astype(np.int32)


class _Paint:
    """Linear albedo of a file's parts; `images` are those that parts were found to have."""

    def __init__(self, albedo: tuple[float, float, float] | Mipmap | None, *, linear_vertices: bool) -> None:
        self.albedo = albedo
        self.images: list[Mipmap] = []
        self.uses: Mapping[str, TextureUse] = {}
        """Of glTF, by its materials' names."""
        self._linear_vertices = linear_vertices
        self._numbers: dict[tuple[int, object], int] = {}
        self._decoded: dict[int, Mipmap] = {}
        self._texels = 0

    @property
    def reads_materials(self) -> bool:
        """Whether a file's materials count, or its texture coordinates, which trimesh reads with them."""
        return self.albedo is None or isinstance(self.albedo, Mipmap)

    def of(self, part: Trimesh) -> _Coat:
        """Return what a part is painted with."""
        visual, vertices, faces = part.visual, len(part.vertices), np.asarray(part.faces, np.int32)
        uv = _coordinates(visual, vertices)
        if self.albedo is not None:
            if isinstance(self.albedo, Mipmap) and uv is not None:
                self.images = [self.albedo]
                return _Coat(np.ones((1, 3), np.float32), ONE_COLOUR, 0, _tamed(uv))
            albedo = DEFAULT_ALBEDO if isinstance(self.albedo, Mipmap) else self.albedo
            return _Coat(np.array([albedo], np.float32), ONE_COLOUR)
        image = None
        if isinstance(visual, TextureVisuals):
            colours, image = self._of_material(part, visual)
        elif isinstance(visual, ColorVisuals) and visual.kind == "vertex":
            colours = self._of_vertices(visual.vertex_colors)
        elif isinstance(visual, ColorVisuals) and visual.kind == "face":
            colours = self._of_vertices(visual.face_colors)
            if len(colours) == len(faces):
                return _Coat(colours, np.repeat(np.arange(len(faces), dtype=np.int32)[:, None], 3, axis=1))
        else:
            colours = np.array([DEFAULT_ALBEDO], np.float32)
        if len(colours) not in {1, vertices}:
            colours = np.array([DEFAULT_ALBEDO], np.float32)
        colours = np.clip(np.nan_to_num(colours), 0, 1).astype(np.float32)
        colour_of = faces if len(colours) == vertices else ONE_COLOUR
        if image is None or uv is None or not isinstance(visual, TextureVisuals):
            return _Coat(colours, colour_of)
        use = self.uses.get(str(visual.material.name), TextureUse())
        return _Coat(colours, colour_of, self._number(image, use), _tamed(use.coordinates(uv)))

    def _of_vertices(self, colours: Any) -> NDArray[np.float32]:
        levels = np.asarray(colours)[:, :3]
        return (levels / 255).astype(np.float32) if self._linear_vertices else _decoded(levels)

    def _of_material(self, part: Trimesh, visual: TextureVisuals) -> tuple[NDArray[np.float32], Any]:
        """Multiply factor and vertex colour, as far as they exist; returns the image, too."""
        material, factor, image = visual.material, None, None
        corners = visual.vertex_attributes.get("color", None)
        if isinstance(material, PBRMaterial):
            image = material.baseColorTexture
            # Without a factor it is 1 (glTF 2.0, 3.9.2).
            factor = np.ones(3) if material.baseColorFactor is None else material.baseColorFactor[:3] / 255
            if material.name == NOTHING and corners is None:
                factor = np.array(DEFAULT_ALBEDO)
        elif isinstance(material, SimpleMaterial):
            # An image without a format is a placeholder made by trimesh.
            image = material.image if getattr(material.image, "format", None) else None
            diffuse = np.atleast_1d(np.asarray(material.kwargs.get("kd", ()), np.float64))
            if len(diffuse) in {1, 3}:
                factor = diffuse
            elif image is not None:
                factor = np.ones(3)
            elif "color" in part.vertex_attributes:  # beside texture coordinates that nothing uses
                return self._of_vertices(to_rgba(part.vertex_attributes["color"])), None
        if factor is None:
            return np.array([DEFAULT_ALBEDO], np.float32), None
        colours: NDArray[np.float32] = np.broadcast_to(factor, (1, 3)).astype(np.float32)
        if corners is not None and len(corners) == len(part.vertices):
            colours = colours * _unit(np.asarray(corners)[:, :3])
        return colours, image

    def _number(self, image: Any, use: TextureUse) -> int:
        """Return the number of an image that is used in some way; it is decoded once."""
        key = id(image), use.wrap
        if key not in self._numbers:
            if id(image) not in self._decoded:
                if image.format not in IMAGES:
                    raise ValueError(f"an image of the kind {image.format}; known: {' '.join(IMAGES)}")
                self._texels += image.size[0] * image.size[1]
                if self._texels > MAX_TEXELS:
                    raise ValueError(f"its images have more than {MAX_TEXELS:,} texels")
                self._decoded[id(image)] = Mipmap.of(decoded(image))
            self._numbers[key] = len(self.images)
            self.images.append(self._decoded[id(image)].wrapped(use.wrap))
        return self._numbers[key]


ONE_COLOUR = np.zeros((1, 3), np.int32)
"""Of all corners."""


def _coordinates(visual: Any, vertices: int) -> NDArray[np.float64] | None:
    """Return the texture coordinates of a part, [V, 2]; None without."""
    uv = getattr(visual, "uv", None)
    return None if uv is None or np.shape(uv) != (vertices, 2) else np.asarray(uv, np.float64)


def _tamed(uv: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.abs(uv) <= FURTHEST, uv, 0)  # NaN is not


def _unit(levels: NDArray[Any]) -> NDArray[np.float32]:
    """Convert stored colours to 0..1."""
    largest = np.iinfo(levels.dtype).max if levels.dtype.kind in "iu" else 1
    return (levels / largest).astype(np.float32)


def _decoded(levels: NDArray[Any]) -> NDArray[np.float32]:
    """Decode 8-bit sRGB levels to 0..1, linear."""
    table = linear_from_srgb(np.arange(256) / 255)
    decoded: NDArray[np.float32] = table.astype(np.float32)[np.asarray(levels, np.uint8)]
    return decoded
