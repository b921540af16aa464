import bz2
import gzip
import tracemalloc
import warnings

import nrrd
import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import choose_grid, open_grids, read_grid
from tfm_cl.scene.bodies.volume import Volume

SHAPE = (2, 3, 4)
FIELDS = {"type": "float", "dimension": 3, "sizes": "4 3 2", "endian": "little", "encoding": "raw"}


@pytest.fixture
def data():
    return np.random.default_rng(4).random(SHAPE, np.float32)


def load(path):
    return read_grid(path, choose_grid(path))


def write(folder, payload=b"", name="smoke.nrrd", **fields):
    """Write a file by hand; a field of None is left out, ``_`` stands for a blank."""
    merged = {key.replace("_", " "): value for key, value in (FIELDS | fields).items() if value is not None}
    header = "NRRD0005\n# by hand\n" + "".join(f"{key}: {value}\n" for key, value in merged.items()) + "\n"
    path = folder / name
    path.write_bytes(header.encode() + payload)
    return path


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ASCII"])
@pytest.mark.parametrize("dtype", ["i1", "u1", "<i2", ">u2", "<i4", ">u4", ">i8", "<u8", ">f4", "<f8"])
def test_reads_what_pynrrd_writes(tmp_path, dtype, encoding):
    data = np.arange(24).reshape(SHAPE).astype(dtype)
    path = tmp_path / "smoke.nrrd"
    nrrd.write(str(path), data, {"encoding": encoding}, index_order="C")
    voxels = load(path)
    assert voxels.dtype == np.float32
    assert voxels.flags.c_contiguous
    np.testing.assert_array_equal(voxels, np.arange(24).reshape(SHAPE))
    assert choose_grid(path).value_type == np.dtype(dtype).name


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2"])
@pytest.mark.parametrize("detached", [False, True])
def test_every_bit_of_float32_survives(tmp_path, encoding, detached):
    data = np.random.default_rng(0).integers(0, 2**32, SHAPE, np.uint32).view(np.float32)
    path = tmp_path / ("smoke.nhdr" if detached else "smoke.nrrd")
    nrrd.write(str(path), data, {"encoding": encoding}, detached_header=detached, index_order="C")
    assert len(list(tmp_path.iterdir())) == 1 + detached
    assert load(path).tobytes() == data.tobytes()


def test_x_varies_fastest(tmp_path):
    voxels = load(write(tmp_path, np.arange(24, dtype="<f4").tobytes()))
    assert voxels.shape == SHAPE
    assert (voxels[0, 0, 1], voxels[0, 1, 0], voxels[1, 0, 0]) == (1, 4, 12)


