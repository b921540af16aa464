"""Generate what stands and shines in the sample scenes: ``python volumes/props.py [-o DIR]``.

- ``knot.ply``: a torus knot (2, 3) as a tube, some 24,000 triangles.
- ``window.png``: a rose window, black lead between coloured panes, to be thrown through a spot's cone.
- ``lamps.toml``: a scene of 400 small coloured spots over a floor in fog.

The same files come out on every run.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from ply import write_ply

WINDOW = 512
"""Pixels along a side."""
AROUND, ALONG = 24, 500
"""Vertices around the knot's tube, and along it."""
LEAD = 0.018
"""Half width of the lead between panes; the window is 2 wide."""
LAMPS = 400


def knot() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the knot's vertices [n, 3], about 1 high, centred at 0, and its triangles [m, 3]."""
    t = np.linspace(0, 2 * np.pi, ALONG, endpoint=False)
    axis = np.stack(
        [(2 + np.cos(3 * t)) * np.cos(2 * t), (2 + np.cos(3 * t)) * np.sin(2 * t), np.sin(3 * t)], axis=-1
    )
    tangent = np.roll(axis, -1, axis=0) - np.roll(axis, 1, axis=0)
    outward = axis * (1, 1, 3)
    side = np.cross(tangent, outward)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    up = np.cross(side, tangent)
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)[:, None]
    tube = 0.45 * (np.cos(angle) * side[:, None] + np.sin(angle) * up[:, None])
    vertices = (axis[:, None] + tube).reshape(-1, 3) / 7
    i, j = np.meshgrid(np.arange(ALONG), np.arange(AROUND), indexing="ij")
    here, there = i * AROUND + j, (i + 1) % ALONG * AROUND + j
    turn = (j + 1) % AROUND - j
    triangles = np.stack([here, there, here + turn, here + turn, there, there + turn], axis=-1)
    return vertices, triangles.reshape(-1, 3)


def window() -> NDArray[np.uint8]:
    """Return the rose window, [row, column, RGB]."""
    y, x = (np.mgrid[0:WINDOW, 0:WINDOW] + 0.5) / WINDOW * 2 - 1
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    image = np.zeros((WINDOW, WINDOW, 3))
    rings = ((0.0, 0.2, 1), (0.24, 0.46, 8), (0.5, 0.7, 16), (0.74, 0.93, 24))
    colours = np.array(
        [(1.0, 0.85, 0.3), (0.9, 0.15, 0.1), (0.1, 0.25, 0.9), (0.15, 0.65, 0.25), (0.75, 0.3, 0.8)]
    )
    for ring, (inner, outer, panes) in enumerate(rings):
        place = (angle / (2 * np.pi) * panes + 0.5 * ring) % panes
        lead = np.abs(place - np.rint(place)) * 2 * np.pi / panes * radius < LEAD
        inside = (radius > inner) & (radius < outer) & ~(lead & (panes > 1))
        image[inside] = colours[(place.astype(int) * (ring + 1) + ring) % len(colours)][inside]
    return np.rint(255 * image).astype(np.uint8)


def lamps() -> str:
    """Return a scene of many small spots that look down into fog."""
    rng = np.random.default_rng(7)
    lights = []
    for number in range(LAMPS):
        x, z = (number % 20 - 9.5) * 0.8, (number // 20 - 9.5) * 0.8
        x, z = x + rng.uniform(-0.2, 0.2), z + rng.uniform(-0.2, 0.2)
        hue = rng.uniform(0, 2 * np.pi)
        colour = 2.4 * (0.55 + 0.45 * np.cos(hue + np.array([0, 2.1, 4.2])))
        tilt = rng.uniform(-0.25, 0.25, 2)
        lights.append(
            f"[[light]]\nfrom = [{x:.3f}, {rng.uniform(0.7, 1.0):.3f}, {z:.3f}]\n"
            f"to = [{x + tilt[0]:.3f}, 0.0, {z + tilt[1]:.3f}]\n"
            f"cone = {rng.uniform(12, 24):.1f}\nblend = 0.4\n"
            'falloff = "inverse-square"\nreach = 1.3\n'
            f"intensity = [{', '.join(f'{c:.3f}' for c in colour)}]\n"
        )
    return f"""# {LAMPS} small coloured spots in fog over a floor: a pixel pays for the lights that touch it.
[volume]
shape = "box"
from = [-9.0, 0.0, -9.0]
to = [9.0, 1.2, 9.0]
density = 0.35

[camera]
from = [0.0, 2.6, 11.0]
to = [0.0, 0.1, 0.0]
fov = 38.0
res = [1280, 720]

[march]
steps = 50

[[solid]]
shape = "plane"
albedo = 0.5

[[solid]]
mesh = "knot.ply"
albedo = [0.8, 0.8, 0.8]
transform = [2.2, 0, 0, 0, 0, 2.2, 0, 0.95, 0, 0, 2.2, 3.0, 0, 0, 0, 1]

{chr(10).join(lights)}"""


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Generate the props of the sample scenes.")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent, metavar="DIR")
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / "knot.ply", *knot())
    Image.fromarray(window()).save(folder / "window.png", optimize=True)
    (folder / "lamps.toml").write_text(lamps(), encoding="utf-8")


if __name__ == "__main__":
    main()
