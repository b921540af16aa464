"""Fields: the few scalar densities that light passes march, whatever bodies and media a scene has.

A light's map holds the optical depth of scalars, but extinction has a colour. Bodies whose extinctions have
one ratio of red, green and blue share a field; what every light ray gathers in RGB is a matrix times the
fields' optical depths:

    τ_rgb = A τ_field,    τ_field = ∫ Σ_bodies weight · D dt

One medium makes one field, with A = σ_t (TFM eq. 13-14), so that changing its colour needs no new map. A grid
with a colour in each voxel, or more ratios than two, make three: red, green and blue themselves.

Only bodies that are marched take part, grids and primitives: what is homogeneous is known in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tfm_cl.scene.bodies.base import MarchedBody
    from tfm_cl.scene.scene import Scene

MOST_FIELDS = 3
SAME_RATIO = 1e-6
"""Of the largest channel: two extinctions closer than that have one colour."""


@dataclass(frozen=True)
class Fields:
    """How the extinction of a scene's marched bodies, grids first, is put together from scalar fields.

    Attributes
    ----------
    rgb_from_field
        float64 [3, K], A: extinction, per world unit, of a density of 1 of each field.
    weights
        float64 [bodies, 3, K]: what a density of 1 of channel c of a body adds to each field. A body without
        colour has one channel, the first; its other rows are 0.
    sigma_t
        float64 [bodies, 3]: extinction of each body's medium at density 1, RGB, per world unit.
    """

    rgb_from_field: NDArray[np.float64]
    weights: NDArray[np.float64]
    sigma_t: NDArray[np.float64]

    @property
    def count(self) -> int:
        """K, 1 to `MOST_FIELDS`; 0 without any."""
        return int(self.rgb_from_field.shape[1])

    @property
    def extinctions(self) -> NDArray[np.float64]:
        """float64 [K]: that of the colour that sees deepest into each field; 1 where none is extinguished."""
        seen = np.where(self.rgb_from_field > 0, self.rgb_from_field, np.inf).min(axis=0)
        extinctions: NDArray[np.float64] = np.where(np.isfinite(seen), seen, 1.0)
        return extinctions

    def depths_along(
        self,
        bodies: Iterable[MarchedBody],
        origin: NDArray[np.floating],
        direction: NDArray[np.floating],
        edges: NDArray[np.floating],
    ) -> NDArray[np.float64]:
        """Integrate each field between distances along a ray.

        Parameters
        ----------
        bodies
            The scene's marched ones.
        origin, direction
            [3], world; the direction has unit length.
        edges
            [n + 1], ascending distances from the origin.

        Returns
        -------
        NDArray
            float64 [n, K].
        """
        depths = np.zeros((len(edges) - 1, self.count))
        for body, weights in zip(bodies, self.weights, strict=True):
            channels = body.depths_along(origin, direction, edges)
            depths += channels @ weights[: channels.shape[1]]
        return depths

    def first_change(self, other: Fields) -> int | None:
        """Return the number of the first body whose part in fields is another; None where all are the same.

        Maps of these fields then serve the others, whatever A.
        """
        if self.weights.shape == other.weights.shape and np.array_equal(self.weights, other.weights):
            return None
        # One grid's new colour may move others to another field: it is the one to name.
        changed = np.abs(_ratios(self.sigma_t) - _ratios(other.sigma_t)).max(axis=1) > SAME_RATIO
        if not changed.any() and self.weights.shape == other.weights.shape:
            changed = (self.weights != other.weights).any(axis=(1, 2))
        return int(changed.argmax())


def _ratios(sigma_t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Extinctions over their largest channel, [grids, 3]."""
    largest = sigma_t.max(axis=1, keepdims=True)
    ratios: NDArray[np.float64] = sigma_t / np.where(largest > 0, largest, 1)
    return ratios


def fields_of(scene: Scene) -> Fields:
    """Group the extinctions of a scene's marched bodies by their colour."""
    extinctions = np.array([scene.medium_of(body).sigma_t for body in scene.marched]).reshape(-1, 3)
    if len(scene.marched) == 0:
        return Fields(np.zeros((3, 0)), np.zeros((0, 3, 0)), extinctions)
    coloured = np.array([body.colour is not None for body in scene.marched])
    weights: NDArray[np.float64]
    if not coloured.any() and (extinctions == extinctions[0]).all():
        weights = np.zeros((len(extinctions), 3, 1))
        weights[:, 0] = 1
        return Fields(extinctions[:1].T.copy(), weights, extinctions)
    ratios: list[NDArray[np.float64]] = []
    numbers, sizes = [], extinctions.max(axis=1)
    for extinction, size in zip(extinctions, sizes, strict=True):
        ratio = extinction / size if size > 0 else extinction
        same = [i for i, one in enumerate(ratios) if size == 0 or np.abs(one - ratio).max() <= SAME_RATIO]
        if not same:
            ratios.append(ratio)
        numbers.append(same[0] if same else len(ratios) - 1)
    if not coloured.any() and len(ratios) < MOST_FIELDS:
        weights = np.zeros((len(extinctions), 3, len(ratios)))
        weights[np.arange(len(extinctions)), 0, numbers] = sizes
        # Relative to the strongest of the field: how strong all of it is stays out of the maps, too.
        strongest = weights[:, 0].max(axis=0)
        weights /= np.where(strongest > 0, strongest, 1)
        return Fields(np.stack(ratios, axis=1) * strongest, weights, extinctions)
    if coloured.all() and all(np.array_equal(one, extinctions[0]) for one in extinctions):
        # As with one medium: its colour stays out of the maps.
        weights = np.broadcast_to(np.eye(3), (len(extinctions), 3, 3)).copy()
        return Fields(np.diag(extinctions[0]), weights, extinctions)
    weights = np.zeros((len(extinctions), 3, 3))
    for grid, (extinction, has_colour) in enumerate(zip(extinctions, coloured, strict=True)):
        if has_colour:
            weights[grid] = np.diag(extinction)
        else:
            weights[grid, 0] = extinction
    return Fields(np.eye(3), weights, extinctions)
