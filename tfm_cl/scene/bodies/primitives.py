"""Bodies made of many small things: what they are to the rest of the project."""

from __future__ import annotations

import copy
import itertools
from abc import abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.limits import FRAMES_A_SECOND, LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.model import same
from tfm_cl.scene.bodies.base import MarchedBody, digest_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import ArrayLike

    from tfm_cl.scene.medium import Medium

DETAIL = 0.5
"""Of the radius of a typical primitive: what a voxel's edge is to a grid."""
LINES = 64
"""Along each side, at most, of the pictures of a body, from three sides, that tell its optical depth."""

ORIGIN = ("source", "chosen")
"""What tells where they come from, not what they are."""

_NUMBERS = itertools.count()


MOST_PLACES = 1 << 21
"""That stand for primitives at once, and those of all of them, roughly."""


class Spread(NamedTuple):
    """Places that stand for primitives."""

    places: NDArray[np.float64]
    """[m, 3], world."""
    shares: NDArray[np.float64]
    """[m], of what a primitive holds; they add up to 1."""
    numbers: NDArray[np.intp]
    """[m], of the primitive."""


def counts_along(lengths: NDArray[np.float64], apart: float, power: int) -> NDArray[np.intp]:
    """Return into how many parts lengths [n] are cut, so that each has these to a power of places.

    As short as ``apart``, where that does not make too many.
    """
    while True:
        counts = np.maximum(np.ceil(lengths / apart), 1)
        if (counts**power).sum() <= max(MOST_PLACES, len(lengths)):
            return counts.astype(np.intp)
        apart *= 1.25


def in_groups(counts: NDArray[np.intp], power: int) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Yield each count of parts, and numbers of those that have it, as many as are taken at once."""
    for count in np.unique(counts).tolist():
        numbers = np.flatnonzero(counts == count)
        together = max(1, MOST_PLACES // count**power)
        for first in range(0, len(numbers), together):
            yield count, numbers[first : first + together]


def mean_opacity(depths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the opacity of optical depths over these: 1 where they are thin."""
    found: NDArray[np.float64] = np.divide(
        -np.expm1(-depths), depths, out=np.ones_like(depths), where=depths > 0
    )
    return found


