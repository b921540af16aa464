"""Measure shadow mapping and many lights: ``python scripts/bench_lights.py -o out/bench_lights``.

- The frame of TFM Fig. 9: 1280×720, 200 steps, a shadow map of 1024², one light, 100,000 triangles, in fog of
  constant density: seconds of the view pass and of tracing, beside the time for the same number of plain
  trilinear samples.
- TFM Fig. 5: ten samples in projective space and ten in the world, SSIM compared with 1000 samples.
- Many small spots in fog: seconds and memory against their number, and against one frame per light; the same
  with two solids among them.

Medians of interleaved rounds; the figures are written to ``lights.json`` and to stdout.
"""

import argparse
import json
import resource
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "volumes"))

import bench
import props

import tfm_cl as tfm
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher

VOLUMES = Path(__file__).resolve().parents[1] / "volumes"
FRAME = (1280, 720)
STEPS = 200
TRIANGLES = 100_000
SHADOW_RES = 1024
FIG5_SAMPLES, FIG5_TRUTH = 10, 1000
COUNTS = (1, 10, 100, 1000, 3000)
LAMPS_FRAME, LAMPS_STEPS = (960, 540), 50
SINGLES = 50
"""Number of lights that are also rendered alone."""
KNOT = 10_000
"""Triangles of the knot among the lamps."""
AREA = 30.0
"""Edge of the square in which the lamps stand, world units."""

Figures = dict[str, Any]


def median_of(work: Callable[[], float], rounds: int) -> float:
    """Run once to warm up, then ``rounds`` times; returns the median of the results."""
    work()
    return statistics.median(work() for _ in range(rounds))


def seconds_of(renderer: tfm.Renderer, scene: tfm.Scene, what: str) -> float:
    """Render, and return the seconds of one of the stages."""
    return renderer.render(scene).stats.seconds[what]


