"""Offset and window, which make densities of stored values, for every format and storage."""

import json
import struct

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError, VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.volume_io.grid import Grid
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.files.volume_io.values import ValueMap
from tfm_cl.plan import options
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.scene_file import SceneFile, VolumeSettings

HOUNSFIELD = np.array([-3024, -1000, -500, 0, 40, 400, 3000, 0], np.int16).reshape(2, 2, 2)


def npy(folder, array):
    np.save(folder / "ct.npy", array)
    return folder / "ct.npy"


def npz(folder, array):
    np.savez(folder / "ct.npz", density=array)
    return folder / "ct.npz"


def raw(folder, array):
    (folder / "ct.raw").write_bytes(array.tobytes())
    description = {"shape": array.shape, "dtype": array.dtype.name}
    (folder / "ct.raw.json").write_text(json.dumps(description))
    return folder / "ct.raw"


def nrrd(folder, array):
    z, y, x = array.shape
    header = f"NRRD0004\ntype: short\ndimension: 3\nsizes: {x} {y} {z}\nendian: little\nencoding: raw\n\n"
    (folder / "ct.nrrd").write_bytes(header.encode() + array.astype("<i2").tobytes())
    return folder / "ct.nrrd"


def vol(folder, array):
    z, y, x = array.shape
    header = b"VOL\3" + struct.pack("<5i6f", 1, x, y, z, 1, 0, 0, 0, 1, 1, 1)
    (folder / "ct.vol").write_bytes(header + array.astype("<f4").tobytes())
    return folder / "ct.vol"


@pytest.mark.parametrize("save", [npy, npz, raw, nrrd, vol])
def test_ct_data_of_every_dense_format(tmp_path, save):
    path = save(tmp_path, HOUNSFIELD)
    with pytest.raises(VolumeError, match="densities are negative"):
        Volume.load(path)
    volume = Volume.load(path, offset=1000)
    np.testing.assert_array_equal(volume.data.ravel(), [0, 0, 500, 1000, 1040, 1400, 4000, 1000])
    volume = Volume.load(path, window=(-1000, 1000))
    np.testing.assert_array_equal(volume.data.ravel(), np.float32([0, 0, 0.25, 0.5, 0.52, 0.7, 1, 0.5]))
    assert volume.notes == ()
    # The offset comes first: stored values become Hounsfield units, of which the window speaks.
    both = Volume.load(save(tmp_path, HOUNSFIELD + np.int16(1024)), offset=-1024, window=(-1000, 1000))
    np.testing.assert_array_equal(both.data, volume.data)


@pytest.mark.parametrize("dtype", [np.uint8, np.int32, np.float16, np.float64, bool])
def test_the_range_of_a_type_becomes_0_to_1(tmp_path, dtype):
    path = npy(tmp_path, np.array([0, 1, 1, 0], dtype).reshape(1, 2, 2))
    np.testing.assert_array_equal(Volume.load(path, window=(0, 4)).data.ravel(), [0, 0.25, 0.25, 0])


def test_what_is_no_number_stays_an_error(tmp_path):
    path = npy(tmp_path, np.array([np.nan, np.inf, -np.inf, 1.0], np.float32).reshape(1, 2, 2))
    with pytest.raises(VolumeError, match=r"1 densities are .*the first nan"):
        Volume.load(path, window=(0, 2))  # infinite values are beyond the window
    with pytest.raises(VolumeError, match=r"2 densities are .*the first nan"):
        Volume.load(path, offset=3)
    np.testing.assert_array_equal(Volume.load(path, offset=3, sanitize=True).data.ravel(), [0, 0, 0, 4])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"offset": np.nan}, "offset is a finite number, at most 1e[+]25; got nan"),
        ({"offset": -1e26}, "offset is a finite number"),
        ({"window": (1, 1)}, r"window is two numbers \[low, high\], low < high; got \(1, 1\)"),
        ({"window": 5}, "window is two numbers"),
        ({"window": (0, 1, 2)}, "window is two numbers"),
        ({"window": ("low", "high")}, "window is two numbers"),
        ({"offset": "much"}, "offset is a finite number"),
        ({"offset": 10**400}, "offset is a finite number"),
        ({"window": (2, 1)}, "window is two numbers"),
        ({"window": (0, np.inf)}, "window is two numbers"),
        ({"window": (np.nan, 1)}, "window is two numbers"),
        ({"window": (1e9, 1e9 + 1)}, "window is two numbers"),  # one float32
    ],
)
def test_impossible_numbers(tmp_path, values, message):
    path = npy(tmp_path, HOUNSFIELD)
    with pytest.raises(VolumeError, match=message):
        Volume.load(path, **values)