class Primitives(MarchedBody):
    """Many points, strands or polygons, each of which holds some density; where they overlap it adds up.

    What a ray meets of each is known in closed form.

    Attributes
    ----------
    positions
        float64 [n, 3], where each is, world.
    radii
        float64 [n], how far each reaches from there, world.
    densities
        float64 [n], at the middle of each.
    """

    DENSITY_KEY: ClassVar[str] = "density"
    HEADER: ClassVar[str]
    """Kernel header, below ``kernels/``, named after the kind: ``kernels/primitive/README.md``."""
    positions: NDArray[np.float64]
    radii: NDArray[np.float64]
    densities: NDArray[np.float64]
    _colour: NDArray[np.float32] | None
    medium: Medium | None
    source: Path | None
    velocity: NDArray[np.float64] | None = None
    """World units per second, where that is known: of points [n, 3], else of corners [n, corners, 3]."""
    seconds_a_frame: float = 1 / FRAMES_A_SECOND
    """How long it moves so fast in a frame."""
    made_from: dict[str, Any] | None = None
    """Keys of a scene file that make it of its file, but for the medium; None: it has been made otherwise."""
    stored: Any = None
    """What its file holds, where the body is there at other moments of a frame too, and is read for these."""
    chosen: dict[str, tuple[Any, str]]
    """What its file left open: by key of the scene file what was chosen, and why."""

    @property
    def colour(self) -> NDArray[np.float32] | None:
        """Extinction of each relative to its density, [n, RGB]; None: 1."""
        return self._colour

    @property
    def label(self) -> str:
        """What messages call it: the file it came from."""
        return type(self).__name__.lower() if self.source is None else str(self.source)

    @abstractmethod
    def transformed(self, world_from_body: ArrayLike) -> Self:
        """Return it elsewhere: a 4×4 matrix of rotation, translation and one scale for all axes.

        Raises
        ------
        VolumeError
            Another matrix: balls would be balls no longer.
        """

    @abstractmethod
    def with_density(self, factor: float) -> Self:
        """Return it with all densities times a factor."""

    @abstractmethod
    def moved(self, frames: float) -> Self:
        """Return it so many frames later, or earlier, moved on by its velocities; itself without any.

        Raises
        ------
        VolumeError
            Something is too far away then.
        """

    def with_velocity(self, *, scale: float = 1.0, fps: float = FRAMES_A_SECOND) -> Self:
        """Return it with velocities that count so many times, at so many frames a second.

        Raises
        ------
        VolumeError
            Numbers out of range.
        """
        if not (abs(scale) <= LARGEST_COLOUR and 0 < fps <= LARGEST_COLOUR):
            raise VolumeError(
                f"{self.label}: a velocity's scale is a number, and fps > 0; got {scale} and {fps}"
            )
        other = copy.copy(self)
        other.seconds_a_frame = scale / fps
        if self.made_from is not None:
            other.made_from = self.made_from | {"velocity_scale": scale, "velocity_fps": fps}
        return other

    def _step(self, velocity: NDArray[np.float64], frames: float) -> NDArray[np.float64]:
        """Return by how much its points or corners move in so many frames, world units."""
        step: NDArray[np.float64] = velocity * (self.seconds_a_frame * frames)
        farthest = float(np.abs(step).max(initial=0.0))
        if not farthest <= LARGEST_COORDINATE:
            raise VolumeError(
                f"{self.label}: moves something by {farthest:.2g} world units in {abs(frames):g} frames; "
                "lower volume.velocity_scale, or set volume.velocity=false"
            )
        return step

    def to_table(self) -> dict[str, Any] | None:
        """As `Body.to_table`."""
        medium = None if self.medium is None else self.medium.to_dict()
        return None if self.made_from is None else self.made_from | {"medium": medium}

    @property
    def narrowest(self) -> float:
        """World units: the least radius of any, as rays see it."""
        return float(self.radii.min())

    @property
    def profile_number(self) -> int:
        """How kernels know of its profile, if its kind has several."""
        return 0

    @property
    def unit_mass(self) -> float:
        """Integral over space of the density of one of radius 1 and density 1, if these tell it."""
        return 0.0

    @property
    @abstractmethod
    def masses(self) -> NDArray[np.float64]:
        """Integral over space of the density of each, [n]."""

    def mass_in(self, room: float) -> float:
        """As `Body.mass_in`."""
        del room
        return float(self.masses.sum())

    @abstractmethod
    def held(self, sigma_t: float) -> NDArray[np.float64]:
        """Return the masses [n] of a thin density that takes as much from light of all directions as each.

        Parameters
        ----------
        sigma_t
            Extinction of the medium at density 1, per world unit.
        """

    @abstractmethod
    def spread(self, apart: float) -> Iterator[Spread]:
        """Yield places that stand for all of them, at most so many world units apart in each.

        Or somewhat farther in what is far larger: there are never more than some millions.
        """

    @abstractmethod
    def fill_sources(self, structs: NDArray[Any], origin: NDArray[np.float64]) -> None:
        """Fill in what kernels are told of each, but for its body and its colour.

        Parameters
        ----------
        structs
            [n] of `tfm_cl.device.structs.declared.SOURCE`.
        origin
            Of the device, world.
        """

    @cached_property
    def number(self) -> int:
        """Tells what it holds from all others of this process."""
        return next(_NUMBERS)

    @property
    def density_key(self) -> tuple[Any, ...]:
        """All that its density in space depends on."""
        return type(self).__name__, self.number

    @cached_property
    def digest(self) -> str:
        """As `MarchedBody.digest`."""
        cls = type(self)
        arrays = {
            name: value
            for name, value in sorted(vars(self).items())
            if isinstance(value, np.ndarray) and not isinstance(getattr(cls, name, None), cached_property)
        }
        return digest_of(" ".join([cls.__name__, str(self.profile_number), *arrays]), *arrays.values())

    @property
    def density(self) -> float:
        """The largest of any, at its middle."""
        return float(self.densities.max())

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """World box around all of them, [2, 3]."""
        reach = self.radii[:, None]
        return np.stack([(self.positions - reach).min(axis=0), (self.positions + reach).max(axis=0)])

    @cached_property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """World box around those that have density, [2, 3]."""
        held = self.densities > 0
        if held.all() or not held.any():
            return self.bounds
        positions, reach = self.positions[held], self.radii[held][:, None]
        return np.stack([(positions - reach).min(axis=0), (positions + reach).max(axis=0)])

    def outline(self) -> NDArray[np.float64]:
        """As `Body.outline`: their middles."""
        return self.positions

    @property
    def largest_density(self) -> NDArray[np.float64]:
        """What no density is greater than, [3]: as if all were at one place."""
        if self.colour is None:
            return np.full(3, self.densities.sum())
        largest: NDArray[np.float64] = self.densities @ self.colour.astype(np.float64)
        return largest

    @property
    def why_empty(self) -> str:
        """Why it has no density at all; empty where it has some."""
        if not self.densities.any():
            return "all densities are 0"
        if self.colour is not None and not self.largest_density.any():
            return "all densities times their colours are 0"
        return ""

    @property
    def detail(self) -> float:
        """World units, the size of what it shows; see `DETAIL`."""
        return DETAIL * float(np.median(self.radii))

    @cached_property
    def typical_density(self) -> float:
        """Of the whole body, weighted by itself: what lies along typical lines, over its extent."""
        depths = np.concatenate(self.line_depths())
        total = depths.sum()
        extent = float(np.mean(self.bounds[1] - self.bounds[0]))
        return float((depths**2).sum() / total / extent) if total > 0 else 0.0

    @property
    def longest_ray(self) -> float:
        """World units, of the rays through its bounds."""
        low, high = self.bounds
        return float(np.linalg.norm(high - low))

    def interval(self, origin: NDArray[np.floating], direction: NDArray[np.floating]) -> tuple[float, float]:
        """As `MarchedBody.interval`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = (self.bounds - origin) / direction
        along = np.isnan(sides).any(axis=0)
        low = np.where(along, -np.inf, sides.min(axis=0)).max()
        high = np.where(along, np.inf, sides.max(axis=0)).min()
        return max(float(low), 0.0), float(high)

    def line_depths(self) -> list[NDArray[np.float64]]:
        """Integrals of the density along lines of three directions, estimated from what each cell holds."""
        masses = self.masses
        if self.colour is not None:
            masses = masses * self.colour.mean(axis=1)
        low, high = self.bounds
        found = []
        for axis in range(3):
            across = [other for other in range(3) if other != axis]
            sides = (high - low)[across]
            # Cells as wide as a primitive, which then is in about one.
            cells = np.clip(sides / (2 * np.median(self.radii)), 1, LINES).astype(int)
            ends = [(low[other], high[other]) for other in across]
            held, *_ = np.histogramdd(
                self.positions[:, across], bins=cells.tolist(), range=ends, weights=masses
            )
            found.append(held.ravel() / np.prod(sides / cells))
        return found

    def equals(self, other: object) -> bool:
        """As `Body.equals`."""
        if not isinstance(other, Primitives) or type(self) is not type(other):
            return False
        return same(self._told, other._told)  # noqa: SLF001 - of the same class

    @property
    def _told(self) -> dict[str, Any]:
        return {name: value for name, value in self.__getstate__().items() if name not in ORIGIN}

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what was made of them, and their number, which is a process's own."""
        made = cached_property
        return {
            name: value
            for name, value in vars(self).items()
            if not isinstance(getattr(type(self), name, None), made) and name != "stored"
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def same_density(self, other: object) -> bool:
        """Tell whether the density is the same everywhere."""
        return isinstance(other, Primitives) and self.density_key == other.density_key

    def with_medium(self, medium: Medium | None) -> Self:
        """Return the same primitives of another medium; None: the scene's."""
        number = self.number
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__ | {"medium": medium_of(medium, self.label), "number": number})
        return other

    @property
    def nbytes(self) -> int:
        """Size in memory."""
        arrays = (self.positions, self.radii, self.densities, self.colour)
        return sum(array.nbytes for array in arrays if array is not None)


