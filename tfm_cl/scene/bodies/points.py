"""Points: particles, each a small ball of density."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, exp, pi, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tfm_cl.constants import MOST_OPACITY, POINT_PROFILES
from tfm_cl.errors import VolumeError, unknown_key
from tfm_cl.limits import FRAMES_A_SECOND, LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.scene.bodies.primitives import (
    Primitives,
    Spread,
    colours_of,
    counts_along,
    in_groups,
    mean_opacity,
    medium_of,
    numbers_of,
    positions_of,
    rigid_scale,
    velocities_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike

    from tfm_cl.scene.medium import Medium

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Profile:
    """How the density of a point falls with the distance r from its middle; both in units of the radius."""

    mass: float
    """∫ D 4π r² dr."""
    through: float
    """∫ D along a line through the middle."""
    part: Callable[[Floats, Floats], Floats]
    """∫ D from the middle to s of a line that passes the middle at a distance b, given s and x = 1 - b²."""


def _of_ball(s: Floats, x: Floats) -> Floats:
    del x
    return s


def _of_gaussian(s: Floats, x: Floats) -> Floats:
    of_each = np.array([erf(value) for value in (3 * s / sqrt(2)).flat]).reshape(s.shape)
    found: Floats = np.exp(-4.5 * (1 - x)) * sqrt(pi / 2) / 3 * of_each
    return found


def _of_smooth(s: Floats, x: Floats) -> Floats:
    return x**3 * s - x**2 * s**3 + 0.6 * x * s**5 - s**7 / 7


NEAR_MIDDLE = 1e-6
"""Of the radius: the density there is as in the middle of a line."""
_ERF = erf(3 / sqrt(2))
PROFILES = {
    "ball": Profile(4 * pi / 3, 2.0, _of_ball),
    # ∫₀¹ r² e^(-9r²/2) dr = (√(π/2) erf(3/√2) / 3 - e^(-9/2)) / 9
    "gaussian": Profile(
        4 * pi / 9 * (sqrt(pi / 2) * _ERF / 3 - exp(-4.5)), 2 * sqrt(pi / 2) / 3 * _ERF, _of_gaussian
    ),
    "smooth": Profile(64 * pi / 315, 32 / 35, _of_smooth),
}
"""By name: constant; exp(-9 r²/2), which ends at three standard deviations; and (1 - r²)³ (the "poly6" kernel
of Müller, Charypar, Gross, "Particle-Based Fluid Simulation for Interactive Applications", SCA 2003)."""


class Points(Primitives):
    """Particles: each fills a ball around its position with density; where balls overlap it adds up.

    Parameters
    ----------
    positions
        [n, 3], world.
    radius
        Where each point's density ends, world units; one number, or [n].
    density
        At the middle of each point; extinction is density * sigma_t. One number, or [n]. 1 where neither
        this nor ``opacity`` is given.
    opacity
        Instead: the part of light that one crossing through the middle takes at sigma_t = 1, from 0 to 1;
        one number, or [n].
    profile
        How the density falls from the middle to the radius: ``"ball"`` not at all, ``"gaussian"`` with a
        standard deviation of a third of the radius, ``"smooth"`` as (1 - r²)³.
    colour
        RGB, or [n, RGB]: extinction relative to the density, of scattering and absorption alike; None: 1.
    velocity
        [n, 3], world units per second, or None: they move, for motion blur.
    medium
        What these points alone are made of; None: the scene's medium.
    source
        The file they came from, if any.

    Raises
    ------
    VolumeError
        Arrays of other shapes, numbers that are not finite or out of range, or both density and opacity.
    """

    HEADER: ClassVar[str] = "primitive/point.h"

    def __init__(
        self,
        positions: ArrayLike,
        radius: ArrayLike,
        density: ArrayLike | None = None,
        *,
        opacity: ArrayLike | None = None,
        profile: str = "smooth",
        colour: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        medium: Medium | None = None,
        source: Path | None = None,
    ) -> None:
        self.source = source
        label = self.label
        if profile not in PROFILES:
            raise VolumeError(
                f"{label}: {unknown_key(str(profile), list(PROFILES)).replace('key', 'profile')}"
            )
        if density is not None and opacity is not None:
            raise VolumeError(f"{label}: both density and opacity are given; keep one")
        self.profile = profile
        self.positions = positions_of(positions, "positions", label)
        count = len(self.positions)
        self.radii = numbers_of(radius, count, "radius", label, most=LARGEST_COORDINATE, above=True)
        if opacity is None:
            self.densities = numbers_of(1.0 if density is None else density, count, "density", label)
        else:
            taken = numbers_of(opacity, count, "opacity", label, most=1.0)
            self.densities = _densities_of(taken, PROFILES[profile].through * self.radii, label)
        self._colour = colours_of(colour, count, label)
        self.velocity = velocities_of(velocity, count, label)
        self.medium = medium_of(medium, self.label)
        self.chosen = {}

    def to_arrays(self) -> tuple[str, dict[str, Any], dict[str, NDArray[Any]]]:
        """As `Body.to_arrays`: files of points hold float32."""
        named: dict[str, NDArray[Any]] = {
            "positions": self.positions,
            "radius": self.radii,
            "density": self.densities,
        }
        named |= {} if self.colour is None else {"colour": self.colour}
        named |= {} if self.velocity is None else {"velocity": self.velocity}
        keys: dict[str, Any] = {"density": 1.0, "profile": self.profile}
        if self.velocity is not None:
            keys["velocity_scale"] = self.seconds_a_frame * FRAMES_A_SECOND
        return "points", keys, {name: array.astype(np.float32) for name, array in named.items()}

    @property
    def profile_number(self) -> int:
        """As `Primitives.profile_number`."""
        return POINT_PROFILES[self.profile]

    @property
    def unit_mass(self) -> float:
        """As `Primitives.unit_mass`."""
        return PROFILES[self.profile].mass

    @property
    def masses(self) -> Floats:
        """As `Primitives.masses`."""
        return self.unit_mass * self.radii**3 * self.densities

    def held(self, sigma_t: float) -> Floats:
        """As `Primitives.held`, by the mean over what each covers."""
        return self.masses * mean_opacity(sigma_t * self.masses / (np.pi * self.radii**2))

    def spread(self, apart: float) -> Iterator[Spread]:
        """As `Primitives.spread`: a block of places, by the density there."""
        for count, numbers in in_groups(counts_along(2 * self.radii, apart, 3), 3):
            along = (np.arange(count) + 0.5) / count * 2 - 1
            offsets = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
            x = 1 - (offsets**2).sum(axis=1)
            offsets, x = offsets[x > 0], x[x > 0]
            shares = PROFILES[self.profile].part(np.full_like(x, NEAR_MIDDLE), x)
            shares /= shares.sum()
            places = self.positions[numbers, None] + self.radii[numbers, None, None] * offsets
            yield Spread(places.reshape(-1, 3), np.tile(shares, len(numbers)), numbers.repeat(len(offsets)))

    def fill_sources(self, structs: NDArray[Any], origin: Floats) -> None:
        """As `Primitives.fill_sources`."""
        structs["a"] = self.positions - origin
        structs["radius"][:, 0], structs["amount"] = self.radii, self.densities

    def depths_along(
        self, origin: NDArray[np.floating], direction: NDArray[np.floating], edges: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """As `MarchedBody.depths_along`, in closed form."""
        away = self.positions - origin
        middle = away @ direction
        beside = (away - middle[:, None] * direction) / self.radii[:, None]
        x = 1 - (beside**2).sum(axis=1)
        met = x > 0
        x, radii = x[met, None], self.radii[met, None]
        reached = np.clip((edges - middle[met, None]) / radii, -np.sqrt(x), np.sqrt(x))
        parts = np.diff(PROFILES[self.profile].part(reached, x), axis=1) * radii * self.densities[met, None]
        colour = np.ones((int(met.sum()), 1)) if self.colour is None else self.colour[met].astype(np.float64)
        depths: NDArray[np.float64] = parts.T @ colour
        return depths

    def transformed(self, world_from_body: ArrayLike) -> Points:
        """As `Primitives.transformed`; velocities turn and grow with it."""
        matrix = np.asarray(world_from_body, dtype=np.float64)
        scale = rigid_scale(matrix, self.label)
        velocity = None if self.velocity is None else self.velocity @ matrix[:3, :3].T
        return self._with(
            positions=self.positions @ matrix[:3, :3].T + matrix[:3, 3],
            radius=self.radii * scale,
            velocity=velocity,
        )

    def with_density(self, factor: float) -> Points:
        """As `Primitives.with_density`."""
        return self._with(density=self.densities * factor)

    def moved(self, frames: float) -> Points:
        """As `Primitives.moved`."""
        if self.velocity is None:
            return self
        return self._with(positions=self.positions + self._step(self.velocity, frames))

    def _with(self, **changes: Any) -> Points:
        kept = {
            name: getattr(self, name)
            for name in ("positions", "profile", "colour", "velocity", "medium", "source")
        }
        other = Points(**{**kept, "radius": self.radii, "density": self.densities, **changes})
        other.seconds_a_frame = self.seconds_a_frame
        return other

    def __repr__(self) -> str:
        coloured = "" if self.colour is None else "coloured, "
        kind = f"{len(self.positions)} of profile {self.profile}"
        return f"Points({self.label}, {kind}, {coloured}density up to {self.density:g})"


def _densities_of(opacities: Floats, lengths: Floats, label: str) -> Floats:
    """Return the densities that take so much along such lengths.

    Raises
    ------
    VolumeError
        One that is too large.
    """
    with np.errstate(over="ignore"):
        densities: Floats = -np.log1p(-np.minimum(opacities, MOST_OPACITY)) / lengths
    wrong = densities > LARGEST_COLOUR
    if wrong.any():
        first = int(wrong.argmax())
        raise VolumeError(
            f"{label}: radius[{first}] is so small that an opacity of {opacities[first]:g} takes a "
            f"density of {densities[first]:g}: that should be up to {LARGEST_COLOUR:g}"
        )
    densities.flags.writeable = False
    return densities
