"""Written volume files against what was written, as this package, OpenVDB and NanoVDB read them."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from openvdb_reading import ask_openvdb, assert_is_what_openvdb_reads, openvdb_python
from scenes import turned
from tolerances import FLOAT32

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import open_grids, vdb_writer
from tfm_cl.files.volume_io.writing import check_writable, write_grids
from tfm_cl.files.volume_io.written_grid import WrittenGrid

UNIFORM, STRETCHED = np.diag([0.5, 0.5, 0.5, 1.0]), np.diag([0.5, 0.25, 2.0, 1.0])
UNIFORM[:3, 3] = 10, -20, 30
STATISTICS = 20 * FLOAT32
"""Of sums of squares in float64 and in NanoVDB's order."""


def grid(name, shape, matrix, *, is_vector=False, first=(0, 0)):
    """Random values of both signs, a third of them active; none in the first slices along y and x."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=(*shape, 3) if is_vector else shape).astype(np.float32)
    active = rng.random(shape) < 1 / 3
    active[:, : first[0]] = active[:, :, : first[1]] = False
    return WrittenGrid(name, values, active, matrix, {"tfm:quantity": "transmittance"})


GRIDS = (
    grid("key", (20, 30, 150), turned(30, (1, 2, 3), (0.1, 0.2, 0.3), (5, -6, 7)), first=(9, 0)),
    grid("rim", (9, 8, 17), UNIFORM, is_vector=True),
    grid("far", (3, 5, 4120), STRETCHED, first=(0, 4080)),
)
"""Leaves in several nodes of every level, and in one; every kind of transform."""


def assert_holds(path, written):
    """A file has these grids, and nothing else."""
    found = {grid.name: grid for grid in open_grids(path)}
    assert set(found) == {grid.name for grid in written}
    for expected in written:
        read = found[expected.name]
        assert read.active_voxels == expected.active_voxels
        values = read.read_colour() if expected.is_vector else read.read()
        low = np.linalg.solve(expected.world_from_index, read.world_from_index[:, 3])[:3]
        np.testing.assert_allclose(low, np.rint(low), atol=1e-9)
        x, y, z = np.rint(low).astype(int)
        whole = np.zeros_like(expected.values)
        part = tuple(slice(a, None) for a in (z, y, x))
        # Leaves reach beyond the array.
        room = whole[part].shape[:3]
        assert not values[room[0] :].any()
        whole[part][tuple(slice(n) for n in values.shape[:3])] = values[tuple(slice(n) for n in room)]
        np.testing.assert_array_equal(whole, expected.dense)
        np.testing.assert_allclose(
            read.world_from_index[:3, :3], expected.world_from_index[:3, :3], rtol=1e-15, atol=1e-15
        )


@pytest.mark.parametrize("extension", [".vdb", ".nvdb"])
def test_what_is_written_is_read_again(tmp_path, extension):
    path = tmp_path / f"light{extension}"
    assert write_grids(path, GRIDS) == [path]
    assert_holds(path, GRIDS)
    once = path.read_bytes()
    write_grids(path, GRIDS)
    assert path.read_bytes() == once  # nothing of the time or of chance is in it
    assert list(tmp_path.iterdir()) == [path]


def test_openvdb_reads_the_same(tmp_path):
    path = tmp_path / "light.vdb"
    write_grids(path, GRIDS)
    ask_openvdb(path)
    assert_is_what_openvdb_reads(path)
    assert_holds(path, GRIDS)
    program = (
        "import json, sys, pyopenvdb as vdb\n"
        "facts = {grid.name: grid.metadata for grid in vdb.readAll(sys.argv[1])[0]}\n"
        "print(json.dumps({name: facts[name]['tfm:quantity'] for name in facts}))"
    )
    told = subprocess.run([openvdb_python(), "-c", program, path], check=True, capture_output=True, text=True)
    assert json.loads(told.stdout) == dict.fromkeys((grid.name for grid in GRIDS), "transmittance")


def nanovdb(tool, *arguments):
    """Run one of NanoVDB's tools."""
    if shutil.which(tool) is None:
        pytest.skip(f"there is no {tool} here (Debian: libnanovdb-tools)")
    return subprocess.run([tool, *arguments], check=True, capture_output=True, text=True).stdout


