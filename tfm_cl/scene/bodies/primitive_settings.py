"""Bodies of primitives in scene files: which file, and what it does not say."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import Field, PlainValidator

from tfm_cl.errors import SceneError, VolumeError, words
from tfm_cl.extras import needs
from tfm_cl.files import curves_io, points_io
from tfm_cl.files.paths import name_of, real_path, source_of
from tfm_cl.files.points_io.attributes import is_ply_with_velocities
from tfm_cl.limits import LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.model import Point, number_or_auto
from tfm_cl.model_fields import TEXT, Accepts, Numbers, accepts
from tfm_cl.scene.bodies.base import OF_BODIES
from tfm_cl.scene.bodies.curves import Curves
from tfm_cl.scene.bodies.moving import MovingSettings
from tfm_cl.scene.bodies.points import Points
from tfm_cl.scene.bodies.polygons import Polygons
from tfm_cl.scene.bodies.primitives import Primitives, rigid_scale
from tfm_cl.scene.frame_numbers import OfFrames
from tfm_cl.scene.medium import OwnMedium
from tfm_cl.scene.optical_depth import density_scale_for, why_density
from tfm_cl.scene.transform import Matrix, Rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tfm_cl.files.mesh_io.triangles import Triangles

P = TypeVar("P", bound=Primitives)
R = TypeVar("R")

OVERLAP = 2.0
"""Radius of points whose file says none, in median distances to the nearest neighbour: they overlap."""
NEIGHBOURS = 10_000
"""Points whose nearest neighbours tell that distance."""
SEED = 20010702
"""Of their choice."""
LONE_RADIUS = 1.0
"""Of points that have no neighbour elsewhere, world units."""

THINNEST = 1e-3
"""Width of strands whose file says none, of the diagonal of their bounds."""

WHITE = (1.0, 1.0, 1.0)
"""Colours of a mesh are not read."""


class PrimitiveSettings(OfFrames, MovingSettings):
    """What all kinds have in common."""

    SECTION: ClassVar[str] = "volume"
    WORDS: ClassVar[dict[str, str]] = OF_BODIES | words({"opacity": "alpha", "density": "densityscale"})
    KEY: ClassVar[str]
    """That names the file, and tells what kind it is."""

    opacity: float | None = Field(
        default=None,
        ge=0,
        le=1,
        description="part of the light that one crossing takes at sigma_t = 1, through the middle of a "
        "point; times the file's own, if any",
    )
    colour: Accepts[Numbers | None, Point | None] = Field(
        default=None,
        validate_default=True,
        description="extinction relative to the density, RGB, instead of the file's",
    )
    transform: Accepts[Rows | None, Matrix | None] = Field(
        default=None,
        validate_default=True,
        description="4x4, 16 numbers row by row, of a rotation, a translation and one scale: moves what the "
        "file holds",
    )
    medium: OwnMedium = Field(
        default=None,
        validate_default=True,
        description="what this body alone is made of: a table like [medium], whose keys it overrides",
    )

    velocity: Literal[False] | None = Field(
        default=None,
        examples=[False],
        description="motion blur: false: it does not move, whatever the file's velocities ('v', 'velocity')",
    )

    @abstractmethod
    def load(self, folder: Path, optical_depth: float, like: Any = None) -> Primitives:
        """As `BodySettings.load`; a file that is the same at another moment is read once."""

    def source(self, folder: Path) -> Path:
        """Return the file's path."""
        return source_of(getattr(self, self.KEY), folder)

    def sources(self) -> list[str]:
        """As `BodySettings.sources`."""
        return [getattr(self, self.KEY)]

    def _read(self, like: tuple[Any, Any] | None, read: Callable[[Path], R], source: Path) -> R:
        """Read a file, unless it was for another moment: the body there keeps it."""
        body = self._same(like, self.KEY)
        if body is None:
            return read(source)
        if body.stored is None:
            body.stored = read(source)
        stored: R = body.stored
        return stored

    def _same(self, like: tuple[Any, Any] | None, *keys: str) -> Any:
        """Return the body of another moment where these keys are the same; else None."""
        other, body = like or (None, None)
        if type(other) is not type(self) or not isinstance(body, Primitives):
            return None
        return body if all(getattr(other, key) == getattr(self, key) for key in keys) else None

    def _remembered(self, body: P, source: Path, chosen: dict[str, tuple[Any, str]]) -> P:
        """Return the body, which tells how it was made."""
        numbers = {key: value for key, (value, _) in chosen.items()}
        body = body.with_velocity(scale=self.velocity_scale, fps=self.velocity_fps)
        body.chosen, body.made_from = chosen, self.to_dict() | numbers | {self.KEY: str(real_path(source))}
        return body

    def _require_one_scale(self, density: float | str | None) -> None:
        if density is not None and self.opacity is not None:
            raise SceneError("volume: both density and opacity are given; keep one")

    def _placed(self, positions: NDArray[np.floating], sizes: Any) -> tuple[NDArray[np.float64], Any]:
        """Move positions [n, 3], and scale sizes, to where they were asked for."""
        places = positions.astype(np.float64)
        if self.transform is None:
            return places, sizes
        matrix = np.reshape(self.transform, (4, 4))
        scale = rigid_scale(matrix, getattr(self, self.KEY))
        return places @ matrix[:3, :3].T + matrix[:3, 3], scale * np.asarray(sizes, dtype=np.float64)

    def _turned(self, velocities: NDArray[np.floating] | None) -> NDArray[np.float64] | None:
        """Turn and scale velocities likewise; None where there are none, or they are not asked for."""
        if velocities is None or self.velocity is False:
            return None
        matrix = np.eye(3) if self.transform is None else np.reshape(self.transform, (4, 4))[:3, :3]
        turned: NDArray[np.float64] = velocities @ matrix.T
        return turned


