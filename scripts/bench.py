#!/usr/bin/env python3
"""Measure the renderer's speed, compared with the device's own limit, the dual march and other programs.

Everything is measured in one run, in turn, round after round. Other load on a shared machine then affects all
figures alike, so that their ratios are meaningful. Writes ``bench.json`` with every figure of every round and
its median, tables on stdout, and plots of the cost against each parameter.

*Nominal* samples are those that a march without any skipping would take: in the light pass, texels whose ray
meets the medium's bounds × light steps; in the view pass, pixels whose ray meets them × view steps × lights;
in the dual march, such pixels × view steps × (1 + light steps) × lights. *Reads* are the densities actually
read; in the view pass they include those for the transmittance, which are not nominal. The *roofline* is the
rate of plain trilinear samples (``bench_kernels.cl``) by eight gathers (``gather``) or four loads of pairs
(``pairs``); ``best`` is the larger of the two.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import tfm_cl as tfm
from tfm_cl.device.bricks import build_bricks
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.device.program import fingerprint, kernels_dir
from tfm_cl.errors import InputError, TfmWarning
from tfm_cl.files import image_io
from tfm_cl.files.paths import replacing, write_text
from tfm_cl.model import decided
from tfm_cl.plan.plan import plan
from tfm_cl.render import buffers
from tfm_cl.render.raster import Crop
from tfm_cl.scene.optical_depth import density_scale_for

warnings.simplefilter("ignore", TfmWarning)  # of pictures of one pixel, that they are black

SCRIPTS = Path(__file__).resolve().parent
REPOSITORY = SCRIPTS.parent
SAMPLE_VOLUMES = ("plume.npz", "cumulus.npz", "figure.npz")
REAL_VOLUMES = ("wdas_cloud_sixteenth.vdb", "cortex_smoke.vdb", "teapot_cloud.nvdb")
"""Real volumes, used if present in ``$TFM_VOLUMES`` or in ``shared/volumes`` beside the repository."""

BASELINE_RES = (1280, 720)
BASELINE_MAP = tfm.MapSettings(res=1024, steps=100, coeffs=8, density_weighting=10.0, storage="f32")
BASELINE_MARCH = tfm.MarchSettings(steps=100, voxels="f32", skip_empty=True, cutoff=1e-4)
TRUTH_RES, TRUTH_STEPS = (320, 180), 400
"""Steps of the dual march that is the reference for errors; twice as many change it by less than a
hundredth."""

GRID_EDGE = 129
"""Voxels along each edge of the roofline's grid, as ``bench_kernels.cl`` expects."""
ROOFLINE_RAYS, ROOFLINE_STEPS = 640, 110
FORMS = {"gather": "trilinear_gather", "pairs": "trilinear_pairs"}

SUNS = 32
"""Directions of the light from all around."""
DUAL_EVERY, PEER_EVERY, START_UP_EVERY = 2, 3, 4
"""Number of rounds per slow measurement: the dual march, other programs, starting up."""

MITSUBA_SAMPLES = 4
"""Mitsuba's samples per pixel: its error falls with their square root, its time grows with their number."""
DISTANT = 1000.0
"""Distance, in radii of the medium, of a spot that stands for vdb_render's directional light."""
TINY_RES = (16, 9)
"""Size of an image for which vdb_render only needs the time for starting up and reading the file."""

Figures = dict[str, float]
Colours = NDArray[np.float32]


# Measuring in turn.


@dataclass
class Measurement:
    """A measurement that is repeated."""

    name: str
    measure: Callable[[], Figures]
    prepare: Callable[[], object] = lambda: None
    every: int = 1
    """The measurement takes part in one of this many rounds."""
    facts: dict[str, Any] = field(default_factory=dict)
    """Constant facts, for the JSON."""
    samples: dict[str, list[float]] = field(default_factory=dict)

    def take(self) -> None:
        """Measure once."""
        for name, value in self.measure().items():
            self.samples.setdefault(name, []).append(float(value))

    def median(self, figure: str) -> float:
        """Median of a figure so far."""
        return float(np.median(self.samples[figure]))

    def to_dict(self) -> dict[str, Any]:
        """Return facts and figures for JSON."""
        figures = {
            name: {"median": self.median(name), "samples": samples} for name, samples in self.samples.items()
        }
        return {"name": self.name, **self.facts, "figures": figures}


def measure_in_turn(order: list[Measurement], repeats: int, deadline: float) -> int:
    """Measure round after round, beginning none that would end too late; returns the rounds done."""
    for number, measurement in enumerate({id(item): item for item in order}.values()):
        progress(f"preparing {number + 1}: {measurement.name}")
        measurement.prepare()
    longest = 0.0
    for done in range(repeats):
        began = time.perf_counter()
        if done and began + longest > deadline:
            progress(f"stopped after {done} rounds: the time is up")
            return done
        for item in order:
            if done % item.every == 0:
                item.take()
        spent = time.perf_counter() - began
        longest = max(longest, spent)
        progress(f"round {done + 1} of {repeats}: {spent:.1f} s")
    return repeats


def progress(text: str) -> None:
    """Report progress on stderr."""
    print(text, file=sys.stderr, flush=True)


# The roofline.


