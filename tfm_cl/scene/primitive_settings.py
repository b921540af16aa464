"""Bodies of primitives in scene files: which file, and what it does not say."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, TypeVar

import numpy as np
from pydantic import Field, PlainValidator

from tfm_cl.errors import SceneError
from tfm_cl.files import points_io
from tfm_cl.files.paths import name_of, real_path, source_of
from tfm_cl.limits import LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.model import Model, Vec3, number_or_auto, section_within
from tfm_cl.scene import placement
from tfm_cl.scene.bodies.points import Points
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.medium import Medium, parse_medium
from tfm_cl.scene.transform import Transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

OVERLAP = 2.0
"""Radius of points whose file says none, in median distances to the nearest neighbour: they form one medium."""
NEIGHBOURS = 10_000
"""Points whose nearest neighbours tell that distance."""
SEED = 20010702
"""Of their choice."""
LONE_RADIUS = 1.0
"""Of points that have no neighbour elsewhere, world units."""

P = TypeVar("P", bound=Primitives)


class Stored(Protocol):
    """What a file says of how much its primitives hold."""

    densities: NDArray[np.float32] | None
    opacities: NDArray[np.float32] | None


class PrimitiveSettings(Model):
    """What all kinds have in common."""

    SECTION: ClassVar[str] = "volume"
    KEY: ClassVar[str]
    """That names the file, and tells what kind it is."""

    density: Annotated[float | Literal["auto"] | None, number_or_auto(0, LARGEST_COLOUR)] = Field(
        None,
        description="extinction at the middle of each is density * sigma_t; times the file's own, if any; "
        "auto: a sensible optical depth, which is also taken where neither this nor any opacity is given",
    )
    opacity: float | None = Field(
        None,
        ge=0,
        le=1,
        description="instead of density: part of the light that one crossing through the middle takes at "
        "sigma_t = 1; times the file's own, if any",
    )
    colour: Vec3 | None = Field(
        None, description="extinction relative to the density, RGB, instead of the file's"
    )
    transform: Transform | None = Field(
        None,
        description="4x4, 16 numbers row by row, of a rotation, a translation and one scale: moves what the "
        "file holds",
    )
    medium: Annotated[Medium | None, section_within(parse_medium)] = Field(
        None, description="what this body alone is made of: a table like [medium], whose keys it overrides"
    )

    @abstractmethod
    def load(self, folder: Path) -> Primitives:
        """Read the body; names are relative to ``folder``."""

    def source(self, folder: Path) -> Path:
        """Return the file's path."""
        return source_of(getattr(self, self.KEY), folder)

    def written(self, folder: Path, body: Primitives) -> dict[str, Any]:
        """Return the section of a scene file anywhere that loads ``body`` again."""
        chosen = {key: value for key, (value, _) in body.chosen.items()}
        return self.to_dict() | chosen | {self.KEY: str(real_path(self.source(folder)))}

    def _amounts(self, stored: Stored) -> tuple[Any, Any]:
        """Return density and opacity of a file's primitives; one of them, or both, are None."""
        if self.density is not None and self.opacity is not None:
            raise SceneError("volume: both density and opacity are given; keep one")
        if self.opacity is not None or (self.density is None and stored.opacities is not None):
            return None, _times(self.opacity, stored.opacities)
        return _times(None if self.density == "auto" else self.density, stored.densities), None

    def _finished(self, body: P, chosen: dict[str, tuple[Any, str]], *, scales: bool) -> P:
        """Move the body, and choose the density where it is left open and scales what the file says."""
        if self.transform is not None:
            body = body.transformed(np.reshape(self.transform, (4, 4)))
        if scales and not isinstance(self.density, float):
            factor = placement.density_scale_for(body)
            body = body.with_density(factor)
            chosen["density"] = factor, placement.WHY_DENSITY
        body.chosen = chosen
        return body


def _points_file(value: Any) -> str:
    return name_of(value, "a file of points")


class PointsSettings(PrimitiveSettings):
    """Points of a file."""

    KEY: ClassVar[str] = "points"
    points: Annotated[str, PlainValidator(_points_file)] = Field(
        description="file of points (particles), relative to the scene file"
    )
    radius: Annotated[float | Literal["auto"] | None, number_or_auto(0, LARGEST_COORDINATE)] = Field(
        None,
        description="where each point's density ends, in the file's units, instead of its own; auto: twice the "
        "median distance to the nearest neighbour, which is also taken where the file says none",
    )
    profile: Literal["ball", "gaussian", "smooth"] = Field(
        "smooth",
        description="how the density falls from the middle of a point to its radius: not at all; with a "
        "standard deviation of a third of it; as (1 - r^2)^3",
    )

    def load(self, folder: Path) -> Points:
        """As `PrimitiveSettings.load`."""
        source, chosen = self.source(folder), dict[str, tuple[Any, str]]()
        stored = points_io.read_points(source)
        radius: Any = stored.radii if self.radius is None else self.radius
        if radius is None or isinstance(radius, str):
            radius = spacing_radius(stored.positions)
            chosen["radius"] = radius, f"{OVERLAP:g} median distances to the nearest neighbour"
        density, opacity = self._amounts(stored)
        points = Points(
            stored.positions,
            radius,
            density,
            opacity=opacity,
            profile=self.profile,
            colour=stored.colours if self.colour is None else self.colour,
            velocity=stored.velocities,
            medium=self.medium,
            source=source,
        )
        return self._finished(points, chosen, scales=opacity is None)


def spacing_radius(positions: NDArray[np.floating]) -> float:
    """Return a radius with which points [n, 3] overlap their neighbours, of two digits."""
    from scipy.spatial import KDTree  # noqa: PLC0415 - few ask

    some = np.random.default_rng(SEED).permutation(len(positions))[:NEIGHBOURS]
    distances, _ = KDTree(positions).query(positions[some], k=2)
    apart = distances[:, 1]
    apart = apart[np.isfinite(apart) & (apart > 0)]
    return float(f"{OVERLAP * float(np.median(apart)):.2g}") if apart.size else LONE_RADIUS


def _times(factor: float | None, of_file: NDArray[np.float32] | None) -> Any:
    if of_file is None:
        return factor
    return of_file if factor is None else factor * of_file
