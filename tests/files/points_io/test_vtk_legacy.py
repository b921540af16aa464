"""Legacy VTK files, written here byte by byte to VTK's description of them."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes

from tfm_cl.files.points_io import read_points

PARTICLES = Path(
    os.environ.get("TFM_PARTICLES", Path(__file__).resolve().parents[4] / "shared" / "particles")
)


def vtk(form, *sections, version="3.0"):
    return b"# vtk DataFile Version %s\nby hand\n%s\n" % (version.encode(), form.encode()) + b"".join(
        sections
    )


def section(form, line, kind, *numbers):
    """A line of words and the array after it."""
    if form == "ASCII":
        return line.encode() + b"\n" + " ".join(map(str, numbers)).encode() + b"\n"
    return line.encode() + b"\n" + struct.pack(f">{len(numbers)}{kind}", *numbers) + b"\n"


def two_points(form, *, dataset="POLYDATA", version="3.0"):
    cells = {
        ("POLYDATA", "3.0"): [section(form, "VERTICES 2 4", "i", 1, 0, 1, 1)],
        ("UNSTRUCTURED_GRID", "3.0"): [
            section(form, "CELLS 2 4", "i", 1, 0, 1, 1),
            section(form, "CELL_TYPES 2", "i", 1, 1),
        ],
        ("UNSTRUCTURED_GRID", "5.1"): [
            b"CELLS 3 2\n",
            section(form, "OFFSETS vtktypeint64", "q", 0, 1, 2),
            section(form, "CONNECTIVITY vtktypeint64", "q", 0, 1),
            section(form, "CELL_TYPES 2", "i", 1, 1),
        ],
    }
    colours = (1, 0, 0.5, 0, 0, 1) if form == "ASCII" else (255, 0, 51, 0, 0, 255)
    return vtk(
        form,
        b"DATASET %s\n" % dataset.encode(),
        section(form, "FIELD FieldData 1\nTIME 1 1 double", "d", 0.5),
        section(form, "POINTS 2 float", "f", 1, 2, 3, 4, 5, 6),
        *cells[dataset, version],
        b"CELL_DATA 2\n",
        section(form, "SCALARS opacity float\nLOOKUP_TABLE default", "f", 9, 9),
        b"POINT_DATA 2\n",
        section(form, "SCALARS radius double 1\nLOOKUP_TABLE mine", "d", 0.5, 1.5),
        section(form, "LOOKUP_TABLE mine 1", *(("f", 0, 0, 0, 1) if form == "ASCII" else ("B", 1, 2, 3, 4))),
        section(form, "VECTORS velocity float", "f", 1, 0, 0, 0, 2, 0),
        section(form, "NORMALS n float", "f", 1, 0, 0, 0, 1, 0),
        b"METADATA\nINFORMATION 0\n\n",
        section(form, "COLOR_SCALARS Cd 3", "B", *colours),
        b"FIELD more 2\n",
        section(form, "density 1 2 unsigned_short", "H", 7, 8),
        b"METADATA\nCOMPONENT_NAMES\nx\n\n",
        section(form, "ids 1 2 vtkIdType", "i", 3, 4),
        version=version,
    )


DATASETS = [("POLYDATA", "3.0"), ("UNSTRUCTURED_GRID", "3.0"), ("UNSTRUCTURED_GRID", "5.1")]


@pytest.mark.parametrize(("dataset", "version"), DATASETS)
@pytest.mark.parametrize("form", ["ASCII", "BINARY"])
def test_points_and_attributes(tmp_path, form, dataset, version):
    path = tmp_path / "a.vtk"
    path.write_bytes(two_points(form, dataset=dataset, version=version))
    points = read_points(path)
    np.testing.assert_array_equal(points.positions, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(points.radii, [0.5, 1.5])
    np.testing.assert_array_equal(points.velocities, [[1, 0, 0], [0, 2, 0]])
    expected = [[1, 0, 0.5 if form == "ASCII" else 0.2], [0, 0, 1]]
    np.testing.assert_allclose(points.colours, expected, rtol=1e-6)
    assert points.opacities is None  # those are of cells


def test_text_of_whole_numbers_is_levels_too(tmp_path):
    data = vtk(
        "ASCII",
        b"DATASET POLYDATA\nPOINTS 1 float\n1 2 3\nPOINT_DATA 1\n",
        b"VECTORS Cd unsigned_char\n255 0 51\n",
    )
    (tmp_path / "a.vtk").write_bytes(data)
    np.testing.assert_allclose(read_points(tmp_path / "a.vtk").colours, [[1, 0, 0.2]], rtol=1e-6)


@pytest.mark.parametrize("form", ["ASCII", "BINARY"])
def test_damaged(tmp_path, form):
    path, data = tmp_path / "a.vtk", two_points(form, dataset="UNSTRUCTURED_GRID", version="5.1")
    assert_read_or_refused(read_points, path, truncated(data))
    assert_read_or_refused(read_points, path, with_other_bytes(data, count=1000))


POLYDATA = b"DATASET POLYDATA\n"
POINT = POLYDATA + b"POINTS 1 float\n1 2 3\n"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"<VTKFile/>", "not a legacy .vtk file"),
        (vtk("TEXT"), "its third line is 'TEXT', not ASCII or BINARY"),
        (vtk("ASCII", b"DATASET STRUCTURED_POINTS\nDIMENSIONS 9 9 9\n"), "holds no section POINTS"),
        (vtk("ASCII", POLYDATA, b"POINTS 2147483648 float\n"), "2,147,483,648 points; from 0 to"),
        (vtk("BINARY", POLYDATA, b"POINTS 67108864 float\n"), "should take 805,306,368 bytes; 0 are left"),
        (vtk("ASCII", POLYDATA, b"POINTS -1 float\n"), "not '-1'"),
        (vtk("ASCII", POLYDATA, b"POINTS 1 string\na\n"), "of type 'string'"),
        (vtk("ASCII", POLYDATA, b"POINTS 0 float\n"), "holds no points"),
        (vtk("ASCII", POLYDATA, b"POINTS 1 float\n1 2 x\n"), "could not convert"),
        (vtk("ASCII", POLYDATA, b"POINTS 1 float\n1 2 inf\n"), "'positions' of point 0 is inf"),
        (vtk("ASCII", POINT, b"VERTICES 1 99999999999\n1 0\n"), "the cells should be 99,999,999,999 numbers"),
        (vtk("ASCII", POINT, b"POINT_DATA 2\nSCALARS radius float\nLOOKUP_TABLE a\n1 2\n"), "'radius' is 2"),
        (vtk("ASCII", POINT, b"POINT_DATA 1\nSCALARS radius float 3\nLOOKUP_TABLE a\n1 2 3\n"), "is 1×3"),
        (vtk("ASCII", POINT, b"POINT_DATA 1\nSCALARS radius float\n1\n"), "the LOOKUP_TABLE of 'radius'"),
        (vtk("ASCII", POINT, b"POINT_DATA 1\nSCALARS a float 99999\nLOOKUP_TABLE b\n"), "99,999 numbers a"),
        (vtk("ASCII", POINT, b"FIELD a 999999999999\n"), "an array begins with ''"),
        (vtk("ASCII", POINT, b"1 2 3\n"), "a section begins with '1 2 3'"),
        (vtk("ASCII", POINT, b"POINT_DATA 1\nCOLOR_SCALARS Cd 4\n1 1 1 1\n"), "'Cd' is 1×4; expected 1×3"),
        (
            vtk("ASCII", POINT, b"CELLS 1 1\nOFFSETS int\n0\nWHAT\n", version="5.1"),
            "CONNECTIVITY of",
        ),
    ],
)
def test_impossible_files(tmp_path, data, message):
    assert_refused(read_points, tmp_path / "a.vtk", data, message)


def test_a_real_dump():
    path = PARTICLES / "cube_2366.vtk"
    if not path.exists():
        pytest.skip(f"{path.name} is not in {PARTICLES} (set TFM_PARTICLES)")
    points = read_points(path)
    assert points.positions.shape == (2366, 3)
    # A cube of particles on a lattice of 0.1 or so, and nothing else is said of them.
    assert (np.ptp(points.positions, axis=0) < 1.5).all()
    assert len(np.unique(points.positions, axis=0)) == 2366
    assert points.radii is None
