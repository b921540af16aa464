"""Truevision TGA: four channels of 8 bits, run-length encoded."""

from pathlib import Path

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from tfm_cl.files.image_io.channels import Bits, codes_of


def write_channels(path: Path, channels: NDArray[np.float32], _bits: Bits) -> None:
    """Write numbers [H, W, 4] from 0 to 1."""
    codes = codes_of(channels, 255).astype(np.uint8)
    PIL.Image.fromarray(codes).save(path, format="TGA", compression="tga_rle")
