"""A tree: trunk and branches as one solid mesh, its leaves as polygons.

Branches fork by turns of the golden angle, a little thicker than if the squares of their radii added up to
that of the branch below (Leonardo's rule). Twigs bend up towards the light; leaves lie along the outermost of
them, two triangles each, folded at the middle, more or less level.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from ply import write_ply

F64 = NDArray[np.float64]
Mesh = tuple[F64, NDArray[np.int64]]
"""Vertices [n, 3] and faces [m, 3 or 4]."""

LEAVES, FULL_LEAVES = 6_500, 13_000
"""Of the small file and the large one; each has two triangles."""
HEIGHT = 2.2
"""World units, more or less; the tree stands at 0, 0, 0."""
TRUNK = 0.085
"""Radius above the roots."""
GRAIN = 1e-4
"""Unit of the files' whole numbers, world units, which keeps them small."""
LEVELS = 5
"""Of branches, the trunk being the first."""
FORKS = (7, 5, 4, 3)
"""Branches of a branch, by its level."""
LENGTHS = (0.95, 0.80, 0.46, 0.26, 0.15)
BENDS = 5
"""Points of a branch, root and tip among them."""
SIDES = (16, 8, 6, 4, 3)
"""Of a branch's tube, by its level."""
LEAF = 0.08
"""Length, world units, with `LEAVES`; area is kept with others."""
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True)
class Branch:
    """A tapered path."""

    level: int
    path: F64
    """[`BENDS`, 3]"""
    radii: F64
    """[`BENDS`]"""


def branches() -> list[Branch]:
    """Return all of them, the trunk first."""
    rng = np.random.default_rng(1519)
    upright = np.array((0.04, 1.0, 0.02))
    return list(_grow(np.zeros(3), upright, 0, TRUNK, 1.0, rng))


def _grow(
    root: F64, heading: F64, level: int, radius: float, vigour: float, rng: np.random.Generator
) -> Iterator[Branch]:
    length = LENGTHS[level] * vigour * rng.uniform(0.85, 1.15)
    path = [root]
    for _ in range(BENDS - 1):
        upward = 0.03 if level == 0 else 0.12
        heading = heading + rng.normal(0, 0.10 if level else 0.05, 3) + np.array((0, upward, 0))
        heading = heading / np.linalg.norm(heading)
        path.append(path[-1] + length / (BENDS - 1) * heading)
    tip = 0.45 if level < LEVELS - 1 else 0.3
    radii = radius * np.linspace(1, tip, BENDS)
    if level == 0:
        radii[0] *= 1.25
    points = np.array(path)
    yield Branch(level, points, radii)
    if level == LEVELS - 1:
        return
    forks = FORKS[level]
    turn = rng.uniform(0, 2 * np.pi)
    for at in np.linspace(0.5 if level == 0 else 0.3, 1, forks):
        # The lowest branches are long and lie flat, the topmost go on with the branch.
        spot, thick, along = _at(points, radii, at)
        side = np.cross(along, (0.3, 0.2, 1.0))
        side /= np.linalg.norm(side)
        other = np.cross(along, side)
        turn += GOLDEN_ANGLE
        lean = (1.15 if level == 0 else 0.85) * (1 - 0.55 * at) * rng.uniform(0.85, 1.15)
        out = np.cos(lean) * along + np.sin(lean) * (np.cos(turn) * side + np.sin(turn) * other)
        share = 0.95 / np.sqrt(forks) * 1.25
        yield from _grow(spot, out, level + 1, min(thick * 0.9, radius * share), 1.15 - 0.3 * at, rng)


def _at(points: F64, radii: F64, part: float) -> tuple[F64, float, F64]:
    """Return the place, the radius and the direction of a part of a path."""
    place = part * (len(points) - 1)
    low = min(int(place), len(points) - 2)
    rest = place - low
    along = points[low + 1] - points[low]
    radius = float(radii[low] + rest * (radii[low + 1] - radii[low]))
    return points[low] + rest * along, radius, along / np.linalg.norm(along)


def wood(grown: list[Branch]) -> Mesh:
    """Return the branches' tubes, open at both ends; faces have four corners."""
    vertices, faces, count = [], [], 0
    for branch in grown:
        sides = SIDES[branch.level]
        along = np.gradient(branch.path, axis=0)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        side = np.cross(along, (0.3, 0.2, 1.0))
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        other = np.cross(along, side)
        angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)[None, :, None]
        ring = np.cos(angle) * side[:, None] + np.sin(angle) * other[:, None]
        tube = branch.path[:, None] + branch.radii[:, None, None] * ring
        vertices.append(tube.reshape(-1, 3))
        i, j = np.meshgrid(np.arange(BENDS - 1), np.arange(sides), indexing="ij")
        here, beside = i * sides + j, i * sides + (j + 1) % sides
        corners = np.stack([here, here + sides, beside + sides, beside], axis=-1)
        faces.append(corners.reshape(-1, 4) + count)
        count += BENDS * sides
    return np.concatenate(vertices), np.concatenate(faces)


def leaves(grown: list[Branch], count: int) -> Mesh:
    """Return leaves of four corners of their own: at the stalk, to a side, at the tip, to the other side."""
    rng = np.random.default_rng(2206)
    twigs = [branch for branch in grown if branch.level >= LEVELS - 2]
    paths = np.stack([twig.path for twig in twigs])
    weight = np.array([1.0 if twig.level == LEVELS - 1 else 0.6 for twig in twigs])
    twig = rng.choice(len(twigs), count, p=weight / weight.sum())
    place = (BENDS - 1) * (0.2 + 0.8 * rng.uniform(0, 1, count) ** 0.7)
    low = np.minimum(place.astype(int), BENDS - 2)
    rest = (place - low)[:, None]
    start, end = paths[twig, low], paths[twig, low + 1]
    stalk = start + rest * (end - start)
    outward = end - start
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    tip = outward + rng.normal(0, 0.6, (count, 3)) + np.array((0, -0.25, 0))
    tip /= np.linalg.norm(tip, axis=-1, keepdims=True)
    across = np.cross(tip, np.array((0.0, 1.0, 0.0)) + rng.normal(0, 0.35, (count, 3)))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    above = np.cross(across, tip)
    size = (LEAF * np.sqrt(LEAVES / count) * rng.uniform(0.7, 1.25, count))[:, None]
    stalk = stalk + 0.12 * size * tip
    middle = stalk + 0.45 * size * tip + 0.10 * size * above
    corners = [stalk, middle - 0.3 * size * across, stalk + size * tip, middle + 0.3 * size * across]
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    first = 4 * np.arange(count)[:, None]
    return vertices, first + np.array((0, 1, 2, 3))


def write(path: Path, mesh: Mesh) -> None:
    """Write a mesh of the tree, in units of `GRAIN`."""
    vertices, faces = mesh
    write_ply(path, np.rint(vertices / GRAIN).astype(np.int16), faces)