def test_windows_line_ends(tmp_path, data):
    path = write(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n") + data.tobytes())
    np.testing.assert_array_equal(load(path), data)


def test_no_placement_leaves_it_to_the_caller(tmp_path, data):
    (grid,) = open_grids(write(tmp_path, data.tobytes()))
    assert (grid.name, grid.shape, grid.has_transform) == ("density", SHAPE, False)
    np.testing.assert_array_equal(grid.world_from_index @ [0, 0, 0, 1], [0.5, 0.5, 0.5, 1])


def centre(path, *index):
    (grid,) = open_grids(path)
    assert grid.has_transform
    return (grid.world_from_index @ [*index, 1])[:3].tolist()


def test_space_origin_is_the_centre_of_the_first_voxel(tmp_path, data):
    path = write(
        tmp_path,
        data.tobytes(),
        space="left-posterior-superior",
        space_directions="(0,2,0) (3,0,0) (0,1,4)",
        space_origin="(10,20,30)",
    )
    assert centre(path, 0, 0, 0) == [10, 20, 30]
    assert centre(path, 1, 0, 0) == [10, 22, 30]
    assert centre(path, 0, 1, 0) == [13, 20, 30]
    assert centre(path, 0, 0, 1) == [10, 21, 34]


@pytest.mark.parametrize(
    ("fields", "first", "last"),
    [
        ({"space_dimension": 3, "space_directions": "(2,0,0) (0,4,0) (0,0,6)"}, [1, 2, 3], [7, 10, 9]),
        ({"spacings": "2 4 6"}, [1, 2, 3], [7, 10, 9]),
        ({"spacings": "2 4 6", "axis_mins": "10 20 30"}, [11, 22, 33], [17, 30, 39]),
        (
            {"spacings": "2 4 6", "axis_mins": "10 20 30", "centers": "node node node"},
            [10, 20, 30],
            [16, 28, 36],
        ),
        ({"axis_mins": "0 0 0", "axis_maxs": "8 12 12"}, [1, 2, 3], [7, 10, 9]),
        ({"axis_mins": "1 2 3", "axis_maxs": "7 10 9", "centers": "node node node"}, [1, 2, 3], [7, 10, 9]),
        ({"axis_mins": "1 2 3"}, [1.5, 2.5, 3.5], [4.5, 4.5, 4.5]),
    ],
)
def test_other_placements(tmp_path, data, fields, first, last):
    path = write(tmp_path, data.tobytes(), **fields)
    assert centre(path, 0, 0, 0) == first
    assert centre(path, 3, 2, 1) == last


@pytest.mark.parametrize(
    ("fields", "extra"),
    [
        ({"byte_skip": 3}, b"abc"),
        ({"byte_skip": -1}, b"any length"),
        ({"line_skip": 2}, b"P5\n4 3\n"),
        ({"lineskip": 1, "byteskip": 1}, b"line\n-"),
    ],
)
def test_skips_in_raw_data(tmp_path, data, fields, extra):
    np.testing.assert_array_equal(load(write(tmp_path, extra + data.tobytes(), **fields)), data)


@pytest.mark.parametrize(("encoding", "compress"), [("gz", gzip.compress), ("bz2", bz2.compress)])
def test_skips_in_compressed_data(tmp_path, data, encoding, compress):
    """Lines are skipped before decompression, bytes after it."""
    payload = b"a line\n" + compress(b"xyz" + data.tobytes())
    path = write(tmp_path, payload, encoding=encoding, line_skip=1, byte_skip=3)
    np.testing.assert_array_equal(load(path), data)


def test_detached_data_beside_the_header(tmp_path, data):
    (tmp_path / "smoke.raw").write_bytes(data.tobytes())
    path = write(tmp_path, name="smoke.nhdr", data_file="./smoke.raw")
    np.testing.assert_array_equal(load(path), data)


@pytest.mark.parametrize("name", ["sub/smoke.raw", "./sub/deeper/smoke.raw", "smoke volume%20.raw"])
def test_detached_data_in_a_folder_below(tmp_path, data, name):
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_bytes(data.tobytes())
    path = write(tmp_path, name="smoke.nhdr", data_file=name)
    np.testing.assert_array_equal(load(path), data)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("/etc/passwd", "must lie beside the header or in a folder below"),
        ("../smoke.raw", "must lie beside"),
        ("sub/../../smoke.raw", "must lie beside"),
        ("..", "must lie beside"),
        ("sub/", "must lie beside"),
        ("..\\smoke.raw", "must lie beside"),
        ("C:smoke.raw", "must lie beside"),
        (".", "does not exist beside it"),
        ("sub", "does not exist beside it"),
        ("nothing.raw", "'nothing.raw' does not exist beside it"),
        ("smoke%03d.raw 0 1 1", "'smoke000.raw' does not exist beside it"),
        ("../smoke%03d.raw 0 1 1", "must lie beside"),
        ("LIST", "LIST and maybe a number, then names"),
        ("LIST\n/etc/passwd\n/etc/passwd", "must lie beside"),
    ],
)
def test_detached_data_elsewhere(tmp_path, data, name, message):
    folder = tmp_path / "folder"
    (folder / "sub").mkdir(parents=True)
    for place in (tmp_path, folder / "sub"):
        (place / "smoke.raw").write_bytes(data.tobytes())
    with pytest.raises(VolumeError, match=message):
        open_grids(write(folder, name="smoke.nhdr", data_file=name))


# ------------------------------------------------------------------------------------- several files


def encoded(array, encoding):
    if encoding == "ascii":
        return " ".join(map(str, array.ravel())).encode()
    plain = array.tobytes()
    codecs = {"raw": bytes, "gzip": gzip.compress, "bzip2": bz2.compress, "hex": lambda b: b.hex().encode()}
    return codecs[encoding](plain)


