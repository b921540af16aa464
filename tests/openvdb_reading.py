"""What OpenVDB itself reads from files, in a Python that has it."""

import functools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tfm_cl.files.volume_io import open_grids

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "make_vdb_fixtures.py"


@functools.cache
def openvdb_python():
    """A Python that has OpenVDB, or none."""
    for python in (sys.executable, shutil.which("python3", path="/usr/bin:/usr/local/bin")):
        command = [python, "-c", "import pyopenvdb"]
        if python and subprocess.run(command, check=False, capture_output=True).returncode == 0:
            return python
    return None


def ask_openvdb(*paths):
    if openvdb_python() is None:
        pytest.skip("no Python here has pyopenvdb (Debian: python3-openvdb)")
    subprocess.run([openvdb_python(), SCRIPT, "describe", *paths], check=True)


def assert_is_what_openvdb_reads(path):
    """Compare all grids of a file with its description, voxels bit for bit."""
    with np.load(path.with_suffix(".npz")) as archive:
        truth = dict(archive)
    facts = json.loads(str(truth["grids"]))
    grids = open_grids(path)
    assert len(grids) == len(facts)
    # OpenVDB sorts by name, and by place in the file within a name.
    clean = sorted(grids, key=lambda grid: grid.name.partition("[")[0])
    for index, (fact, grid) in enumerate(zip(facts, clean, strict=True)):
        assert grid.name.partition("[")[0] == fact["name"]
        assert grid.grid_class == fact["class"]
        if "frustum" in grid.unsupported:
            continue
        is_vector = grid.read_colour is not None
        assert bool(grid.unsupported) == is_vector
        background = list(grid.colour_background) if is_vector else grid.background
        assert background == fact["background"]
        assert grid.active_voxels == fact["active"]
        own, matrix = grid.world_from_index, truth[f"{index}_matrix"]
        low = np.rint(np.linalg.solve(matrix, own[:, 3])[:3]).astype(int)
        np.testing.assert_allclose(own[:3, :3], matrix[:3, :3], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(own[:3, 3], (matrix @ [*low, 1])[:3], rtol=1e-12, atol=1e-9)

        expected = truth[f"{index}_values"]
        ours = np.full_like(expected, background)
        z, y, x = (low - truth[f"{index}_low"])[::-1]
        assert min(x, y, z) >= 0
        values = grid.read_colour() if is_vector else grid.read()
        assert values.shape == (*grid.shape, 3)[: values.ndim]
        assert values.dtype == np.float32
        ours[tuple(slice(a, a + n) for a, n in zip((z, y, x), grid.shape, strict=True))] = values
        np.testing.assert_array_equal(ours.view(np.int32), expected.view(np.int32))
