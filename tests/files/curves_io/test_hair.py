"""Cem Yuksel's .hair files, written here byte by byte to the published layout."""

import struct

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes
from memory import peak_of

from tfm_cl.errors import VolumeError
from tfm_cl.files.curves_io import read_curves

POINTS = np.arange(15, dtype="<f4").reshape(5, 3)


def hair(strands, points, arrays, *data, segments=0, thickness=0.25, transparency=0.5, colour=(1, 0.5, 0)):
    numbers = (strands, points, arrays, segments, thickness, transparency, *colour)
    return b"HAIR" + struct.pack("<4I5f", *numbers) + b"by hand".ljust(88, b"\0") + b"".join(data)


def of_all_arrays():
    return hair(
        2,
        5,
        31,
        struct.pack("<2H", 2, 1),
        POINTS.tobytes(),
        struct.pack("<5f", 5, 4, 3, 2, 1),
        struct.pack("<5f", 0, 0.25, 0.5, 0.75, 1),
        (POINTS / 16).tobytes(),
    )


def read(path, data):
    path.write_bytes(data)
    return read_curves(path)


def test_the_header_has_128_bytes():
    assert len(hair(0, 0, 0)) == 128


def test_all_arrays(tmp_path):
    curves = read(tmp_path / "a.hair", of_all_arrays())
    np.testing.assert_array_equal(curves.counts, [3, 2])
    np.testing.assert_array_equal(curves.positions, POINTS)
    np.testing.assert_array_equal(curves.widths, [5, 4, 3, 2, 1])
    np.testing.assert_array_equal(curves.opacities, [1, 0.75, 0.5, 0.25, 0])
    np.testing.assert_array_equal(curves.colours, POINTS / 16)


def test_the_header_speaks_for_arrays_that_are_not_there(tmp_path):
    points = np.arange(18, dtype="<f4").reshape(6, 3)
    curves = read(tmp_path / "a.hair", hair(2, 6, 2, points.tobytes(), segments=2))
    np.testing.assert_array_equal(curves.counts, [3, 3])
    np.testing.assert_array_equal(curves.positions, points)
    np.testing.assert_array_equal(curves.widths, [0.25] * 6)
    np.testing.assert_array_equal(curves.opacities, [0.5] * 6)
    np.testing.assert_array_equal(curves.colours, [[1, 0.5, 0]] * 6)


def test_damaged(tmp_path):
    path = tmp_path / "a.hair"
    assert_read_or_refused(read_curves, path, truncated(of_all_arrays()))
    assert_read_or_refused(read_curves, path, with_other_bytes(of_all_arrays(), count=1000))


NAN = float("nan")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"HAIL" + bytes(124), "not a .hair file"),
        (hair(0, 0, 2), "holds no curves"),
        (hair(1, 5, 1, struct.pack("<H", 4)), "holds no points"),
        (hair(1, 5, 2, POINTS.tobytes()), "1 strands of 0 segments have not 5 points"),
        (hair(5, 5, 2, POINTS.tobytes()), "curve 0 has 1 points, of 5; expected 2 or more"),
        (hair(2, 5, 3, struct.pack("<2H", 1, 1), POINTS.tobytes()), "have 4 points; the file has 5"),
        (hair(2, 5, 3, struct.pack("<2H", 4, 0), POINTS.tobytes()), "curve 1 has 1 points"),
        (hair(2, 5, 3, struct.pack("<2H", 65535, 1), POINTS.tobytes()), "curve 0 has 65,536 points, of 5"),
        (hair(1, 2**31, 2, segments=2**31 - 1), "2,147,483,648 points; from 0 to"),
        (hair(2**32 - 1, 5, 3), "8,589,934,650 bytes should follow; 0 do"),
        (hair(1, 1 << 26, 2, segments=(1 << 26) - 1), "805,306,368 bytes should follow; 0 do"),
        (hair(1, 5, 2, POINTS.tobytes(), segments=4, thickness=-1), "'width' of point 0 is -1.0"),
        (hair(1, 5, 2, POINTS.tobytes(), segments=4, thickness=NAN), "'width' of point 0 is nan"),
        (hair(1, 5, 2, POINTS.tobytes(), segments=4, transparency=NAN), "'opacity' of point 0 is nan"),
        (hair(1, 5, 2, POINTS.tobytes(), segments=4, colour=(0, NAN, 0)), "'colour' of point 0 is nan"),
    ],
)
def test_impossible_files(tmp_path, data, message):
    assert_refused(read_curves, tmp_path / "a.hair", data, message)


def test_the_announced_is_not_allocated(tmp_path):
    path = tmp_path / "a.hair"
    path.write_bytes(hair(1 << 25, 1 << 26, 2, segments=1))
    error, peak = peak_of(lambda: read_curves(path))
    assert "bytes should follow" in str(error)
    assert peak < 1 << 20


@pytest.mark.parametrize("name", ["a.abc", "a", "a.bgeo"])
def test_unknown_formats(tmp_path, name):
    with pytest.raises(VolumeError, match=r"not a known format of curves '.*'; known: \.hair "):
        read_curves(tmp_path / name)


@pytest.mark.parametrize("name", ["a.hair", "a.npz"])
def test_files_that_cannot_be_read(tmp_path, name):
    with pytest.raises(VolumeError, match="no such file"):
        read_curves(tmp_path / name)
    (tmp_path / name).touch()
    with pytest.raises(VolumeError, match=name):
        read_curves(tmp_path / name)
