"""Hair and fur: strands that grow out of a ball and fall over it.

1. Roots lie evenly spread on the scalp, in the order of a golden spiral.
2. A strand leaves along the normal, combed back, and bends down step by step; the ball, and the strands below
   it, push it out.
3. Strands join into locks: towards their tips they draw near one among them, the lock's guide.
4. Waves swing to the side of a strand; curls wind around it. Both begin above the root, and all strands of a
   lock swing together, but for a little.

Widths fall from root to tip.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

BALL = 0.5
"""Radius of the head, world units; it is centred at 0."""
SKIN = 1.01
"""Times the ball's radius: nothing is nearer."""
GRAIN = 1 / 2048
"""Positions are rounded to this, a fortieth of a lock, which keeps the files small."""


FULL = 10_000
"""Strands of a large file, of which the papers have as many."""


@dataclass(frozen=True)
class Style:
    """How hair grows."""

    strands: int
    """Of the small file."""
    points: int
    """Of each strand there."""
    full_points: int
    """Of each of `FULL` strands."""
    length: float
    """World units, of the longest; the shortest has two thirds."""
    width: float
    """At the root, of the small file's strands; those of the large one cover the same."""
    locks: int
    joined: float
    """Part of the way to the lock's guide that tips go."""
    swing: float = 0.0
    """Radius of curls, or of waves, world units."""
    turns: float = 0.0
    """Of a curl or wave, along the longest strand."""
    winds: bool = False
    """Curls instead of waves."""
    is_fur: bool = False
    """All over the ball, and short."""

    def tuft(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays of the small file of curves."""
        return _tuft(self, self.strands, self.points)

    def full_tuft(self) -> dict[str, NDArray[np.generic]]:
        """Return those of the large one."""
        return _tuft(self, FULL, self.full_points)


STYLES = {
    "straight": Style(2600, 15, 36, 1.2, 0.010, locks=200, joined=0.5),
    "wavy": Style(1900, 21, 41, 1.2, 0.012, locks=130, joined=0.6, swing=0.03, turns=4.0),
    "curly": Style(900, 44, 81, 1.15, 0.016, locks=110, joined=0.8, swing=0.045, turns=3.4, winds=True),
    "fur": Style(5200, 8, 36, 0.24, 0.0075, locks=420, joined=0.5, is_fur=True),
}


def _tuft(style: Style, strands: int, points: int) -> dict[str, NDArray[np.generic]]:
    rng = np.random.default_rng(340_000)
    roots = _roots(style, strands)
    length = style.length * rng.uniform(0.67, 1, strands)
    if not style.is_fur:
        length *= 0.75 + 0.25 * np.clip(0.5 - 0.9 * roots[:, 2] / BALL, 0, 1)
    paths = _fall(style, roots, length, points, rng)
    along = np.linspace(0, 1, points)[:, None]
    lock = _nearest(roots, _roots(style, style.locks))
    guide = np.array([np.flatnonzero(lock == number)[0] for number in range(lock.max() + 1)])[lock]
    joined = style.joined * along[None] ** 1.4
    paths = (1 - joined) * paths + joined * paths[guide]
    paths *= np.maximum(1, SKIN * BALL / np.linalg.norm(paths, axis=-1, keepdims=True))
    if style.swing:
        paths += _swings(style, paths, along[None] * length[:, None, None], lock, rng)
    widths = style.width * np.sqrt(style.strands / strands) * (1 - 0.75 * along[:, 0] ** 2)
    return {
        "points": (np.rint(paths / GRAIN) * GRAIN).astype(np.float16).reshape(-1, 3),
        "counts": np.full(strands, points, np.uint16),
        "width": np.tile(widths, strands).astype(np.float16),
    }


def _roots(style: Style, count: int) -> F64:
    """Return points of the scalp, [count, 3]: all of the ball, or less a face and a neck."""
    low = -1.0 if style.is_fur else -0.25
    share = 1.0
    while True:
        number = np.arange(int(count * share) + 8)
        y = 1 - (1 - low) * (number + 0.5) / len(number)
        around = np.sqrt(1 - y * y)
        turn = np.pi * (3 - np.sqrt(5)) * number
        points = np.stack([around * np.cos(turn), y, around * np.sin(turn)], axis=-1)
        if not style.is_fur:
            points = points[points[:, 2] < 0.35 + 0.5 * y]
        if len(points) >= count:
            kept: F64 = BALL * points[np.linspace(0, len(points) - 1, count).round().astype(int)]
            return kept
        share *= 1.02


def _fall(style: Style, roots: F64, length: F64, points: int, rng: np.random.Generator) -> F64:
    """Let strands grow: [strands, points, 3]."""
    # The spiral's regular rows would show.
    roots = roots + 0.3 * np.sqrt(4 * np.pi * BALL**2 / len(roots)) * rng.uniform(-1, 1, roots.shape)
    roots *= BALL / np.linalg.norm(roots, axis=-1, keepdims=True)
    normal = roots / BALL
    heading = normal + rng.standard_normal(roots.shape) * (0.22 if style.is_fur else 0.06)
    if not style.is_fur:
        heading += (0, 0.1, -0.55)
        heading[:, 0] += 0.45 * np.sign(roots[:, 0])
    layer = BALL * (1.015 + 0.16 * rng.uniform(0, 1, len(roots)) ** 1.5)
    weight = 1.1 if style.is_fur else 11.0
    paths = np.empty((len(roots), points, 3))
    # A few steps between points: the path is that of a smooth strand, of however many points.
    fine = 4
    step = (length / (points - 1) / fine)[:, None]
    here = roots.copy()
    for number in range(points):
        paths[:, number] = here
        for _ in range(fine):
            heading /= np.linalg.norm(heading, axis=-1, keepdims=True)
            here = here + step * heading
            heading = heading + weight * step * np.array((0.0, -1.0, 0.0)) / style.length
            away = np.linalg.norm(here, axis=-1, keepdims=True)
            outward = here / away
            inward = np.minimum((heading * outward).sum(axis=-1, keepdims=True), 0)
            pressed = np.clip((layer[:, None] - away) / (0.1 * BALL), 0, 1)
            heading = heading - pressed * inward * outward
            here = np.where(away < SKIN * BALL, SKIN * BALL * outward, here)
    return paths


def _swings(style: Style, paths: F64, along: F64, lock: NDArray[np.intp], rng: np.random.Generator) -> F64:
    """Return how far waves or curls take each point aside."""
    tangent = np.gradient(paths, axis=1)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    side = np.cross(tangent, paths)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    locks = lock.max() + 1
    begin = rng.uniform(0, 2 * np.pi, locks)[lock] + 0.35 * rng.standard_normal(len(lock))
    pace = rng.uniform(0.85, 1.15, locks)[lock]
    phase = begin[:, None, None] + 2 * np.pi * style.turns / style.length * pace[:, None, None] * along
    reach = style.swing * np.clip(along / (0.3 * style.length), 0, 1)
    if not style.winds:
        swung: F64 = reach * np.sin(phase) * side
        return swung
    hand = np.where(rng.uniform(0, 1, locks) < 0.5, -1.0, 1.0)[lock][:, None, None]  # noqa: PLR2004 - half of them
    up = np.cross(side, tangent)
    # Lifted by their radius, curls do not dive into the ball.
    outward = paths / np.linalg.norm(paths, axis=-1, keepdims=True)
    wound: F64 = reach * (np.cos(phase) * side + hand * np.sin(phase) * up + outward)
    return wound


def _nearest(points: F64, centres: F64) -> NDArray[np.intp]:
    """Return the number of each point's nearest centre, without those that no point is near."""
    distances = ((points[:, None] - centres[None]) ** 2).sum(axis=-1)
    _, numbers = np.unique(distances.argmin(axis=1), return_inverse=True)
    return numbers