class Roofline:
    """Plain trilinear samples by `FORMS` on a launcher's device."""

    def __init__(self, launcher: Launcher, grid: NDArray[np.float32], rays: int = ROOFLINE_RAYS) -> None:
        self._launcher = launcher
        self._rays = rays
        path = SCRIPTS / "bench_kernels.cl"
        # Some drivers know a program by its text alone, and miss that an included file has changed.
        defines = {"GRID_EDGE": GRID_EDGE, "BENCH_KERNELS": zlib.crc32(path.read_bytes())}
        self._kernels = {
            form: launcher.kernels.kernel(name, str(path), (), defines) for form, name in FORMS.items()
        }
        self._grid = launcher.upload("the roofline's grid", grid)
        self._sums = launcher.empty("the roofline's sums", 4 * rays * rays)
        self.latest: dict[str, float] = {}
        """Samples per second by form, as last measured."""

    def run(self, form: str, steps: int = ROOFLINE_STEPS) -> float:
        """Seconds on the device."""
        size = self._rays
        return self._launcher.run(
            self._kernels[form],
            self._launcher.tiles((0, 0, size, size)),
            {"grid": self._grid, "sums": self._sums, "size": size, "steps": steps},
        )

    def sums(self, form: str, steps: int = ROOFLINE_STEPS) -> NDArray[np.float32]:
        """Return the sum of every ray's samples, [y, x]."""
        self.run(form, steps)
        return self._launcher.download(self._sums, (self._rays, self._rays), np.float32)

    def measure(self) -> Figures:
        """Seconds and samples per second of each form."""
        seconds = {form: self.run(form) for form in FORMS}
        self.latest = {form: self._rays**2 * ROOFLINE_STEPS / spent for form, spent in seconds.items()}
        figures = {f"{form}_seconds": spent for form, spent in seconds.items()}
        return figures | {f"{form}_rate": rate for form, rate in self.latest.items()}

    def shares(self, name: str, rate: float) -> Figures:
        """Compare a rate of samples with the latest rooflines."""
        best = max(self.latest.values())
        return {
            f"{name}_share_of_gather": rate / self.latest["gather"],
            f"{name}_share_of_best": rate / best,
        }


def roofline_grid(volume: tfm.Volume) -> NDArray[np.float32]:
    """Return a volume's voxels in a cube of `GRID_EDGE`, cut or filled with zeros."""
    grid = np.zeros((GRID_EDGE,) * 3, np.float32)
    z, y, x = (min(GRID_EDGE - 1, count) for count in volume.shape)
    grid[1 : z + 1, 1 : y + 1, 1 : x + 1] = volume.data[:z, :y, :x]
    return grid


# Frames.


class Frame:
    """A scene rendered through maps and, in some rounds, by the dual march."""

    def __init__(
        self, renderer: tfm.Renderer, scene: tfm.Scene, roofline: Roofline, *, with_dual: bool = False
    ) -> None:
        self._renderer = renderer
        self._scene = scene
        self._roofline = roofline
        self._with_dual = with_dual
        self._rounds = 0
        self._pixels = pixels_that_meet(scene)

    def prepare(self) -> None:
        """Compile the kernels; programs do not depend on resolution and steps."""
        coarse = with_map(self._scene, res=32)
        self._renderer.render(coarse, crop=(0, 0, 1, 1))
        if self._with_dual:
            self._renderer.render(coarse, crop=(0, 0, 1, 1), method="dual")

    def measure(self) -> Figures:
        """Seconds on the device, samples, rates and shares of each pass; seconds of the host."""
        scene, march, light_map = self._scene, self._scene.march, self._scene.map
        began = time.perf_counter()
        maps = self._renderer.build_maps(scene)
        result = self._renderer.render(scene, maps=maps)
        wall = time.perf_counter() - began
        buffers = [found.buffers for found in maps]
        hits = sum(found.hits for found in buffers)
        light = self._pass(
            "light",
            sum(found.seconds for found in buffers),
            hits * decided(light_map.steps),
            sum(found.samples for found in buffers),
        )
        view = self._pass(
            "view",
            result.stats.seconds["view_pass"],
            self._pixels * decided(march.steps) * len(scene.lights),
            result.stats.samples["view_pass"],
        )
        seconds = light["light_seconds"] + view["view_seconds"]
        figures = light | view | {"frame_seconds": seconds, "host_seconds": wall - seconds}
        if self._with_dual and self._rounds % DUAL_EVERY == 0:
            result = self._renderer.render(scene, method="dual")
            nominal = self._pixels * decided(march.steps) * (1 + decided(light_map.steps)) * len(scene.lights)
            spent = result.stats.seconds["view_pass"]
            figures |= self._pass("dual", spent, nominal, result.stats.samples["view_pass"])
            figures["dual_over_frame"] = spent / seconds
        self._rounds += 1
        return figures

    def _pass(self, name: str, seconds: float, nominal: int, reads: int) -> Figures:
        figures = {
            f"{name}_seconds": seconds,
            f"{name}_nominal": nominal,
            f"{name}_reads": reads,
            f"{name}_nominal_rate": nominal / seconds,
            f"{name}_read_rate": reads / seconds,
        }
        figures |= self._roofline.shares(f"{name}_nominal", nominal / seconds)
        return figures | self._roofline.shares(f"{name}_read", reads / seconds)


def pixels_that_meet(scene: tfm.Scene) -> int:
    """Count the pixels whose ray meets the medium's bounds."""
    (width, height), camera = scene.camera.res, scene.camera
    tangent = np.tan(np.radians(camera.fov) / 2)
    x = (2 * (np.arange(width) + 0.5) / width - 1) * tangent * width / height
    y = (1 - 2 * (np.arange(height) + 0.5) / height) * tangent
    index_from_camera = np.linalg.inv(scene.grids[0].world_from_index) @ camera.world_from_camera
    begin, end = np.zeros((height, width)), np.full((height, width), np.inf)
    for axis, count in enumerate(scene.grids[0].shape[::-1]):
        right, up, forward, origin = index_from_camera[axis]
        direction = right * x + (up * y + forward)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = (-1 - origin) / direction, (count - origin) / direction
        # A NaN, from a ray within a face of the box, does not clip.
        begin = np.fmax(begin, np.fmin(low, high))
        end = np.fmin(end, np.fmax(low, high))
    return int(np.count_nonzero(begin < end))


def baseline_scene(volume: tfm.Volume, res: tuple[int, int]) -> tfm.Scene:
    """Return a scene with one light, placed automatically."""
    placed = tfm.Scene(volume, map=BASELINE_MAP, march=BASELINE_MARCH)
    return with_res(placed, res)


def with_res(scene: tfm.Scene, res: tuple[int, int]) -> tfm.Scene:
    """Return the scene with an image of another size."""
    return scene.replace(camera=scene.camera.replace(res=res))


