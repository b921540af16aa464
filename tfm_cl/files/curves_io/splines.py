"""Curves as renderers store them, to polylines.

A curve has spans, of four control points each where it is cubic; a span becomes `SEGMENTS` segments of the
polyline. Bases, wrapping and where values lie are those of USD's ``BasisCurves``
(https://openusd.org/release/api/class_usd_geom_basis_curves.html).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

SEGMENTS = 8
"""Of the polyline in a span of a cubic curve: of a quarter circle it strays by 0.5 % of the radius."""


class _Basis(NamedTuple):
    step: int
    """Control points from one span to the next."""
    reach: int
    """Control points of a span."""
    segments: int
    matrix: NDArray[np.float64]
    """From [u³, u², u, 1] to the weights of four control points."""


BASES = {
    "linear": _Basis(1, 2, 1, np.array([[0.0] * 4, [0] * 4, [-1, 1, 0, 0], [1, 0, 0, 0]])),
    "bezier": _Basis(
        3, 4, SEGMENTS, np.array([[-1.0, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]])
    ),
    "bspline": _Basis(
        1, 4, SEGMENTS, np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6
    ),
    "catmullRom": _Basis(
        1, 4, SEGMENTS, np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]]) / 2
    ),
}
WRAPS = ("nonperiodic", "periodic", "pinned")


@dataclass(frozen=True)
class Polylines:
    """How values of curves become values of polylines' points; use `polylines` to make one."""

    counts: NDArray[np.int64]
    """[curves]: points of each polyline."""
    control: NDArray[np.int32]
    """[n, 4]: control points that each point of a polyline depends on."""
    ends: NDArray[np.int32]
    """[n, 2]: the ends of the span that it lies in."""
    at: NDArray[np.int8]
    """[n]: where in the span, from 0 to the number of its segments."""
    weights: NDArray[np.float64]
    """[segments + 1, 4]: of the control points, there."""
    vertices: int
    """Number of control points."""
    span_ends: int
    """Number of ends of all curves' spans."""
    pinned: NDArray[np.int64] | None
    """[curves]: control points of each, to which two are added so that it begins and ends at its own."""

    def of_vertices(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Evaluate values [vertices] or [vertices, numbers] of control points by the curves' basis."""
        if self.pinned is not None:
            values = _with_phantoms(values, self.pinned)
        weights = self.weights[self.at].reshape(-1, 4, *[1] * (values.ndim - 1))
        found = np.zeros((len(self.at), *values.shape[1:]))
        for point in range(4):
            found += weights[:, point] * values[self.control[:, point]]
        return found

    def of_span_ends(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Interpolate values [span_ends] or [span_ends, numbers] linearly."""
        fraction = (self.at / (len(self.weights) - 1)).reshape(-1, *[1] * (values.ndim - 1))
        found: NDArray[np.float64] = values[self.ends[:, 0]] * (1 - fraction)
        return found + values[self.ends[:, 1]] * fraction


def polylines(counts: NDArray[np.int64], basis: str, wrap: str, most: int) -> Polylines:
    """Find the polylines of curves.

    Parameters
    ----------
    counts
        [curves]: control points of each.
    basis, wrap
        A key of `BASES`, and one of `WRAPS`.
    most
        Number of the polylines' points at most.

    Raises
    ------
    ValueError
        Unknown words, a number of control points that such a curve cannot have, or too many points.
    """
    if basis not in BASES or wrap not in WRAPS:
        raise ValueError(f"its curves are {basis[:20]!r}, {wrap[:20]!r}, which is not known")
    kind, is_closed = BASES[basis], wrap == "periodic"
    # Other curves begin and end at control points anyway.
    pinned = counts if wrap == "pinned" and basis in {"bspline", "catmullRom"} else None
    control = counts if pinned is None else counts + 2
    rest = control if is_closed else control - kind.reach
    is_wrong = (counts < (3 if is_closed else 2)) | (rest < 0) | (rest % kind.step != 0)
    if is_wrong.any():
        wrong = int(is_wrong.argmax())
        raise ValueError(f"curve {wrong} has {counts[wrong]:,} points, which no {wrap} {basis} curve has")
    spans = rest // kind.step + (not is_closed)
    points = spans * kind.segments + 1
    if points.sum() > most:
        raise ValueError(f"its curves become {points.sum():,} points; up to {most:,} can be read")
    ends = spans + (not is_closed)
    curve = np.repeat(np.arange(len(counts), dtype=np.int32), points)
    at = np.arange(len(curve)) - _starts(points)[curve]
    span = np.minimum(at // kind.segments, spans[curve] - 1)
    local = (span * kind.step)[:, None] + np.arange(4)
    # A line has no third and fourth control point; their weights are 0.
    local = local % control[curve, None] if is_closed else np.minimum(local, control[curve, None] - 1)
    both = (span[:, None] + np.arange(2)) % ends[curve, None]
    fraction = np.arange(kind.segments + 1) / kind.segments
    return Polylines(
        counts=points,
        control=(local + _starts(control)[curve, None]).astype(np.int32),
        ends=(both + _starts(ends)[curve, None]).astype(np.int32),
        at=(at - span * kind.segments).astype(np.int8),
        weights=np.stack([fraction**power for power in (3, 2, 1, 0)], axis=1) @ kind.matrix,
        vertices=int(counts.sum()),
        span_ends=int(ends.sum()),
        pinned=pinned,
    )


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where each of several runs begins."""
    starts: NDArray[np.int64] = np.cumsum(counts) - counts
    return starts


def _with_phantoms(values: NDArray[Any], counts: NDArray[np.int64]) -> NDArray[Any]:
    """Add a value before and after each curve's, in line with the first two and the last two."""
    first = _starts(counts)
    last = first + counts - 1
    before, after = 2 * values[first] - values[first + 1], 2 * values[last] - values[last - 1]
    places = np.stack([first, last + 1], axis=1).ravel()
    both = np.stack([before, after], axis=1).reshape(-1, *values.shape[1:])
    found: NDArray[Any] = np.insert(np.asarray(values, np.float64), places, both, axis=0)
    return found