def split(folder, array, counts, encoding="raw", before=b""):
    """Write the array's parts along its slowest axes, one a file; returns their names."""
    parts = array.reshape(-1, *array.shape[counts:]) if counts else [array]
    (folder / "slices").mkdir(exist_ok=True)
    names = [f"slices/s{10 - 2 * number:02d}.bin" for number in range(len(parts))]
    for name, part in zip(names, parts, strict=True):
        (folder / name).write_bytes(before + encoded(part, encoding))
    return names


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ascii", "hex"])
@pytest.mark.parametrize("form", ["LIST", "pattern"])
def test_a_file_for_each_slice(tmp_path, data, form, encoding):
    names = split(tmp_path, data, 1, encoding)
    text = "LIST\n" + "\n".join(names) if form == "LIST" else "slices/s%02d.bin 10 8 -2"
    path = write(tmp_path, name="smoke.nhdr", encoding=encoding, data_file=text)
    np.testing.assert_array_equal(load(path), data)


@pytest.mark.parametrize(("within", "counts"), [(1, 2), (2, 1)])
def test_files_of_fewer_axes(tmp_path, data, within, counts):
    names = split(tmp_path, data, counts)
    path = write(tmp_path, name="smoke.nhdr", data_file=f"LIST {within}\n" + "\n".join(names))
    np.testing.assert_array_equal(load(path), data)


def test_files_of_all_axes_are_slabs(tmp_path):
    data = np.random.default_rng(1).random((6, 3, 4), np.float32)
    for number in range(2):
        (tmp_path / f"slab{number}.raw").write_bytes(data[3 * number : 3 * number + 3].tobytes())
    path = write(tmp_path, name="smoke.nhdr", sizes="4 3 6", data_file="slab%d.raw 0 1 1 3")
    np.testing.assert_array_equal(load(path), data)


@pytest.mark.parametrize("fields", [{"byte_skip": 5}, {"byte_skip": -1}, {"line_skip": 1}])
def test_skips_apply_to_every_file(tmp_path, data, fields):
    names = split(tmp_path, data, 1, before=b"head\n")
    path = write(tmp_path, name="smoke.nhdr", **fields, data_file="LIST\n" + "\n".join(names))
    np.testing.assert_array_equal(load(path), data)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("LIST\na.raw", r"in 1 files; for sizes \[4, 3, 2\] with 2 axes in each, that is 2"),
        ("LIST 1\na.raw\na.raw", "in 2 files; .* with 1 axes in each, that is 6"),
        ("LIST 3\na.raw\na.raw\na.raw", "a divisor of 2"),
        ("LIST 4\na.raw", "files have 4 axes; the array has 3"),
        ("LIST many\na.raw", "LIST and maybe a number"),
        ("a%d.raw 0 9 0", "never gets from 0 to 9 in steps of 0"),
        ("a%d.raw 0 9 -1", "never gets"),
        ("a%d.raw 0 999999999 1", "in 1,000,000,000 files"),
        ("LIST\na.raw\nb.raw", "b.raw: holds 47 bytes of data, too few for 4×3×2 voxels .*in 2 files"),
    ],
)
def test_files_that_are_not_the_array(tmp_path, text, message):
    (tmp_path / "a.raw").write_bytes(bytes(48))
    (tmp_path / "b.raw").write_bytes(bytes(47))
    with pytest.raises(VolumeError, match=message):
        open_grids(write(tmp_path, name="smoke.nhdr", data_file=text))


@pytest.mark.parametrize("encoding", ["gzip", "hex"])
def test_every_file_must_be_of_its_length(tmp_path, data, encoding):
    names = split(tmp_path, data, 1, encoding)
    path = write(tmp_path, name="a.nhdr", encoding=encoding, data_file="LIST\n" + "\n".join(names))
    first = tmp_path / names[0]
    first.write_bytes(encoded(np.zeros(13, np.float32), encoding))
    with pytest.raises(VolumeError, match=r"s10\.bin: holds more voxels"):
        load(path)
    if encoding == "gzip":
        first.write_bytes(encoded(np.zeros(11, np.float32), encoding))
        with pytest.raises(VolumeError, match=r"s10\.bin: its data end early"):
            load(path)


# ---------------------------------------------------------------------------- axes that are not space


def arranged(volumes, place):
    """Volumes [n, z, y, x] as an array whose axis ``place`` (0 is the fastest) runs over them."""
    return np.ascontiguousarray(np.moveaxis(volumes, 0, 3 - place))


