import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import choose_grid, open_grids, read_grid
from tfm_cl.scene.bodies.volume import Volume

SHAPE = (2, 3, 4)
TYPES = ["?", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8"]


def load(path, name=None):
    return read_grid(path, choose_grid(path, name))


def npy(header, data=b""):
    """Bytes of a file with any header text, as the format's description lays them out."""
    text = header.encode("latin1")
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def npz(path, members, compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def npy_bytes(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


@pytest.mark.parametrize("byte_order", ["<", ">"])
@pytest.mark.parametrize("dtype", TYPES)
def test_every_type_keeps_its_values(tmp_path, dtype, byte_order):
    data = (np.arange(24) % 2 if dtype == "?" else np.arange(24)).reshape(SHAPE)
    np.save(tmp_path / "a.npy", data.astype(np.dtype(dtype).newbyteorder(byte_order)))
    voxels = load(tmp_path / "a.npy")
    assert voxels.dtype == np.float32
    assert voxels.flags.c_contiguous
    np.testing.assert_array_equal(voxels, data)


def test_every_bit_of_float32_survives(tmp_path):
    data = np.random.default_rng(0).integers(0, 2**32, SHAPE, np.uint32).view(np.float32)
    np.save(tmp_path / "a.npy", data)
    assert load(tmp_path / "a.npy").tobytes() == data.tobytes()


def test_fortran_order(tmp_path):
    data = np.random.default_rng(0).random(SHAPE, np.float32)
    np.save(tmp_path / "a.npy", np.asfortranarray(data))
    assert b"'fortran_order': True" in (tmp_path / "a.npy").read_bytes()
    voxels = load(tmp_path / "a.npy")
    assert voxels.flags.c_contiguous
    np.testing.assert_array_equal(voxels, data)


def test_header_of_version_2(tmp_path):
    data = np.random.default_rng(0).random(SHAPE, np.float32)
    with (tmp_path / "a.npy").open("wb") as stream:
        np.lib.format.write_array(stream, data, version=(2, 0))
    np.testing.assert_array_equal(load(tmp_path / "a.npy"), data)


def test_npy_is_the_grid_density_without_a_transform(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros(SHAPE, ">u2"))
    (grid,) = open_grids(tmp_path / "a.npy")
    assert (grid.name, grid.shape, grid.value_type, grid.has_transform) == ("density", SHAPE, "uint16", False)
    np.testing.assert_array_equal(grid.world_from_index @ [0, 0, 0, 1], [0.5, 0.5, 0.5, 1])


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_of_an_archive_are_grids(tmp_path, save):
    rng = np.random.default_rng(0)
    density, heat = rng.random(SHAPE, np.float32), rng.random((3, 2, 5))
    save(tmp_path / "a.npz", density=density, heat=np.asfortranarray(heat), frame=np.arange(3))
    assert [grid.name for grid in open_grids(tmp_path / "a.npz")] == ["density", "heat"]
    np.testing.assert_array_equal(load(tmp_path / "a.npz"), density)
    np.testing.assert_array_equal(load(tmp_path / "a.npz", "heat"), heat.astype(np.float32))


@pytest.mark.parametrize("size", [2.0, np.array([2.0]), np.array([2, 2, 2])])
def test_archive_with_voxel_size_and_origin(tmp_path, size):
    np.savez(tmp_path / "a.npz", smoke=np.zeros(SHAPE), voxel_size=size, origin=[1.0, 2.0, 3.0])
    (grid,) = open_grids(tmp_path / "a.npz")
    assert grid.has_transform
    np.testing.assert_array_equal(grid.world_from_index @ [0, 0, 0, 1], [2, 3, 4, 1])
    np.testing.assert_array_equal(grid.world_from_index @ [1, 1, 1, 1], [4, 5, 6, 1])


@pytest.mark.parametrize("order", ["C", "F"])
def test_archive_with_a_matrix(tmp_path, order):
    matrix = np.array([[0, 2, 0, 5], [3, 0, 0, 6], [0, 0, 4, 7], [0, 0, 0, 1]], order=order)
    np.savez(tmp_path / "a.npz", smoke=np.zeros(SHAPE), world_from_index=matrix)
    (grid,) = open_grids(tmp_path / "a.npz")
    assert grid.has_transform
    np.testing.assert_array_equal(grid.world_from_index, matrix)


@pytest.mark.parametrize(
    ("placement", "message"),
    [
        ({"voxel_size": [1.0, 2.0]}, "voxel_size is an array"),
        ({"voxel_size": [1.0, 0.0, 1.0]}, "voxel_size is > 0"),
        ({"voxel_size": np.nan}, "not finite"),
        ({"voxel_size": "large"}, "voxel_size is an array"),
        ({"origin": 0.0}, "origin is an array"),
        ({"origin": np.zeros((1000, 1000))}, "origin is an array"),
        ({"world_from_index": np.eye(3)}, "world_from_index is an array"),
        ({"world_from_index": np.eye(4), "origin": np.zeros(3)}, "both world_from_index and origin"),
    ],
)
def test_wrong_placement(tmp_path, placement, message):
    np.savez(tmp_path / "a.npz", smoke=np.zeros(SHAPE), **placement)
    with pytest.raises(VolumeError, match=message):
        open_grids(tmp_path / "a.npz")


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("the pickle was loaded",))


def test_pickles_are_never_loaded(tmp_path):
    array = np.full((10, 10, 10), Trap(), dtype=object)  # a pickle shorter than 1000 pointers
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    np.savez(tmp_path / "a.npz", array)
    for path in (tmp_path / "a.npy", tmp_path / "a.npz"):
        with pytest.raises(VolumeError, match=r"pickled .* never loaded"):
            choose_grid(path)
        (grid,) = open_grids(path)
        with pytest.raises(VolumeError, match=r"pickled .* never loaded"):
            grid.read()


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((3, 4)), r"shape \(3, 4\)"),
        (np.zeros((2, 2, 3, 4)), r"shape \(2, 2, 3, 4\); a volume is \[z, y, x\]"),
        (np.zeros((2, 2, 3, 3)), r"shape \(2, 2, 3, 3\), a colour; give it beside a volume .*volume\.colour"),
        (np.zeros((1, 2, 3, 1)), r"shape \(1, 2, 3, 1\); a volume is"),  # which one is left out?
        (np.zeros((1,) * 30), r"shape \(1, 1, 1, 1, 1, 1, 1, 1, …\); a volume is"),
        (np.zeros(SHAPE, np.complex64), "complex64"),
        (np.zeros(SHAPE, "S3"), "bytes24"),
        (np.zeros(SHAPE, [("a", "f4")]), "not real numbers"),
        (np.zeros((0, 3, 4)), "empty"),
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_other_arrays_are_described_but_refused(tmp_path, array, message, suffix):
    path = tmp_path / f"a{suffix}"
    (np.save if suffix == ".npy" else np.savez)(path, array)
    with pytest.raises(VolumeError, match=message):
        choose_grid(path)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize(
    "shape", [(1, 2, 3, 4), (2, 3, 4, 1), (2, 1, 3, 4), (1, 1, 2, 3, 4), (1, 2, 3, 4, 1), (1, 1, 3, 4)]
)
def test_axes_of_one_sample_are_left_out(tmp_path, shape, order, suffix):
    data = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    path = tmp_path / f"a{suffix}"
    (np.save if suffix == ".npy" else np.savez)(path, np.asarray(data, order=order))
    grid = choose_grid(path)
    kept = [size for size in shape if size > 1]
    assert grid.shape == tuple([1] * (3 - len(kept)) + kept)
    np.testing.assert_array_equal(grid.read(), data.reshape(grid.shape))


def test_the_colour_of_a_flat_volume_is_no_volume(tmp_path):
    smoke, colour = np.ones((1, 4, 5), np.float32), np.full((1, 4, 5, 3), 2, np.float32)
    np.savez(tmp_path / "a.npz", smoke=smoke, colour=colour)
    volume = Volume.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(volume.data, smoke)
    np.testing.assert_array_equal(volume.colour, colour)


def test_newer_versions_of_the_format(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.ones(SHAPE))
    content = path.read_bytes()
    for version, message in (
        (b"\3\0", "3.0; it is for structured"),
        (b"\4\0", "4.0; .*update tfm_cl, or save"),
    ):
        path.write_bytes(content[:6] + version + content[8:])
        with pytest.raises(VolumeError, match=f"version {message}"):
            open_grids(path)


def test_archive_without_arrays(tmp_path):
    with pytest.raises(VolumeError, match="no grid"):
        open_grids(npz(tmp_path / "a.npz", {"readme.txt": "hello"}))


HEADER = "{'descr': %s, 'fortran_order': %s, 'shape': %s, }\n"


@pytest.mark.parametrize(
    "header",
    [
        HEADER % ("'<f4'", "False", "(100000, 100000, 100000)"),
        HEADER % ("'<f4'", "True", f"({10**30}, 1, 1)"),
        HEADER % ("'<f4'", "True", f"({10**4000}, {10**4000}, 1)"),
        HEADER % ("'<f4'", "False", "(-1, 3, 4)"),
        HEADER % ("'<f4'", "False", "(-2, -3, 4)"),
        HEADER % ("'<f4'", "False", "(2, 3, 4.0)"),
        HEADER % ("'<f4'", "3", "(2, 3, 4)"),
        HEADER % ("'<f77'", "False", "(2, 3, 4)"),
        HEADER % ("'|V2000000000'", "False", "(2, 3, 4)"),
        HEADER % ("[('a', '|O')]", "False", "(2, 3, 5)"),
        "{" * 5000,
        "(" * 9000,
        "-" * 9000 + "1",
        "__import__('os').abort()",
        "",
        "{'descr': '<f4'}",
        "'''",
        " " * 20000,
    ],
)
def test_hostile_headers(tmp_path, header):
    content = npy(header, bytes(96))
    (tmp_path / "a.npy").write_bytes(content)
    npz(tmp_path / "a.npz", {"a.npy": content})
    for path in (tmp_path / "a.npy", tmp_path / "a.npz"):
        with pytest.raises(VolumeError) as caught:
            choose_grid(path)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 400 + len(str(path))


def test_header_written_by_python_2(tmp_path):
    header = HEADER % ("'<f4'", "False", "(2L, 3L, 4L)")
    (tmp_path / "a.npy").write_bytes(npy(header, np.arange(24, dtype="<f4").tobytes()))
    np.testing.assert_array_equal(load(tmp_path / "a.npy").ravel(), np.arange(24))


def test_structured_header_of_version_3(tmp_path):
    with (tmp_path / "a.npy").open("wb") as stream:
        np.lib.format.write_array(stream, np.zeros(SHAPE), version=(3, 0))
    with pytest.raises(VolumeError, match="version"):
        open_grids(tmp_path / "a.npy")


def forge_size(path, size):
    """Set the uncompressed size in both headers of a one-member archive."""
    content = bytearray(path.read_bytes())
    for signature, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        struct.pack_into("<I", content, content.find(signature) + at, size)
    path.write_bytes(content)


def test_zip_bomb_is_refused_before_it_is_unpacked(tmp_path):
    header = HEADER % ("'|u1'", "False", "(1500, 1000, 1000)")
    path = npz(tmp_path / "a.npz", {"a.npy": npy(header, bytes(1000))}, zipfile.ZIP_DEFLATED)
    with pytest.raises(VolumeError, match="but holds 1,000"):
        open_grids(path)
    forge_size(path, 10 + len(header) + 1_500_000_000)
    tracemalloc.start()
    with pytest.raises(VolumeError, match="cannot hold"):
        open_grids(path)
    assert tracemalloc.get_traced_memory()[1] < 4 << 20
    tracemalloc.stop()


def test_forged_size_within_the_ratio_ends_early(tmp_path):
    header = HEADER % ("'|u1'", "False", "(100, 100, 10)")
    path = npz(tmp_path / "a.npz", {"a.npy": npy(header, bytes(10))}, zipfile.ZIP_DEFLATED)
    forge_size(path, 10 + len(header) + 100_000)
    with pytest.raises(VolumeError):
        load(path)


def test_checksum_of_a_member_is_checked(tmp_path):
    path = npz(tmp_path / "a.npz", {"a.npy": npy_bytes(np.zeros(SHAPE))})
    content = bytearray(path.read_bytes())
    content[200] ^= 1  # within the voxels
    path.write_bytes(content)
    with pytest.raises(VolumeError, match="CRC"):
        load(path)


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_compressions_are_refused(tmp_path, compression):
    path = npz(tmp_path / "a.npz", {"a.npy": npy_bytes(np.zeros(SHAPE))}, compression)
    with pytest.raises(VolumeError, match=r"numpy\.savez"):
        open_grids(path)


def test_every_truncation_of_npy(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.zeros(SHAPE, np.float32))
    sound = path.read_bytes()
    for length in range(len(sound)):
        path.write_bytes(sound[:length])
        with pytest.raises(VolumeError):
            open_grids(path)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_flips_and_truncations_never_raise_anything_else(tmp_path, suffix):
    path, rng, refused = tmp_path / f"a{suffix}", np.random.default_rng(11), 0
    data = np.random.default_rng(0).integers(0, 9, (4, 5, 6)).astype(np.float32)
    if suffix == ".npy":
        np.save(path, data)
    else:
        np.savez_compressed(path, density=data, voxel_size=2.0)
    sound = path.read_bytes()
    tracemalloc.start()
    for trial in range(250):
        damaged = bytearray(sound)
        for _ in range(1 + trial % 3):
            damaged[rng.integers(min(len(damaged), 128) if suffix == ".npy" else len(damaged))] = (
                rng.integers(256)
            )
        path.write_bytes(damaged[: rng.integers(len(damaged))] if trial % 5 == 0 else damaged)
        try:
            assert load(path).dtype == np.float32
        except VolumeError as error:
            refused += "\n" not in str(error)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert refused > 80
    assert peak < 16 << 20
