"""VTK's XML files, written here byte by byte to VTK's description of them."""

import base64
import struct
import zlib

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes
from memory import peak_of

from tfm_cl.files.points_io import read_points

POSITIONS = np.float32([[1, 2, 3], [4, 5, 6]])
RADII = np.array([0.5, 1.5])
COLOURS = np.uint8([[255, 0, 51], [0, 0, 255]])
TYPES = {"f4": "Float32", "f8": "Float64", "u1": "UInt8"}
LAYOUTS = ["ascii", "inline", "inline alone", "base64", "raw", "inline zlib", "base64 zlib", "raw zlib"]


def packed(plain, order, header, layout):
    """Header and bytes of an array, as they are in a file."""
    if "zlib" not in layout:
        head = struct.pack(order + header, len(plain))
        if "raw" in layout:
            return head + plain
        if "alone" in layout:
            return base64.b64encode(head) + base64.b64encode(plain)
        return base64.b64encode(head + plain)
    size = 8  # of a block: several, and often a shorter one
    blocks = [plain[at : at + size] for at in range(0, len(plain), size)]
    small = [zlib.compress(block) for block in blocks]
    numbers = [len(blocks), size, len(plain) % size, *map(len, small)]
    head, data = struct.pack(f"{order}{len(numbers)}{header}", *numbers), b"".join(small)
    return head + data if "raw" in layout else base64.b64encode(head) + base64.b64encode(data)


def two_points(layout, *, kind="UnstructuredGrid", order="<", header="I", pieces=1, extra=b""):
    appended, body = b"", b""
    for piece in range(pieces):
        arrays = []
        for name, values in (("Points", POSITIONS + 10 * piece), ("radius", RADII), ("Cd", COLOURS)):
            numbers = values.reshape(2, -1)
            plain = values.astype(values.dtype.newbyteorder(order)).tobytes()
            tag = f'<DataArray Name="{name}" type="{TYPES[values.dtype.str[1:]]}" '
            tag += f'NumberOfComponents="{numbers.shape[1]}" '
            if layout == "ascii":
                arrays.append(f'{tag} format="ascii">\n{" ".join(map(str, values.ravel()))}\n</DataArray>')
            elif "inline" in layout:
                text = packed(plain, order, header, layout).decode()
                arrays.append(f'{tag} format="binary">\n {text}\n</DataArray>')
            else:
                arrays.append(f'{tag} format="appended" offset="{len(appended)}"/>')
                appended += packed(plain, order, header, layout)
        points, *others = (array.encode() for array in arrays)
        body += b'<Piece NumberOfPoints="2" NumberOfCells="0"><PointData>%s%s</PointData>' % (
            b"".join(others),
            extra,
        )
        body += b"<Points>%s</Points><Cells></Cells></Piece>" % points
    root = f'<VTKFile type="{kind}" version="1.0" byte_order="{"Little" if order == "<" else "Big"}Endian"'
    root += f' header_type="{"UInt32" if header == "I" else "UInt64"}"'
    root += ' compressor="vtkZLibDataCompressor">' if "zlib" in layout else ">"
    data = b'<?xml version="1.0"?>\n%s\n<%s>%s</%s>\n' % (root.encode(), kind.encode(), body, kind.encode())
    if appended:
        encoding = b"raw" if "raw" in layout else b"base64"
        data += b'<AppendedData encoding="%s">\n_%s\n</AppendedData>\n' % (encoding, appended)
    return data + b"</VTKFile>\n"


@pytest.mark.parametrize(("order", "header"), [("<", "I"), ("<", "Q"), (">", "I"), (">", "Q")])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_points_and_attributes(tmp_path, layout, order, header):
    path = tmp_path / "a.vtu"
    path.write_bytes(two_points(layout, order=order, header=header))
    points = read_points(path)
    np.testing.assert_array_equal(points.positions, POSITIONS)
    np.testing.assert_array_equal(points.radii, RADII)
    np.testing.assert_allclose(points.colours, COLOURS / 255, rtol=1e-6)
    assert points.densities is None


def test_poly_data(tmp_path):
    (tmp_path / "a.vtp").write_bytes(two_points("ascii", kind="PolyData"))
    np.testing.assert_array_equal(read_points(tmp_path / "a.vtp").positions, POSITIONS)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_pieces_are_joined(tmp_path, layout):
    (tmp_path / "a.vtu").write_bytes(two_points(layout, pieces=2))
    points = read_points(tmp_path / "a.vtu")
    np.testing.assert_array_equal(points.positions, np.concatenate([POSITIONS, POSITIONS + 10]))
    np.testing.assert_array_equal(points.radii, [0.5, 1.5, 0.5, 1.5])