def write_axes(folder, array, kind, place, encoding="raw", **fields):
    kinds = ["space"] * 3
    kinds.insert(place, kind)
    sizes = " ".join(map(str, array.shape[::-1]))
    given = {"dimension": 4, "sizes": sizes, "encoding": encoding, "kinds": " ".join(kinds)} | fields
    return write(folder, encoded(array, encoding), **given)


@pytest.fixture
def volumes():
    return np.random.default_rng(8).random((3, *SHAPE), np.float32)


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("kind", ["list", "time", "vector", "3-vector", "complex-thing"])
def test_volumes_along_an_axis_are_chosen_by_number(tmp_path, volumes, kind, place, encoding):
    path = write_axes(tmp_path, arranged(volumes, place), kind, place, encoding)
    for number, volume in enumerate(volumes):
        np.testing.assert_array_equal(read_grid(path, choose_grid(path, f"density[{number}]")), volume)
    for name in (None, "density"):
        with pytest.raises(
            VolumeError,
            match=rf"axis {place}, of kind '{kind}', is not space: it holds 3 volumes; .*'density\[2\]'",
        ):
            choose_grid(path, name)
    with pytest.raises(VolumeError, match=r"no grid named 'density\[3\]'"):
        choose_grid(path, "density[3]")


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ascii", "hex"])
@pytest.mark.parametrize("place", [0, 1, 3])
@pytest.mark.parametrize("kind", ["RGB-color", "3-color", "XYZ-color"])
def test_colours(tmp_path, volumes, kind, place, encoding):
    path = write_axes(tmp_path, arranged(volumes, place), kind, place, encoding)
    grid = choose_grid(path)
    assert (grid.name, grid.value_type, grid.shape) == ("colour", "3 × float32", SHAPE)
    np.testing.assert_array_equal(grid.read_colour(), np.moveaxis(volumes, 0, -1))
    np.testing.assert_array_equal(grid.read(), np.ones(SHAPE))
    np.testing.assert_array_equal(read_grid(path, choose_grid(path, "colour[1]")), volumes[1])


def test_a_colour_is_a_coloured_volume(tmp_path, volumes):
    volumes[:, 0, 0, 0] = 0
    volume = Volume.load(write_axes(tmp_path, arranged(volumes, 0), "RGB-color", 0))
    assert (volume.data[0, 0, 0], volume.data[0, 0, 1]) == (0, 1)
    np.testing.assert_array_equal(volume.colour, np.moveaxis(volumes, 0, -1))


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("kinds", [None, "stub", "list", "???", "space"])
def test_an_axis_of_one_sample_is_left_out(tmp_path, data, kinds, place):
    array = arranged(data[None], place)
    path = write_axes(tmp_path, array, kinds or "", place, kinds=None)
    if kinds:
        path = write_axes(tmp_path, array, kinds, place)
    np.testing.assert_array_equal(load(path), data)
    assert choose_grid(path).name == "density"


NONE_FIRST = "none (2,0,0) (0,3,0) (0,0,4)"


@pytest.mark.parametrize(
    ("fields", "first", "last"),
    [
        ({"space_directions": NONE_FIRST, "space_origin": "(10,20,30)"}, [10, 20, 30], [16, 26, 34]),
        ({"space_directions": "none  ( 2, 0, 0 ) (0,3,0)(0,0,4)"}, [1, 1.5, 2], [7, 7.5, 6]),
        ({"space_directions": "(nan,nan,nan) (2,0,0) (0,3,0) (0,0,4)"}, [1, 1.5, 2], [7, 7.5, 6]),
        ({"spacings": "NaN 2 3 4"}, [1, 1.5, 2], [7, 7.5, 6]),
        ({"spacings": "1 2 3 4", "kinds": "list domain domain domain"}, [1, 1.5, 2], [7, 7.5, 6]),
        ({"axis_mins": "nan 0 0 0", "axis_maxs": "nan 8 9 8"}, [1, 1.5, 2], [7, 7.5, 6]),
    ],
)
def test_places_beside_an_axis_that_is_not_space(tmp_path, volumes, fields, first, last):
    kinds = fields.get("kinds")
    if "axis_mins" in fields:
        kinds = "list space space space"
    path = write_axes(tmp_path, arranged(volumes, 0), "", 0, **(fields | {"kinds": kinds}))
    (grid,) = [grid for grid in open_grids(path) if grid.name == "density[1]"]
    assert grid.has_transform
    assert (grid.world_from_index @ [0, 0, 0, 1])[:3].tolist() == first
    assert (grid.world_from_index @ [3, 2, 1, 1])[:3].tolist() == last