def medium_of(medium: Medium | None, label: str) -> Medium | None:
    """Check that a body's medium is one, or None.

    Raises
    ------
    VolumeError
        It is something else.
    """
    if medium is not None and not hasattr(medium, "sigma_t"):
        raise VolumeError(f"{label}: medium should be a Medium, or None; got {medium!r}")
    return medium


def positions_of(values: ArrayLike, what: str, label: str) -> NDArray[np.float64]:
    """Check positions [n, 3]; the result cannot be written to.

    Raises
    ------
    VolumeError
        Another shape, none, or a number that is not finite or too large.
    """
    array = _numbers(values, what, label)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):  # noqa: PLR2004 - x, y, z
        raise VolumeError(f"{label}: {what} should be [n, 3] with n ≥ 1; got the shape {list(array.shape)}")
    wrong = ~(np.abs(array) <= LARGEST_COORDINATE).all(axis=1)
    if wrong.any():
        first = int(wrong.argmax())
        raise VolumeError(
            f"{label}: {what}[{first}] = {array[first].tolist()}: should be finite, up to "
            f"{LARGEST_COORDINATE:g}"
        )
    array.flags.writeable = False
    return array


def numbers_of(
    values: ArrayLike, count: int, what: str, label: str, *, most: float = LARGEST_COLOUR, above: bool = False
) -> NDArray[np.float64]:
    """Check one number for all, or one for each of ``count``; returns [count], not to be written to.

    Raises
    ------
    VolumeError
        Another shape, or a number below 0 (or 0 where it has to be ``above``), beyond ``most`` or not finite.
    """
    array = _numbers(values, what, label)
    if array.shape not in ((), (count,)):
        raise VolumeError(
            f"{label}: {what} should be one number or one for each of {count}; got the shape "
            f"{list(array.shape)}"
        )
    wrong = ~((array > 0 if above else array >= 0) & (array <= most))
    if wrong.any():
        first = int(np.atleast_1d(wrong).argmax())
        name = what if array.ndim == 0 else f"{what}[{first}]"
        bound = "above 0" if above else "0 or more"
        raise VolumeError(
            f"{label}: {name} = {np.atleast_1d(array)[first]:g}: should be {bound}, up to {most:g}"
        )
    full = np.array(np.broadcast_to(array, (count,)))
    full.flags.writeable = False
    return full


