"""What a body is to the rest of the project."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tfm_cl.scene.medium import Medium

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
    def same_density(self, other: object) -> bool:
        """Tell whether the density is the same everywhere, looking at what it was made from only."""


def around(boxes: list[NDArray[Any]]) -> NDArray[np.float64]:
    """World box around boxes, [2, 3]."""
    corners = np.stack(boxes)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