@pytest.mark.parametrize("written", GRIDS, ids=lambda grid: grid.name)
def test_nanovdb_makes_the_same_file(tmp_path, written):
    ours, theirs, vdb = (tmp_path / name for name in ("ours.nvdb", "theirs.nvdb", "same.vdb"))
    write_grids(ours, GRIDS)
    assert "passed" in nanovdb("nanovdb_validate", "-v", "-g", written.name, ours)
    write_grids(ours, [written])
    write_grids(vdb, [written])
    nanovdb("nanovdb_convert", "-s", "all", "-c", "none", vdb, theirs)
    one, other = (np.frombuffer(path.read_bytes(), np.uint8) for path in (ours, theirs))
    assert one.shape == other.shape
    # Bit by bit, but that sums of floats may differ in their last bits.
    at_grid = 16 + 176 + len(written.name) + 1
    different = np.unique((np.flatnonzero(one != other) - at_grid - 672) // 4)
    sums = different[different >= 0]
    ours, theirs = (array[at_grid + 672 :].view("<f4")[sums] for array in (one, other))
    np.testing.assert_allclose(ours, theirs, rtol=STATISTICS)
    assert len(sums) < len(one) // 1000


def test_numpy_has_a_description_beside_it(tmp_path):
    path = tmp_path / "light.npy"
    float_grid, colours = (grid(name, (3, 4, 5), UNIFORM, is_vector=name == "rim") for name in ("key", "rim"))
    assert write_grids(path, [float_grid, colours]) == [path, tmp_path / "light.json"]
    array, facts = np.load(path), json.loads((tmp_path / "light.json").read_text())
    assert array.shape == (2, 3, 4, 5, 3)
    np.testing.assert_array_equal(array[0], np.repeat(float_grid.dense[..., None], 3, axis=-1))
    np.testing.assert_array_equal(array[1], colours.dense)
    assert facts["axes"] == ["grid", "z", "y", "x", "rgb"]
    assert [one["name"] for one in facts["grids"]] == ["key", "rim"]
    assert facts["world_from_index"] == UNIFORM.tolist()
    write_grids(path, [float_grid])
    np.testing.assert_array_equal(np.load(path)[0], float_grid.dense)
    with pytest.raises(VolumeError, match="different voxels do not make one array"):
        write_grids(path, GRIDS)
    np.testing.assert_array_equal(np.load(path)[0], float_grid.dense)


def test_what_cannot_be_written_is_refused(tmp_path, monkeypatch):
    with pytest.raises(VolumeError, match=r"cannot be written as '\.exr'; known: \.npy \.nvdb \.vdb"):
        check_writable(tmp_path / "light.exr")
    with pytest.raises(VolumeError, match="there is no directory"):
        check_writable(tmp_path / "no" / "light.npy")
    dark = WrittenGrid("key", GRIDS[1].values, np.zeros_like(GRIDS[1].active), UNIFORM)
    with pytest.raises(VolumeError, match="grid 'key' has no active voxel"):
        write_grids(tmp_path / "light.vdb", [dark])
    with pytest.raises(VolumeError, match="at most 255 bytes"):
        write_grids(tmp_path / "light.nvdb", [grid("k" * 256, (8, 8, 8), UNIFORM)])
    with pytest.raises(VolumeError, match=r"values are float32 \[z, y, x\]"):
        WrittenGrid("key", np.zeros((2, 2)), np.zeros((2, 2), bool), UNIFORM)
    with pytest.raises(VolumeError, match="a grid's name is text"):
        WrittenGrid("", GRIDS[0].values, GRIDS[0].active, UNIFORM)

    def fail(path, _grids):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(vdb_writer, "write", fail)
    with pytest.raises(VolumeError, match="No space left on device"):
        write_grids(tmp_path / "light.vdb", GRIDS)
    assert not list(tmp_path.iterdir())