def colours_of(values: ArrayLike | None, count: int, label: str) -> NDArray[np.float32] | None:
    """Check one colour for all, or one for each of ``count``; returns [count, 3], not to be written to.

    Raises
    ------
    VolumeError
        As `numbers_of`.
    """
    if values is None:
        return None
    array = _numbers(values, "colour", label)
    if array.shape not in ((3,), (count, 3)):
        raise VolumeError(
            f"{label}: colour should be RGB, one or one for each of {count}; got the shape "
            f"{list(array.shape)}"
        )
    if not ((array >= 0) & (array <= LARGEST_COLOUR)).all():
        raise VolumeError(f"{label}: colour should be finite and 0 or more")
    full = np.array(np.broadcast_to(array, (count, 3)), dtype=np.float32)
    full.flags.writeable = False
    return full


def _numbers(values: ArrayLike, what: str, label: str) -> NDArray[np.float64]:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise VolumeError(f"{label}: {what} should be numbers") from None


def velocities_of(values: ArrayLike | None, count: int, label: str) -> NDArray[np.float64] | None:
    """Check one velocity for each of ``count``; returns [count, 3], not to be written to.

    Raises
    ------
    VolumeError
        As `positions_of`, or another number of them.
    """
    if values is None:
        return None
    found = positions_of(values, "velocity", label)
    if len(found) != count:
        raise VolumeError(f"{label}: velocity should be [{count}, 3]; got {len(found)} of them")
    return found


def rigid_scale(matrix: NDArray[np.float64], label: str) -> float:
    """Return the one scale of a 4×4 matrix that keeps angles.

    Raises
    ------
    VolumeError
        It does not.
    """
    linear = matrix[:3, :3] if matrix.shape == (4, 4) else np.zeros((3, 3))
    square = linear @ linear.T
    scale = square[0, 0]
    is_rigid = scale > 0 and np.allclose(square, scale * np.eye(3), rtol=1e-6, atol=1e-6 * scale)
    if not is_rigid or not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise VolumeError(
            f"{label}: transform should be a rotation, a translation and one scale for all axes: shapes stay "
            "what they are"
        )
    return float(np.sqrt(scale))
