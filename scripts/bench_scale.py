#!/usr/bin/env python3
"""Measure how cost grows: ``python scripts/bench_scale.py -o out/bench``.

Voxels up to the paper's cloud of 600×200×400 and a sparse grid of 1024³, pictures up to 4096×2304, maps up to
4096² and scenes of up to 16 grids; all else is the baseline of ``bench.py``. Every case runs in a process of
its own, so that its peak of memory is its own: of the whole process, with the volume as NumPy made it.
``--quick`` leaves out what takes gigabytes. Seconds are medians; the figures are written to ``scale.json``
and to stdout, and plotted.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))

import bench

import tfm_cl as tfm
from tfm_cl.scene.optical_depth import density_scale_for

CUMULUS = Path(__file__).resolve().parents[1] / "volumes" / "cumulus.npz"
PAPER_CLOUD = (400, 200, 600)
"""Voxels z, y, x of the cloud of TFM section 5."""
SPARSE_EDGE, SPARSE_ACTIVE = 1024, 0.1
TILE_EDGE = 64
"""Voxels along the pieces of density that are strewn over the sparse grid."""
ROUNDS = 3
LARGE = 1 << 28
"""Voxels from which on a case takes gigabytes."""

Figures = dict[str, Any]


class Case(NamedTuple):
    """One point of one curve."""

    grows: str
    """What is varied."""
    size: float
    """On the curve's axis."""
    name: str
    make: Callable[[], tfm.Scene]


def smooth(shape: tuple[int, int, int], seed: int = 1) -> NDArray[np.float32]:
    """Return a cloud that fills a box: a few waves in each direction, cut off below zero."""
    random = np.random.default_rng(seed)
    z, y, x = (np.linspace(-1, 1, count, dtype=np.float32) for count in shape)
    waves = np.zeros(shape, np.float32)
    for _ in range(6):
        frequency, phase = random.uniform(2, 12, 3), random.uniform(0, 2 * np.pi, 3)
        along = [
            np.sin(f * t + p, dtype=np.float32) for f, t, p in zip(frequency, (z, y, x), phase, strict=True)
        ]
        waves += along[0][:, None, None] * along[1][:, None] * along[2]
    inside = 1 - (z**2)[:, None, None] - (y**2)[:, None] - x**2
    cloud: NDArray[np.float32] = np.maximum(waves + 0.3, 0) * np.maximum(inside, 0)
    return cloud


def sparse(edge: int) -> NDArray[np.float32]:
    """Return a cube of voxels in which pieces of cloud fill `SPARSE_ACTIVE` of the room."""
    random, tiles = np.random.default_rng(2), edge // TILE_EDGE
    piece = smooth((TILE_EDGE,) * 3)
    filled = float((piece > 0).mean())
    voxels = np.zeros((edge,) * 3, np.float32)
    for place in random.permutation(tiles**3)[: round(SPARSE_ACTIVE / filled * tiles**3)]:
        z, y, x = (slice(i * TILE_EDGE, (i + 1) * TILE_EDGE) for i in np.unravel_index(place, (tiles,) * 3))
        voxels[z, y, x] = piece
    return voxels


def scene_of(voxels: Callable[[], NDArray[np.float32]]) -> tfm.Scene:
    """Return the baseline with other voxels, 2 units long."""
    density = voxels()
    volume = tfm.Volume(density, voxel_size=2 / max(density.shape))
    volume = volume.with_density_scale(density_scale_for(volume))
    return bench.baseline_scene(volume, bench.BASELINE_RES)


def cumulus(res: tuple[int, int] = bench.BASELINE_RES, texels: int = 1024) -> tfm.Scene:
    """Return the baseline of the sample cloud, with a picture and a map of other sizes."""
    return bench.with_map(bench.baseline_scene(bench.load(CUMULUS), res), res=texels)


