#!/usr/bin/env python3
"""Check a GPU against the CPU, and measure it: ``scripts/gpu_check.sh`` on a machine that has one.

Pictures of the benchmark's baseline and of a few small scenes (every basis, kinds of bodies, lights and
solids) are rendered by both devices and compared; then the baseline is measured on the GPU as ``bench.py``
does it. Writes ``gpu_check.json`` and ``gpu_check.md`` and prints the latter. Exit codes: 0 good, 1 a picture
differs or is not rendered, 2 wrong use, 3 no such device.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import bench

import tfm_cl as tfm
from tfm_cl.device.device import DeviceInfo, choose_device, list_devices
from tfm_cl.device.launch import Launcher
from tfm_cl.errors import InputError, NoDeviceError
from tfm_cl.files.paths import write_text
from tfm_cl.maps.bases import BASES

LARGEST_RMSE = 1e-3
"""Relative RMSE between the devices' pictures. Both march the same steps in float32 and differ in rounding
only: sums in another order, fused operations, divisions and square roots to 3 ulp, as OpenCL allows. That
makes up to 1.4e-5 between 1 and 8 lanes of a CPU, most of it where rounding decides whether a step at the
edge of a cone, of a shadow or of the cutoff counts. A quarter of the smallest error of a map, so that what
passes is the same picture; mistakes are far above."""
LEAST_SSIM = 0.9999
"""Likewise for structure: an edge that is off by a pixel makes 0.99."""

SCENES = (
    *("storage f16", "storage u8", "dual", "sampling world", "Henyey-Greenstein", "camera inside"),
    "phase functions",
    *("many lights", "many lights, dual", "other lights", "solids", "solids, learnt basis"),
    *("several volumes", "fog in a box, solids", "fog in a sphere", "fog everywhere"),
    *("grid in fog, tfm", "grid in fog, dual", "two tints, tfm", "coloured grid in a box, tfm"),
    *("two bodies, tfm", "mixture, other lights, solids", "no light", "evaluate"),
)
"""Those that are compared of what the tests render on a simulated GPU."""
BASIS_RES = (48, 27)

Maker = Callable[[tfm.Renderer], NDArray[Any]]
"""What a renderer makes: a picture, or numbers."""


@dataclass(frozen=True)
class Compared:
    """A picture of both devices."""

    name: str
    rmse: float | None = None
    """Relative to the mean of the CPU's."""
    ssim: float | None = None
    """Of pictures that are large enough."""
    failed: str = ""
    """Why there is no picture."""

    @property
    def good(self) -> bool:
        """Whether they are the same but for rounding."""
        same = self.rmse is not None and self.rmse <= LARGEST_RMSE
        return same and (self.ssim is None or self.ssim >= LEAST_SSIM)


def find_device(name: str | None) -> DeviceInfo:
    """Return the device of that name, or the first GPU.

    Raises
    ------
    NoDeviceError
        There is none.
    """
    devices = list_devices()
    if name is not None:
        wanted = choose_device(name).name.strip()
        return next(device for device in devices if device.name == wanted)
    for device in devices:
        if device.kind == "GPU":
            return device
    names = ", ".join(f"'{device.platform}: {device.name}'" for device in devices) or "no device at all"
    raise NoDeviceError(
        f"no GPU among the OpenCL devices, but {names}; install its driver's OpenCL, or name a device"
    )


def find_cpu() -> DeviceInfo:
    """Return the CPU that pictures are compared with.

    Raises
    ------
    NoDeviceError
        There is none.
    """
    for device in sorted(list_devices(), key=lambda device: not device.default):
        if device.kind == "CPU":
            return device
    raise NoDeviceError("no OpenCL device of a CPU to compare with; pip install 'pyopencl[pocl]'")


# Pictures.


def scenes() -> dict[str, Maker]:
    """Return what is compared, by name."""
    cases = importlib.import_module("oracles.oclgrind_run").CASES
    return {name: cases[name] for name in SCENES} | {f"basis {name}": of_basis(name) for name in BASES}


