"""Learnt functions as text, so that scene files can give them: ``ROWSxCOLUMNS:`` and float32 in base64."""

from __future__ import annotations

import base64
import binascii
import re
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

FUNCTIONS_EXPECTED = "should be what tfm wrote for the frames of a range, ROWSxCOLUMNS:BASE64, or empty"
MOST_VALUES = 1 << 16
"""Numbers of them, at most."""
LARGEST = 1e18
"""Of these: float32 holds their squares."""
_BEGIN = re.compile(r"([1-9][0-9]{0,4})x([1-9][0-9]{0,4}):", re.ASCII)


def functions_text(modes: NDArray[np.float32]) -> str:
    """Write data of functions, [rows, columns], bit by bit."""
    values = base64.b64encode(modes.astype("<f4").tobytes()).decode("ascii")
    return "{}x{}:{}".format(*modes.shape, values)


@lru_cache(16)
def functions_in(text: str) -> NDArray[np.float32]:
    """Read data of functions, [rows, columns]; they are not to be changed.

    Raises
    ------
    ValueError
        A text that is none.
    """
    begin = _BEGIN.match(text)
    if begin is None:
        raise ValueError(FUNCTIONS_EXPECTED)
    rows, columns = int(begin[1]), int(begin[2])
    if rows * columns > MOST_VALUES:
        raise ValueError(f"has {rows * columns:,} numbers, more than {MOST_VALUES:,}")
    try:
        data = base64.b64decode(text[begin.end() :], validate=True)
    except (binascii.Error, ValueError):
        raise ValueError(FUNCTIONS_EXPECTED) from None
    if len(data) != 4 * rows * columns:
        raise ValueError(f"says {rows}×{columns} numbers, and has {len(data)} bytes; {FUNCTIONS_EXPECTED}")
    values = np.frombuffer(data, "<f4").reshape(rows, columns).astype(np.float32)
    if not (np.abs(values) <= LARGEST).all():
        raise ValueError(f"has numbers beyond {LARGEST:g}; {FUNCTIONS_EXPECTED}")
    values.flags.writeable = False
    return values