def test_a_space_with_time(tmp_path, volumes):
    path = write_axes(
        tmp_path,
        arranged(volumes, 3),
        "",
        3,
        kinds=None,
        space="right-anterior-superior-time",
        space_directions="(2,0,0,0) (0,3,0,0) (0,0,4,0) (0,0,0,0.5)",
        space_origin="(10,20,30,1)",
    )
    grid = choose_grid(path, "density[2]")
    np.testing.assert_array_equal(grid.read(), volumes[2])
    assert (grid.world_from_index @ [1, 1, 1, 1])[:3].tolist() == [12, 23, 34]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kinds": "space space list"}, "2 axes of space, not 3"),
        ({"kinds": "RGB-color space space"}, "2 axes of space, not 3"),
        ({"space_directions": "none none (0,0,1)"}, "1 axes of space"),
        (
            {"dimension": 4, "sizes": "2 2 3 2"},
            "4 axes of space, not 3 .*; name those that are not in 'kinds', as 'list'",
        ),
        (
            {"dimension": 5, "sizes": "2 3 4 1 2", "kinds": "vector list space space space"},
            "axis 0, of kind 'vector', and axis 1, of kind 'list', are not space; save one volume",
        ),
        ({"dimension": 4, "sizes": "2000 1 1 1", "kinds": "list space space space"}, "the limit is 1,024"),
        ({"space_directions": "(1,0) (0,1) (1,1)", "space_dimension": 2}, "not in three dimensions"),
        ({"space_directions": "(1,0,0,1) (0,1,0,0) (0,0,1,0)"}, "not in three dimensions"),
    ],
)
def test_axes_that_are_no_volume_are_refused_by_name(tmp_path, fields, message):
    with pytest.raises(VolumeError, match=message) as caught:
        choose_grid(write(tmp_path, bytes(8000), **fields))
    assert "damaged" not in str(caught.value)


def test_fields_that_do_not_matter_here_are_passed_over(tmp_path, data):
    """All that the format allows beside what is needed, and as it allows to write it."""
    text = """NRRD0005
# a comment: with a colon
Type: float
dimension:3
sizes:   4   3  2
ENCODING: raw
endian: Little
content: smoke "unbalanced quote
number: 24
labels: "x" "y" "z
units: "mm" "mm" "mm"
space units: "mm" "mm" "mm"
sample units: kg/m^3
thicknesses: nan nan 2
old min: 0
oldmax: 1
min: 0
block size: 8
measurement frame: (1,0,0) (0,1,0) (0,0,1)
measurement frame: none
centerings: cell cell cell
space: left-posterior-superior
space directions: (1,0,0) (0,1,0) (0,0,1)
key with a : colon:=value
DWMRI_b-value:=1000
DWMRI_b-value:=1000
naïve:=ü

"""
    path = tmp_path / "a.nrrd"
    path.write_bytes(text.encode() + data.tobytes())
    np.testing.assert_array_equal(load(path), data)
    path.write_bytes(b"\xef\xbb\xbf" + text.encode() + data.tobytes())  # a byte order mark
    np.testing.assert_array_equal(load(path), data)
    path.write_bytes(text.encode().replace(b"\n", b"\r\n") + data.tobytes())
    np.testing.assert_array_equal(load(path), data)


