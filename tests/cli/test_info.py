import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.device.bricks import build_bricks
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.files.volume_io import open_grids

DATA = Path(__file__).resolve().parents[1] / "files" / "volume_io" / "data"

DEVICE_BYTES = 11 * (4 * 1332 + 48) + 4 * (6 * 4 * 4)
"""Of `blobs`: ten of 3 × 2 × 2 blocks and the empty record, each of 11³ + 1 voxels and 12 numbers of
its place, and 6 × 4 × 4 bricks."""

KEYS = [
    *("name", "class", "values", "dims", "voxel_size", "bounds", "min", "max", "mean"),
    *("active_voxels", "active_share", "device_bytes", "renders"),
]


def test_json_of_an_array(cli, cloud):
    density = blobs()
    report = cli("info", cloud, "--json").json
    assert report["file"] == str(cloud)
    (grid,) = report["grids"]
    assert list(grid) == KEYS
    assert grid["name"] == "density"
    assert grid["values"] == "float32"
    assert grid["dims"] == [16, 12, 14]  # x, y, z of an array [14, 12, 16]
    assert grid["voxel_size"] == [1, 1, 1]
    assert grid["bounds"] == [[-0.5, -0.5, -0.5], [16.5, 12.5, 14.5]]
    assert (grid["min"], grid["max"]) == (density.min(), density.max())
    assert grid["mean"] == pytest.approx(density.mean(dtype=np.float64))
    assert grid["active_voxels"] == np.count_nonzero(density)
    assert grid["active_share"] == np.count_nonzero(density) / density.size
    assert grid["device_bytes"] == DEVICE_BYTES
    assert grid["renders"] == "yes"


def test_text_of_an_array(cli, cloud):
    done = cli("info", cloud)
    assert done.code == 0
    assert done.err == ""
    lines = [" ".join(line.split()) for line in done.out.splitlines()]
    assert lines[:2] == [str(cloud), "grid 'density'"]
    assert "dims 16 × 12 × 14" in lines
    assert "bounds (-0.5, -0.5, -0.5) to (16.5, 12.5, 14.5)" in lines
    assert "max 1" in lines
    assert f"device bytes {DEVICE_BYTES:,}" in lines