def of_basis(basis: str) -> Maker:
    """Return how to render a lumpy ball through maps of a basis."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in (20, 22, 24)), indexing="ij")
    density = np.clip(1 - x**2 - y**2 - z**2, 0, 1) * (1 + np.sin(9 * x) * np.sin(7 * y + 8 * z))
    light_map = tfm.MapSettings(basis=basis, res=48, steps=32, density_weighting=10.0)
    scene = tfm.Scene(tfm.Volume(density, density_scale=3.0, voxel_size=0.1), map=light_map)
    scene = bench.with_march(bench.with_res(scene, BASIS_RES), steps=32)
    return lambda renderer: renderer.render(scene).image


def compare_scenes(gpu: tfm.Renderer, cpu: tfm.Renderer, names: list[str]) -> Iterator[Compared]:
    """Compare small pictures."""
    makers = scenes()
    for name in names:
        bench.progress(name)
        yield compared(name, makers[name], gpu, cpu, difference)


def compare_volumes(gpu: tfm.Renderer, cpu: tfm.Renderer, frames: dict[str, tfm.Scene]) -> Iterator[Compared]:
    """Compare the baseline's pictures."""

    def rendered(scene: tfm.Scene, method: str) -> Maker:
        return lambda renderer: renderer.render(scene, method=method).image

    for volume, scene in frames.items():
        for method, name in names_of(volume).items():
            bench.progress(name)
            yield compared(name, rendered(scene, method), gpu, cpu, whole_difference)


def names_of(volume: str) -> dict[str, str]:
    """Return what the pictures of a volume are called: method -> name."""
    return {method: f"{volume}, {method}" for method in ("tfm", "dual")}


def compared(
    name: str,
    make: Maker,
    gpu: tfm.Renderer,
    cpu: tfm.Renderer,
    measure: Callable[[NDArray[Any], NDArray[Any]], tuple[float, float | None]],
) -> Compared:
    """Render on both and measure the difference; what a device refuses is told in the table."""
    try:
        rmse, ssim = measure(make(gpu), make(cpu))
    except tfm.TfmError as error:
        return Compared(name, failed=" ".join(str(error).split()))
    return Compared(name, rmse, ssim)


def difference(found: NDArray[Any], expected: NDArray[Any]) -> tuple[float, None]:
    """Relative RMSE of numbers; infinite where some are not finite."""
    squared = np.mean(np.square(found.astype(np.float64) - expected))
    rmse = float(np.sqrt(squared) / max(float(np.abs(expected).mean()), 1e-30))
    return (rmse if math.isfinite(rmse) else math.inf), None


def whole_difference(found: NDArray[Any], expected: NDArray[Any]) -> tuple[float, float | None]:
    """Relative RMSE and SSIM of pictures."""
    if not np.isfinite(found).all():
        return math.inf, None
    metrics = tfm.compare(found, expected)
    return metrics.rmse, metrics.ssim


# Seconds.


def measure(
    renderer: tfm.Renderer, launcher: Launcher, frames: dict[str, tfm.Scene], repeats: int
) -> tuple[bench.Measurement, list[bench.Measurement]]:
    """Measure the roofline and the baseline in turn; returns both."""
    roofline = bench.Roofline(launcher, np.ones((bench.GRID_EDGE,) * 3, np.float32))
    limit = bench.Measurement("roofline", roofline.measure, roofline.measure, facts={"lanes": launcher.lanes})
    rows = []
    for name, scene in frames.items():
        frame = bench.Frame(renderer, scene, roofline, with_dual=True)
        facts = {"volume": name, "varied": None, "lanes": launcher.lanes}
        rows.append(bench.Measurement(name, frame.measure, frame.prepare, facts=facts))
    order = [limit, *(item for row in rows for item in (row, limit))]
    bench.measure_in_turn(order, repeats, deadline=math.inf)
    return limit, rows


# Output.


def markdown(report: dict[str, Any]) -> str:
    """Return the report as Markdown."""
    machine, pictures = report["machine"], [Compared(**picture) for picture in report["pictures"]]
    bad = [picture for picture in pictures if not picture.good]
    width, height = report["baseline"]["res"]
    rooflines = ", ".join(
        f"{form} {report['roofline']['figures'][f'{form}_rate']['median'] / 1e6:,.0f}" for form in bench.FORMS
    )
    lines = [
        f"# {machine['device']}",
        f"{machine['driver']}, {machine['opencl']}; lanes: {machine['lanes']}.",
        f"{width}×{height}, map 1024², 100 + 100 steps, 8 coefficients; rounds: {report['rounds']}, medians.",
        f"Trilinear samples, M/s: {rooflines}.",
        "",
        "| device seconds | light pass | view pass | frame | dual march | dual / frame | host |",
        "|---|---|---|---|---|---|---|",
        *(seconds_row(row) for row in report["frames"]),
        "",
        f"{len(pictures) - len(bad)} of {len(pictures)} pictures are those of {report['cpu']}:",
        f"relative RMSE ≤ {LARGEST_RMSE:g}, SSIM ≥ {LEAST_SSIM:g}.",
        "",
        "| picture | relative RMSE | SSIM | |",
        "|---|---|---|---|",
        *(picture_row(picture) for picture in pictures),
    ]
    return "\n".join(lines)


