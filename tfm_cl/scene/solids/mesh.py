"""Triangle meshes, from a file or from arrays."""

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, PlainValidator

from tfm_cl.errors import SceneError
from tfm_cl.extras import needs
from tfm_cl.files.albedo import read_albedo
from tfm_cl.files.mesh_io.triangles import Textures, Triangles, checked
from tfm_cl.files.mipmap import Mipmap
from tfm_cl.files.paths import name_of, source_of
from tfm_cl.model_fields import TEXT, Accepts, Numbers, accepts
from tfm_cl.scene.frame_numbers import OfFrames
from tfm_cl.scene.solids.base import ReflectanceOrImage, Solid
from tfm_cl.scene.transform import IDENTITY

EXTENSIONS = (".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
"""Mesh formats that are read: they hold plain numbers, and no archives, programs or pickles."""


@accepts(TEXT)
def _mesh(value: Any) -> str | Triangles:
    if isinstance(value, Triangles):
        return value
    name = name_of(value)
    if Path(name).suffix.lower() not in EXTENSIONS:
        raise ValueError(f"should be a file of a known kind: {' '.join(EXTENSIONS)}")
    return name


ALL_EDGES = 180.0
"""Degrees: no edge is sharper."""


@accepts({"type": "boolean"}, {"type": "number", "minimum": 0, "maximum": ALL_EDGES})
def _smooth(value: Any) -> Any:
    if value is None or isinstance(value, bool):
        return value
    if not isinstance(value, int | float) or not 0 <= value <= ALL_EDGES:
        raise ValueError("should be true, false, or an angle from 0 to 180 degrees")
    return float(value)


def _of_vertices(
    name: str, what: str, values: Any, vertices: ArrayLike, columns: int
) -> NDArray[np.float64] | None:
    """Check finite numbers, one row for each vertex; None stays so."""
    if values is None:
        return None
    rows, shape = np.asarray(values, dtype=np.float64), [*np.shape(vertices)[:1], columns]
    if list(rows.shape) != shape or not np.isfinite(rows).all():
        raise SceneError(f"{name}: {what} should be finite numbers {shape}, one row for each vertex")
    return rows


class MeshSolid(OfFrames, Solid):
    """Triangles, visible from both sides, flat or shaded smoothly.

    The file is read when it is first needed, once per object.
    """

    mesh: Accepts[str | Path | Triangles, Annotated[str | Triangles, PlainValidator(_mesh)]] = Field(
        description=f"file: {' '.join(EXTENSIONS)}"
    )
    albedo: Accepts[float | Numbers | str | Path | None, ReflectanceOrImage | None] = Field(
        default=None,
        validate_default=True,
        description="diffuse reflectance, linear RGB, 0 to 1, or an image file, which needs texture "
        "coordinates; default: the file's colours and textures, or 0.8 if it has none",
    )
    smooth: Annotated[bool | float | None, BeforeValidator(_smooth)] = Field(
        default=None,
        description="false: flat triangles; true: the normals of the file, computed across all edges if it "
        "has none; an angle in degrees: computed across the edges that are no sharper; default: the normals "
        "of the file, flat if it has none",
    )

    @classmethod
    def from_arrays(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        albedo: Any = None,
        *,
        normals: ArrayLike | None = None,
        uv: ArrayLike | None = None,
        transform: Any = IDENTITY,
        **options: Any,
    ) -> Self:
        """Make a mesh from arrays.

        Parameters
        ----------
        vertices
            [V, 3], object units.
        faces
            [F, 3], integers: rows of ``vertices``.
        albedo
            One colour, or one per vertex [V, 3], interpolated in between; linear, 0 to 1; None means 0.8. Or
            an image file, for which ``uv`` is needed.
        normals
            [V, 3], for smooth shading; None: flat.
        uv
            [V, 2], texture coordinates; v points upwards in the image.
        transform
            World-from-object matrix, 4×4.
        **options
            ``smooth``, ``visible`` and ``holdout``, as of a scene file.

        Raises
        ------
        SceneError
            As for a file: invalid shapes, values or indices.
        """
        name, options = "MeshSolid.from_arrays", {"transform": transform, **options}
        colours = None
        if np.ndim(albedo) == 2:  # noqa: PLR2004 - a colour for each vertex
            colours, albedo = np.asarray(albedo, dtype=np.float32), None
            if colours.shape != np.shape(vertices) or not ((colours >= 0) & (colours <= 1)).all():
                raise SceneError(
                    f"{name}: albedo should be numbers from 0 to 1, [3] or one row for each vertex"
                )
        colour_of = None if colours is None else np.asarray(faces, dtype=np.int32)
        directions = _of_vertices(name, "normals", normals, vertices, 3)
        triangles = checked(name, vertices, faces, colours, colour_of, directions)
        coordinates = _of_vertices(name, "uv", uv, vertices, 2)
        if coordinates is not None:
            # Of no image yet: `albedo` may name one.
            none = np.full(len(triangles.faces), -1, np.int32)
            triangles = replace(triangles, textures=Textures(coordinates, triangles.faces, none, ()))
        return cls(mesh=triangles, albedo=albedo, **options)

    @cached_property
    def _triangles(self) -> Triangles:
        albedo = read_albedo(self.albedo) if isinstance(self.albedo, str) else self.albedo
        triangles = self._read(albedo)
        if self.smooth is None or (self.smooth is True and triangles.normals is not None):
            return triangles
        if self.smooth is False:
            return triangles.shaded(None)
        from tfm_cl.files.mesh_io.normals import smoothed  # noqa: PLC0415 - few ask for it

        return smoothed(triangles, ALL_EDGES if self.smooth is True else self.smooth)

    def _read(self, albedo: tuple[float, float, float] | Mipmap | None) -> Triangles:
        """Return the triangles, painted; with the file's normals."""
        if not isinstance(self.mesh, Triangles):
            source = source_of(self.mesh, error=SceneError)
            with needs("solids", f"{source}: a mesh", SceneError):
                from tfm_cl.files.mesh_io.loading import read_mesh  # noqa: PLC0415 - reads with trimesh: slow to import

            return read_mesh(source, albedo)
        if albedo is None:
            return self.mesh
        if not isinstance(albedo, Mipmap):
            return self.mesh.painted(albedo)
        textures = self.mesh.textures
        if textures is None:
            raise SceneError(f"solid.albedo = {self.albedo!r}: an image needs texture coordinates: give uv")
        whole = replace(textures, image_of=np.zeros_like(textures.image_of), images=(albedo,))
        return replace(self.mesh.painted((1.0, 1.0, 1.0)), textures=whole)

    def load(self) -> Triangles:
        """Read the file, once; the triangles are in object space.

        Raises
        ------
        SceneError
            The file is missing, damaged, too large, of unknown type, or has no triangles.
        """
        return self._triangles

    def like(self, other: Solid) -> Self:
        """As `Solid.like`."""
        read, keys = vars(other).get("_triangles"), ("mesh", "albedo", "smooth")
        told = isinstance(self.mesh, str) and [getattr(self, key) for key in keys]
        if read is not None and told == [getattr(other, key) for key in keys]:
            self.__dict__["_triangles"] = read
        return self

    def read_files(self) -> None:
        """As `load`."""
        self.load()

    def files(self) -> list[str]:
        """As `Solid.files`."""
        return [name for name in (self.mesh, self.albedo) if isinstance(name, str)]

    def world_vertices(self) -> NDArray[np.float64]:
        """[V, 3], world units.

        Raises
        ------
        SceneError
            As `load`.
        """
        matrix = self.world_from_object
        vertices = self.load().vertices
        if self.transform == IDENTITY:
            return vertices
        return vertices @ matrix[:3, :3].T + matrix[:3, 3]

    def bounds(self) -> NDArray[np.float64]:
        """Bounds of the vertices of its triangles; reads the file."""
        used = np.zeros(len(self.load().vertices), dtype=bool)
        used[self.load().faces] = True
        world = self.world_vertices()[used]
        return np.stack([world.min(axis=0), world.max(axis=0)])

    def to_dict(self) -> dict[str, Any]:
        """Return the solid as a table for a scene file.

        Raises
        ------
        SceneError
            If the mesh was made from arrays: it has no file to refer to.
        """
        if isinstance(self.mesh, Triangles):
            raise SceneError(
                "solid.mesh: a mesh made from arrays cannot be written to a scene file; save it as .ply"
            )
        return super().to_dict()
