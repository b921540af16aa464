"""PLY files, written here byte by byte to the format's description."""

import struct

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes
from memory import peak_of

from tfm_cl.files.points_io import read_points

PROPERTIES = b"""\
property float x
property double y
property float z
property uchar red
property uchar green
property uint8 blue
property float32 pscale
property int id
"""
ROWS = [(1, 2, 3, 0, 51, 255, 0.5, 7), (4, 5, 6, 102, 204, 153, 1.5, -8)]
FORMATS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}


def ply(form, elements, data):
    return b"ply\nformat %s 1.0\ncomment by hand\n%send_header\n%s" % (form.encode(), elements, data)


def rows(form):
    if FORMATS[form] is None:
        return "".join(" ".join(map(str, row)) + "\n" for row in ROWS).encode()
    return b"".join(struct.pack(FORMATS[form] + "fdf3Bfi", *row) for row in ROWS)


def two_points(form, *, before=(b"", b""), after=(b"", b"")):
    elements = before[0] + b"element vertex 2\n" + PROPERTIES + after[0]
    return ply(form, elements, before[1] + rows(form) + after[1])


def assert_two_points(points):
    np.testing.assert_array_equal(points.positions, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(points.radii, [0.5, 1.5])
    np.testing.assert_allclose(points.colours, [[0, 0.2, 1], [0.4, 0.8, 0.6]], rtol=1e-6)
    assert points.opacities is None


@pytest.mark.parametrize("newline", [b"\n", b"\r\n"])
@pytest.mark.parametrize("form", FORMATS)
def test_points_and_properties(tmp_path, form, newline):
    path, data = tmp_path / "a.ply", two_points(form)
    header = data[: -len(rows(form))]
    path.write_bytes(header.replace(b"\n", newline) + rows(form))
    assert_two_points(read_points(path))


@pytest.mark.parametrize("form", FORMATS)
def test_faces_are_left_alone(tmp_path, form):
    """Also polygons of several sizes, and whatever is wrong with them."""
    path = tmp_path / "a.ply"
    faces = b"element face 2\nproperty list uchar int vertex_indices\n"
    path.write_bytes(two_points(form, after=(faces, b"\x03garbage")))
    assert_two_points(read_points(path))


@pytest.mark.parametrize("form", FORMATS)
def test_an_element_before_the_points(tmp_path, form):
    before = b"7 0.5\n" if FORMATS[form] is None else struct.pack(FORMATS[form] + "if", 7, 0.5)
    camera = b"element camera 1\nproperty int kind\nproperty float fov\n"
    (tmp_path / "a.ply").write_bytes(two_points(form, before=(camera, before)))
    assert_two_points(read_points(tmp_path / "a.ply"))


@pytest.mark.parametrize("form", FORMATS)
def test_damaged(tmp_path, form):
    path, data = tmp_path / "a.ply", two_points(form)
    assert_read_or_refused(read_points, path, truncated(data.rstrip(b"\n")))
    assert_read_or_refused(read_points, path, with_other_bytes(data))


XYZ = b"property float x\nproperty float y\nproperty float z\n"
BINARY = "binary_little_endian"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"solid\n", "not a .ply file"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\n", "the header has a line ''"),
        (b"ply\nformat text 1.0\n", "the header has a line 'format text 1.0'"),
        (b"ply\nend_header\n", "a line 'end_header'"),
        (b"ply\nproperty float x\n", "a line 'property float x'"),
        (b"ply\nformat ascii 1.0\n" + b"comment\n" * 20_000, "more than 10000 lines"),
        (b"ply\n" + b"x" * 10_000, "a line of words should be here"),
        (ply("ascii", b"element face 0\n", b""), "no element 'vertex'"),
        (ply("ascii", b"element vertex -1\n" + XYZ, b""), "whole number of 0 or more, not '-1'"),
        (ply("ascii", b"element vertex 1e3\n" + XYZ, b""), "not '1e3'"),
        (ply("ascii", b"element vertex " + b"9" * 4000 + b"\n", b""), "not '9999"),
        (ply(BINARY, b"element vertex 2147483648\n" + XYZ, b""), "2,147,483,648 points; from 0 to"),
        (ply(BINARY, b"element vertex 67108864\n" + XYZ, b""), "should take 805,306,368 bytes; 0 are left"),
        (ply("ascii", b"element vertex 67108864\n" + XYZ, b"0 0 0"), "there are fewer"),
        (ply("ascii", b"element vertex 0\n" + XYZ, b""), "holds no points"),
        (ply("ascii", b"element vertex 1\n" + XYZ, b"1 2 three\n"), "could not convert"),
        (ply("ascii", b"element vertex 1\n" + XYZ, b"1 2 nan\n"), "'positions' of point 0 is nan"),
        (
            ply("ascii", b"element vertex 1\n" + XYZ + b"property uchar red\n", b"1 2 3 256"),
            "beyond its type",
        ),
        (ply("ascii", b"element vertex 1\nproperty float x\n", b"1\n"), "its vertices have no y, z"),
        (ply("ascii", b"element vertex 1\n" + XYZ + XYZ, b"1 2 3 4 5 6"), "the same name"),
        (
            ply(BINARY, b"element f 9\nproperty list uchar int i\nelement vertex 1\n" + XYZ, b"\0" * 99),
            "'f' has lists of numbers",
        ),
        (
            ply(BINARY, b"element a 999999999999\nproperty int d\nelement vertex 1\n", b""),
            "should take",
        ),
    ],
)
def test_impossible_files(tmp_path, data, message):
    assert_refused(read_points, tmp_path / "a.ply", data, message)


def test_memory_is_that_of_what_is_used(tmp_path):
    path, count = tmp_path / "a.ply", 100_000
    rest = b"".join(b"property double a%d\n" % index for index in range(50))
    path.write_bytes(ply(BINARY, b"element vertex %d\n" % count + XYZ + rest, bytes(count * (12 + 50 * 8))))
    points, peak = peak_of(lambda: read_points(path))
    assert len(points.positions) == count
    assert peak < 40 * count