def knot_of(triangles: int) -> tfm.MeshSolid:
    """Return the sample knot with at least this many triangles."""
    props.ALONG = -(-triangles // (2 * props.AROUND))
    vertices, faces = props.knot()
    return tfm.MeshSolid.from_arrays(1.6 * vertices + (0, 1, 0), faces, albedo=0.7)


def shadow_mapping(renderer: tfm.Renderer, rate: float, rounds: int) -> Figures:
    """Measure the frame of Fig. 9; `rate` is that of trilinear samples per second."""
    figures: Figures = {}
    scene = tfm.Scene(
        tfm.BoxVolume(from_=(-3, 0, -3), to=(3, 3.4, 3), density=0.2),
        camera=tfm.Camera(from_=(2.2, 1.2, 5.2), to=(0, 1.1, 0), fov=44, res=FRAME),
        lights=[tfm.SpotLight(from_=(-2.6, 3.6, -2.9), to=(0.1, 0.9, 0.2), cone=24, intensity=(30, 30, 30))],
        march=tfm.MarchSettings(steps=STEPS),
        solids=[knot_of(TRIANGLES), tfm.PlaneSolid()],
        shadow=tfm.ShadowSettings(res=SHADOW_RES),
    )
    for name in ("pcf", "nearest"):
        asked = scene.replace(shadow=tfm.ShadowSettings(res=SHADOW_RES, filter=name))
        first = renderer.render(asked)
        seconds = median_of(partial(seconds_of, renderer, asked, "view_pass"), rounds)
        samples = first.stats.samples["view_pass"]
        figures[name] = {
            "seconds": seconds,
            "samples": samples,
            "samples_a_second": samples / seconds,
            "part_of_trilinear": seconds / (samples / rate),
            "part_of_trilinear_for_whole_frame": seconds / (FRAME[0] * FRAME[1] * STEPS / rate),
            "first_frame_trace_seconds": first.stats.seconds["trace"],
        }

    def moved() -> float:
        """Render with a new camera and a new light: everything is traced again."""
        away = 1e-3 * time.perf_counter() % 1e-2
        light = scene.lights[0].replace(from_=(-2.6 + away, 3.6, -2.9))
        camera = scene.camera.replace(from_=(2.2 + away, 1.2, 5.2))
        return renderer.render(scene.replace(camera=camera, lights=[light])).stats.seconds["trace"]

    return figures | {"trace_seconds_of_a_moved_frame": median_of(moved, rounds)}


def projective_sampling(renderer: tfm.Renderer) -> Figures:
    """Compare ten samples in projective space and in the world with a thousand (Fig. 5)."""
    scene = tfm.Scene.load(VOLUMES / "projector.toml")

    def image(sampling: str, steps: int) -> Any:
        return renderer.render(scene.replace(march=scene.march.replace(sampling=sampling, steps=steps))).image

    truth = image("projective", FIG5_TRUTH)
    figures = {}
    for sampling in ("projective", "world"):
        found = tfm.compare(image(sampling, FIG5_SAMPLES), truth)
        figures[sampling] = {"ssim": found.ssim, "psnr": found.psnr}
    return figures


def lamps(count: int) -> tfm.Scene:
    """Return small spots in fog, seen from above their square."""
    rng = np.random.default_rng(11)
    place = np.column_stack(
        [rng.uniform(-AREA / 2, AREA / 2, count), np.ones(count), rng.uniform(-AREA / 2, AREA / 2, count)]
    )
    aim = place + np.column_stack([rng.normal(0, 0.2, count), -np.ones(count), rng.normal(0, 0.2, count)])
    lights = [
        tfm.SpotLight(from_=at, to=to, cone=20, blend=0.3, reach=1.0, falloff="inverse-square")
        for at, to in zip(place, aim, strict=True)
    ]
    return tfm.Scene(
        tfm.BoxVolume(from_=(-AREA, 0, -AREA), to=(AREA, 2, AREA), density=0.05),
        camera=tfm.Camera(from_=(0, 9, 26), to=(0, 0, 0), fov=45, res=LAMPS_FRAME),
        lights=lights,
        march=tfm.MarchSettings(steps=LAMPS_STEPS),
    )


def many_lights(renderer: tfm.Renderer, rounds: int) -> Figures:
    """Measure frames with more and more lights, and one frame per light."""
    figures: Figures = {}
    for count in COUNTS:
        scene = lamps(count)
        passes = median_of(partial(seconds_of, renderer, scene, "view_pass"), rounds)
        whole = median_of(partial(seconds_of, renderer, scene, "total"), rounds)
        figures[str(count)] = {
            "view_pass_seconds": passes,
            "seconds": whole,
            "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }
    most = lamps(COUNTS[-1])
    figures |= against_singles(renderer, most, figures[str(COUNTS[-1])]["seconds"])
    return figures | {"with_solids": lights_among_solids(renderer, most, rounds)}


def against_singles(renderer: tfm.Renderer, scene: tfm.Scene, seconds: float) -> Figures:
    """Compare the seconds of a frame with one frame for each of its lights, some of which are rendered."""
    lights = scene.lights[:: len(scene.lights) // SINGLES]
    single = statistics.median(seconds_of(renderer, scene.replace(lights=[one]), "total") for one in lights)
    return {"single_frame_seconds": single, "part_of_single_frames": seconds / (single * len(scene.lights))}


def lights_among_solids(renderer: tfm.Renderer, scene: tfm.Scene, rounds: int) -> Figures:
    """Measure many lights that reach a floor and a knot: the first frame, and when all has been traced."""
    floor = tfm.PlaneSolid(point=(0, 0.3, 0))
    scene = scene.replace(solids=[floor, knot_of(KNOT)])
    renderer.render(scene.replace(lights=scene.lights[:1]))  # which compiles
    first = renderer.render(scene).stats
    whole = median_of(partial(seconds_of, renderer, scene, "total"), rounds)
    return {
        "first_frame_seconds": first.seconds["total"],
        "first_frame_trace_seconds": first.seconds["trace"],
        "shadow_maps": first.made.get("shadow map", 0),
        "view_pass_seconds": median_of(partial(seconds_of, renderer, scene, "view_pass"), rounds),
        "trace_seconds": seconds_of(renderer, scene, "trace"),
        "seconds": whole,
    } | against_singles(renderer, scene, whole)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Measure shadow mapping and many lights.")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/bench_lights"), metavar="DIR")
    parser.add_argument("--rounds", type=int, default=5, metavar="N")
    parser.add_argument("--device", metavar="NAME")
    options = parser.parse_args()
    with tfm.Renderer(options.device) as renderer:
        launcher = Launcher(choose_device(options.device))
        grid = bench.roofline_grid(tfm.Volume.load(VOLUMES / "plume.npz"))
        roofline = bench.Roofline(launcher, grid)
        rate = statistics.median(roofline.measure()["gather_rate"] for _ in range(options.rounds + 1))
        report = {
            "trilinear_samples_a_second": rate,
            "shadow_mapping": shadow_mapping(renderer, rate, options.rounds),
            "projective_sampling": projective_sampling(renderer),
            "many_lights": many_lights(renderer, options.rounds),
        }
    options.output.mkdir(parents=True, exist_ok=True)
    text = json.dumps(report, indent=2)
    (options.output / "lights.json").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