def with_map(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the map."""
    return scene.replace(map=scene.map.replace(**changes))


def with_march(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the march."""
    return scene.replace(march=scene.march.replace(**changes))


def with_lights(scene: tfm.Scene, count: int) -> tfm.Scene:
    """Return the scene with its light shared among `count` of them in a ring around it."""
    light = scene.lights[0]
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - what a scene places by itself
    x, y, z = np.subtract(light.from_, light.to)
    intensity = tuple(float(value) / count for value in light.intensity)
    ring = []
    for angle in 2 * np.pi * np.arange(count) / count:
        turned = (x * np.cos(angle) + z * np.sin(angle), y, z * np.cos(angle) - x * np.sin(angle))
        at = tuple(float(value) for value in np.add(light.to, turned))
        ring.append(light.replace(from_=at, intensity=intensity))
    return scene.replace(lights=tuple(ring))


def with_auto(scene: tfm.Scene) -> tfm.Scene | None:
    """Return the scene with automatic resolution and steps; None where the settings refuse that."""
    try:
        return plan(with_march(with_map(scene, res="auto", steps="auto"), steps="auto")).scene
    except tfm.TfmError:
        return None


# One parameter at a time.


@dataclass(frozen=True)
class Variation:
    """The baseline with one parameter changed."""

    parameter: str
    value: Any
    scene: tfm.Scene
    lanes: int | None = None


PARAMETERS: dict[str, tuple[str, Callable[[Any], float] | None]] = {
    "resolution": ("pixels", lambda res: res[0] * res[1]),
    "view_steps": ("view steps", float),
    "light_steps": ("light steps", float),
    "coeffs": ("coefficients per texel", float),
    "map_res": ("texels of the map", lambda res: res * res),
    "storage": ("bits of a coefficient", lambda kind: int(kind[1:])),
    "voxels": ("bits of a voxel", lambda kind: int(kind[1:])),
    "lanes": ("rays per work-item", float),
    "skip_empty": ("skip_empty", None),
    "cutoff": ("cutoff", None),
    "lights": ("lights", float),
}
"""Label of each parameter and position on a logarithmic axis (None: values side by side)."""


def baseline_values(scene: tfm.Scene, lanes: int) -> dict[str, Any]:
    """Return the value of every parameter in the baseline."""
    return {
        "resolution": scene.camera.res,
        "view_steps": scene.march.steps,
        "light_steps": scene.map.steps,
        "coeffs": scene.map.coeffs,
        "map_res": scene.map.res,
        "storage": scene.map.storage,
        "voxels": scene.march.voxels,
        "lanes": lanes,
        "skip_empty": scene.march.skip_empty,
        "cutoff": scene.march.cutoff,
        "lights": len(scene.lights),
    }


def variations(scene: tfm.Scene, lanes: int, possible: Iterable[int]) -> Iterator[Variation]:
    """Change each parameter of the baseline separately; the baseline's own values are left out."""
    width, height = scene.camera.res
    for part in (0.25, 0.5, 1.5, 2.0):
        res = (max(1, round(width * part)), max(1, round(height * part)))
        yield Variation("resolution", res, with_res(scene, res))
    for steps in (25, 50, 200, 400):
        yield Variation("view_steps", steps, with_march(scene, steps=steps))
        yield Variation("light_steps", steps, with_map(scene, steps=steps))
    for coeffs in (1, 2, 4, 16, 32):
        yield Variation("coeffs", coeffs, with_map(scene, coeffs=coeffs))
    for res_of_map in (128, 256, 512, 2048):
        yield Variation("map_res", res_of_map, with_map(scene, res=res_of_map))
    for kind in ("f16", "u8"):
        yield Variation("storage", kind, with_map(scene, storage=kind))
        yield Variation("voxels", kind, with_march(scene, voxels=kind))
    for other in set(possible) - {lanes}:
        yield Variation("lanes", other, scene, lanes=other)
    yield Variation("skip_empty", value=False, scene=with_march(scene, skip_empty=False))
    for cutoff in (0.0, 1e-3):
        yield Variation("cutoff", cutoff, with_march(scene, cutoff=cutoff))
    for count in (2, 4, 8):
        yield Variation("lights", count, with_lights(scene, count))


def many_lights(scene: tfm.Scene) -> Iterator[tuple[str, tfm.Scene]]:
    """Yield scenes of more and more lights, all else automatic, and their names."""
    spot, *_ = spot_of(scene)
    lit = {
        "1 sun": scene.replace(lights=[tfm.SunLight(from_=spot.from_, to=spot.to)]),
        **{f"{count} spots": with_lights(scene, count) for count in (2, 4, 8, 64)},
        f"sky of {SUNS} suns": scene.replace(lights=[tfm.EnvironmentLight(samples=SUNS)]),
    }
    for name, scene_of_lights in lit.items():
        auto = with_auto(scene_of_lights)
        if auto is not None:
            yield name, auto


# The work of the host.


class Host:
    """Wall-clock seconds of the work before, between and after the kernels."""

    def __init__(self, renderer: tfm.Renderer, launcher: Launcher, scene: tfm.Scene) -> None:
        self._renderer, self._launcher, self._scene = renderer, launcher, scene
        self._maps = renderer.build_maps(scene)
        self._frame = buffers.allocate(launcher, Crop((0, 0, *scene.camera.res)), None, emits=False)

    def measure(self) -> Figures:
        """Upload of the bricks; parameters and launch of one pixel; read-back of a whole frame."""
        volume, voxels = self._scene.grids[0], self._scene.march.voxels

        def put_on_the_device() -> None:
            build_bricks(self._launcher, [volume.channel_leaves], "the volume", voxels).filling.wait()

        def read_back() -> None:
            read = buffers.start_read(self._launcher, self._frame, None, None)
            read()

        upload = seconds_of(put_on_the_device)
        one_pixel = seconds_of(lambda: self._renderer.render(self._scene, maps=self._maps, crop=(0, 0, 1, 1)))
        return {
            "upload_seconds": upload,
            "one_pixel_seconds": one_pixel,
            "read_back_seconds": seconds_of(read_back),
        }


def seconds_of(work: Callable[[], object]) -> float:
    """Run something and return its wall-clock seconds."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def start_up(device: str | None, path: Path) -> Figures:
    """In a new process: make the context and compile the kernels of the baseline."""
    volume = load(path)
    began = time.perf_counter()
    with tfm.Renderer(device) as renderer:
        context = time.perf_counter() - began
        scene = with_map(baseline_scene(volume, TINY_RES), res=32)
        result = renderer.render(scene)
    return {"context_seconds": context, "compile_seconds": result.stats.seconds["compile"]}


def measure_start_up(device: str | None, path: Path) -> Figures:
    """Start two processes in turn: with an empty PoCL cache, and with what the first left there."""
    figures: Figures = {}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(Path(__file__).resolve()), "--start-up", str(path)]
        command += ["--device", device] if device else []
        for state in ("cold", "warm"):
            run = subprocess.run(  # noqa: S603 - this script
                command,
                env=os.environ | {"POCL_CACHE_DIR": folder},
                capture_output=True,
                text=True,
                check=True,
            )
            figures |= {f"{state}_{name}": value for name, value in json.loads(run.stdout).items()}
    return figures


# Errors.


def error_of(image: Colours, truth: Colours) -> float:
    """Relative RMSE over the lit pixels."""
    lit = tfm.compare(image, truth).lit
    return lit.rmse if lit else float("nan")


def truth_of(renderer: tfm.Renderer, scene: tfm.Scene) -> Colours:
    """Return the converged dual march of a scene."""
    fine = with_march(with_map(scene, steps=TRUTH_STEPS), steps=TRUTH_STEPS)
    return renderer.render(with_res(fine, TRUTH_RES), method="dual").image


def errors(renderer: tfm.Renderer, scene: tfm.Scene) -> Figures:
    """Errors of the baseline, of automatic settings and of the dual march."""
    truth = truth_of(renderer, scene)
    small = with_res(scene, TRUTH_RES)
    found = {
        "tfm": error_of(renderer.render(small).image, truth),
        "lattice": error_of(renderer.render(with_map(small, lookup="lattice")).image, truth),
        "dual": error_of(renderer.render(small, method="dual").image, truth),
    }
    auto = with_auto(scene)  # the values chosen for the baseline's resolution
    if auto is not None:
        found["auto"] = error_of(renderer.render(with_res(auto, TRUTH_RES)).image, truth)
    return found


# Other programs.


class AbsentError(Exception):
    """A program for comparison is not available; the message says why."""


@dataclass(frozen=True)
class Peer:
    """A way to render a scene of `peer_scenes`."""

    name: str
    light: str
    note: str
    seconds: Callable[[], Figures]
    image: Callable[[], Colours]
    """Picture at `TRUTH_RES`."""


def spot_of(scene: tfm.Scene) -> tuple[tfm.SpotLight, NDArray[np.float64], float]:
    """Return the scene's light, the vector from it to its target, and that vector's length."""
    light = scene.lights[0]
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - what a scene places by itself
    axis = np.subtract(light.to, light.from_)
    return light, axis, float(np.linalg.norm(axis))


def near_light(scene: tfm.Scene) -> tfm.Scene:
    """Use inverse-square falloff, as Mitsuba does, with the same irradiance at the light's target."""
    light, _, distance = spot_of(scene)
    intensity = tuple(float(value) * distance**2 for value in light.intensity)
    return scene.replace(lights=(light.replace(falloff="inverse-square", intensity=intensity),))


def distant_light(scene: tfm.Scene) -> tfm.Scene:
    """Move the light so far away that its rays are almost parallel, like those of vdb_render."""
    light, axis, distance = spot_of(scene)
    low, high = scene.grids[0].occupied_bounds
    away = DISTANT * float(np.linalg.norm(high - low)) / 2
    at = tuple(float(value) for value in np.subtract(light.to, axis / distance * away))
    cone = float(np.degrees(np.arcsin(1.02 / DISTANT)))
    return scene.replace(lights=(light.replace(from_=at, cone=cone),))


def our_peer(renderer: tfm.Renderer, scene: tfm.Scene, light: str, method: str) -> Peer:
    """Return this project on the peers' scene: device seconds of both passes."""

    def seconds() -> Figures:
        maps = renderer.build_maps(scene) if method == "tfm" else []
        view = renderer.render(scene, maps=maps, method=method).stats.seconds["view_pass"]
        return {"seconds": sum(built.buffers.seconds for built in maps) + view}

    def image() -> Colours:
        return renderer.render(with_res(scene, TRUTH_RES), method=method).image

    return Peer(f"tfm_cl {method}", light, "device seconds, light and view pass", seconds, image)


class PlainC:
    """``bench_dual.c``."""

    def __init__(self, scene: tfm.Scene, folder: Path) -> None:
        compiler = shutil.which("gcc")
        if compiler is None:
            raise AbsentError("not installed: gcc")
        self._program, self._folder, self._scene = folder / "bench_dual", folder, scene
        flags = ["-O3", "-march=native", "-fopenmp"]
        command = [compiler, *flags, str(SCRIPTS / "bench_dual.c"), "-o", str(self._program), "-lm"]
        run = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - gcc
        if run.returncode:
            raise AbsentError(f"not run: gcc does not compile it: {complaint(run.stderr)}")

    def run(self, res: tuple[int, int]) -> tuple[float, Colours]:
        """Return the seconds of the march and the picture."""
        scene_file, picture = self._folder / "scene", self._folder / "picture"
        grid = np.pad(self._scene.grids[0].data, 1)
        scene_file.write_bytes(plain_scene(with_res(self._scene, res)) + grid.tobytes())
        command = [str(self._program), str(scene_file), str(picture), str(os.cpu_count() or 1)]
        run = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - ours
        width, height = res
        return float(run.stdout), np.fromfile(picture, np.float32).reshape(height, width, 3)

    def peer(self, light: str) -> Peer:
        """Return it as a peer."""
        return Peer(
            "dual march in C",
            light,
            f"gcc -O3 -march=native, {os.cpu_count()} threads; seconds of the march",
            lambda: {"seconds": self.run(self._scene.camera.res)[0]},
            lambda: self.run(TRUTH_RES)[1],
        )


def plain_scene(scene: tfm.Scene) -> bytes:
    """Return the struct ``Scene`` of ``bench_dual.c`` for a grey medium and one light."""
    volume, camera, medium, light = scene.grids[0], scene.camera, scene.medium, spot_of(scene)[0]
    world_from_centred, padded_from_index = np.eye(4), np.eye(4)
    world_from_centred[:3, 3] = volume.bounds.mean(axis=0)
    padded_from_index[:3, 3] = 1
    centred_from_world = np.linalg.inv(world_from_centred)
    centred_from_light = centred_from_world @ light.frame().world_from_light
    right, up, forward, position = (centred_from_world @ camera.world_from_camera)[:3].T
    width, height = camera.res
    tangent = np.tan(np.radians(camera.fov) / 2)
    sigma_t = medium.sigma_t
    floats = [
        (padded_from_index @ np.linalg.inv(volume.world_from_index) @ world_from_centred)[:3],
        np.linalg.inv(centred_from_light)[:3],
        centred_from_light[:3, 3],
        np.tan(np.radians(light.cone)),
        position,
        right * tangent * width / height,
        up * tangent,
        forward,
        volume.density_scale * sigma_t[0],
        scene.march.cutoff,
        np.array(medium.sigma_s) / sigma_t * light.intensity / (4 * np.pi),
    ]
    z, y, x = (count + 2 for count in volume.shape)
    ints = [x, y, z, width, height, scene.march.steps, scene.map.steps, light.falloff == "inverse-square"]
    packed = np.hstack([np.ravel(part) for part in floats]).astype(np.float32)
    return packed.tobytes() + np.array(ints, np.int32).tobytes()


class VdbRender:
    """OpenVDB's ``vdb_render`` with its default steps.

    Its light is directional, and a colour c means an irradiance of 4π c. Coefficients are per voxel.
    """

    def __init__(self, scene: tfm.Scene, path: Path, folder: Path) -> None:
        found = shutil.which("vdb_render")
        if found is None:
            raise AbsentError("not installed: vdb_render (Debian: libopenvdb-tools)")
        self._program, self._picture = found, folder / "vdb_render.exr"
        self._scene, self._path = scene, path

    def run(self, res: tuple[int, int]) -> float:
        """Return the seconds of the whole process."""
        camera, volume, medium = self._scene.camera, self._scene.grids[0], self._scene.medium
        light, axis, distance = spot_of(self._scene)
        width, height = camera.res
        horizontal = 2 * np.degrees(np.arctan(np.tan(np.radians(camera.fov) / 2) * width / height))
        voxel = volume.density_scale * float(np.mean(volume.voxel_size))
        command = [self._program, str(self._path), str(self._picture)]
        for option, values in {
            "-fov": horizontal,
            "-translate": camera.from_,
            "-lookat": camera.to,
            "-up": camera.up,
            "-scatter": np.multiply(voxel, medium.sigma_s),
            "-absorb": np.multiply(voxel, medium.sigma_a),
            "-light": (*(-axis / distance), *np.divide(light.intensity, 4 * np.pi)),
            "-gain": 0,
        }.items():
            command += [option, ",".join(f"{value:.9g}" for value in np.atleast_1d(values))]
        command += ["-res", f"{res[0]}x{res[1]}"]
        command += ["-name", volume.name] if volume.name else []
        began = time.perf_counter()
        run = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - vdb_render
        spent = time.perf_counter() - began
        if run.returncode:
            raise AbsentError(f"not run: it ends with {run.returncode}: {complaint(run.stderr)}")
        return spent

    def seconds(self) -> Figures:
        """Seconds of the process, and without those of a tiny image."""
        process, tiny = self.run(self._scene.camera.res), self.run(TINY_RES)
        figures = {"process_seconds": process}
        return figures | ({"seconds": process - tiny} if process > tiny else {})

    def image(self) -> Colours:
        """Return the picture at `TRUTH_RES`."""
        self.run(TRUTH_RES)
        return image_io.load_image(self._picture)[..., :3]

    def peer(self, light: str) -> Peer:
        """Return it as a peer."""
        note = "default steps (1 voxel, shadow 3), -gain 0; process less that of a tiny image"
        return Peer("vdb_render", light, note, self.seconds, self.image)


class Mitsuba:
    """Mitsuba 3's single scattering; its LLVM variant needs the library of that name."""

    def __init__(self, scene: tfm.Scene, stack: ExitStack) -> None:
        missing = [name for name in ("mitsuba", "drjit", "pytest") if importlib.util.find_spec(name) is None]
        if missing:
            raise AbsentError(f"not installed: Python packages {', '.join(missing)} (make oracles)")
        sys.path.insert(0, str(REPOSITORY / "tests"))
        oracle = importlib.import_module("oracles.mitsuba_scene")  # how the tests describe a scene to it
        self._variant = stack.enter_context(oracle.mitsuba_variant())
        if not self._variant.startswith("llvm"):
            raise AbsentError("not installed: an LLVM that Mitsuba takes (Debian: libllvm19)")
        self._large = oracle.MitsubaScene(scene)
        self._small = oracle.MitsubaScene(with_res(scene, TRUTH_RES))

    def seconds(self) -> Figures:
        """Seconds of rendering."""
        return {"seconds": seconds_of(lambda: self._large.batches(1, MITSUBA_SAMPLES, seed=1))}

    def image(self) -> Colours:
        """Return the picture at `TRUTH_RES`."""
        return np.asarray(self._small.batches(1, MITSUBA_SAMPLES, seed=1)[0], np.float32)

    def peer(self, light: str) -> Peer:
        """Return it as a peer."""
        note = f"{self._variant}, volpath, {MITSUBA_SAMPLES} samples per pixel; rendering only"
        return Peer("Mitsuba 3", light, note, self.seconds, self.image)


def complaint(text: str) -> str:
    """Return the most informative line of a program's messages, shortened."""
    lines = text.strip().splitlines() or ["no message"]
    return next((line for line in lines if "error" in line), lines[0])[:200]


def find_peers(
    renderer: tfm.Renderer, scene: tfm.Scene, path: Path, stack: ExitStack
) -> tuple[list[Peer], dict[str, tfm.Scene], dict[str, str]]:
    """Return the available peers, the scenes of their lights, and why the others are missing."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    scenes = {"near": near_light(scene)}
    builders: dict[str, Callable[[], Peer]] = {
        "dual march in C": lambda: PlainC(scenes["near"], folder).peer("near"),
        "Mitsuba 3": lambda: Mitsuba(scenes["near"], stack).peer("near"),
        "vdb_render": lambda: VdbRender(scenes["distant"], path, folder).peer("distant"),
    }
    absent = {}
    if path.suffix == ".vdb":
        scenes["distant"] = distant_light(scene)
    else:
        del builders["vdb_render"]
        absent["vdb_render"] = "not run: reads .vdb files only"
    peers = [
        our_peer(renderer, lit, light, method) for light, lit in scenes.items() for method in ("tfm", "dual")
    ]
    for name, build in builders.items():
        try:
            peers.append(build())
        except AbsentError as reason:
            absent[name] = str(reason)
    return peers, scenes, absent


def peer_measurements(
    renderer: tfm.Renderer, scene: tfm.Scene, path: Path, stack: ExitStack
) -> tuple[list[Measurement], dict[str, str]]:
    """Return the data of the peers' rows; their errors are measured here, once."""
    peers, scenes, absent = find_peers(renderer, scene, path, stack)
    truths = {light: truth_of(renderer, lit) for light, lit in scenes.items()}
    rows = []
    for peer in peers:
        progress(f"error of {peer.name}")
        try:
            image = peer.image()
        except AbsentError as reason:
            absent[peer.name] = str(reason)
            continue
        truth = truths[peer.light]
        shown, wanted = image[..., :3].astype(np.float64).ravel(), truth[..., :3].astype(np.float64).ravel()
        scale = float(shown @ wanted / (shown @ shown))
        facts = {
            "light": peer.light,
            "note": peer.note,
            "error": error_of(image, truth),
            "least_squares_scale": scale,
            "error_scaled": error_of((image * np.float32(scale)).astype(np.float32), truth),
        }
        rows.append(Measurement(peer.name, peer.seconds, every=PEER_EVERY, facts=facts))
    return rows, absent


# The run.


@cache
def load(path: Path) -> tfm.Volume:
    """Read a volume; its density is scaled so that both body and detail are visible."""
    volume = tfm.Volume.load(path)
    return volume.with_density_scale(density_scale_for(volume))


def find_volumes() -> list[Path]:
    """Return the sample volumes, and the real ones that exist."""
    real = Path(os.environ.get("TFM_VOLUMES", REPOSITORY.parent / "shared" / "volumes"))
    samples = [REPOSITORY / "volumes" / name for name in SAMPLE_VOLUMES]
    return samples + [real / name for name in REAL_VOLUMES if (real / name).is_file()]


def describe_machine(launcher: Launcher) -> dict[str, Any]:
    """Return the facts that the figures depend on."""
    device = launcher.device
    versions = {"python": platform.python_version()}
    for name in ("tfm_cl", "numpy", "pyopencl", "pocl-binary-distribution", "mitsuba"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "platform": platform.platform(),
        "device": device.name.strip(),
        "opencl": device.version.strip(),
        "driver": f"{device.platform.name.strip()} {device.driver_version.strip()}",
        "lanes": launcher.lanes,
        "kernels": fingerprint(kernels_dir()),
        "versions": versions,
        "load_before": os.getloadavg() if hasattr(os, "getloadavg") else None,
    }


def cpu_model() -> str:
    """Return the processor's name."""
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8") if cpuinfo.is_file() else ""
    found = re.search(r"^model name\s*:\s*(.*)$", text, re.MULTILINE)
    return found[1] if found else platform.processor() or platform.machine()


class Bench:
    """All measurements of a run, in their order."""

    def __init__(self, options: argparse.Namespace, stack: ExitStack) -> None:
        self._options, self._stack = options, stack
        self._began = time.perf_counter()
        self._renderers: dict[int, tfm.Renderer] = {}
        launcher = Launcher(choose_device(options.device))
        self.machine = describe_machine(launcher)
        self.lanes, self.lanes_possible = launcher.lanes, launcher.lanes_possible
        self._paths: list[Path] = options.volumes
        named = [path for path in self._paths if path.stem == "cumulus"]
        self._varied = (named or self._paths)[0]
        self._grid = roofline_grid(load(self._varied))
        self.rooflines = {self.lanes: self._roofline(self.lanes, launcher)}
        scenes = {path: baseline_scene(load(path), options.res) for path in self._paths}
        self._scenes = scenes

        progress("errors")
        renderer = self._renderer(self.lanes)
        self.errors = {path.name: errors(renderer, scene) for path, scene in scenes.items()}
        self.frames: list[Measurement] = []
        for path in self._paths:
            self._add_baseline(path)
        if not options.quick:
            self._add_variations()
        host = Host(renderer, launcher, scenes[self._varied])
        self.host = [
            Measurement("host", host.measure),
            Measurement(
                "start-up", lambda: measure_start_up(options.device, self._varied), every=START_UP_EVERY
            ),
        ]
        self.peers: list[Measurement] = []
        self.absent: dict[str, str] = {}
        if options.peers:
            path = next((path for path in self._paths if path.suffix == ".vdb"), self._varied)
            self.peers, self.absent = peer_measurements(renderer, scenes[path], path, stack)
            for peer in self.peers:
                peer.facts["volume"] = path.name

    def run(self) -> dict[str, Any]:
        """Measure everything; returns the report."""
        order: list[Measurement] = []
        group = None
        for frame in self.frames:
            # Next to the measurement they are compared with, since the machine's speed drifts.
            if frame.facts["varied"] is None or frame.facts["varied"] != group:
                order.append(self.rooflines[self.lanes])
            group = frame.facts["varied"]
            order.append(frame)
        order += [roofline for lanes, roofline in self.rooflines.items() if lanes != self.lanes]
        order += [*self.host, *self.peers]
        deadline = self._began + 60 * self._options.minutes
        rounds = measure_in_turn(order, self._options.repeats, deadline)
        if fingerprint(kernels_dir()) != self.machine["kernels"]:
            progress("the kernels' sources have changed during the run: figures of both may be mixed")
        load_after = os.getloadavg() if hasattr(os, "getloadavg") else None
        return {
            "machine": self.machine | {"load_after": load_after},
            "rounds": rounds,
            "seconds": time.perf_counter() - self._began,
            "baseline": {
                **baseline_values(self._scenes[self._varied], self.lanes),
                "density_weighting": BASELINE_MAP.density_weighting,
            },
            "rooflines": [roofline.to_dict() for roofline in self.rooflines.values()],
            "frames": [frame.to_dict() for frame in self.frames],
            "host": [measurement.to_dict() for measurement in self.host],
            "errors": {
                "against": f"dual march of {TRUTH_STEPS} × {TRUTH_STEPS} steps at {shown(TRUTH_RES)}",
                "relative_rmse_lit": self.errors,
            },
            "peers": [peer.to_dict() for peer in self.peers],
            "peers_absent": self.absent,
        }

    def _renderer(self, lanes: int) -> tfm.Renderer:
        if lanes not in self._renderers:
            renderer = tfm.Renderer(self._options.device, lanes=lanes)
            self._renderers[lanes] = self._stack.enter_context(renderer)
        return self._renderers[lanes]

    def _roofline(self, lanes: int, launcher: Launcher) -> Measurement:
        roofline = Roofline(launcher, self._grid)
        if lanes == self.lanes:
            self._shares = roofline
        return Measurement(
            f"roofline of {lanes} lanes", roofline.measure, roofline.measure, facts={"lanes": lanes}
        )

    def _add(self, name: str, path: Path, lanes: int, frame: Frame, varied: str | None, value: Any) -> None:
        facts = {"volume": path.name, "varied": varied, "value": value, "lanes": lanes}
        self.frames.append(Measurement(name, frame.measure, frame.prepare, facts=facts))

    def _add_baseline(self, path: Path) -> None:
        scene, renderer = self._scenes[path], self._renderer(self.lanes)
        frame = Frame(renderer, scene, self._shares, with_dual=True)
        self._add(path.stem, path, self.lanes, frame, None, None)
        lattice = with_map(scene, lookup="lattice")
        on_lattice = Frame(renderer, lattice, self._shares)
        self._add(f"{path.stem} lattice", path, self.lanes, on_lattice, "lattice", "lattice")
        auto = with_auto(scene)
        if auto is not None:
            values = {"map_res": auto.map.res, "light_steps": auto.map.steps, "view_steps": auto.march.steps}
            self._add(
                f"{path.stem} auto",
                path,
                self.lanes,
                Frame(renderer, auto, self._shares),
                "auto",
                values,
            )

    def _add_variations(self) -> None:
        path = self._varied
        many = [found for found in self._paths if found.stem.startswith("wdas")] or [path]
        for name, scene in many_lights(self._scenes[many[0]]):
            frame = Frame(self._renderer(self.lanes), scene, self._shares)
            self._add(f"{many[0].stem} auto, {name}", many[0], self.lanes, frame, "auto lights", name)
        for variation in variations(self._scenes[path], self.lanes, self.lanes_possible):
            lanes = variation.lanes or self.lanes
            if lanes not in self.rooflines:
                launcher = Launcher(choose_device(self._options.device), lanes=lanes)
                self.rooflines[lanes] = self._roofline(lanes, launcher)
            name = f"{path.stem} {variation.parameter}={shown(variation.value)}"
            frame = Frame(self._renderer(lanes), variation.scene, self._shares)
            self._add(name, path, lanes, frame, variation.parameter, variation.value)


# Output.


def shown(value: Any) -> str:
    """Return a value as tables and plots show it."""
    if isinstance(value, tuple | list):
        return "×".join(str(part) for part in value)
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else str(value)


def table(rows: list[list[str]]) -> str:
    """Return rows of columns, the first of each flush left."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = (
        "  ".join(
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )
    return "\n".join(line.rstrip() for line in lines)


def _median(row: dict[str, Any], figure: str, form: str = "{:.4f}", factor: float = 1.0) -> str:
    found = row["figures"].get(figure)
    return form.format(found["median"] * factor) if found else "-"


def roofline_table(report: dict[str, Any]) -> str:
    """Rates of the rooflines."""
    rows = [["roofline, M samples/s", "gather", "pairs"]]
    for row in report["rooflines"]:
        rates = [_median(row, f"{form}_rate", "{:.0f}", 1e-6) for form in FORMS]
        rows.append([f"{row['lanes']} lanes", *rates])
    return table(rows)


PASSES = ("light", "view", "dual")


def seconds_table(report: dict[str, Any]) -> str:
    """Seconds of every frame."""
    rows = [["device seconds", "light", "view", "frame", "dual", "dual/frame", "host"]]
    for row in report["frames"]:
        cells = [_median(row, f"{name}_seconds") for name in ("light", "view", "frame", "dual")]
        ratio, host = _median(row, "dual_over_frame", "{:.1f}"), _median(row, "host_seconds")
        rows.append([row["name"], *cells, ratio, host])
    return f"{table(rows)}\n(frame = light + view; host = wall-clock time of a frame less the device's)"


def rate_table(report: dict[str, Any]) -> str:
    """Rates of nominal samples, reads, and fractions of the roofline, for every frame."""
    rows = [
        ["light, view, dual", *("nominal M/s",) * 3, *("read M",) * 3, *("% gather",) * 3, *("% best",) * 3]
    ]
    for row in report["frames"]:
        cells = [_median(row, f"{name}_nominal_rate", "{:.0f}", 1e-6) for name in PASSES]
        cells += [_median(row, f"{name}_reads", "{:.1f}", 1e-6) for name in PASSES]
        for roof in ("gather", "best"):
            cells += [_median(row, f"{name}_nominal_share_of_{roof}", "{:.0f}", 100) for name in PASSES]
        rows.append([row["name"], *cells])
    return f"{table(rows)}\n(%: nominal samples per second over those of the roofline)"


def host_table(report: dict[str, Any]) -> str:
    """Seconds of the host."""
    rows = [["host seconds", ""]]
    for row in report["host"]:
        rows += [[name.removesuffix("_seconds"), _median(row, name)] for name in row["figures"]]
    return table(rows)


def error_table(report: dict[str, Any]) -> str:
    """Errors of every volume."""
    found = report["errors"]["relative_rmse_lit"]
    columns = list(dict.fromkeys(name for row in found.values() for name in row))
    rows = [["relative RMSE, lit pixels", *columns]]
    for name, row in found.items():
        rows.append([name, *(f"{row[column]:.4f}" if column in row else "-" for column in columns)])
    return f"{table(rows)}\n(against the {report['errors']['against']})"


def peer_table(report: dict[str, Any]) -> str:
    """Seconds and errors of the peers."""
    rows = [["peer (light)", "seconds", "RMSE", "RMSE scaled", "scale"]]
    rows += [
        [
            f"{row['name']} ({row['light']})",
            _median(row, "seconds"),
            f"{row['error']:.4f}",
            f"{row['error_scaled']:.4f}",
            f"{row['least_squares_scale']:.3f}",
        ]
        for row in report["peers"]
    ]
    lines = [table(rows)]
    if report["peers"]:
        lines.append(f"on {report['peers'][0]['volume']}; seconds at the baseline's resolution")
    lines.append(
        "RMSE scaled: after the best single factor, as conventions differ. near: a spot with inverse-square "
        f"falloff; distant: a spot {DISTANT:g} radii away for vdb_render's directional light"
    )
    lines += [
        f"{name}: {note}" for name, note in {row["name"]: row["note"] for row in report["peers"]}.items()
    ]
    lines += [f"{name}: {why}" for name, why in report["peers_absent"].items()]
    return "\n".join(lines)


def tables(report: dict[str, Any]) -> str:
    """All tables as text."""
    machine = report["machine"]
    head = (
        f"{machine['cpu']}, {machine['cores']} cores; {machine['device']}, {machine['driver']}; "
        f"{report['rounds']} rounds, medians"
    )
    parts = [head, roofline_table(report), seconds_table(report), rate_table(report)]
    parts += [host_table(report), error_table(report)]
    if report["peers"] or report["peers_absent"]:
        parts.append(peer_table(report))
    return "\n\n".join(parts)


def plots(report: dict[str, Any], out: Path) -> list[Path]:
    """Draw seconds against every parameter that was varied; returns the files."""
    written = []
    for parameter, (label, place) in PARAMETERS.items():
        rows = [row for row in report["frames"] if row["varied"] == parameter]
        if not rows:
            continue
        base = [
            {**row, "value": report["baseline"][parameter]}
            for row in report["frames"]
            if row["varied"] is None and row["volume"] == rows[0]["volume"]
        ]
        at = place or float
        points = sorted([*base, *rows], key=lambda row, at=at: at(row["value"]))  # type: ignore[misc]
        figure = Figure(figsize=(6, 4), dpi=120, layout="constrained")
        axes = figure.add_subplot()
        x = [at(row["value"]) for row in points] if place else list(range(1, len(points) + 1))
        series = {
            name: [row["figures"][f"{name}_seconds"]["median"] for row in points]
            for name in ("light", "view", "frame")
        }
        for (name, y), (colour, marker) in zip(
            series.items(), (("#0072B2", "o"), ("#D55E00", "s"), ("#222222", "^")), strict=True
        ):
            axes.plot(x, y, color=colour, marker=marker, label=name, linestyle="-" if place else "none")
        axes.set_yscale("log")
        if place:
            axes.set_xscale("log")
            guide = [series["frame"][-1] * value / x[-1] for value in x]
            axes.plot(x, guide, color="#999999", linestyle=":", label="slope 1")
        else:
            axes.margins(x=0.3)
        axes.set_xticks(x, [shown(row["value"]) for row in points], fontsize=8)
        axes.minorticks_off()
        axes.set_xlabel(label if place is None or label.endswith("steps") else f"{parameter} ({label})")
        axes.set_ylabel("device seconds")
        axes.set_title(rows[0]["volume"], fontsize=9)
        axes.legend(fontsize=8)
        written.append(out / f"bench_{parameter}.png")
        with replacing(written[-1]) as temporary:
            figure.savefig(temporary, format="png")
    return written


# The command line.


def resolution(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT, for argparse."""
    found = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if not found:
        raise argparse.ArgumentTypeError(f"'{text}' should be WIDTHxHEIGHT in pixels")
    return int(found[1]), int(found[2])


def positive(kind: Callable[[str], float]) -> Callable[[str], float]:
    """Return a parser of numbers > 0, for argparse."""

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = 0
        if not 0 < value < float("inf"):
            raise argparse.ArgumentTypeError(f"'{text}' should be a number > 0")
        return value

    return parse


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--quick", action="store_true", help="the baseline of one volume only, 3 rounds")
    parser.add_argument("--volumes", nargs="+", type=Path, metavar="FILE", help="instead of the usual six")
    parser.add_argument("--repeats", type=positive(int), metavar="N", help="rounds (default 5, quick 3)")
    parser.add_argument("--minutes", type=positive(float), default=6.0, help="begin no round that ends later")
    parser.add_argument("--res", type=resolution, default=BASELINE_RES, help="the baseline's, WIDTHxHEIGHT")
    parser.add_argument("--peers", action="store_true", help="other programs too, where installed")
    parser.add_argument("--device", metavar="NAME", help="part of the OpenCL device's name")
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("out/bench"), metavar="DIR", help="default out/bench"
    )
    parser.add_argument("--start-up", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    options.repeats = int(options.repeats or (3 if options.quick else 5))
    usual = [REPOSITORY / "volumes" / "cumulus.npz"] if options.quick else find_volumes()
    options.volumes = list(dict.fromkeys(options.volumes or usual))
    return options


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit code."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        if options.start_up:
            print(json.dumps(start_up(options.device, options.start_up)))
            return 0
        try:
            options.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{options.out}: cannot be made a directory ({error.strerror})") from error
        with ExitStack() as stack:
            report = Bench(options, stack).run()
        write_text(options.out / "bench.json", json.dumps(report, indent=1) + "\n")
        print(tables(report))
        for path in (options.out / "bench.json", *plots(report, options.out)):
            progress(str(path))
    except tfm.TfmError as error:
        print(f"bench.py: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