def test_a_terminal_without_the_multiplication_sign(cloud, program, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    done = subprocess.run(program("info", cloud), capture_output=True, text=True, check=True)
    assert r"16 \xd7 12" in done.stdout


def test_every_grid_of_an_archive_in_its_place(cli):
    np.savez(
        "two.npz", a=np.zeros((2, 3, 4)), b=np.ones((1, 1, 1), np.uint8), voxel_size=2.0, origin=(10, 20, 30)
    )
    a, b = cli("info", "two.npz", "--json").json["grids"]
    assert (a["name"], a["values"], a["dims"]) == ("a", "float64", [4, 3, 2])
    assert (a["active_voxels"], a["active_share"], a["mean"]) == (0, 0, 0)
    assert (b["name"], b["values"], b["dims"]) == ("b", "uint8", [1, 1, 1])
    assert b["bounds"] == [[9, 19, 29], [13, 23, 33]]


def test_values_that_are_no_density_are_counted(cli):
    density = blobs()
    density[0, 0, :3] = np.nan, np.inf, -np.inf
    np.save("odd.npy", density)
    (grid,) = cli("info", "odd.npy", "--json").json["grids"]
    assert grid["not_finite"] == 3
    assert grid["max"] == 1


def test_a_grid_without_a_single_number(cli):
    np.save("nan.npy", np.full((2, 2, 2), np.nan))
    (grid,) = cli("info", "nan.npy", "--json").json["grids"]
    assert (grid["min"], grid["max"], grid["mean"], grid["not_finite"]) == (None, None, None, 8)
    assert grid["renders"].startswith("8 densities are negative, infinite or NaN, the first nan at ")
    figures = cli("info", "nan.npy").out.replace("nan.npy", "").replace(grid["renders"], "")
    assert "nan" not in figures


def test_several_grids_of_a_vdb(cli):
    """Against the arrays that OpenVDB itself read from the same file."""
    report = cli("info", DATA / "several.vdb", "--json").json
    assert len(report["grids"]) > 1
    with np.load(DATA / "several.npz") as truth:
        for grid in report["grids"]:
            if grid["max"] is not None:
                assert any(
                    np.isclose(grid["max"], array.max()) for array in truth.values() if array.ndim == 3
                )


@pytest.fixture(scope="module")
def on_device(device_name):
    """``on_device(path)`` is the memory that the volume takes on a CPU."""
    launcher = Launcher(choose_device(device_name))
    return lambda path: (
        build_bricks(launcher, [tfm.Volume.load(path).channel_leaves], "the volume", "f32").nbytes
    )


def device_bytes(cli, path):
    return cli("info", path, "--json").json["grids"][0]["device_bytes"]


def test_device_bytes_of_every_place_of_a_voxel(cli, on_device):
    """A voxel is read by its own block and by those before it, if it is one of their last."""
    for place in range(20):
        density = np.zeros((3, 20, 30), np.float32)
        density[1, place, place + 5] = 1
        np.save("voxel.npy", density)
        assert device_bytes(cli, "voxel.npy") == on_device("voxel.npy"), place


@pytest.mark.parametrize("shape", [(1, 1, 1), (7, 8, 9), (40, 33, 17)])
def test_device_bytes_of_arrays(cli, on_device, rng, shape):
    np.save("sparse.npy", (rng.random(shape) > 0.999).astype(np.float32))
    assert device_bytes(cli, "sparse.npy") == on_device("sparse.npy")
    np.save("zero.npy", np.zeros(shape))
    assert device_bytes(cli, "zero.npy") == on_device("zero.npy")


def test_device_bytes_of_leaves_that_begin_anywhere(cli, on_device):
    assert device_bytes(cli, DATA / "negative.vdb") == on_device(DATA / "negative.vdb")


@pytest.mark.parametrize("name", ["wdas_cloud_sixteenth.vdb", "cortex_smoke.vdb"])
def test_device_bytes_of_real_volumes(cli, on_device, shared_volumes, name):
    assert device_bytes(cli, shared_volumes / name) == on_device(shared_volumes / name)


def test_what_is_not_read_has_no_device_bytes(cli):
    report = cli("info", DATA / "several.vdb", "--json").json
    unread = [grid for grid in report["grids"] if grid["max"] is None]
    assert unread
    assert all(grid["device_bytes"] is None for grid in unread)


@pytest.mark.parametrize("name", ["negative", "tiles", "half", "sphere", "several"])
def test_figures_of_a_vdb_are_those_of_its_dense_array(cli, name):
    grids = [grid for grid in open_grids(DATA / f"{name}.vdb") if not grid.unsupported]
    report = cli("info", DATA / f"{name}.vdb", "--json").json["grids"]
    shown = [grid for grid in report if grid["max"] is not None]
    assert len(shown) == len(grids) > 0
    for grid, facts in zip(grids, shown, strict=True):
        values = grid.read()
        assert (facts["min"], facts["max"]) == (values.min(), values.max())
        assert facts["mean"] == pytest.approx(values.mean(dtype=np.float64), rel=1e-12)
        assert facts["active_voxels"] == grid.active_voxels
        assert facts["active_share"] == grid.active_voxels / values.size


@pytest.mark.parametrize(
    ("name", "active"), [("wdas_cloud_sixteenth.vdb", 415_642), ("cortex_smoke.vdb", 1_049_275)]
)
def test_real_volumes(cli, shared_volumes, name, active):
    (grid,) = cli("info", shared_volumes / name, "--json").json["grids"]
    assert grid["name"] == "density"
    assert grid["active_voxels"] == active
    assert grid["renders"] == "yes"


def test_a_level_set_says_why_it_does_not_render(cli, shared_volumes):
    (grid,) = cli("info", shared_volumes / "cortex_sphere.vdb", "--json").json["grids"]
    assert grid["class"] == "level set"
    assert "is a level set" in grid["renders"]


def test_terminal_codes_in_a_grid_name_are_not_printed(cli):
    np.savez("odd.npz", **{"\x1b[31mred\n": np.ones((2, 2, 2))})
    out = cli("info", "odd.npz").out
    assert r"grid '\x1b[31mred\n'" in out


def test_a_file_name_beyond_ascii(cli, cloud, folder):
    shutil.copy(cloud, folder / "wolke – é.npy")
    done = cli("info", "wolke – é.npy", "--json")
    assert json.loads(done.out)["file"] == "wolke – é.npy"


def of_voxels(value, **others):
    density = np.zeros((12, 12, 12))
    density[3:9, 3:9, 3:9] = value
    return {"density": density, **others}


COLOUR = np.ones((12, 12, 12, 3), np.float32)
VOLUMES = {
    "good": of_voxels(1.0),
    "faint": of_voxels(1e-26),
    "strong": of_voxels(3e38),
    "coloured": of_voxels(1.0, colour=COLOUR),
    "negative": of_voxels(-1.0),
    "not a number": of_voxels(np.nan),
    "infinite": of_voxels(np.inf),
    "beyond float32": of_voxels(1e60),
    "zero": of_voxels(0.0),
    "below float32": of_voxels(1e-60),
    "denormal": of_voxels(1e-40),
    "least": of_voxels(2e-45),
    "colour of 0": of_voxels(1.0, colour=0 * COLOUR),
    "negative colour": of_voxels(1.0, colour=-COLOUR),
    "colour of another shape": of_voxels(1.0, colour=COLOUR[1:]),
    "flat voxels": of_voxels(1.0, world_from_index=np.diag([1.0, 1, 0, 1])),
    "huge voxels": of_voxels(1.0, voxel_size=1e30),
    "beyond coordinates": of_voxels(1.0, voxel_size=5e14),
    "far away": of_voxels(1.0, origin=(1e14, 0, 0)),
    "tiny voxels": of_voxels(1.0, voxel_size=1e-30),
}


@pytest.mark.quick(*(name for name in VOLUMES if name not in ("coloured", "colour of 0")))
@pytest.mark.parametrize("arrays", VOLUMES.values(), ids=VOLUMES)
def test_info_says_what_render_says(cli, tiny, arrays):
    np.savez("v.npz", **arrays)
    (grid,) = cli("info", "v.npz", "--json").json["grids"]
    done = cli("render", "v.npz", "-o", "v.png", "--no-dither", *tiny)
    shows = done.code == 0 and np.asarray(PIL.Image.open("v.png")).max() > 0
    assert (grid["renders"] == "yes") is bool(shows)
    if not shows:
        said = grid["renders"].removeprefix("the picture is black: ")
        assert said in done.err


def test_more_bricks_than_any_device_indexes_do_not_render(cli, monkeypatch):
    np.save("v.npy", np.ones((3, 3, 3)))
    monkeypatch.setattr("tfm_cl.device.bricks.MAX_INDEX", 7)
    (grid,) = cli("info", "v.npy", "--json").json["grids"]
    assert grid["renders"] == "the volume has 8 bricks; kernels index 7"
    assert grid["device_bytes"] is None


def test_a_scene_is_told_of_by_another_command(refused, folder):
    (folder / "scene.toml").write_text("")
    assert "`tfm render scene.toml --print-config` tells all" in refused("info", "scene.toml")
