"""Sequences that are baked: their order, and scales that do not flicker."""

import numpy as np
from scenes import blobs

from tfm_cl.cli.bake import alike
from tfm_cl.scene.scene import Scene


def write(folder, number, density, temperature=None):
    """Write a frame, and return its path."""
    path = folder / f"smoke_{number}.npz"
    hot = {} if temperature is None else {"temperature": temperature * blobs()}
    np.savez(path, density=density * blobs(), voxel_size=0.1, **hot)
    return path


def test_the_deepest_and_the_hottest_frame_scale_all(folder):
    paths = [write(folder, 1, 1.0, 0.5), write(folder, 2, 4.0, 0.25)]
    alone = [alike([path], [], "fire")[0][0] for path in paths]
    files, shared = alike(paths, [], "fire")
    scales = [file.make(Scene).bodies[0].density_scale for file in files]
    assert scales[0] == scales[1] == alone[1].make(Scene).bodies[0].density_scale
    assert alone[0].make(Scene).bodies[0].density_scale > scales[0]
    kelvin = [file.medium.temperature_scale for file in files]
    assert kelvin[0] == kelvin[1] == alone[0].medium.temperature_scale < alone[1].medium.temperature_scale
    assert shared == {
        "volume.density_scale": scales[0],
        "medium.temperature_scale": kelvin[0],
        "medium.Le_scale": alone[0].medium.Le_scale,
    }
    # What was asked for stays.
    files, shared = alike(paths, [("volume.density_scale", 3.0)], "smoke")
    assert [file.make(Scene).bodies[0].density_scale for file in files] == [3.0, 3.0]
    assert shared == {}


def test_numbers_in_names_count(cli, folder):
    for number in (10, 9):
        write(folder, number, 1.0)
    (folder / "smoke_9.npz").write_bytes(b"broken")
    done = cli("bake", "smoke_10.npz", "smoke_9.npz", "-o", "sheet.png", "--what", "six-way")
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert done.err.startswith("tfm: smoke_9.npz: ")  # which is read first
    assert not list(folder.glob("sheet*"))
