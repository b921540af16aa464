import json
import tracemalloc

import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import choose_grid, open_grids, read_grid

SHAPE = (2, 3, 4)


def write_raw(folder, data, sidecar="smoke.raw.json", *, head=b"", **keys):
    path = folder / "smoke.raw"
    path.write_bytes(head + data.tobytes())
    (folder / sidecar).write_text(json.dumps({"shape": list(SHAPE), "dtype": data.dtype.name} | keys))
    return path


def load(path):
    return read_grid(path, choose_grid(path))


@pytest.mark.parametrize("byte_order", ["little", "big"])
@pytest.mark.parametrize("dtype", ["bool", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8"])
def test_every_type_keeps_its_values(tmp_path, dtype, byte_order):
    data = (np.arange(24) % 2 if dtype == "bool" else np.arange(24)).reshape(SHAPE)
    stored = data.astype(np.dtype(dtype).newbyteorder("<" if byte_order == "little" else ">"))
    voxels = load(write_raw(tmp_path, stored, byte_order=byte_order))
    assert voxels.dtype == np.float32
    assert voxels.flags.c_contiguous
    np.testing.assert_array_equal(voxels, data)


def test_any_byte_but_0_is_true(tmp_path):
    path = write_raw(tmp_path, np.array([0, 1, 2, 255], np.uint8), shape=[1, 1, 4], dtype="bool")
    assert load(path).tolist() == [[[0, 1, 1, 1]]]


def test_x_varies_fastest(tmp_path):
    data = np.arange(24, dtype=np.uint8)
    assert load(write_raw(tmp_path, data))[1, 2, 3] == 23
    assert load(write_raw(tmp_path, data))[0, 0, 1] == 1
    assert load(write_raw(tmp_path, data))[0, 1, 0] == 4


def test_fortran_order_lets_z_vary_fastest(tmp_path):
    voxels = load(write_raw(tmp_path, np.arange(24, dtype=np.uint8), order="F"))
    assert voxels.shape == SHAPE
    assert voxels.flags.c_contiguous
    assert (voxels[1, 0, 0], voxels[0, 1, 0], voxels[0, 0, 1]) == (1, 2, 6)


def test_offset_leaves_out_a_header(tmp_path):
    path = write_raw(tmp_path, np.arange(24, dtype=np.float32), head=b"7 bytes", offset=7)
    np.testing.assert_array_equal(load(path).ravel(), np.arange(24))


def test_placement_and_name(tmp_path):
    data = np.zeros(SHAPE, np.float32)
    (grid,) = open_grids(write_raw(tmp_path, data, voxel_size=[1, 2, 4], origin=[10, 20, 30], name="fog"))
    assert (grid.name, grid.shape, grid.value_type, grid.has_transform) == ("fog", SHAPE, "float32", True)
    np.testing.assert_allclose(grid.world_from_index @ [0, 0, 0, 1], [10.5, 21, 32, 1])
    np.testing.assert_allclose(grid.world_from_index @ [1, 1, 1, 1], [11.5, 23, 36, 1])


def test_without_placement_it_is_left_to_the_caller(tmp_path):
    (grid,) = open_grids(write_raw(tmp_path, np.zeros(SHAPE, np.float32)))
    assert (grid.name, grid.has_transform) == ("density", False)


def test_one_number_is_a_cubic_voxel(tmp_path):
    (grid,) = open_grids(write_raw(tmp_path, np.zeros(SHAPE, np.float32), voxel_size=0.5))
    np.testing.assert_allclose(np.diag(grid.world_from_index), [0.5, 0.5, 0.5, 1])
    np.testing.assert_allclose(grid.world_from_index[:3, 3], 0.25)


def test_both_sidecar_names_and_the_longer_wins(tmp_path):
    data = np.arange(24, dtype=np.uint8)
    path = write_raw(tmp_path, data, "smoke.json", name="short")
    assert choose_grid(path).name == "short"
    write_raw(tmp_path, data, "smoke.raw.json", name="long")
    assert choose_grid(path).name == "long"


def test_missing_sidecar_tells_what_to_write(tmp_path):
    (tmp_path / "smoke.raw").write_bytes(bytes(24))
    with pytest.raises(VolumeError, match=r'smoke\.raw\.json beside it.*"shape"'):
        open_grids(tmp_path / "smoke.raw")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"shpae": 1}, "unknown key 'shpae'; did you mean 'shape'"),
        ({"qqq": 1}, "unknown key 'qqq'; known: shape"),
        ({"dtype": "uint9"}, "did you mean 'uint"),
        ({"dtype": "object"}, "dtype is one of"),
        ({"dtype": 3}, "dtype is one of"),
        ({"byte_order": "middle"}, "little big"),
        ({"order": ["C"]}, "order is one of"),
        ({"shape": [2, 3]}, "shape is"),
        ({"shape": [2, 3, 0]}, "shape is"),
        ({"shape": [2, 3, 10**4000]}, "shape is"),
        ({"shape": [2, 3, 4.0]}, "shape is"),
        ({"shape": None}, "got nothing"),
        ({"shape": [2, 3, 10**18]}, "holds 24 bytes"),
        ({"shape": [2, 3, 5]}, "tells 30"),
        ({"shape": [2, 3, 3]}, "tells 18"),
        ({"offset": -1}, "offset is"),
        ({"offset": 0.5}, "offset is"),
        ({"offset": 10**4000}, "offset is"),
        ({"offset": 1}, "tells 25"),
        ({"voxel_size": 0}, "voxel_size is"),
        ({"voxel_size": [1, 1]}, "voxel_size is"),
        ({"voxel_size": float("nan")}, "voxel_size is"),
        ({"voxel_size": float("inf")}, "voxel_size is"),
        ({"voxel_size": "1"}, "voxel_size is"),
        ({"voxel_size": 10**400}, "voxel_size is"),
        ({"origin": 0}, "origin is"),
        ({"origin": [0, 0, None]}, "origin is"),
        ({"name": 3}, "name is"),
    ],
)
def test_wrong_keys_are_named(tmp_path, keys, message):
    path = write_raw(tmp_path, np.zeros(24, np.uint8), **keys)
    with pytest.raises(VolumeError, match=r"smoke\.raw") as caught:
        open_grids(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", "3", '{"shape": 1' + "0" * 5000 + "}", "[" * 100_000])
def test_sidecar_that_is_no_object(tmp_path, text):
    path = write_raw(tmp_path, np.zeros(24, np.uint8))
    (tmp_path / "smoke.raw.json").write_text(text)
    with pytest.raises(VolumeError, match=r"smoke\.raw\.json: "):
        open_grids(path)


def test_sidecar_with_bad_encoding_or_too_large(tmp_path):
    path = write_raw(tmp_path, np.zeros(24, np.uint8))
    (tmp_path / "smoke.raw.json").write_bytes(b'{"name": "\xff"}')
    with pytest.raises(VolumeError, match="not valid JSON"):
        open_grids(path)
    (tmp_path / "smoke.raw.json").write_bytes(b" " * ((1 << 20) + 1))
    with pytest.raises(VolumeError, match="too large"):
        open_grids(path)


def test_file_shortened_after_it_was_described(tmp_path):
    path = write_raw(tmp_path, np.zeros(24, np.uint8))
    (grid,) = open_grids(path)
    path.write_bytes(bytes(10))
    with pytest.raises(VolumeError, match="cut short"):
        read_grid(path, grid)


def test_volumes_larger_than_a_step_are_whole(tmp_path):
    # Reading goes in steps of 2^20 voxels; 3.5 of them exercise the growing buffer.
    data = np.random.default_rng(1).integers(0, 255, (7, 512, 1024), np.uint8)
    path = write_raw(tmp_path, data, shape=list(data.shape))
    np.testing.assert_array_equal(load(path), data)


def test_flips_of_the_sidecar_never_raise_anything_else(tmp_path):
    path = write_raw(tmp_path, np.arange(24, dtype=np.uint8), voxel_size=[1, 1, 1], offset=0, name="a")
    sidecar = tmp_path / "smoke.raw.json"
    sound, rng, refused = sidecar.read_bytes(), np.random.default_rng(5), 0
    tracemalloc.start()
    for _ in range(400):
        damaged = bytearray(sound)
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        sidecar.write_bytes(damaged)
        try:
            assert load(path).size == 24
        except VolumeError as error:
            refused += "\n" not in str(error)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert refused > 100
    assert peak < 8 << 20