@pytest.mark.parametrize("magic", ["NRRD0006", "NRRD0010", "NRRD9999"])
def test_newer_versions(tmp_path, magic):
    path = write(tmp_path, bytes(96))
    path.write_bytes(path.read_bytes().replace(b"NRRD0005", magic.encode()))
    with pytest.raises(VolumeError, match=f"NRRD version {int(magic[4:])}; .*newer.*update tfm_cl, or save"):
        open_grids(path)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"sizes": "4 3 3"}, "96 bytes of data, too few for 4×3×3"),
        ({"sizes": "1000000000 1000000000 1000000000"}, "too few"),
        ({"sizes": "1e99 1 1"}, "do not fit"),
        ({"sizes": "nan 1 1"}, "do not fit"),
        ({"sizes": "4 3 0"}, "do not fit"),
        ({"sizes": "4 3"}, "do not fit"),
        ({"sizes": "4 three 2"}, "damaged NRRD header"),
        ({"sizes": None}, "'sizes' is missing"),
        ({"type": None}, "'type' is missing"),
        ({"dimension": "many"}, "damaged NRRD header"),
        ({"dimension": 2, "sizes": "4 6"}, "2 axes"),
        ({"type": "block"}, "values of type 'block'"),
        ({"encoding": "zstd"}, "encoding 'zstd'; known: ascii bzip2 gzip hex raw"),
        ({"endian": None}, "endian"),
        ({"endian": "middle"}, "endian"),
        ({"byte_skip": -2}, "byte skip"),
        ({"byte_skip": 10**30}, "byte skip"),
        ({"byte_skip": 1}, "too few"),
        ({"line_skip": 10**17}, "lines to skip"),
        ({"line_skip": 10**18}, "line skip is a whole number"),
        ({"line_skip": -1}, "line skip is ≥ 0"),
        ({"data_file": "%d " * 100_000}, "data file is a name; got 299,999 characters"),
        ({"spacings": "1 1"}, "spacings is a number for each axis"),
        ({"spacings": "1 1 one"}, "spacings is a number for each axis"),
        ({"spacings": "1 1 inf"}, "spacings must be finite"),
        ({"axis_mins": "1 1 nan", "axis_maxs": "2 2 2"}, "axis mins must be finite"),
        ({"kinds": "space space"}, "kinds is a word for each axis"),
        ({"space_directions": "(1,0,0) (0,1) (0,0,1)"}, "finite vectors"),
        ({"space_directions": "(1,0,0) (0,1,nan) (0,0,1)"}, "finite vectors"),
        ({"space_directions": "(1,0,0) (0,1,0)"}, "a vector or 'none' for each axis"),
        ({"space_directions": "1 0 0"}, "damaged NRRD header"),
        ({"space_directions": "(1,0,0) (0,1,0) (0,0,1)", "space_origin": "(1,2)"}, "is one vector"),
        ({"Sizes": "4 3 2"}, "'sizes' is there twice"),
    ],
)
def test_wrong_headers(tmp_path, fields, message):
    with pytest.raises(VolumeError, match=message):
        choose_grid(write(tmp_path, bytes(96), **fields))


@pytest.mark.parametrize(
    "content", [b"", b"\n", b"hello\n\n", b"NRRD0005", b"NRRD0009\n\n", b"NRRD0005\nno colon\n\n"]
)
def test_not_a_nrrd_file(tmp_path, content):
    (tmp_path / "a.nrrd").write_bytes(content)
    with pytest.raises(VolumeError, match="NRRD"):
        open_grids(tmp_path / "a.nrrd")


def test_endless_header(tmp_path):
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0005\n" + b"# x\n" * 300_000)
    with pytest.raises(VolumeError, match="within 1 MiB"):
        open_grids(tmp_path / "a.nrrd")


@pytest.mark.parametrize(("encoding", "compress"), [("gzip", gzip.compress), ("bzip2", bz2.compress)])
def test_compressed_length_must_be_the_declared_one(tmp_path, encoding, compress):
    with pytest.raises(VolumeError, match="end early"):
        load(write(tmp_path, compress(bytes(95)), encoding=encoding))
    with pytest.raises(VolumeError, match="more voxels"):
        load(write(tmp_path, compress(bytes(97)), encoding=encoding))
    with pytest.raises(VolumeError):
        load(write(tmp_path, compress(bytes(96))[:-3], encoding=encoding))


def test_checksum_of_gzip_is_checked(tmp_path, data):
    payload = bytearray(gzip.compress(data.tobytes()))
    payload[-6] ^= 1
    with pytest.raises(VolumeError, match="CRC"):
        load(write(tmp_path, payload, encoding="gzip"))


def peak_of(action):
    tracemalloc.start()
    with pytest.raises(VolumeError):
        action()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize("encoding", ["gzip", "bzip2"])
def test_a_small_file_cannot_declare_a_large_volume(tmp_path, encoding):
    compress = {"gzip": gzip.compress, "bzip2": bz2.compress}[encoding]
    path = write(tmp_path, compress(bytes(1000)), type="uchar", sizes="1000 1000 1000", encoding=encoding)
    assert peak_of(lambda: load(path)) < 32 << 20


