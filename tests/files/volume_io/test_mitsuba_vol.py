import math
import struct
import tracemalloc

import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import choose_grid, open_grids, read_grid
from tfm_cl.scene.bodies.volume import Volume

BOX = (-1.0, 0.0, 2.0, 1.0, 6.0, 3.0)
FORMATS = {1: "<f4", 2: "<f2", 3: "u1"}


def vol(data, encoding=1, *, version=3, sizes=None, channels=None, box=BOX):
    """Bytes of a file, written out from the description of the format; ``data`` is [z, y, x, channel]."""
    z, y, x, c = data.shape
    x, y, z = sizes or (x, y, z)
    head = (
        b"VOL" + bytes([version]) + struct.pack("<5i", encoding, x, y, z, c if channels is None else channels)
    )
    return head + struct.pack("<6f", *box) + data.astype(FORMATS.get(encoding, "<f4")).tobytes()


@pytest.fixture
def data():
    return np.random.default_rng(3).integers(0, 255, (2, 3, 4, 1)).astype(np.float32)


def write(folder, content):
    path = folder / "smoke.vol"
    path.write_bytes(content)
    return path


def load(path, name=None):
    return read_grid(path, choose_grid(path, name))


@pytest.mark.parametrize(("encoding", "scale"), [(1, 1), (2, 1), (3, 255)])
def test_encodings(tmp_path, data, encoding, scale):
    voxels = load(write(tmp_path, vol(data, encoding)), "density")
    assert voxels.dtype == np.float32
    assert voxels.flags.c_contiguous
    np.testing.assert_array_equal(voxels, data[..., 0] / np.float32(scale))


def test_uint8_spans_0_to_1(tmp_path):
    data = np.array([0, 255], np.uint8).reshape(1, 1, 2, 1)
    assert load(write(tmp_path, vol(data, 3))).tolist() == [[[0.0, 1.0]]]


def test_x_varies_fastest(tmp_path):
    data = np.arange(24, dtype=np.float32).reshape(2, 3, 4, 1)
    voxels = load(write(tmp_path, vol(data)))
    assert (voxels[0, 0, 1], voxels[0, 1, 0], voxels[1, 0, 0]) == (1, 4, 12)


def test_box_places_the_voxels(tmp_path, data):
    (grid,) = open_grids(write(tmp_path, vol(data)))
    assert grid.has_transform
    assert grid.shape == (2, 3, 4)
    # Low corner of the first voxel and high corner of the last one are the box's.
    low = grid.world_from_index @ [-0.5, -0.5, -0.5, 1]
    high = grid.world_from_index @ [3.5, 2.5, 1.5, 1]
    np.testing.assert_allclose([*low[:3], *high[:3]], BOX)


def test_channels_are_grids(tmp_path):
    data = np.random.default_rng(3).random((2, 3, 4, 3), np.float32)
    path = write(tmp_path, vol(data[..., :2]))
    assert [grid.name for grid in open_grids(path)] == ["channel0", "channel1"]
    for channel in range(2):
        np.testing.assert_array_equal(load(path, f"channel{channel}"), data[..., channel])
    with pytest.raises(VolumeError, match="choose one with --grid"):
        choose_grid(path)


@pytest.mark.parametrize(("encoding", "scale"), [(1, 1), (2, 1), (3, 255)])
def test_three_channels_are_a_colour(tmp_path, encoding, scale):
    data = np.random.default_rng(3).integers(0, 255, (2, 3, 4, 3)).astype(np.float32)
    data[1, 1, 1] = 0
    path = write(tmp_path, vol(data, encoding))
    grids = open_grids(path)
    assert [grid.name for grid in grids] == ["colour", "channel0", "channel1", "channel2"]
    assert grids[0].value_type == f"3 × {np.dtype(FORMATS[encoding]).name}"
    for channel in range(3):
        np.testing.assert_array_equal(load(path, f"channel{channel}"), data[..., channel] / np.float32(scale))
    volume = Volume.load(path)
    np.testing.assert_array_equal(volume.colour, data / np.float32(scale))
    np.testing.assert_array_equal(volume.data, data.any(axis=-1))
    np.testing.assert_array_equal(volume.channels[1].data, data[..., 1] / np.float32(scale))
    np.testing.assert_array_equal(volume.bounds, Volume.load(path, "channel0").bounds)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "version 2 .*save it again with a current Mitsuba"),
        ({"version": 4}, "version 4 .*update tfm_cl, or save it as version 3"),
        ({"encoding": 4}, "directions"),
        ({"encoding": 9}, "encoding 9"),
        ({"sizes": (0, 3, 2)}, "0×3×2"),
        ({"sizes": (-4, -3, 2)}, "-4×-3×2"),
        ({"sizes": (5, 3, 2)}, "holds 144 bytes"),
        ({"sizes": (2**31 - 1,) * 3}, "holds 144 bytes"),
        ({"channels": 0}, "0 channels"),
        ({"channels": 2}, "holds 144 bytes"),
        ({"channels": 2**31 - 1}, "channels"),
        ({"box": (0, 0, 0, 1, 0, 1)}, "no volume"),
        ({"box": (0, 0, 0, 1, -1, 1)}, "no volume"),
        ({"box": (0, 0, 0, 1, math.nan, 1)}, "no volume"),
        ({"box": (0, 0, 0, 1, math.inf, 1)}, "no volume"),
    ],
)
def test_wrong_headers(tmp_path, data, change, message):
    path = write(tmp_path, vol(data, **change))
    with pytest.raises(VolumeError, match=message):
        open_grids(path)


def test_truncation_and_flips(tmp_path, data):
    sound, rng, refused = vol(data), np.random.default_rng(7), 0
    for length in range(len(sound)):
        with pytest.raises(VolumeError):
            open_grids(write(tmp_path, sound[:length]))
    with pytest.raises(VolumeError, match="damaged"):
        open_grids(write(tmp_path, sound + b"\0"))
    tracemalloc.start()
    for _ in range(500):
        damaged = bytearray(sound)
        damaged[rng.integers(48)] = rng.integers(256)
        path = write(tmp_path, damaged)
        try:
            for grid in open_grids(path):
                read_grid(path, grid)
        except VolumeError:
            refused += 1
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert refused > 100
    assert peak < 8 << 20


@pytest.fixture
def mitsuba():
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    return mi


def test_reads_what_mitsuba_writes(tmp_path, mitsuba):
    data = np.random.default_rng(2).random((4, 3, 2, 3), np.float32)
    path = tmp_path / "mitsuba.vol"
    mitsuba.VolumeGrid(data).write(str(path))
    for channel in range(3):
        np.testing.assert_array_equal(load(path, f"channel{channel}"), data[..., channel])


def test_voxel_centres_are_where_mitsuba_has_them(tmp_path, mitsuba):
    data = np.random.default_rng(2).random((4, 3, 2, 1), np.float32)
    path = write(tmp_path, vol(data))
    grid = choose_grid(path)
    field = mitsuba.load_dict({"type": "gridvolume", "filename": str(path), "use_grid_bbox": True})
    place = mitsuba.SurfaceInteraction3f()
    for z, y, x in np.ndindex(4, 3, 2):
        place.p = (grid.world_from_index @ [x, y, z, 1])[:3].tolist()
        assert field.eval_1(place) == pytest.approx(data[z, y, x, 0], abs=1e-6)
