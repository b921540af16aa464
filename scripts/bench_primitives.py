"""Measure particles and hair: ``python scripts/bench_primitives.py -o out/bench_primitives``.

- FOM's plume of 16,384 particles: a frame of 1280×800 with a new map of 512² and 7 Fourier coefficients, in
  units of the time for 60 million plain trilinear samples; its map by FOM (Fourier) and OSM (slices) at 256²,
  512² and 1024² (FOM Tables 1 and 2).
- A model of 10,000 strands (OSM, Plates): its map of 512² with 7 and 32 slices.
- Growth: frames of 10⁴ to 10⁶ points that fill a cube, and the memory of the process.
- The error of each basis at the primitives themselves, at equal bytes: the root mean square of T against the
  exact transmittance of the float64 reference.

Medians of interleaved rounds; the figures are written to ``primitives.json`` and to stdout.
"""

import argparse
import json
import resource
import statistics
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "volumes"))

import bench
import hair

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.maps.bases import BASES
from tfm_cl.scene.bodies.thin import thickness_of

VOLUMES = Path(__file__).resolve().parents[1] / "volumes"
FRAME = (1280, 800)
STEPS = 60
PLUME_SAMPLES, HAIR_SAMPLES = 60e6, 150e6
"""Trilinear samples in whose time a frame of the plume, and a map of the hair, should be done."""
COUNTS = (10_000, 100_000, 1_000_000)
BYTES = (16, 24, 40)
LOOKED_AT = 300
"""Primitives at which errors are measured, evenly spread over all."""
NUMBER_BYTES = {"nodes": 4, "nodes-t": 4}
"""Of float16: two, or four where a number is a depth and a transmittance."""

Figures = dict[str, Any]


def plume_scene() -> tfm.Scene:
    """Return FOM's plume in the light of a spot, with its settings."""
    held = np.load(VOLUMES / "particles.npz")
    points = tfm.Points(held["positions"], held["radius"], opacity=held["opacity"])
    settings = tfm.MapSettings(basis="fourier", coeffs=7, res=512, steps=STEPS)
    scene = tfm.Scene(points, map=settings, march=tfm.MarchSettings(steps=STEPS))
    return scene.replace(camera=scene.camera.replace(res=FRAME))


def hair_scene() -> tfm.Scene:
    """Return 10,000 strands in the light of a spot."""
    tuft = hair.STYLES["straight"].full_tuft()
    strands = tfm.Curves(tuft["points"], tuft["counts"], tuft["width"], opacity=0.6)
    settings = tfm.MapSettings(basis="slices", coeffs=32, res=512, steps=STEPS)
    return tfm.Scene(strands, map=settings, march=tfm.MarchSettings(steps=STEPS))


def moved(scene: tfm.Scene, number: int) -> tfm.Scene:
    """Move the light a little: no map that is there serves."""
    light = scene.lights[0].to_dict()
    place = np.add(light["from"], 1e-4 * number).tolist()
    return scene.replace(lights=[tfm.SpotLight(**light | {"from": place})])


def map_seconds(renderer: tfm.Renderer, scene: tfm.Scene, number: int) -> float:
    """Seconds of a new map, with the look at its rays that comes before."""
    small = scene.replace(camera=scene.camera.replace(res=(16, 16)))
    return float(renderer.render(moved(small, number)).stats.seconds["light_pass"])


def speed(renderer: tfm.Renderer, roofline: bench.Roofline, rounds: int) -> Figures:
    """Measure the plume's frame and maps, and the maps of hair, each in turn."""
    plume, strands = plume_scene(), hair_scene()
    maps = {
        f"{basis} {res}": plume.replace(map=plume.map.replace(basis=basis, coeffs=coeffs, res=res))
        for res in (256, 512, 1024)
        for basis, coeffs in (("fourier", 7), ("slices", 16))
    }
    maps |= {
        f"hair, {coeffs} slices": strands.replace(map=strands.map.replace(coeffs=coeffs))
        for coeffs in (7, 32)
    }
    found: dict[str, list[float]] = {name: [] for name in ("frame", *maps)}
    rates = []
    for number in range(rounds + 1):
        rates.append(roofline.measure()["gather_rate"])
        seconds = renderer.render(moved(plume, number)).stats.seconds
        found["frame"].append(seconds["light_pass"] + seconds["view_pass"])
        for name, scene in maps.items():
            found[name].append(map_seconds(renderer, scene, number))
    rate = statistics.median(rates[1:])
    medians = {name: statistics.median(values[1:]) for name, values in found.items()}
    return {
        "trilinear_samples_a_second": rate,
        "plume_frame_seconds": medians["frame"],
        "plume_frame_over_goal": medians["frame"] * rate / PLUME_SAMPLES,
        "hair_map_over_goal": medians["hair, 32 slices"] * rate / HAIR_SAMPLES,
        "map_seconds": {name: medians[name] for name in maps},
        "fom_over_osm": {
            res: medians[f"fourier {res}"] / medians[f"slices {res}"] for res in (256, 512, 1024)
        },
    }