def test_what_is_not_used_is_not_read(tmp_path):
    """Not even where it is damaged: many such arrays might lead to the same bytes."""
    wrong = b'<DataArray Name="pressure" type="Float32" format="appended" offset="99999"/>'
    (tmp_path / "a.vtu").write_bytes(two_points("raw", extra=wrong))
    np.testing.assert_array_equal(read_points(tmp_path / "a.vtu").radii, RADII)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_damaged(tmp_path, layout):
    path, data = tmp_path / "a.vtu", two_points(layout)
    assert_read_or_refused(read_points, path, truncated(data, every=3))
    assert_read_or_refused(read_points, path, with_other_bytes(data, count=1000))


def changed(layout, old, new, **options):
    data = two_points(layout, **options)
    assert old in data
    return data.replace(old, new)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"# vtk DataFile", "not readable as XML"),
        (b"<VTKFile type='ImageData'/>", "not a VTK file of UnstructuredGrid or PolyData"),
        (b"<VTKFile type='PolyData'/>", "holds no piece with points"),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><VTKFile type='PolyData'/>", "has a DOCTYPE"),
        (b"<VTKFile type='PolyData'>" + b"<a/>" * 1_000_001 + b"</VTKFile>", "tags of XML; up to 1,000,000"),
        (
            changed("raw zlib", b"vtkZLib", b"vtkLZ4"),
            "compressed by 'vtkLZ4DataCompressor'; save it with zlib",
        ),
        (changed("raw", b"LittleEndian", b"PDP"), "byte_order is 'PDP'"),
        (changed("raw", b"UInt32", b"UInt16"), "header_type is 'UInt16'"),
        (changed("raw", b"Float64", b"String"), "'radius' is of type 'String'"),
        (changed("raw", b'Points="2"', b'Points="-2"'), "NumberOfPoints should be a whole number, not '-2'"),
        (changed("raw", b'Points="2"', b'Points="2147483648"'), "2,147,483,648 points; from 0 to"),
        (changed("raw", b'Points="2"', b'Points="67108864"'), "damaged or incomplete"),
        (changed("ascii", b'Points="2"', b'Points="67108864"'), "there are fewer"),
        (changed("raw", b'Points="2"', b'Points="0"'), "holds no piece with points"),
        (changed("raw", b'NumberOfComponents="3"', b'NumberOfComponents="9999"'), "9,999 numbers a point"),
        (changed("raw", b'offset="0"', b'offset="9999999"'), "should take"),
        (changed("raw", b'format="appended"', b'format="magic"'), "the format 'magic'"),
        (
            changed("raw", b"<Points>", b"<Nothing>").replace(b"</Points>", b"</Nothing>"),
            "0 arrays of points",
        ),
        (changed("ascii", b"1.0 2.0", b"1.0 nan"), "'positions' of point 0 is nan"),
        (changed("ascii", b"255 0 51", b"256 0 51"), "beyond its type"),
        (changed("inline", b"<PointData>", b"<PointData><DataArray Name='radius'/>"), "of type ''"),
        (changed("raw", b'Name="Cd"', b'Name="radius"'), "two arrays 'radius'"),
        (changed("inline", b"AAAA", b"AA A"), "damaged or incomplete"),
        (changed("inline", b"AAAA", b"A?AA"), "not base64"),
        (
            changed("ascii", b'Name="radius"', b'Name="width"', pieces=2).replace(b"width", b"radius", 1),
            "do not have the same attributes",
        ),
    ],
)
def test_impossible_files(tmp_path, data, message):
    assert_refused(read_points, tmp_path / "a.vtu", data, message)


def test_blocks_that_expand_to_more_than_they_say(tmp_path):
    """A block of zeros of 64 MiB where 24 bytes are announced."""
    small = zlib.compress(bytes(1 << 26))
    head = struct.pack("<4I", 1, 24, 0, len(small))
    points = base64.b64encode(head) + base64.b64encode(small)
    data = (
        b"""<VTKFile type="PolyData" compressor="vtkZLibDataCompressor"><PolyData>
        <Piece NumberOfPoints="2"><Points><DataArray type="Float32"
        NumberOfComponents="3" format="binary">%s</DataArray></Points>
        </Piece></PolyData></VTKFile>"""
        % points
    )
    path = tmp_path / "a.vtp"
    path.write_bytes(data)
    error, peak = peak_of(lambda: read_points(path))
    assert "a zlib block should hold 24 bytes" in str(error)
    assert peak < 1 << 21
