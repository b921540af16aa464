"""Classic .bgeo files, written here byte by byte to the published layout."""

import gzip
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes
from memory import peak_of

from tfm_cl.files.points_io import read_points

PARTICLES = Path(
    os.environ.get("TFM_PARTICLES", Path(__file__).resolve().parents[4] / "shared" / "particles")
)


def header(points, attributes, *, version=5, magic=b"BgeoV"):
    return magic + struct.pack(">i", version) + struct.pack(">8i", points, 0, 0, 0, attributes, 0, 0, 0)


def attribute(name, numbers, kind, default=None):
    text = struct.pack(">H", len(name)) + name.encode() + struct.pack(">Hi", numbers, kind)
    return text + (b"\0" * 4 * numbers if default is None else default)


def words(*texts):
    """The strings that an attribute of indices chooses from."""
    return struct.pack(">i", len(texts)) + b"".join(struct.pack(">H", len(t)) + t.encode() for t in texts)


def two_points():
    """Two points with attributes of every type that is read."""
    data = header(2, 5)
    data += attribute("pscale", 1, 0) + attribute("Cd", 3, 5) + attribute("id", 1, 1)
    data += attribute("shop", 1, 4, words("smoke", "")) + attribute("v", 3, 5)
    data += struct.pack(">4f f 3f i i 3f", 1, 2, 3, 1, 0.5, 0.25, 0.5, 0.75, 7, 0, -1, -2, -3)
    data += struct.pack(">4f f 3f i i 3f", 4, 5, 6, 1, 1.5, 1, 0, 1, 8, 1, 9, 8, 7)
    return data + b"\0\xff"  # extra: what Houdini keeps behind the points


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_points_and_attributes(tmp_path, pack):
    path = tmp_path / "two.bgeo"
    path.write_bytes(pack(two_points()))
    points = read_points(path)
    np.testing.assert_array_equal(points.positions, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(points.radii, [0.5, 1.5])
    np.testing.assert_array_equal(points.colours, [[0.25, 0.5, 0.75], [1, 0, 1]])
    np.testing.assert_array_equal(points.velocities, [[-1, -2, -3], [9, 8, 7]])
    assert points.densities is None
    assert points.opacities is None


def test_whole_numbers_keep_their_values(tmp_path):
    path = tmp_path / "a.bgeo"
    path.write_bytes(header(1, 1) + attribute("density", 1, 1) + struct.pack(">4f i", 0, 0, 0, 1, -3))
    np.testing.assert_array_equal(read_points(path).densities, [-3])


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_truncated(tmp_path, pack):
    whole = pack(two_points()[:-2])
    assert_read_or_refused(read_points, tmp_path / "a.bgeo", truncated(whole))


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_with_other_bytes(tmp_path, pack):
    assert_read_or_refused(read_points, tmp_path / "a.bgeo", with_other_bytes(pack(two_points())))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (header(2, 0, magic=b"NSJb\x07"), "not a classic .bgeo file"),
        (header(2, 0, version=12), "version 12; expected 5"),
        (header(-1, 0), "-1 points; from 0 to"),
        (header(2**31 - 1, 0), "2,147,483,647 points; from 0 to"),
        (header(2, -1), "-1 attributes"),
        (header(2, 2**31 - 1), "2147483647 attributes"),
        (header(2, 1) + attribute("a", 0, 0), "'a' has 0 numbers"),
        (header(2, 1) + attribute("a", 65535, 0), "'a' has 65535 numbers"),
        (header(2, 1) + attribute("a", 1, 2), "of type 2"),
        (header(2, 1) + attribute("a", 1, 4, struct.pack(">i", -1)), "'a' has -1 strings"),
        (header(2, 1) + attribute("a", 1, 4, struct.pack(">i", 2**31 - 1)), "strings"),
        (header(0, 0), "holds no points"),
        (header(1 << 26, 0), "67,108,864 points should take 1,073,741,824 bytes; there are fewer"),
        (gzip.compress(header(1 << 26, 0), mtime=0), "there are fewer"),
        (header(1, 0) + struct.pack(">4f", 0, float("nan"), 0, 1), "'positions' of point 0 is nan"),
    ],
)
def test_impossible_files(tmp_path, data, message):
    assert_refused(read_points, tmp_path / "a.bgeo", data, message)


def test_the_announced_is_not_allocated(tmp_path):
    path = tmp_path / "a.bgeo"
    path.write_bytes(gzip.compress(header(1 << 26, 200) + attribute("a", 64, 0) * 200))

    error, peak = peak_of(lambda: read_points(path))
    assert "there are fewer" in str(error)
    assert peak < 1 << 22


def test_a_stream_that_goes_on_is_left_alone(tmp_path):
    """What follows the points, however much it expands to, is not unpacked."""
    path = tmp_path / "a.bgeo"
    packer = zlib.compressobj(wbits=31)
    data = packer.compress(header(1, 0) + struct.pack(">4f", 1, 2, 3, 1))
    data += b"".join(packer.compress(bytes(1 << 20)) for _ in range(64)) + packer.flush()
    path.write_bytes(data)
    points, peak = peak_of(lambda: read_points(path))
    np.testing.assert_array_equal(points.positions, [[1, 2, 3]])
    assert peak < 1 << 23


def test_a_real_dump():
    path = PARTICLES / "dam_break_6859.bgeo"
    if not path.exists():
        pytest.skip(f"{path.name} is not in {PARTICLES} (set TFM_PARTICLES)")
    points = read_points(path)
    assert points.positions.shape == (6859, 3)
    assert points.velocities.shape == (6859, 3)
    # Water, that has fallen by a metre or two; its density is 1000 inside and less where particles end.
    assert np.abs(points.positions).max() < 3
    assert np.linalg.norm(points.velocities, axis=1).max() < 10
    assert 950 < points.densities.max() < 1100
    assert points.densities.min() > 0
    assert points.radii is None
