import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

DATA = Path(__file__).resolve().parents[1] / "volume_io" / "data"

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
    assert grid["device_bytes"] == 4 * 18 * 14 * 16
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
    assert "device bytes 16,128" in lines


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
    assert "nan" not in cli("info", "nan.npy").out.replace("nan.npy", "")


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
