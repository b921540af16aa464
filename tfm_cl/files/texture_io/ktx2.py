"""Textures as KTX 2.0: an uncompressed 2-D array texture of one mip level, RGBA of floats or halves.

Rows are stored from v = 0 on, as Vulkan, Direct3D, Metal and OpenGL take them.
Khronos, "KTX File Format Specification", version 2.0.4; "Data Format Specification", version 1.3.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
VK_FORMATS = {2: 97, 4: 109}
"""Bytes a channel -> VK_FORMAT_R16G16B16A16_SFLOAT, VK_FORMAT_R32G32B32A32_SFLOAT."""
HEADER, INDEX, LEVEL = "<9I", "<4I2Q", "<3Q"
ALIGNMENT = 16
"""Of the data: of a texel's bytes."""
BASIC = struct.Struct("<IHH8B8B")
"""Basic data format descriptor: vendor and type, version, size, model … and bytes of the planes."""
SAMPLE = struct.Struct("<HBBIff")
"""First bit, bits - 1, channel, position, and the numbers that stand for -1 and 1."""
CHANNELS = (0, 1, 2, 15)
"""R, G, B and A of the model RGBSDA."""
FLOAT_SIGNED = 0xC0
RGBSDA, LINEAR, VERSION = 1, 1, 2


def write(path: Path, layers: NDArray[np.floating[Any]]) -> None:
    """Write a file."""
    count, height, width, _ = layers.shape
    data = np.ascontiguousarray(layers).astype(layers.dtype.newbyteorder("<")).tobytes()
    descriptor = _descriptor(layers.dtype.itemsize)
    pairs = b"".join(map(_pair, ((b"KTXorientation", b"rd"), (b"KTXwriter", b"tfm_cl"))))
    first = len(IDENTIFIER) + sum(map(struct.calcsize, (HEADER, INDEX, LEVEL)))
    begin = first + len(descriptor) + len(pairs)
    padding = -begin % ALIGNMENT
    size = layers.dtype.itemsize
    with path.open("wb") as stream:
        stream.write(IDENTIFIER)
        # Depth 0: two dimensions. One face, one level, no supercompression.
        stream.write(struct.pack(HEADER, VK_FORMATS[size], size, width, height, 0, count, 1, 1, 0))
        where = first, len(descriptor), first + len(descriptor), len(pairs)
        stream.write(struct.pack(INDEX, *where, 0, 0))
        stream.write(struct.pack(LEVEL, begin + padding, len(data), len(data)))
        stream.write(descriptor + pairs + bytes(padding) + data)


def _descriptor(size: int) -> bytes:
    """Say that a texel is four signed floats of so many bytes."""
    block = BASIC.size + len(CHANNELS) * SAMPLE.size
    planes = 4 * size, *(0,) * 7
    basic = BASIC.pack(0, VERSION, block, RGBSDA, 0, LINEAR, 0, 0, 0, 0, 0, *planes)
    samples = [
        SAMPLE.pack(8 * size * i, 8 * size - 1, channel | FLOAT_SIGNED, 0, -1.0, 1.0)
        for i, channel in enumerate(CHANNELS)
    ]
    return struct.pack("<I", 4 + block) + basic + b"".join(samples)


def _pair(pair: tuple[bytes, bytes]) -> bytes:
    """Write a key and its text, padded to four bytes."""
    text = b"\0".join((*pair, b""))
    return struct.pack("<I", len(text)) + text + bytes(-len(text) % 4)