Density = Annotated[float | Literal["auto"] | None, number_or_auto(0, LARGEST_COLOUR)]
Length = Annotated[float | Literal["auto"] | None, number_or_auto(0, LARGEST_COORDINATE)]


@accepts(TEXT)
def _points_file(value: Any) -> str:
    return name_of(value, "a file of points")


class PointsSettings(PrimitiveSettings):
    """Points of a file."""

    KEY: ClassVar[str] = "points"
    WORDS: ClassVar[dict[str, str]] = words({"radius": "size pscale pointsize width", "profile": "kernel"})
    points: Annotated[str, PlainValidator(_points_file)] = Field(
        description="file of points (particles), relative to the scene file"
    )
    density: Density = Field(
        default=None,
        description="instead of opacity: extinction at the middle of each is density * sigma_t; times the "
        "file's own, if any; auto: a sensible optical depth, which is also taken where neither this nor any "
        "opacity is given",
    )
    radius: Length = Field(
        default=None,
        description="where each point's density ends, in the file's units, instead of its own; auto: twice "
        "the median distance to the nearest neighbour, which is also taken where the file says none",
    )
    profile: Literal["ball", "gaussian", "smooth"] = Field(
        default="smooth",
        description="how the density falls from the middle of a point to its radius: not at all; with a "
        "standard deviation of a third of it; as (1 - r^2)^3",
    )

    def load(self, folder: Path, optical_depth: float, like: Any = None) -> Points:
        """As `PrimitiveSettings.load`; what is chosen is chosen once for all moments."""
        self._require_one_scale(self.density)
        source, chosen = self.source(folder), dict[str, tuple[Any, str]]()
        stored = self._read(like, points_io.read_points, source)
        there = self._same(like, self.KEY, "radius", "density", "opacity")
        known = {} if there is None else there.chosen
        radius: Any = stored.radii if self.radius is None else self.radius
        if "radius" in known:
            radius, _ = chosen["radius"] = known["radius"]
        elif radius is None or isinstance(radius, str):
            apart = spacing(stored.positions)
            radius = LONE_RADIUS if apart is None else float(f"{OVERLAP * apart:.2g}")
            chosen["radius"] = radius, f"{OVERLAP:g} median distances to the nearest neighbour"
        opacity = None if self.density is not None else _times(self.opacity, stored.opacities)
        factor = self.density if isinstance(self.density, float) else None
        positions, radius = self._placed(stored.positions, radius)
        points = Points(
            positions,
            radius,
            None if opacity is not None else _times(factor, stored.densities),
            opacity=opacity,
            profile=self.profile,
            colour=stored.colours if self.colour is None else self.colour,
            velocity=self._turned(stored.velocities),
            medium=self.medium,
            source=source,
        )
        if opacity is None and factor is None:
            found = density_scale_for(points, optical_depth), why_density(optical_depth)
            chosen["density"] = known.get("density", found)
            points = points.with_density(chosen["density"][0])
        return self._remembered(points, source, chosen)


@accepts(TEXT)
def _curves_file(value: Any) -> str:
    return name_of(value, "a file of curves")


