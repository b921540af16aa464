"""The mesh of triangles, from a file or from arrays."""

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
"""What is read: formats of plain numbers, without archives, programs or pickles."""


def _mesh(value: Any) -> str | Triangles:
    if isinstance(value, Triangles):
        return value
    name = name_of(value)
    if Path(name).suffix.lower() not in EXTENSIONS:
        raise ValueError(f"should be a file of a known kind: {' '.join(EXTENSIONS)}")
    return name


class MeshSolid(Solid):
    """Triangles with flat (geometric) normals; seen from both sides.

    The file is read when it is first needed, once for each object.
    """

    mesh: Annotated[str | Triangles, PlainValidator(_mesh)] = Field(
        description=f"file: {' '.join(EXTENSIONS)}"
    )
    albedo: Albedo | None = Field(
        None, description="diffuse reflectance, linear RGB, 0 to 1; left out: the file's colours, else 0.8"
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
        """Make a mesh of arrays.

        Parameters
        ----------
        vertices
            [V, 3], object units.
        faces
            [F, 3], whole numbers: rows of ``vertices``.
        albedo
            One colour, or one for each vertex [V, 3], interpolated in between; linear, 0 to 1; 0.8 when None.
        transform
            World_from_object, 4×4.

        Raises
        ------
        SceneError
            As for a file: shapes, values or indices that cannot be.
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
        """Read the file, once; object space.

        Raises
        ------
        SceneError
            Missing, damaged, too large or unknown file, or one without triangles.
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
        """Around the vertices of its triangles; reads the file."""
        used = np.zeros(len(self.load().vertices), dtype=bool)
        used[self.load().faces] = True
        world = self.world_vertices()[used]
        return np.stack([world.min(axis=0), world.max(axis=0)])

    def to_dict(self) -> dict[str, Any]:
        """Return the solid as a scene file writes it.

        Raises
        ------
        SceneError
            A mesh of arrays has no file to name.
        """
        if isinstance(self.mesh, Triangles):
            raise SceneError(
                "solid.mesh: a mesh of arrays cannot be written to a scene file; save it as .ply"
            )
        return super().to_dict()
