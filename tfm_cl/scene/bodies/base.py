"""What a body is to the rest of the project."""

from __future__ import annotations

import hashlib
import itertools
from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from tfm_cl.errors import words

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from tfm_cl.scene.medium import Medium


class BodySettings(Protocol):
    """What a scene file says of a body."""

    @property
    def medium(self) -> Medium | None:
        """What this body alone is made of."""

    def replace(self, **changes: Any) -> Self:
        """Return a copy with other values."""

    def load(self, folder: Path, optical_depth: float, like: tuple[BodySettings, Body] | None = None) -> Body:
        """Make the body, reading its files.

        Parameters
        ----------
        folder
            That the files' names are relative to.
        optical_depth
            Along typical lines of sight, where the density is left open.
        like
            Other settings, and what they made: what both read alike need not be read again.
        """

    def sources(self) -> list[str]:
        """Return the names of the files that it reads."""


BODIES: dict[str, Callable[[dict[str, Any]], BodySettings]] = {}
"""Key of a body's table -> what makes settings of such a table: the key tells of what kind the body is."""
OF_BODIES = words(
    {
        "translate": "position location translation offsetposition",
        "rotate": "rotation orientation eulerrotation",
        "transform": "matrix toworld worldfromobject worldmatrix xform",
        "colour": "color rgb cd",
        "medium": "material interior volumematerial",
        "write it in medium = { … }, or in [medium] for all bodies": (
            "sigmas sigmaa scattering absorption phase emission preset anisotropy"
        ),
        "write sigma_s and sigma_a in [medium], or in medium = { … } for this body: albedo 0.9 at extinction "
        "1 is sigma_s = 0.9, sigma_a = 0.1": "albedo singlescatteringalbedo ssa",
        "extinction is density times sigma_s + sigma_a of [medium], or of medium = { … } for this body": (
            "extinction sigmat"
        ),
    }
)
"""Keys of bodies in other programs -> the key here, or what to do."""
MOST_BODIES = 16
"""In one scene: each adds to what kernels are told."""


class Body:
    """What fills some of space with density.

    Where bodies overlap, their extinctions add up. A body may have a ``medium`` of its own; None means the
    scene's.
    """

    DENSITY_KEY: ClassVar[str]
    """The key of a scene file that its density is a multiple of, which is also the attribute's name."""

    @property
    def own_medium(self) -> Medium | None:
        """The medium that this body alone is made of; None: the scene's."""
        medium: Medium | None = getattr(self, "medium", None)
        return medium

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """World box around all that may have density, [2, 3]: low and high corner; may be infinite."""

    @property
    @abstractmethod
    def occupied_bounds(self) -> NDArray[np.float64]:
        """World box around what has density, [2, 3]."""

    @abstractmethod
    def mass_in(self, room: float) -> float:
        """Integral over space of the density; of what is everywhere, over so much of it, world units³."""

    def outline(self) -> NDArray[np.float64]:
        """World points [n, 3] around what is seen of it; none of what is everywhere."""
        box = self.occupied_bounds
        return np.array([*itertools.product(*box.T)] if np.isfinite(box).all() else np.empty((0, 3)))

    @abstractmethod
    def to_table(self) -> dict[str, Any] | None:
        """Return a ``[[volume]]`` table of a scene file anywhere that makes it; None where no file has it."""

    def to_arrays(self) -> tuple[str, dict[str, Any], dict[str, NDArray[Any]]] | None:
        """Return what an ``.npz`` file can hold it with; None where none can.

        Returns
        -------
        The key of the file in a ``[[volume]]`` table, the other keys of that, and the arrays by their names.
        """
        return None

    @property
    @abstractmethod
    def label(self) -> str:
        """What messages call it."""

    @property
    @abstractmethod
    def largest_density(self) -> NDArray[np.float64]:
        """What no density inside is greater than, in red, green and blue, [3]."""

    @property
    @abstractmethod
    def why_empty(self) -> str:
        """Why it has no density at all, for messages; empty where it has some."""

    @abstractmethod
    def with_medium(self, medium: Medium | None) -> Self:
        """Return the same body of another medium."""

    @abstractmethod
    def equals(self, other: object) -> bool:
        """Tell whether another has the same density and medium, number by number, wherever it comes from."""

    @abstractmethod
    def same_density(self, other: object) -> bool:
        """Tell whether the density is the same everywhere, looking at what it was made from only."""


class MarchedBody(Body):
    """A body that rays are marched through, and whose part in the maps has a field."""

    @property
    @abstractmethod
    def colour(self) -> NDArray[np.float32] | None:
        """Extinction in red, green and blue relative to the density, everywhere in it; None: 1."""

    @property
    @abstractmethod
    def density_key(self) -> tuple[Any, ...]:
        """All that its density in space depends on."""

    @property
    @abstractmethod
    def digest(self) -> str:
        """The same told by contents, in hexadecimal digits: what another process reads alike has the same."""

    @property
    @abstractmethod
    def detail(self) -> float:
        """World units: texels and steps follow what is as small as that."""

    @property
    @abstractmethod
    def typical_density(self) -> float:
        """Mean density weighted by itself: that of the body, not of the empty space around it."""

    @property
    @abstractmethod
    def longest_ray(self) -> float:
        """World units, of the rays through its bounds."""

    @abstractmethod
    def interval(self, origin: NDArray[np.floating], direction: NDArray[np.floating]) -> tuple[float, float]:
        """Part of a ray from ``origin`` within its bounds: begin ≥ 0, end; empty where begin ≥ end."""

    @abstractmethod
    def depths_along(
        self, origin: NDArray[np.floating], direction: NDArray[np.floating], edges: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Integrate the density between distances ``edges`` [n + 1] along a ray with a unit direction.

        Returns float64 [n, 1], or [n, RGB] where it has a colour.
        """

    @abstractmethod
    def line_depths(self) -> list[NDArray[np.float64]]:
        """Integrals of the density along lines of three directions, in any order; some empty ones are out."""


def around(boxes: list[NDArray[Any]]) -> NDArray[np.float64]:
    """World box around boxes, [2, 3]."""
    corners = np.stack(boxes)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def digest_of(what: str, *arrays: NDArray[Any]) -> str:
    """Return hexadecimal digits that tell arrays from others, and what they stand for."""
    found = hashlib.sha256(what.encode())
    for array in arrays:
        found.update(f"|{array.dtype.str}{array.shape}|".encode())
        found.update(np.ascontiguousarray(array).data)
    return found.hexdigest()
