"""Triangle meshes, from a file or from arrays."""

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, PlainValidator

from tfm_cl.errors import SceneError
from tfm_cl.files.mesh_io.triangles import Triangles, checked
from tfm_cl.files.paths import name_of, source_of
from tfm_cl.scene.solids.base import Albedo, Solid
from tfm_cl.scene.transform import IDENTITY

EXTENSIONS = (".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
"""Mesh formats that are read: they hold plain numbers, and no archives, programs or pickles."""


def _mesh(value: Any) -> str | Triangles:
    if isinstance(value, Triangles):
        return value
    name = name_of(value)
    if Path(name).suffix.lower() not in EXTENSIONS:
        raise ValueError(f"should be a file of a known kind: {' '.join(EXTENSIONS)}")
    return name


class MeshSolid(Solid):
    """Triangles with flat (geometric) normals, visible from both sides.

    The file is read when it is first needed, once per object.
    """

    mesh: Annotated[str | Triangles, PlainValidator(_mesh)] = Field(
        description=f"file: {' '.join(EXTENSIONS)}"
    )
    albedo: Albedo | None = Field(
        None,
        description="diffuse reflectance, linear RGB, 0 to 1; default: the file's colours, or 0.8 if it has "
        "none",
    )

    @classmethod
    def from_arrays(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        albedo: Any = None,
        *,
        transform: Any = IDENTITY,
    ) -> Self:
        """Make a mesh from arrays.

        Parameters
        ----------
        vertices
            [V, 3], object units.
        faces
            [F, 3], integers: rows of ``vertices``.
        albedo
            One colour, or one per vertex [V, 3], interpolated in between; linear, 0 to 1; None means 0.8.
        transform
            World-from-object matrix, 4×4.

        Raises
        ------
        SceneError
            As for a file: invalid shapes, values or indices.
        """
        name = "MeshSolid.from_arrays"
        if np.ndim(albedo) < 2:  # noqa: PLR2004 - a colour for each vertex
            return cls(mesh=checked(name, vertices, faces), albedo=albedo, transform=transform)
        colours = np.asarray(albedo, dtype=np.float32)
        if colours.shape != np.shape(vertices) or not ((colours >= 0) & (colours <= 1)).all():
            raise SceneError(f"{name}: albedo should be numbers from 0 to 1, [3] or one row for each vertex")
        triangles = checked(name, vertices, faces, colours, np.asarray(faces, dtype=np.int32))
        return cls(mesh=triangles, transform=transform)

    @cached_property
    def _triangles(self) -> Triangles:
        if isinstance(self.mesh, Triangles):
            return self.mesh if self.albedo is None else self.mesh.painted(self.albedo)
        from tfm_cl.files.mesh_io.loading import read_mesh  # noqa: PLC0415 - reads with trimesh: slow to import

        return read_mesh(source_of(self.mesh, error=SceneError), self.albedo)

    def load(self) -> Triangles:
        """Read the file, once; the triangles are in object space.

        Raises
        ------
        SceneError
            The file is missing, damaged, too large, of unknown type, or has no triangles.
        """
        return self._triangles

    def read_files(self) -> None:
        """As `load`."""
        self.load()

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