def test_gzip_that_cannot_hold_the_volume_is_refused_unread(tmp_path):
    path = write(tmp_path, gzip.compress(bytes(1000)), type="uchar", sizes="1000 100 1", encoding="gzip")
    with pytest.raises(VolumeError, match="too few for 1000×100×1"):
        open_grids(path)


def test_memory_grows_with_what_is_read_only(tmp_path):
    payload = bz2.compress(bytes(3 << 20))  # three steps of reading, of a thousand declared
    path = write(tmp_path, payload, type="uchar", sizes="1024 1024 1024", encoding="bzip2")
    assert peak_of(lambda: load(path)) < 48 << 20


@pytest.mark.parametrize("encoding", ["gzip", "bzip2"])
def test_a_bomb_is_not_unpacked_beyond_the_declared_size(tmp_path, encoding):
    compress = {"gzip": gzip.compress, "bzip2": bz2.compress}[encoding]
    path = write(tmp_path, compress(bytes(60_000_000)), encoding=encoding)
    assert peak_of(lambda: load(path)) < 16 << 20


@pytest.mark.parametrize("text", ["1 2 3", "1 " * 25, "x " * 24, "1" * 10_000, "1,2 " * 24, "\0 " * 24])
def test_wrong_numbers_in_ascii(tmp_path, text):
    with pytest.raises(VolumeError):
        load(write(tmp_path, text.encode(), encoding="ascii"))


def test_ascii_across_the_blocks_it_is_read_in(tmp_path):
    values = np.random.default_rng(6).random(40_000).astype(np.float32)
    text = "\n".join(repr(float(v)) for v in values)
    path = write(tmp_path, text.encode(), encoding="text", sizes="100 40 10")
    np.testing.assert_array_equal(load(path).ravel(), values)


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ascii", "hex"])
def test_flips_and_truncations_never_raise_anything_else(tmp_path, data, encoding):
    path = write(
        tmp_path, encoded(data, encoding), encoding=encoding, spacings="1 1 1", byte_skip=0, line_skip=0
    )
    sound, rng, refused = path.read_bytes(), np.random.default_rng(9), 0
    tracemalloc.start()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for trial in range(200):
            damaged = bytearray(sound)
            for _ in range(1 + trial % 3):
                damaged[rng.integers(len(damaged))] = rng.integers(256)
            path.write_bytes(damaged[: rng.integers(len(damaged))] if trial % 4 == 0 else damaged)
            try:
                assert load(path).dtype == np.float32
            except VolumeError as error:
                refused += "\n" not in str(error)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert refused > 50
    assert peak < 32 << 20


@pytest.mark.parametrize(
    ("kind", "place", "encoding"), [("RGB-color", 0, "gzip"), ("list", 1, "raw"), ("RGB-color", 2, "hex")]
)
def test_damaged_axes_and_lists_never_raise_anything_else(tmp_path, volumes, kind, place, encoding):
    array = arranged(volumes, place)
    names = split(tmp_path, array, 1, encoding)
    directions = ["(1,0,0)", "(0,1,0)", "(0,0,1)"]
    directions.insert(place, "none")
    fields = {"space_directions": " ".join(directions), "spacings": "1 nan 1 1", "space": "scanner-xyz"}
    text = "LIST 3\n" + "\n".join(names)
    path = write_axes(tmp_path, array, kind, place, encoding, **fields, data_file=text)
    sound, rng, refused = path.read_bytes()[: -len(encoded(array, encoding))], np.random.default_rng(5), []
    path.write_bytes(sound)
    assert choose_grid(path, f"{'colour' if kind == 'RGB-color' else 'density'}[1]").read() is not None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for trial in range(150):
            damaged = bytearray(sound)
            for _ in range(1 + trial % 2):
                damaged[rng.integers(len(damaged))] = rng.choice(list(b"0123456789 ()\n:,-%x"))
            path.write_bytes(damaged[: rng.integers(len(damaged))] if trial % 5 == 0 else damaged)
            try:
                for grid in open_grids(path):
                    if not grid.unsupported:
                        grid.read()
                    if grid.read_colour is not None:
                        grid.read_colour()
            except VolumeError as error:
                refused.append(str(error))
    assert len(refused) > 40
    assert all("\n" not in message and len(message) < 500 for message in refused)
