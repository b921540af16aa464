"""Generate the sample bodies of this folder: ``python volumes/generate.py [NAME ...] [-o DIR] [--full]``.

Each volume is a function of position in a module of its own name, sampled here at the voxel centres,
rounded and written as ``NAME.npz``. Particles, hair and the tree are what their modules return; ``--full``
writes the hair and the tree in the size that the papers have, as ``NAME_full``. The same arrays come out on
every run. A sequence comes on demand, ``python volumes/generate.py rising_plume --frames 1-24``, as
``NAME.0001.npz`` …, with a velocity ``v`` for every voxel; in another folder its scene is beside it.
"""

import argparse
import re
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import cumulus
import figure
import fire
import hair
import inks
import numpy as np
import particles
import plume
import rising_plume
import tree
from noise import F32
from numpy.typing import NDArray

SIGNIFICANT_BITS = 6
"""Densities are rounded to this many binary digits: steps of 1.6 to 3 %, a tenth of the size on disk."""
FAINTEST = 2.0**-12
"""Smaller densities become exactly 0."""
SLAB = 16
"""Voxel planes sampled at a time, to bound the memory for intermediate arrays."""


class Placed(Protocol):
    """Where the voxels are that a module of this folder fills."""

    SHAPE: tuple[int, int, int]
    VOXEL: float
    ORIGIN: tuple[float, float, float]


class Sample(Placed, Protocol):
    """What the module of a volume declares."""

    SOLID: bool

    def density(self, z: F32, y: F32, x: F32) -> F32:
        """Density 0 … 1 at a rectangular mesh of world coordinates, ``[z, y, x]``."""
        ...


SAMPLES: dict[str, Sample] = {
    "cumulus": cumulus,
    "figure": figure,
    "plume": plume,
    "fire": fire,
    "inks": inks,
}
PARTICLES = {"particles": particles.smoke_plume, "spirals": particles.spirals}
GROWN = (*hair.STYLES, "tree")
"""Those that have a full size too."""
NAMES = (*SAMPLES, *PARTICLES, *GROWN)
SEQUENCES = {"rising_plume": rising_plume}
"""Those of several frames, which are not made unless they are named."""
SUFFIX = "_full"


