"""Make the clear sky's numbers from Mitsuba's: ``make oracles``, then ``python scripts/sky_data.py``.

Mitsuba's wheel has the dataset of Hosek and Wilkie's model with its licence (BSD), which goes along.
"""

import importlib.util
import math
import struct
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

DATA = Path(__file__).resolve().parents[1] / "tfm_cl" / "files" / "hosek_wilkie.npz"
HEADER = 18
"""Bytes in front of a tensor file's table: its name, version and number of tensors."""
OF_CIE_Y = 1 / 106.7502593994140625
"""1 / the integral of the luminance's weights, nm, as Mitsuba has it."""
OF_SUN = 467.069280386
"""Mitsuba's factor from the sun's numbers for RGB to the sky's."""
SOLID_ANGLE = 2 * math.pi * (1 - math.cos(math.radians(0.5358 / 2)))
"""Of the sun, steradians."""


def tensors(file: bytes) -> dict[str, NDArray[np.float64]]:
    """Return the float64 tensors of one of Mitsuba's files by name."""
    (count,) = struct.unpack_from("<I", file, HEADER - 4)
    at, found = HEADER, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", file, at)
        name = file[at + 2 : at + 2 + length].decode()
        axes, _, begin = struct.unpack_from("<HBQ", file, at + 2 + length)
        shape = struct.unpack_from(f"<{axes}Q", file, at + 13 + length)
        found[name] = np.frombuffer(file, "<f8", math.prod(shape), begin).reshape(shape)
        at += 13 + length + 8 * axes
    return found


def main() -> int:
    """Write the numbers and their licence."""
    mitsuba = importlib.util.find_spec("mitsuba")
    if mitsuba is None or mitsuba.origin is None:
        print("Mitsuba is not installed: make oracles", file=sys.stderr)
        return 1
    folder = Path(mitsuba.origin).parent / "data" / "sunsky"
    found = tensors((folder / "sunsky_datasets.bin").read_bytes())
    # The mean of the j-th power of the cosine over a disk is 2 / (j + 2).
    sun = found["sun_rad_rgb"] @ (2 / (np.arange(6) + 2))
    np.savez_compressed(
        DATA,
        shape=found["sky_params_rgb"].astype(np.float32),
        radiance=(OF_CIE_Y * found["sky_rad_rgb"]).astype(np.float32),
        sun=(OF_CIE_Y * OF_SUN * SOLID_ANGLE * sun).astype(np.float32),
    )
    licence = (folder / "LICENSE").read_text(encoding="utf-8")
    DATA.with_suffix(".LICENSE").write_text(licence, encoding="utf-8")
    print(DATA)
    return 0


if __name__ == "__main__":
    sys.exit(main())
