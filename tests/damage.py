"""Damaged copies of a file, and what a reader may do with them."""

import dataclasses

import numpy as np
import pytest

from tfm_cl.errors import VolumeError

LONGEST_MESSAGE = 500
"""Characters, whatever a file claims its names to be."""


def truncated(data, *, every=1):
    """The file, cut at every so many bytes."""
    return [data[:size] for size in range(0, len(data), every)]


def with_other_bytes(data, *, count=400, seed=0):
    """The file with a byte, or four in a row, of other values at places all over it."""
    rng = np.random.default_rng(seed)
    found = []
    for index in range(count):
        copy, at = bytearray(data), int(rng.integers(len(data)))
        extreme = [b"\x00" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x80\x00\x00\x00"]
        new = extreme[index // 2 % len(extreme)] if index % 2 else bytes([int(rng.integers(256))])
        copy[at : at + len(new)] = new[: len(data) - at]
        found.append(bytes(copy))
    return found


def assert_read_or_refused(read, path, copies):
    """Each copy is read as finite numbers or refused in a line that names the file; some are refused."""
    refused = 0
    for copy in copies:
        path.write_bytes(copy)
        try:
            stored = read(path)
        except VolumeError as error:
            (line,) = str(error).splitlines()
            assert line.startswith(f"{path}: ")
            assert len(line) - len(str(path)) < LONGEST_MESSAGE
            assert line.isprintable()
            refused += 1
        else:
            for field in dataclasses.fields(stored):
                values = getattr(stored, field.name)
                assert values is None or np.isfinite(values).all(), field.name
    assert refused


def assert_refused(read, path, data, message):
    """The file is refused, in a line that says so."""
    path.write_bytes(data)
    with pytest.raises(VolumeError, match=message) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()