class CurvesSettings(PrimitiveSettings):
    """Strands of a file."""

    KEY: ClassVar[str] = "curves"
    WORDS: ClassVar[dict[str, str]] = words({"width": "radius thickness widths diameter"})
    curves: Annotated[str, PlainValidator(_curves_file)] = Field(
        description="file of curves (hair, fur), relative to the scene file"
    )
    density: float | None = Field(
        default=None,
        ge=0,
        le=LARGEST_COLOUR,
        description="instead of opacity: a crossing of a strand has the optical depth density * width at "
        "sigma_t = 1",
    )
    width: Length = Field(
        default=None,
        description="of all strands, from edge to edge, in the file's units, instead of the file's; auto: a "
        "thousandth of the diagonal of their bounds, which is also taken where the file says none",
    )

    def load(self, folder: Path, optical_depth: float, like: Any = None) -> Curves:
        """As `PrimitiveSettings.load`; what is thin says its opacity."""
        del optical_depth
        self._require_one_scale(self.density)
        source, chosen = self.source(folder), dict[str, tuple[Any, str]]()
        stored = self._read(like, curves_io.read_curves, source)
        width: Any = stored.widths if self.width is None else self.width
        if width is None or isinstance(width, str):
            extent = np.ptp(stored.positions.astype(np.float64), axis=0)
            width = float(f"{THINNEST * float(np.linalg.norm(extent)):.2g}")
            chosen["width"] = width, f"{THINNEST:g} of the diagonal of their bounds"
        positions, width = self._placed(stored.positions, width)
        curves = Curves(
            positions,
            stored.counts,
            width,
            self.density,
            opacity=None if self.density is not None else _times(self.opacity, stored.opacities),
            colour=stored.colours if self.colour is None else self.colour,
            velocity=self._turned(stored.velocities),
            medium=self.medium,
            source=source,
        )
        return self._remembered(curves, source, chosen)


@accepts(TEXT)
def _mesh_file(value: Any) -> str:
    return name_of(value, "a mesh file")


class PolygonsSettings(PrimitiveSettings):
    """Triangles of a file."""

    KEY: ClassVar[str] = "mesh"
    mesh: Annotated[str, PlainValidator(_mesh_file)] = Field(
        description="file of triangles, relative to the scene file, as of a [[solid]]; colours are not read"
    )

    def load(self, folder: Path, optical_depth: float, like: Any = None) -> Polygons:
        """As `PrimitiveSettings.load`; what is thin says its opacity."""
        del optical_depth
        source = self.source(folder)
        triangles, velocities = self._read(like, self._triangles, source)
        vertices, _ = self._placed(triangles.vertices, 1.0)
        polygons = Polygons(
            vertices,
            triangles.faces,
            1.0 if self.opacity is None else self.opacity,
            colour=self.colour,
            velocity=self._turned(velocities),
            medium=self.medium,
            source=source,
        )
        return self._remembered(polygons, source, {})

    def _triangles(self, source: Path) -> tuple[Triangles, NDArray[np.float32] | None]:
        """Read triangles, and velocities of their vertices."""
        with needs("solids", f"{source}: a mesh", VolumeError):
            from tfm_cl.files.mesh_io.loading import read_mesh  # noqa: PLC0415 - reads with trimesh: slow to import

        try:
            triangles = read_mesh(source, WHITE)
        except SceneError as error:
            raise VolumeError(*error.args) from None
        return triangles, self._velocities(source, triangles.vertices)

    def _velocities(self, source: Path, vertices: NDArray[np.floating]) -> NDArray[np.float32] | None:
        """Return those of vertices [V, 3] that a ``.ply`` file may have; readers of meshes leave them out."""
        if self.velocity is False or not is_ply_with_velocities(source):
            return None
        stored = points_io.read_points(source)
        if stored.velocities is None:
            return None
        # Readers of meshes may put vertices in another order, or leave some out.
        whole = np.concatenate([stored.positions, vertices.astype(np.float32)])
        _, first, same = np.unique(whole, axis=0, return_index=True, return_inverse=True)
        rows = first[same.ravel()[len(stored.positions) :]]
        if (rows >= len(stored.positions)).any():
            raise VolumeError(
                f"{source}: its velocities are not of its triangles' vertices; set volume.velocity=false"
            )
        return stored.velocities[rows]


def spacing(positions: NDArray[np.floating]) -> float | None:
    """Return the median distance of points [n, 3] to their nearest neighbour; None where none has one."""
    with needs("points", "the spacing of points, in place of a radius", VolumeError):
        from scipy.spatial import KDTree  # noqa: PLC0415 - few ask

    some = np.random.default_rng(SEED).permutation(len(positions))[:NEIGHBOURS]
    distances, _ = KDTree(positions).query(positions[some], k=2)
    apart = distances[:, 1]
    apart = apart[np.isfinite(apart) & (apart > 0)]
    return float(np.median(apart)) if apart.size else None


def _times(factor: float | None, of_file: NDArray[np.float32] | None) -> Any:
    if of_file is None:
        return factor
    return of_file if factor is None else factor * of_file
