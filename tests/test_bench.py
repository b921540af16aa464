"""The benchmark: what it counts is right, and a small run ends with all figures. Speed is not asserted."""

import importlib.util
import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs, make_scene, turned

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "bench.py"

RAYS, STEPS = 30, 110  # not a multiple of a tile
SUM = 1e-4
"""Of the largest sum: positions near 100 in float32, added up a hundred times, are off by 1e-4 of a voxel at
most, and the test's voxels differ by 1 from one to the next."""
PLAIN_C = 2e-5
"""Relative RMSE of two float32 marches with the same samples, which round in another order: measured 2e-6."""


def load(name):
    spec = importlib.util.spec_from_file_location(name, SCRIPT.with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def bench():
    yield load("bench")
    del sys.modules["bench"]


@pytest.fixture(scope="module")
def scale():
    yield load("bench_scale")
    del sys.modules["bench_scale"]


def sums_by_numpy(grid):
    """The same rays, [y, x], in float64."""
    y, x = np.meshgrid(*[np.arange(RAYS) / RAYS] * 2, indexing="ij")
    total = np.zeros((RAYS, RAYS))
    for step in range(1, STEPS + 1):
        at = [10 + 100 * u + step * (u - 0.5) * 0.1 for u in (x, y)] + [np.full_like(x, 2 + step)]
        cell = [np.floor(a).astype(int) for a in at]
        part = [a - c for a, c in zip(at, cell, strict=True)]
        for corner in np.ndindex(2, 2, 2):
            weight = math.prod(f if up else 1 - f for f, up in zip(part, corner, strict=True))
            i, j, k = (c + up for c, up in zip(cell, corner, strict=True))
            total += weight * grid[k, j, i]
    return total


@pytest.mark.parametrize("form", ["gather", "pairs"])
def test_roofline_sums_trilinear_samples(bench, device_name, rng, form):
    grid = rng.random((bench.GRID_EDGE,) * 3, dtype=np.float32)
    device = choose_device(device_name)
    expected = sums_by_numpy(grid)
    for lanes in Launcher(device).lanes_possible:
        launcher = Launcher(device, ("-Werror",), lanes=lanes)
        found = bench.Roofline(launcher, grid, RAYS).sums(form, STEPS)
        np.testing.assert_allclose(found, expected, rtol=0, atol=SUM * expected.max())


def test_roofline_counts_its_samples(bench, device_name):
    grid = np.ones((bench.GRID_EDGE,) * 3, np.float32)
    roofline = bench.Roofline(Launcher(choose_device(device_name)), grid)
    figures = roofline.measure()

    for form in bench.FORMS:
        samples = roofline.sums(form).sum(dtype=np.float64)
        assert figures[f"{form}_rate"] * figures[f"{form}_seconds"] == pytest.approx(samples)
    assert roofline.shares("a", 1.0)["a_share_of_gather"] == 1 / figures["gather_rate"]


def test_a_volume_fills_the_roofline_grid(bench):
    data = np.arange(1, 4 * 5 * 150 + 1, dtype=np.float32).reshape(4, 5, 150)
    grid = bench.roofline_grid(tfm.Volume(data))

    assert grid.shape == (bench.GRID_EDGE,) * 3
    np.testing.assert_array_equal(grid[1:5, 1:6, 1:], data[..., :128])
    assert np.count_nonzero(grid) == 4 * 5 * 128


@pytest.mark.parametrize("at", [(0.6, 0.8, 4.2), (0.05, 0.1, 0.0), (0.6, 0.8, 40.0)])
def test_pixels_that_meet_the_bounds(bench, at):
    camera = tfm.Camera(from_=at, to=(0.1, 0.1, 0.1), fov=38, res=(24, 18))
    scene = make_scene(camera=camera)
    begin, end = reference.march_bounds(scene.volume, *reference.camera_rays(camera))

    assert bench.pixels_that_meet(scene) == np.count_nonzero(begin < end) > 0


def test_lights_share_the_intensity(bench):
    scene = bench.with_lights(make_scene(), 4)
    (first, *_), to = scene.lights, np.zeros(3)

    assert len(scene.lights) == 4
    np.testing.assert_allclose(first.intensity, np.array((3, 2.5, 2)) / 4)
    away = [np.linalg.norm(np.subtract(light.from_, to)) for light in scene.lights]
    np.testing.assert_allclose(away, away[0])
    assert len({light.from_ for light in scene.lights}) == 4


def test_rounds_end_in_time(bench, capsys):
    often, rarely = [], []
    every = bench.Measurement("a", lambda: {"x": often.append(1) or len(often)})
    third = bench.Measurement("b", lambda: {"x": rarely.append(1) or 1.0}, every=3)
    rounds = bench.measure_in_turn([every, third, every], 4, deadline=math.inf)

    assert (rounds, len(often), len(rarely)) == (4, 8, 2)
    assert every.to_dict()["figures"]["x"] == {"median": 4.5, "samples": [1, 2, 3, 4, 5, 6, 7, 8]}
    assert bench.measure_in_turn([every], 4, deadline=0) == 1
    assert "the time is up" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_plain_c_renders_the_same(bench, renderer, tmp_path):
    volume = tfm.Volume(
        blobs(), world_from_index=turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (9, 0, 3)), density_scale=4
    )
    scene = bench.near_light(bench.baseline_scene(volume, (96, 54)))
    scene = bench.with_march(scene, sampling="world")  # steps of equal length
    # Its edge within the medium: the camera looks through what is not lit.
    light = scene.lights[0].replace(cone=3.0)
    for variant in (scene, scene.replace(lights=(light,))):
        _, image = bench.PlainC(variant, tmp_path).run((96, 54))
        assert bench.error_of(image, renderer.render(variant, method="dual").image) < PLAIN_C


