import bz2
import gzip
import tracemalloc
import warnings

import nrrd
import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.volume_io import choose_grid, open_grids, read_grid

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


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("/etc/passwd", "plain name"),
        ("../smoke.raw", "plain name"),
        ("..", "plain name"),
        (".", "plain name"),
        ("sub/smoke.raw", "plain name"),
        ("..\\smoke.raw", "plain name"),
        ("C:smoke.raw", "plain name"),
        ("nothing.raw", "not beside it"),
        ("LIST", "several files"),
        ("smoke%03d.raw 0 9 1", "several files"),
    ],
)
def test_detached_data_elsewhere(tmp_path, data, name, message):
    folder = tmp_path / "folder"
    (folder / "sub").mkdir(parents=True)
    for place in (tmp_path, folder / "sub"):
        (place / "smoke.raw").write_bytes(data.tobytes())
    with pytest.raises(VolumeError, match=message):
        open_grids(write(folder, name="smoke.nhdr", data_file=name))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"sizes": "4 3 3"}, "96 bytes of data, too few for 4×3×3"),
        ({"sizes": "1e9 1e9 1e9"}, "too few"),
        ({"sizes": "1e99 1 1"}, "do not fit"),
        ({"sizes": "nan 1 1"}, "do not fit"),
        ({"sizes": "4 3 0"}, "do not fit"),
        ({"sizes": "4 3"}, "do not fit"),
        ({"sizes": "4 three 2"}, "damaged NRRD header"),
        ({"sizes": None}, "'sizes' is missing"),
        ({"type": None}, "'type' is missing"),
        ({"dimension": "many"}, "damaged NRRD header"),
        ({"dimension": 4, "sizes": "1 4 3 2"}, "4 axes"),
        ({"dimension": 2, "sizes": "4 6"}, "2 axes"),
        ({"type": "block"}, "values of type 'block'"),
        ({"encoding": "hex"}, "encoding 'hex'"),
        ({"endian": None}, "endian"),
        ({"endian": "middle"}, "endian"),
        ({"byte_skip": -2}, "byte skip"),
        ({"byte_skip": 10**30}, "byte skip"),
        ({"byte_skip": 1}, "too few"),
        ({"line_skip": 10**18}, "lines to skip"),
        ({"spacings": "1 1"}, "spacings must be 3"),
        ({"spacings": "1 1 nan"}, "spacings must be 3"),
        ({"space_directions": "(1,0,0) none (0,0,1)"}, "space directions must be 9"),
        ({"space_directions": "(1,0) (0,1) (1,1)"}, "space directions must be 9"),
        ({"space_directions": "1 0 0"}, "damaged NRRD header"),
        ({"space_directions": ""}, "damaged NRRD header"),
        ({"space_directions": "(1,0,0) (0,1,0) (0,0,1)", "space_origin": "(1,2)"}, "space origin must be 3"),
        ({"labels": '"x'}, "damaged NRRD header"),
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


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ascii"])
def test_flips_and_truncations_never_raise_anything_else(tmp_path, data, encoding):
    payload = {
        "raw": data.tobytes(),
        "gzip": gzip.compress(data.tobytes()),
        "bzip2": bz2.compress(data.tobytes()),
        "ascii": " ".join(map(str, data.ravel())).encode(),
    }[encoding]
    path = write(tmp_path, payload, encoding=encoding, spacings="1 1 1", byte_skip=0, line_skip=0)
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
