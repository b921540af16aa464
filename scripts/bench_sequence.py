"""Measure sequences: ``python scripts/bench_sequence.py -o out/bench_sequence``.

- Overhead: frames per second of a sequence of 128³ voxels (VDB) at 640×360, beside the device seconds of its
  passes, once the program has started; with one process and with two; and where but the camera moves. What
  the device does ahead for the next frame, its voxels and looks at its lights' rays, is no pass of any. What
  else runs on the machine changes that, but hardly the CPU time of a frame, of all threads.
- Steadiness: a volume that moves by an eighth of a voxel from frame to frame, beside the dual march in twice
  the steps, whose pictures are its own: how far differences of successive frames are from those of these.
- Flicker of light from what glows (`medium.emission_lights`): the voxels of `fire.toml` are resampled an
  eighth of a voxel further in each frame; how far each frame is from halfway between its neighbours.

The figures are written to ``sequence.json`` and to stdout.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from skimage.metrics import structural_similarity

import tfm_cl as tfm
from tfm_cl.files.volume_io.writing import write_grids
from tfm_cl.files.volume_io.written_grid import WrittenGrid
from tfm_cl.metrics import LIT_ALPHA, WHITE_PERCENTILE
from tfm_cl.plan.plan import plan
from tfm_cl.scene.scene_file import SceneFile

VOLUMES = Path(__file__).resolve().parents[1] / "volumes"
FRAMES, FEW, EDGE = 56, 8, 128
RES = (640, 360)
DRIFT = np.array([0.125, 0.0625, 0.03125])
"""Voxels from frame to frame, along x, y and z."""
STEADY_FRAMES, STEADY_RES = 6, (320, 180)
GLOWING_FRAMES, GLOWING_RES, LIGHTS = 9, (160, 90), (16, 64)
BRIGHT = 0.01
"""Of the brightest pixel: those that are darker do not count as lit by what glows."""
FINER = 2
"""Times as many steps has the dual march."""

Figures = dict[str, Any]


def frames_in(folder: Path) -> None:
    """Write a plume of 128³ voxels that rises."""
    with np.load(VOLUMES / "plume.npz") as archive:
        found = archive["density"]
    voxels = np.zeros((EDGE, EDGE, EDGE), np.float32)
    part = tuple(slice(0, min(EDGE, size)) for size in found.shape)
    voxels[part] = found[part]
    for frame in range(1, FRAMES + 1):
        values = np.roll(voxels, frame, axis=1)
        grid = WrittenGrid("density", values, values > 0, np.eye(4))
        write_grids(folder / f"plume.{frame:04d}.vdb", [grid])


def rendered(folder: Path, frames: int, jobs: int, *, turns: bool) -> tuple[float, float, list[Figures]]:
    """Render some frames as a user does; returns the seconds, those of the CPU, and the figures of each."""
    size, figures = "x".join(map(str, RES)), folder / "figures.json"
    what = ["plume.0001.vdb", "--turntable", str(FRAMES)] if turns else ["plume.####.vdb"]
    command = [sys.executable, "-m", "tfm_cl", "render", *what, "--frames", f"1-{frames}"]
    command += ["--plan-frames", f"1-{FRAMES}", "-o", f"{'turn' if turns else 'a'}.####.exr", "--res", size]
    command += ["--look", "plain", "--jobs", str(jobs), "--json", figures.name, "-q"]
    started, before = time.perf_counter(), os.times()
    subprocess.run(command, cwd=folder, check=True)  # noqa: S603
    seconds, after = time.perf_counter() - started, os.times()
    cpu = sum(after[2:4]) - sum(before[2:4])
    return seconds, cpu, json.loads(figures.read_text())["frames"]


def overhead(folder: Path, jobs: int, *, turns: bool = False) -> Figures:
    """Compare the seconds of the frames after the first few with those of the device.

    ``turns``: only the camera moves.
    """
    rendered(folder, FEW, jobs, turns=turns)  # compiles, and decides what is left open
    begun, cpu_begun, _ = rendered(folder, FEW, jobs, turns=turns)
    whole, cpu_whole, of_frames = rendered(folder, FRAMES, jobs, turns=turns)
    seconds, count = whole - begun, FRAMES - FEW
    parts = {
        name: sum(found["seconds"].get(name, 0.0) for found in of_frames[FEW:])
        for name in ("load", "light_pass", "view_pass", "host", "save")
    }
    device = (parts["light_pass"] + parts["view_pass"]) / jobs  # each has its part of the cores
    return {
        "jobs": jobs,
        "moves": "the camera" if turns else "the volume",
        "frames": count,
        "start": begun,
        "seconds": seconds,
        "frames_per_second": count / seconds,
        "cpu_seconds_a_frame": (cpu_whole - cpu_begun) / count,
        "of_frames": parts,
        "device": device,
        "overhead": seconds / device - 1,
    }


def steadiness(path: Path, *, together: bool) -> Figures:
    """Compare the differences of successive frames with those of the dual march.

    ``together``: the basis learns once for all of them, as in a range.
    """
    file = SceneFile.read(path, [("camera.res", list(STEADY_RES))])
    scene = plan(file.make(tfm.Scene), file=file).scene
    (volume,) = scene.grids
    finer = scene.replace(
        march=scene.march.replace(steps=FINER * scene.march.steps),
        map=scene.map.replace(steps=FINER * scene.map.steps),
    )

    def at(frame: int, of: tfm.Scene) -> tfm.Scene:
        moved = np.eye(4)
        moved[:3, 3] = frame * DRIFT * volume.voxel_size
        return of.replace(volume=volume.transformed(moved))

    with tfm.Renderer() as renderer:
        if together:
            functions = renderer.functions_for([at(frame, scene) for frame in range(STEADY_FRAMES)])
            scene = scene.replace(map=scene.map.replace(functions=functions))
        mine = [renderer.render(at(frame, scene)).image for frame in range(STEADY_FRAMES)]
        exact = [renderer.render(at(frame, finer), method="dual").image for frame in range(STEADY_FRAMES)]
    lit = np.max([one[..., 3] for one in exact], axis=0) > LIT_ALPHA
    bright = float(np.mean([one[lit, :3] for one in exact]))

    def rms(pictures: list[np.ndarray]) -> float:
        return float(np.sqrt(np.mean([one[lit, :3].astype(np.float64) ** 2 for one in pictures]))) / bright

    steps = [
        (one - before, truth - truth_before)
        for (before, truth_before), (one, truth) in pairwise(zip(mine, exact, strict=True))
    ]
    white = float(np.percentile([one[..., :3].mean(axis=2) for one in exact], WHITE_PERCENTILE))
    ssim = [
        structural_similarity(  # type: ignore[no-untyped-call]
            one[..., :3].mean(axis=2), truth[..., :3].mean(axis=2), data_range=white
        )
        for one, truth in steps
    ]
    return {
        "volume": path.name,
        "learnt": "once" if together else "in each frame",
        "error": rms([one - truth for one, truth in zip(mine, exact, strict=True)]),
        "motion": rms([truth for _, truth in steps]),
        "temporal_error": rms([one - truth for one, truth in steps]),
        "temporal_ssim": min(map(float, ssim)),
    }


def fires(folder: Path) -> list[Path]:
    """Write frames of a fire that passes through its voxels."""
    with np.load(VOLUMES / "fire.npz") as archive:
        first = dict(archive)
    paths = []
    for frame in range(GLOWING_FRAMES):
        moved = {
            name: np.clip(ndimage.shift(first[name].astype(np.float32), frame * DRIFT[::-1], order=3), 0, 1)
            for name in ("density", "temperature")
        }
        paths.append(folder / f"fire.{frame:04d}.npz")
        np.savez(paths[-1], **(first | moved))
    return paths


def flicker(frames: list[Path], lights: int) -> Figures:
    """Compare each frame with the middle between its neighbours: the light of what glows, and the glow."""
    ground = {"shape": "plane", "point": [0, -1, 0], "albedo": [0.3, 0.28, 0.25]}
    asked = [("camera.res", list(GLOWING_RES)), ("image.samples", 1), ("medium.emission_lights", lights)]
    asked += [("light", []), ("image.background", [0, 0, 0]), ("solid", [ground])]
    with tfm.Renderer() as renderer:
        found = [
            renderer.render(
                SceneFile.read(VOLUMES / "fire.toml", [*asked, ("volume.file", str(path))]).make(tfm.Scene)
            )
            for path in frames
        ]

    def of(layer: str) -> float:
        seen = np.array([one.aovs[layer][..., :3] for one in found], np.float64)
        jumps = seen[1:-1] - (seen[:-2] + seen[2:]) / 2
        mean = seen.mean(axis=(0, 3))
        lit = mean > BRIGHT * seen.max()
        return float(np.sqrt((jumps[:, lit] ** 2).mean()) / mean[lit].mean())

    return {"lights": lights, "emission_light": of("emission_light"), "emission": of("emission")}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", dest="out", type=Path, required=True, help="folder of the results")
    parser.add_argument("--only", choices=["overhead", "steadiness", "flicker"], help="measure that alone")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    figures: Figures = {}
    if arguments.only in (None, "overhead"):
        frames_in(arguments.out)
        figures["overhead"] = [
            *(overhead(arguments.out, jobs) for jobs in (1, 2)),
            overhead(arguments.out, 1, turns=True),
        ]
    if arguments.only in (None, "steadiness"):
        names = "plume.npz", "cumulus.npz", "figure.npz"
        figures["steadiness"] = [
            steadiness(VOLUMES / name, together=together) for name in names for together in (False, True)
        ]
    if arguments.only in (None, "flicker"):
        frames = fires(arguments.out)
        figures["flicker"] = [flicker(frames, lights) for lights in LIGHTS]
    (arguments.out / "sequence.json").write_text(json.dumps(figures, indent=2) + "\n")
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
