"""What studies measure with: a renderer, sizes, scenes and times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tfm_cl as tfm
from tfm_cl.metrics import REC709, lit_mask

Floats = NDArray[np.float64]
VOLUMES = Path(__file__).resolve().parents[2] / "volumes"
SMOKE, CLOUD, HARD = "plume", "cumulus", "figure"
Image = NDArray[np.float32]


@dataclass(frozen=True)
class Sizes:
    """The amount of computation."""

    map_res: int = 1024
    steps: int = 100
    picture: float = 1.0
    """Fraction of the scene files' resolutions."""
    fine_steps: int = 1000
    """Steps along a camera ray in the reference of TFM figure 5."""
    rounds: int = 5
    """Rounds of the speed measurements, which are taken in turn."""
    map_sizes: tuple[int, ...] = (256, 512, 1024)
    """Sizes for FOM tables 1 and 2."""
    screens: tuple[tuple[int, int], ...] = ((1680, 1050), (1280, 800))
    frame: tuple[int, int] = (1280, 720)
    """Frame size for the speeds in TFM figure 10."""
    coarse_and_fine: tuple[int, int] = (32, 512)
    """Sizes of the maps in FOM figure 4."""
    slice_counts: tuple[int, ...] = (4, 8, 16, 24, 32)
    """Numbers of planes in OSM figure 4."""
    rays: int = 24
    """Texels along each side of the map in studies of single rays."""


QUICK = Sizes(
    map_res=256,
    picture=0.25,
    fine_steps=300,
    rounds=1,
    map_sizes=(64, 128, 256),
    screens=((336, 210), (256, 160)),
    frame=(320, 180),
    coarse_and_fine=(16, 128),
    slice_counts=(4, 8, 16),
    rays=12,
)
Seconds = dict[str, float]


@dataclass(frozen=True)
class Timings:
    """Device seconds, of which only ratios are meaningful."""

    least: dict[Any, Seconds]
    noise: float
    """Typical ratio of the median of the rounds to the smallest."""

    @property
    def note(self) -> str:
        """A sentence."""
        return f"The least of the rounds counts; their median is typically {self.noise:.2f} times as much."


def _least(samples: Sequence[Seconds]) -> Seconds:
    return {name: min(sample[name] for sample in samples) for name in samples[0]}


BRIEF = 4
"""Number of times that a measurement of a tenth of a second is repeated in a round."""
SIDE_DISTANCE = 5.0
"""Distance from the centre of the medium to the light of `Lab.side`, in radii of the medium."""
WHITE = (10.0, 10.0, 10.0)
"""Intensity of the lights placed by this script."""


class Lab:
    """A renderer, sizes, and data shared by several studies."""

    def __init__(self, renderer: tfm.Renderer, sizes: Sizes) -> None:
        self.renderer = renderer
        self.sizes = sizes
        self.scene = cache(self._scene)
        self.side = cache(self._side)

    def _scene(self, name: str) -> tfm.Scene:
        scene = self._small(tfm.Scene.load(VOLUMES / f"{name}.toml"))
        return scene.replace(
            map=tfm.MapSettings(basis="dct", coeffs=8, res=self.sizes.map_res, steps=self.sizes.steps),
            march=tfm.MarchSettings(steps=self.sizes.steps),
        )

    def _side(self, name: str) -> tfm.Scene:
        """Return a sample scene under one white light from the left, along the grid's x axis."""
        scene = self.scene(name)
        low, high = scene.grids[0].occupied_bounds
        centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        at = centre - (SIDE_DISTANCE * radius, 0, 0)
        cone = float(np.degrees(np.arcsin(1 / SIDE_DISTANCE))) + 0.5
        light = tfm.SpotLight(from_=tuple(at), to=tuple(centre), cone=cone, intensity=WHITE)
        return scene.replace(lights=(light,))

    def _small(self, scene: tfm.Scene) -> tfm.Scene:
        width, height = (max(16, round(side * self.sizes.picture)) for side in scene.camera.res)
        return scene.replace(camera=scene.camera.replace(res=(width, height)))

    def image(self, scene: tfm.Scene, method: str = "tfm", **changes: Any) -> Image:
        """Render with other settings of the map."""
        return self.renderer.render(with_map(scene, **changes), method=method).image

    def error(self, image: Image, truth: Image) -> float:
        """Visible error: RMS over the lit pixels of sRGB luma, 0 to 1."""
        lit = tfm.compare(image, truth).lit
        return float(10 ** (-lit.psnr / 20)) if lit else float("nan")

    def least(self, measurements: dict[Any, Callable[[], Seconds]]) -> Timings:
        """Measure all in turn, round after round, and take the smallest, as the machine may be shared."""
        found: dict[Any, list[Seconds]] = {key: [] for key in measurements}
        for _ in range(self.sizes.rounds):
            for key, measure in measurements.items():
                found[key].append(measure())
        least = {key: _least(samples) for key, samples in found.items()}
        noise = [
            float(np.median([sample[name] for sample in samples])) / least[key][name]
            for key, samples in found.items()
            for name in samples[0]
            if least[key][name] > 0
        ]
        return Timings(least, float(np.median(noise)))

    def frame_seconds(self, scene: tfm.Scene, method: str = "tfm", times: int = 1) -> Seconds:
        """Device seconds of both passes, the smallest of several measurements."""
        samples = []
        for _ in range(times):
            maps = self.renderer.build_maps(scene) if method == "tfm" else []
            view = self.renderer.render(scene, maps=maps, method=method).stats.seconds["view_pass"]
            samples.append({"map": sum(built.buffers.seconds for built in maps), "view": view})
        least = _least(samples)
        return {**least, "frame": sum(least.values())}


def with_map(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the map."""
    return scene.replace(map=scene.map.replace(**changes))


def with_march(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the march."""
    return scene.replace(march=scene.march.replace(**changes))


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.square(values).mean()))


def roughness(image: Image, truth: Image) -> float:
    """RMS of the Laplacian of the error's luminance over the lit pixels, over the reference's mean there."""
    error = (image - truth)[..., :3].astype(np.float64) @ REC709
    laplacian = sum(np.roll(error, shift, axis) for shift in (1, -1) for axis in (0, 1)) - 4 * error
    lit = lit_mask(truth)
    return rms(laplacian[lit]) / float((truth[lit, :3] @ REC709).mean())