def growth(renderer: tfm.Renderer, rounds: int) -> Figures:
    """Measure frames of points that fill a cube, each with as many neighbours."""
    rng, figures = np.random.default_rng(5), {}
    for count in COUNTS:
        points = tfm.Points(rng.random((count, 3)), 1.5 * count ** (-1 / 3), density=8.0)
        scene = tfm.Scene(points, map=tfm.MapSettings(res=512, steps=100), march=tfm.MarchSettings(steps=100))
        scene = scene.replace(camera=scene.camera.replace(res=(640, 360)))
        runs = [renderer.render(moved(scene, number)).stats.seconds for number in range(rounds + 1)][1:]
        figures[str(count)] = {
            "light_pass": statistics.median(run["light_pass"] for run in runs),
            "view_pass": statistics.median(run["view_pass"] for run in runs),
            "peak_memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }
    return figures


def errors(renderer: tfm.Renderer, scene: tfm.Scene) -> Figures:
    """Compare T at primitives, of strands just before they are crossed, with the exact one."""
    (body,) = scene.primitives
    (light,) = scene.lights
    chosen = np.linspace(0, len(body.positions) - 1, LOOKED_AT).astype(int)
    places = body.positions[chosen]
    to_light = np.asarray(light.to_dict()["from"]) - places
    to_light /= np.linalg.norm(to_light, axis=1, keepdims=True)
    places = places + 2 * thickness_of([body]) * to_light
    exact = np.exp(-exact_depths(scene, light, places))
    table: Figures = {}
    for name, basis in BASES.items():
        for nbytes in BYTES:
            most = nbytes // NUMBER_BYTES.get(name, 2)
            coeffs = max((n for n in basis.counts if n <= most), default=0)
            if coeffs:
                settings = tfm.MapSettings(basis=name, coeffs=coeffs, res=512, steps=200, storage="f16")
                (light_map,) = renderer.build_maps(scene.replace(map=settings))
                error = light_map.evaluate(places) - exact
                table.setdefault(name, {})[nbytes] = float(np.sqrt((error**2).mean()))
    return table


def exact_depths(scene: tfm.Scene, light: Any, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Optical depth between a light and points, in float64, a few at a time."""
    parts = np.array_split(points, max(1, len(points) // 20))
    return np.concatenate([reference.light_optical_depth(scene, light, part) for part in parts])


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Measure particles and hair.")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/bench_primitives"), metavar="DIR")
    parser.add_argument("--rounds", type=int, default=5, metavar="N")
    parser.add_argument("--device", metavar="NAME")
    options = parser.parse_args()
    with tfm.Renderer(options.device) as renderer:
        launcher = Launcher(choose_device(options.device))
        roofline = bench.Roofline(launcher, bench.roofline_grid(tfm.Volume.load(VOLUMES / "plume.npz")))
        report = {
            "speed": speed(renderer, roofline, options.rounds),
            "growth": growth(renderer, options.rounds),
            "rms_of_t": {
                "plume": errors(renderer, plume_scene()),
                "small tuft": errors(renderer, small_tuft()),
            },
        }
    options.output.mkdir(parents=True, exist_ok=True)
    text = json.dumps(report, indent=2)
    (options.output / "primitives.json").write_text(text + "\n", encoding="utf-8")
    print(text)


def small_tuft() -> tfm.Scene:
    """Return the sample tuft of straight hair, which the reference follows in a minute."""
    held = np.load(VOLUMES / "straight.npz")
    strands = tfm.Curves(held["points"], held["counts"], held["width"], opacity=0.6)
    return tfm.Scene(strands, map=tfm.MapSettings(res=512, steps=STEPS))


if __name__ == "__main__":
    main()