@pytest.mark.parametrize(
    "text",
    [
        "offset = nan",
        "offset = 1e26",
        'offset = "much"',
        "window = [1, 1]",
        "window = 5",
        "window = [0, inf]",
        f"offset = {10**400}",
        f"window = [0, {10**400}]",
    ],
)
def test_impossible_numbers_in_a_scene(tmp_path, text):
    npy(tmp_path, HOUNSFIELD)
    (tmp_path / "a.toml").write_text(f'[volume]\nfile = "ct.npy"\n{text}\n')
    with pytest.raises(SceneError, match=f"volume.{text.split()[0]}"):
        SceneFile.read(tmp_path / "a.toml")


def test_keys_of_a_scene_and_back(tmp_path):
    npy(tmp_path, HOUNSFIELD)
    (tmp_path / "a.toml").write_text('[volume]\nfile = "ct.npy"\noffset = 24\nwindow = [-1000, 1000]\n')
    file = SceneFile.read(tmp_path / "a.toml")
    scene = file.make(tfm.Scene)
    assert scene.bodies[0].data.max() == 1
    table = options.table(file, scene)["volume"]
    defaults = VolumeSettings(file="ct.npy").to_dict()
    assert table == defaults | {
        "file": table["file"],
        "grid": "density",
        "offset": 24.0,
        "window": [-1000.0, 1000.0],
    }


# ----------------------------------------------------------------------------------------- leaves


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """``tree(background)`` pretends that a file holds one leaf of 1 to 512 in a box of 8 × 8 × 24 voxels."""

    def make(background=0.0, shape=(8, 8, 24), **fields):
        values = np.arange(1, 513, dtype=np.float32).reshape(1, 8, 8, 8)
        leaves = Leaves(shape, (0, 0, 0), np.array([[0, 0, 1]], np.int32), values)
        dense = leaves.to_dense() if shape[2] == 24 else None
        if background:
            dense[dense == 0] = background
            leaves = Leaves.from_dense(dense)
        grid = Grid(
            name="density",
            grid_class="fog volume",
            value_type="float32",
            shape=shape,
            world_from_index=np.eye(4),
            has_transform=True,
            is_box_of_stored=True,
            background=background,
            read=lambda: dense,
            read_leaves=lambda: leaves,
            **fields,
        )
        monkeypatch.setattr(volume_io, "open_grids", lambda _: [grid])
        return tmp_path / "a.vdb", dense

    return make


@pytest.mark.parametrize("values", [{}, {"offset": -100}, {"window": (0, 256)}, {"window": (100, 200)}])
def test_leaves_stay_leaves_where_empty_space_stays_empty(tree, values):
    path, dense = tree()
    volume = Volume.load(path, **values)
    assert volume.notes == ()
    expected = ValueMap(values.get("offset", 0), values.get("window")).of_array(dense.copy())
    np.testing.assert_array_equal(volume.data, expected)
    assert len(volume.leaves.values) == 1
    assert isinstance(volume._voxels.stored, Leaves)


@pytest.mark.parametrize(("values", "outside"), [({"offset": 100}, "100"), ({"window": (-256, 256)}, "0.5")])
def test_empty_space_that_is_filled_is_noted(tree, values, outside):
    path, dense = tree()
    volume = Volume.load(path, **values)
    np.testing.assert_array_equal(
        volume.data, ValueMap(values.get("offset", 0), values.get("window")).of_array(dense.copy())
    )
    assert volume.data[0, 0, 0] == float(outside)
    (note,) = volume.notes
    assert (
        f"outside what the file stores its value is {outside} without end; it is that inside the box" in note
    )


def test_empty_space_that_cannot_be_filled_is_refused(tree):
    path, _ = tree(shape=(8, 8, 1 << 24))
    tree(shape=(8, 1 << 11, 1 << 18))
    with pytest.raises(VolumeError, match=r"make its empty space 100, .* the limit is .*; choose them so"):
        Volume.load(path, offset=100)


def test_a_background_fills_the_box_and_is_noted(tree):
    path, dense = tree(background=0.25)
    volume = Volume.load(path)
    np.testing.assert_array_equal(volume.data, dense)
    (note,) = volume.notes
    assert "outside what the file stores its value is 0.25 without end" in note
    low, high = volume.bounds
    assert (low.tolist(), high.tolist()) == ([-1, -1, -1], [24, 8, 8])
    assert Volume.load(path, offset=-0.25).notes == ()


@pytest.mark.slow
def test_a_renderer_hands_notes_on(tree, renderer):
    path, _ = tree(background=0.25)
    volume = Volume.load(path)
    camera = tfm.Camera(from_=(4, 4, 40), to=(4, 4, 4), res=(4, 4))
    scene = tfm.Scene(volume.with_density_scale(0.01), camera=camera)
    assert renderer.render(scene, method="dual").warnings == volume.notes