def seconds_row(row: dict[str, Any]) -> str:
    """Return the seconds of a volume."""
    passes = [f"{name}_seconds" for name in ("light", "view", "frame", "dual")]
    names = (*passes, "dual_over_frame", "host_seconds")
    figures = (f"{row['figures'][name]['median']:.4g}" for name in names)
    return f"| {row['name']} | {' | '.join(figures)} |"


def picture_row(picture: Compared) -> str:
    """Return how much a picture differs."""
    rmse = "" if picture.rmse is None else f"{picture.rmse:.2g}"
    ssim = "" if picture.ssim is None else f"{picture.ssim:.6f}"
    return f"| {picture.name} | {rmse} | {ssim} | {picture.failed or ('' if picture.good else 'differs')} |"


# The command line.


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("device", nargs="?", help="part of the OpenCL device's name (default: the first GPU)")
    parser.add_argument(
        "--lanes", type=int, metavar="N", help="rays a work-item (default: as suits the device)"
    )
    parser.add_argument("--volumes", nargs="+", type=Path, metavar="FILE", help="instead of the usual six")
    parser.add_argument("--scenes", nargs="+", choices=[*scenes()], metavar="NAME", help="instead of all")
    parser.add_argument(
        "--repeats", type=bench.positive(int), default=5, metavar="N", help="default 5 rounds"
    )
    parser.add_argument(
        "--res", type=bench.resolution, default=bench.BASELINE_RES, help="the baseline's, WIDTHxHEIGHT"
    )
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("out/gpu_check"), metavar="DIR", help="default out/gpu_check"
    )
    return parser.parse_args(arguments)


def check(options: argparse.Namespace) -> dict[str, Any]:
    """Compare and measure; returns the report."""
    began = time.perf_counter()
    device, cpu_device = find_device(options.device), find_cpu()
    paths = options.volumes or bench.find_volumes()
    frames = {path.stem: bench.baseline_scene(bench.load(path), options.res) for path in paths}
    with tfm.Renderer(device.name, lanes=options.lanes) as gpu:
        with tfm.Renderer(cpu_device.name) as cpu:
            pictures = [
                *compare_volumes(gpu, cpu, frames),
                *compare_scenes(gpu, cpu, options.scenes or [*scenes()]),
            ]
        failed = {picture.name for picture in pictures if picture.failed}
        launcher = Launcher(choose_device(device.name), lanes=options.lanes)
        rendered = {
            name: scene for name, scene in frames.items() if failed.isdisjoint(names_of(name).values())
        }
        roofline, rows = measure(gpu, launcher, rendered, int(options.repeats))
        machine = bench.describe_machine(launcher)
    return {
        "machine": machine,
        "cpu": cpu_device.name,
        "tolerances": {"rmse": LARGEST_RMSE, "ssim": LEAST_SSIM},
        "baseline": {"res": options.res},
        "rounds": int(options.repeats),
        "seconds": time.perf_counter() - began,
        "roofline": roofline.to_dict(),
        "frames": [row.to_dict() for row in rows],
        "pictures": [asdict(picture) for picture in pictures],
    }


def main(arguments: list[str] | None = None) -> int:
    """Check; returns the exit code."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        try:
            options.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{options.out}: cannot be made a directory ({error.strerror})") from error
        report = check(options)
        text = markdown(report)
        write_text(options.out / "gpu_check.json", json.dumps(report, indent=1) + "\n")
        write_text(options.out / "gpu_check.md", text + "\n")
    except tfm.TfmError as error:
        print(f"gpu_check.py: {error}", file=sys.stderr)
        return error.exit_code
    print(text)
    return 0 if all(Compared(**picture).good for picture in report["pictures"]) else 1


if __name__ == "__main__":
    sys.exit(main())