def test_distant_light_is_parallel(bench):
    scene = bench.baseline_scene(tfm.Volume(blobs()), (48, 27))
    light, axis, distance = bench.spot_of(bench.distant_light(scene))
    low, high = scene.volume.occupied_bounds
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T - light.from_
    angles = np.degrees(
        np.arccos(np.clip(corners @ axis / distance / np.linalg.norm(corners, axis=1), -1, 1))
    )

    assert angles.max() < light.cone < 0.1


def figures_of(report):
    for group in ("rooflines", "frames", "host", "peers"):
        for row in report[group]:
            for name, figure in row["figures"].items():
                yield f"{group} {row['name']} {name}", [figure["median"], *figure["samples"]]
    for volume, row in report["errors"]["relative_rmse_lit"].items():
        yield f"errors {volume}", list(row.values())


def run_script(*arguments):
    command = [sys.executable, "-W", "error", str(SCRIPT), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_a_quick_run(tmp_path):
    np.savez(tmp_path / "blobs.npz", density=blobs((40, 36, 44)))
    arguments = ("--quick", "--res", "64x36", "--volumes", tmp_path / "blobs.npz", "--peers", "-o", tmp_path)
    run = run_script(*arguments)
    assert run.returncode == 0, run.stderr
    report = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))

    assert set(report) == {
        *("machine", "rounds", "seconds", "baseline", "rooflines", "frames", "host", "errors"),
        *("peers", "peers_absent"),
    }
    assert report["rounds"] == 3
    assert report["machine"]["cores"] >= 1
    figures = dict(figures_of(report))
    assert len(figures) > 30
    assert [name for name, values in figures.items() if not all(0 < v < math.inf for v in values)] == []
    frame = report["frames"][0]["figures"]
    assert len(frame["view_seconds"]["samples"]) == 3
    assert len(frame["dual_over_frame"]["samples"]) == 2
    assert frame["view_nominal"]["median"] <= 64 * 36 * 100
    assert frame["light_reads"]["median"] <= frame["light_nominal"]["median"] <= 1024**2 * 100
    assert {row["name"] for row in report["peers"]} >= {"tfm_cl tfm", "tfm_cl dual"}
    assert "vdb_render" in report["peers_absent"]  # no .vdb
    for expected in ("roofline", "blobs", "cold_compile", "relative RMSE", "peer (light)"):
        assert expected in run.stdout


@pytest.mark.slow
def test_plots_of_every_parameter(bench, device_name, tmp_path):
    """The whole set of variations, tiny."""
    np.savez(tmp_path / "blobs.npz", density=blobs((20, 18, 22)))
    arguments = ("--res", "32x18", "--repeats", "1", "--volumes", tmp_path / "blobs.npz", "-o", tmp_path)
    run = run_script(*arguments)
    assert run.returncode == 0, run.stderr
    report = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))

    varied = {row["varied"] for row in report["frames"]}
    assert varied == {*bench.PARAMETERS, None, "auto", "lattice", "auto lights"}
    varied &= set(bench.PARAMETERS)
    assert {row["lanes"] for row in report["rooflines"]} == set(
        Launcher(choose_device(device_name)).lanes_possible
    )
    assert {path.name for path in tmp_path.glob("*.png")} == {f"bench_{name}.png" for name in varied}
    figures = dict(figures_of(report))
    assert [name for name, values in figures.items() if not all(0 < v < math.inf for v in values)] == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--res", "0x5"], "WIDTHxHEIGHT"),
        (["--repeats", "0"], "number > 0"),
        (["--minutes", "nan"], "number > 0"),
        (["--quick", "--volumes", "none.vdb"], "none.vdb"),
    ],
)
def test_wrong_use(bench, capsys, tmp_path, arguments, message):
    try:
        code = bench.main([*arguments, "-o", str(tmp_path / "out")])
    except SystemExit as stopped:
        code = stopped.code

    assert code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]


def test_each_curve_of_the_scale_grows(scale):
    cases = scale.cases()

    assert {case.grows for case in cases} == {"voxels", "pixels", "texels", "grids"}
    assert len({(case.grows, case.name) for case in cases}) == len(cases)
    assert max(case.size for case in cases if case.grows == "pixels") == 4096 * 2304
    assert len(scale.side_by_side(4).grids) == 4
    low, high = scale.side_by_side(4).bounds
    assert high - low == pytest.approx(np.ptp(scale.side_by_side(1).bounds, axis=0) * (2, 1, 2))


def test_a_tenth_of_the_sparse_grid_is_active(scale):
    voxels = scale.sparse(256)

    assert voxels.shape == (256, 256, 256)
    assert (voxels > 0).mean() == pytest.approx(0.1, abs=0.01)


@pytest.mark.slow
def test_a_case_of_the_scale_is_measured(scale, device_name, tmp_path):
    case = scale.Case("pixels", 16 * 9, "16×9", lambda: scale.cumulus((16, 9), texels=32))
    row = scale.measure(case, device_name)

    assert row["name"] == "16×9"
    assert min(row[key] for key in ("light", "view", "light_reads", "view_reads", "peak_gib")) > 0
    scale.plot([row, row | {"size": 288}], tmp_path / "scale.png")
    assert (tmp_path / "scale.png").stat().st_size > 1000