def generate(
    sample: Sample, every: int = 1, function: Callable[[F32, F32, F32], F32] | None = None
) -> NDArray[np.float16 | np.uint8]:
    """Sample a volume at the voxel centres.

    Parameters
    ----------
    sample
        The volume's module.
    every
        Odd; 3 samples only the middle voxel of each block of 3×3×3, and so on.
    function
        Of its module, of a mesh; by default its density.

    Returns
    -------
    NDArray
        ``[z, y, x]``: uint8 of 0 and 1 for a solid, else float16 in 0 … 1.
    """
    x, y, z = (
        (low + (np.arange(every // 2, count, every) + 0.5) * sample.VOXEL).astype(np.float32)
        for low, count in zip(sample.ORIGIN, sample.SHAPE[::-1], strict=True)
    )
    function = function or sample.density
    values = np.concatenate([function(z[i : i + SLAB], y, x) for i in range(0, len(z), SLAB)])
    return values.astype(np.uint8) if sample.SOLID else _rounded(values)


def _rounded(density: F32) -> NDArray[np.float16]:
    mantissa, exponent = np.frexp(np.where(density < FAINTEST, np.float32(0), density))
    steps = np.float32(1 << SIGNIFICANT_BITS)
    return np.ldexp(np.rint(mantissa * steps) / steps, exponent).astype(np.float16)


def save(sample: Placed, path: Path, **grids: NDArray[np.float16 | np.uint8]) -> None:
    """Write ``density`` and other grids, ``voxel_size`` and ``origin`` (both x, y, z) to an ``.npz`` file."""
    placed = {"voxel_size": np.full(3, sample.VOXEL), "origin": np.array(sample.ORIGIN)}
    np.savez_compressed(path, **grids, **placed)  # type: ignore[arg-type]


def write_volume(name: str, folder: Path) -> str:
    """Write a volume; returns what it is."""
    sample = SAMPLES[name]
    grids = {"density": generate(sample)}
    if sample is fire:
        grids["temperature"] = generate(sample, function=fire.temperature)
    if sample is inks:
        grids["colour"] = generate(sample, function=inks.colour)
    save(sample, folder / f"{name}.npz", **grids)
    z, y, x = grids["density"].shape
    return f"{x}×{y}×{z} voxels"


def write_particles(name: str, folder: Path) -> str:
    """Write particles; returns what they are."""
    made = PARTICLES[name]()
    np.savez_compressed(folder / f"{name}.npz", **made.arrays())  # type: ignore[arg-type]
    return f"{len(made.positions):,} points"


def write_hair(name: str, folder: Path, *, full: bool) -> str:
    """Write hair or fur; returns what it is."""
    style = hair.STYLES[name]
    arrays = style.full_tuft() if full else style.tuft()
    np.savez_compressed(folder / f"{name}{SUFFIX * full}.npz", **arrays)  # type: ignore[arg-type]
    points, strands = len(arrays["points"]), len(arrays["counts"])
    return f"{strands:,} strands, {points - strands:,} segments"


def write_tree(folder: Path, *, full: bool) -> str:
    """Write the tree's two meshes; returns what they are."""
    grown = tree.branches()
    count = tree.FULL_LEAVES if full else tree.LEAVES
    tree.write(folder / f"wood{SUFFIX * full}.ply", tree.wood(grown))
    tree.write(folder / f"leaves{SUFFIX * full}.ply", tree.leaves(grown, count))
    return f"{2 * count:,} triangles of leaves"


def write_sequence(name: str, folder: Path, frames: range | None) -> str:
    """Write frames of a sequence, by default all, and its scene; returns what they are."""
    sample = SEQUENCES[name]
    frames = frames or range(1, sample.FRAMES + 1)
    for frame in frames:
        density, velocity = sample.sample(frame)
        grids = {"density": _rounded(density), "v": velocity.astype(np.float16)}
        save(sample, folder / f"{name}.{frame:04d}.npz", **grids)
    scene = Path(__file__).with_name(f"{name}.toml")
    if folder.resolve() != scene.parent.resolve():
        shutil.copyfile(scene, folder / scene.name)
    z, y, x = sample.SHAPE
    return f"{len(frames)} frames of {x}×{y}×{z} voxels"


def _frames(text: str) -> range:
    """Read ``1-24``."""
    if not (found := re.fullmatch(r"(\d{1,4})-(\d{1,4})", text)):
        raise argparse.ArgumentTypeError(f"'{text}' is not FIRST-LAST, as 1-24")
    return range(int(found[1]), int(found[2]) + 1)


def write(name: str, folder: Path, *, full: bool, frames: range | None = None) -> str:
    """Write the files of a name; returns what they hold."""
    if name in SEQUENCES:
        return write_sequence(name, folder, frames)
    if name in SAMPLES:
        return write_volume(name, folder)
    if name in PARTICLES:
        return write_particles(name, folder)
    return write_tree(folder, full=full) if name == "tree" else write_hair(name, folder, full=full)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Generate the sample bodies.")
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"{', '.join(NAMES)} (default: all), or a sequence: {', '.join(SEQUENCES)}",
    )
    parser.add_argument("--full", action="store_true", help=f"{', '.join(GROWN)} in the size of the papers'")
    parser.add_argument("--frames", type=_frames, metavar="FIRST-LAST", help="of a sequence (default: all)")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent, metavar="DIR")
    arguments = parser.parse_args()
    known = GROWN if arguments.full else (*NAMES, *SEQUENCES)
    unknown = [name for name in arguments.names if name not in known]
    if unknown:
        which = "full size" if arguments.full else "sample"
        parser.error(f"no {which} named '{unknown[0]}'; known: {', '.join(known)}")
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or (GROWN if arguments.full else NAMES):
        start = time.perf_counter()
        what = write(name, arguments.output, full=arguments.full, frames=arguments.frames)
        print(f"{name}: {what}, {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