def side_by_side(count: int) -> tfm.Scene:
    """Return the baseline of some clouds in a square."""
    cloud, row = bench.load(CUMULUS), round(count**0.5)
    size = np.ptp(cloud.bounds, axis=0)
    clouds = []
    for number in range(count):
        moved = np.eye(4)
        moved[:3, 3] = size * (number % row, 0, number // row)
        clouds.append(cloud.transformed(moved))
    scene = tfm.Scene(clouds, map=bench.BASELINE_MAP, march=bench.BASELINE_MARCH)
    return bench.with_res(scene, bench.BASELINE_RES)


def cases() -> list[Case]:
    """List all, each curve from small to large."""

    def cubes(edge: int) -> Callable[[], tfm.Scene]:
        return partial(scene_of, partial(smooth, (edge,) * 3))

    def image(width: int) -> tuple[int, int]:
        return width, width * 9 // 16

    paper = partial(scene_of, partial(smooth, PAPER_CLOUD))
    huge = partial(scene_of, partial(sparse, SPARSE_EDGE))
    return [
        *(Case("voxels", edge**3, f"{edge}³", cubes(edge)) for edge in (64, 128, 256, 512)),
        Case("voxels", float(np.prod(PAPER_CLOUD)), "600×200×400", paper),
        Case("voxels", SPARSE_EDGE**3, f"{SPARSE_EDGE}³, 10 % active", huge),
        *(
            Case(
                "pixels",
                float(np.prod(image(width))),
                "{}×{}".format(*image(width)),
                partial(cumulus, image(width)),
            )
            for width in (640, 1280, 2560, 4096)
        ),
        *(
            Case("texels", texels**2, f"{texels}²", partial(cumulus, texels=texels))
            for texels in (512, 1024, 2048, 4096)
        ),
        *(Case("grids", count, str(count), partial(side_by_side, count)) for count in (1, 4, 9, 16)),
    ]


def measure(case: Case, device: str | None) -> Figures:
    """Render one case a few times; in a process of its own."""
    scene = case.make()
    rounds: list[Figures] = []
    with tfm.Renderer(device) as renderer:
        for _ in range(1 + ROUNDS):
            began = time.perf_counter()
            maps = renderer.build_maps(scene)
            result = renderer.render(scene, maps=maps)
            seconds = time.perf_counter() - began
            light = sum(one.buffers.seconds for one in maps)
            view = result.stats.seconds["view_pass"]
            rounds.append({"light": light, "view": view, "host": seconds - light - view})
        name = renderer.device_name
    figures = {key: statistics.median(one[key] for one in rounds[1:]) for key in rounds[0]}
    reads = {
        "light_reads": sum(one.buffers.samples for one in maps),
        "view_reads": result.stats.samples["view_pass"],
    }
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return (
        {"grows": case.grows, "size": case.size, "name": case.name}
        | figures
        | reads
        | {
            "peak_gib": peak,
            "device": name,
        }
    )


def _measure(number: int, device: str | None) -> Figures:
    return measure(cases()[number], device)


def plot(rows: list[Figures], path: Path) -> None:
    """Draw seconds against each size, and lines of proportional growth."""
    kinds = list(dict.fromkeys(row["grows"] for row in rows))
    figure = Figure(figsize=(3.6 * len(kinds), 3.6), dpi=120, layout="constrained")
    for axes, kind in zip(np.atleast_1d(figure.subplots(1, len(kinds))), kinds, strict=True):
        of_kind = sorted((row for row in rows if row["grows"] == kind), key=lambda row: row["size"])
        sizes = [row["size"] for row in of_kind]
        for key, colour, marker in (("light", "#0072B2", "o"), ("view", "#D55E00", "s")):
            axes.plot(sizes, [row[key] for row in of_kind], color=colour, marker=marker, label=f"{key} pass")
        first = of_kind[0]["light"] + of_kind[0]["view"]
        axes.plot(sizes, [first * size / sizes[0] for size in sizes], "k:", label="proportional")
        axes.set(xscale="log", yscale="log", xlabel=kind, ylabel="seconds")
    axes.legend()
    figure.savefig(path)


def main() -> int:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/bench"), help="folder for the results")
    parser.add_argument("--device", help="part of the device's name")
    parser.add_argument("--quick", action="store_true", help="leave out what takes gigabytes")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    rows = []
    print(f"{'':28}{'light s':>9}{'view s':>9}{'host s':>9}{'peak GiB':>10}")
    for number, case in enumerate(cases()):
        if options.quick and case.grows == "voxels" and case.size >= LARGE:
            continue
        with multiprocessing.get_context("spawn").Pool(1) as alone:
            row = alone.apply(_measure, (number, options.device))
        rows.append(row)
        label = f"{row['grows']} {row['name']}"
        print(
            f"{label:28}{row['light']:9.3f}{row['view']:9.3f}{row['host']:9.3f}{row['peak_gib']:10.2f}",
            flush=True,
        )
    (options.output / "scale.json").write_text(json.dumps(rows, indent=1) + "\n")
    plot(rows, options.output / "scale.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
