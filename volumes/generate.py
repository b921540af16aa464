"""Generate the sample volumes of this folder: ``python volumes/generate.py [NAME ...] [-o DIR]``.

Each volume is a function of position in a module of its own name, sampled here at the voxel centres,
rounded and written as ``NAME.npz``. The same arrays come out on every run.
"""

import argparse
import time
from pathlib import Path
from typing import Protocol

import cumulus
import figure
import numpy as np
import plume
from noise import F32
from numpy.typing import NDArray

SIGNIFICANT_BITS = 6
"""Densities are rounded to this many binary digits: steps of 1.6 to 3 %, a tenth of the size on disk."""
FAINTEST = 2.0**-12
"""Smaller densities become exactly 0."""
SLAB = 16
"""Voxel planes sampled at a time, to bound the memory for intermediate arrays."""


class Sample(Protocol):
    """What a module of this folder declares."""

    SHAPE: tuple[int, int, int]
    VOXEL: float
    ORIGIN: tuple[float, float, float]
    SOLID: bool

    def density(self, z: F32, y: F32, x: F32) -> F32:
        """Density 0 … 1 at a rectangular mesh of world coordinates, ``[z, y, x]``."""
        ...


SAMPLES: dict[str, Sample] = {"cumulus": cumulus, "figure": figure, "plume": plume}


def generate(sample: Sample, every: int = 1) -> NDArray[np.float16 | np.uint8]:
    """Sample a volume at the voxel centres.

    Parameters
    ----------
    sample
        The volume's module.
    every
        Odd; 3 samples only the middle voxel of each block of 3×3×3, and so on.

    Returns
    -------
    NDArray
        ``[z, y, x]``: uint8 of 0 and 1 for a solid, else float16 in 0 … 1.
    """
    x, y, z = (
        (low + (np.arange(every // 2, count, every) + 0.5) * sample.VOXEL).astype(np.float32)
        for low, count in zip(sample.ORIGIN, sample.SHAPE[::-1], strict=True)
    )
    density = np.concatenate([sample.density(z[i : i + SLAB], y, x) for i in range(0, len(z), SLAB)])
    return density.astype(np.uint8) if sample.SOLID else _rounded(density)


def _rounded(density: F32) -> NDArray[np.float16]:
    mantissa, exponent = np.frexp(np.where(density < FAINTEST, np.float32(0), density))
    steps = np.float32(1 << SIGNIFICANT_BITS)
    return np.ldexp(np.rint(mantissa * steps) / steps, exponent).astype(np.float16)


def save(sample: Sample, density: NDArray[np.float16 | np.uint8], path: Path) -> None:
    """Write ``density``, ``voxel_size`` (x, y, z) and ``origin`` (x, y, z) to an ``.npz`` file."""
    np.savez_compressed(
        path, density=density, voxel_size=np.full(3, sample.VOXEL), origin=np.array(sample.ORIGIN)
    )


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Generate the sample volumes.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(SAMPLES)} (default: all)")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent, metavar="DIR")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.names if name not in SAMPLES]
    if unknown:
        parser.error(f"no sample volume named '{unknown[0]}'; known: {', '.join(SAMPLES)}")
    arguments.output.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or SAMPLES:
        start = time.perf_counter()
        density = generate(SAMPLES[name])
        path = arguments.output / f"{name}.npz"
        save(SAMPLES[name], density, path)
        z, y, x = density.shape
        seconds = time.perf_counter() - start
        print(f"{path}: {x}×{y}×{z} voxels, {path.stat().st_size / 1000:.0f} kB, {seconds:.1f} s")


if __name__ == "__main__":
    main()
