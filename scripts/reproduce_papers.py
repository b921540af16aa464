#!/usr/bin/env python3
"""Reproduce the figures and tables of the papers that this project builds on, beside their numbers.

TFM: Delalandre et al., "Transmittance Function Mapping", I3D 2011. FOM: Jansen and Bavoil, "Fourier
Opacity Mapping", I3D 2010. OSM: Kim and Neumann, "Opacity Shadow Maps", Eurographics Workshop on
Rendering 2001.

Each of their claims gives one line, ``holds``, ``holds when …`` or ``does not hold``, which is computed from
the measurements. Where the papers show particles, hair or a bunny, the sample volumes are used instead:
``plume`` is smoke, ``cumulus`` a cloud, and ``figure``, with hard edges, the pathological case. Speeds are
ratios within one run, of device seconds measured in turn. Writes ``papers.md``, ``papers.json`` and one
picture per study.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import InputError
from tfm_cl.files.paths import replacing, write_text
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.resolved import resolve
from tfm_cl.metrics import REC709, display_rgb, lit_mask, white_of
from tfm_cl.scene.lights.base import texel_positions

VOLUMES = Path(__file__).resolve().parents[1] / "volumes"
SMOKE, CLOUD, HARD = "plume", "cumulus", "figure"

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

# The criteria. If a paper gives a number, that is the bound; if it gives a word, this is our reading of it.
INDISTINGUISHABLE = 0.99
"""Smallest SSIM that counts as 'almost indistinguishable': the least in TFM's table 1 with 8 coefficients is
0.9903."""
PLAUSIBLE = 0.9868
"""Smallest SSIM that counts as 'plausible': that of the worse of the paper's pictures with 2 coefficients."""
DRASTIC = 2.0
"""Factor by which the error falls if it is 'drastically reduced'."""
STEADY = 0.8
"""Smallest ratio of the frame rates with 16 and with 2 coefficients: the worse of the paper's two volumes has
0.81."""
COINCIDES = 0.02
"""Largest difference, as a fraction of full transmittance, at which two curves in a plot of a few hundred
pixels 'coincide almost exactly'."""
NEGLIGIBLE = 0.01
"""Largest change due to an outlier, and largest overshoot that is not ringing, as a fraction of full
transmittance."""
SAME_SIZE = 1.25
"""Largest ratio of two critical sizes, or of two costs, that are 'the same' or 'comparable'."""
MAP_PRICE = 1.5
"""Largest ratio of costs in 'at a disadvantage by as much as 1.5x'."""
FOURFOLD = (1.8, 5.0)
"""Factors of cost for four times the texels that are 'approximately proportional': the paper's own tables
have 1.9 to 4.0."""
LINEAR = 0.99
"""Smallest R² of a relation that is 'linear'."""


# The results of a study.


@dataclass(frozen=True)
class Case:
    """A claim under one condition."""

    where: str
    measured: dict[str, float]
    holds: bool


@dataclass(frozen=True)
class Claim:
    """A claim of a paper, and the measurements."""

    text: str
    paper: str
    """The paper's number or wording."""
    cases: tuple[Case, ...]

    @property
    def verdict(self) -> str:
        """``holds``, ``holds when …`` or ``does not hold``."""
        kept = [case.where for case in self.cases if case.holds]
        broken = [case.where for case in self.cases if not case.holds]
        if not kept:
            return "does not hold"
        if not broken:
            return "holds"
        return (
            f"holds when {'; '.join(kept)}"
            if len(kept) <= len(broken)
            else f"holds when not {'; '.join(broken)}"
        )

    @property
    def measured(self) -> str:
        """The measured values, in words."""
        return "; ".join(
            " ".join([f"{case.where}:" if case.where else "", ", ".join(_named(case.measured))]).strip()
            for case in self.cases
        )


def _named(values: dict[str, float]) -> Iterable[str]:
    return (f"{name} {shown(value)}".strip() for name, value in values.items())


def at_least(where: str, value: float, bound: float, what: str = "") -> Case:
    """Make a case that holds if a number is at least a bound."""
    return Case(where, {what: value}, value >= bound)


def at_most(where: str, value: float, bound: float, what: str = "") -> Case:
    """Make a case that holds if a number is at most a bound."""
    return Case(where, {what: value}, value <= bound)


def smaller(where: str, **values: float) -> Case:
    """Make a case that holds if the first of two numbers is smaller than the second."""
    first, second = values.values()
    return Case(where, {name.replace("_", " "): value for name, value in values.items()}, first < second)


@dataclass(frozen=True)
class Study:
    """A reproduced figure or table of a paper."""

    title: str
    how: str
    """The differences from the paper's setup."""
    claims: list[Claim]
    rows: list[list[str]]
    """Rows of a table, the header first."""
    figure: Figure | None = None


# The measurements.


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


class Lab:
    """A renderer, sizes, and data shared by several studies."""

    def __init__(self, renderer: tfm.Renderer, sizes: Sizes) -> None:
        self.renderer = renderer
        self.sizes = sizes
        self.scene = cache(self._scene)
        self.side = cache(self._side)
        self.table = cache(self._table)

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

    def _table(self, name: str) -> Table1:
        return Table1(self, self.scene(name))


SIDE_DISTANCE = 5.0
"""Distance from the centre of the medium to the light of `Lab.side`, in radii of the medium."""
WHITE = (10.0, 10.0, 10.0)
"""Intensity of the lights placed by this script."""


def with_map(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the map."""
    return scene.replace(map=scene.map.replace(**changes))


def with_march(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the march."""
    return scene.replace(march=scene.march.replace(**changes))


# Single light rays, with the library's own functions.

CELLS = 512
"""Number of steps along a ray."""
EDGES: Floats = np.arange(CELLS + 1) / CELLS
MIDDLES: Floats = (np.arange(CELLS) + 0.5) / CELLS
DEPTHS = (0.5, 12.0)
"""Range of the optical depths of the rays studied: neither nearly transparent nor opaque."""


def reconstructed(basis: str, n: int, steps: Floats) -> Floats:
    """Optical depth from n coefficients, not clamped, [rays, `CELLS` + 1], at the edges of the steps.

    ``steps`` are optical depths of equal steps, [rays, `CELLS`].
    """
    make = BASES[basis].functions
    assert make is not None  # noqa: S101 - bases with functions only
    functions = make(resolve(tfm.MapSettings(basis=basis, coeffs=n)), None)
    depth: Floats = (steps @ functions.analysis(CELLS)) @ functions.values(EDGES).T
    return depth


def accumulated(steps: Floats) -> Floats:
    """Exact optical depth at the edges of the steps."""
    depth: Floats = np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)
    return depth


def profiles(lab: Lab, name: str, *, per_ray: bool = False) -> Floats:
    """Optical depths of the steps of some of the light's rays, [rays, `CELLS`].

    All rays share one range, from the nearest to the farthest density, or each has that of the medium's box.
    """
    scene = lab.side(name)
    light, volume = scene.lights[0], scene.grids[0]
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - as `Lab.side` makes it
    rays = reference.map_rays(light, texel_positions(lab.sizes.rays).reshape(-1, 2))
    begin, end = reference.march_bounds(volume, *rays)
    rays, begin, end = rays.part(np.flatnonzero(end > begin)), begin[end > begin], end[end > begin]
    if not per_ray:
        near, far = np.full_like(begin, begin.min()), np.full_like(end, end.max())
        occupied = np.flatnonzero(_steps(scene, rays, near, far).any(axis=0))
        width = (far - near) / CELLS
        begin, end = near + occupied[0] * width, near + (occupied[-1] + 1) * width
    steps = _steps(scene, rays, begin, end)
    total = steps.sum(axis=1)
    chosen: Floats = steps[(total > DEPTHS[0]) & (total < DEPTHS[1])]
    return chosen


def _steps(scene: tfm.Scene, rays: reference.Rays, begin: Floats, end: Floats) -> Floats:
    distance = begin[:, None] + (end - begin)[:, None] * MIDDLES
    points = rays.origins[:, None] + distance[..., None] * rays.directions[:, None]
    sigma_t = float(scene.medium.sigma_t.mean())
    steps: Floats = sigma_t * reference.density(scene.grids[0], points) * ((end - begin) / CELLS)[:, None]
    return steps


def most_features(steps: Floats) -> int:
    """Return the ray whose density rises most often, which is drawn."""
    smooth = np.apply_along_axis(lambda row: np.convolve(row, np.ones(25) / 25, "same"), 1, steps)
    high = smooth > 0.25 * smooth.max(axis=1, keepdims=True)
    return int((np.diff(high.astype(int), axis=1) > 0).sum(axis=1).argmax())


# Drawing.

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
EXACT: dict[str, Any] = {"color": "#222222", "linewidth": 2.2, "alpha": 0.5, "label": "exact"}


def plots(count: int, height: float = 3.0) -> tuple[Figure, list[Axes]]:
    """Return a figure with plots side by side."""
    figure = Figure(figsize=(4.2 * count, height), dpi=90, layout="constrained")
    return figure, [figure.add_subplot(1, count, i + 1) for i in range(count)]


def pictures(rows: Sequence[Sequence[tuple[str, Image | Floats, float]]], width: float = 2.4) -> Figure:
    """Return a figure with rows of pictures: caption, linear RGB, and the value shown as white."""
    columns = max(map(len, rows))
    heights = [width * row[0][1].shape[0] / row[0][1].shape[1] + 0.3 for row in rows]
    figure = Figure(figsize=(width * columns, sum(heights)), dpi=100, layout="constrained")
    grid = figure.add_gridspec(len(rows), columns, height_ratios=heights)
    for y, row in enumerate(rows):
        for x, (caption, image, white) in enumerate(row):
            axes = figure.add_subplot(grid[y, x])
            axes.imshow(display_rgb(image, white))
            axes.set_title(caption, fontsize=8)
            axes.set_axis_off()
    return figure


def lit_window(image: Image) -> tuple[slice, slice]:
    """Return the part of a picture that shows the medium."""
    y, x = np.nonzero(lit_mask(image))
    if len(y) == 0:
        return slice(None), slice(None)
    return slice(int(y.min()), int(y.max()) + 1), slice(int(x.min()), int(x.max()) + 1)


def curves(axes: Axes, title: str, exact: Floats, found: dict[str, Floats]) -> None:
    """Plot an exact transmittance and its reconstructions over the range."""
    axes.plot(EDGES, exact, **EXACT)
    for (label, values), colour in zip(found.items(), COLOURS, strict=False):
        axes.plot(EDGES, values, color=colour, linewidth=1.1, label=label)
    axes.set_title(title, fontsize=9)
    axes.set_xlabel("depth")
    axes.set_ylabel("transmittance")
    axes.legend(fontsize=7)


def shown(value: float) -> str:
    """Format a number with three significant digits; near 1, those of the difference from 1."""
    if not np.isfinite(value):
        return str(value)
    if 0.9 <= value < 1:  # noqa: PLR2004 - the range of SSIM and R²
        return f"{value:.4f}"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"  # noqa: PLR2004 - not 1e+03


# Transmittance Function Mapping.

NUMBERS = (2, 8, 16)
ALPHAS = (10.0, 1.0)
PAPER_FPS = {SMOKE: (15.10, 14.78, 12.18), HARD: (14.41, 14.20, 13.98)}
PAPER_SSIM = {
    (SMOKE, 10.0): (0.9973, 0.9974, 0.9974),
    (SMOKE, 1.0): (0.8712, 0.9549, 0.9535),
    (HARD, 10.0): (0.9868, 0.9903, 0.9905),
    (HARD, 1.0): (0.7977, 0.8257, 0.7755),
}
PAPER_PSNR = {
    (SMOKE, 10.0): (54.52, 58.58, 60.02),
    (SMOKE, 1.0): (17.64, 25.50, 25.60),
    (HARD, 10.0): (35.61, 43.27, 46.19),
    (HARD, 1.0): (16.74, 15.07, 14.30),
}
"""PSNR in TFM table 1 by volume and α, with 2, 8 and 16 coefficients."""
PAPER_SPEEDUP = (14.61 / 1.6, 14.20 / 1.6, 13.90 / 1.6)
"""Speed-ups over the dual march in TFM figure 10, with 2, 8 and 16 coefficients."""
PLAIN_MARCH = {"skip_empty": False, "cutoff": 0.0}
"""March as in the papers: every step of every ray."""
SETTINGS = ("every step marched", "empty space skipped", "scene file")
"""Settings of the speed measurements: twice one light and a medium that fills the frame; then two lights, as
pictured."""
HAZE = 1e-5
"""Density added to every voxel, as a fraction of the largest, so that every sample needs its light, as in the
papers' marches."""


def hazy(scene: tfm.Scene) -> tfm.Scene:
    """Return the scene without empty space, otherwise unchanged."""
    volume = scene.grids[0]
    data = np.maximum(volume.data, np.float32(HAZE) * volume.data.max())
    return scene.replace(
        volume=tfm.Volume(data, world_from_index=volume.world_from_index, density_scale=volume.density_scale)
    )


class Table1:
    """Data shared by TFM's table 1 and figure 10."""

    def __init__(self, lab: Lab, scene: tfm.Scene) -> None:
        self._lab, self.scene = lab, scene
        self.dual = lab.renderer.render(scene, method="dual").image
        self.images = {
            (n, alpha): lab.image(scene, coeffs=n, density_weighting=alpha)
            for n in NUMBERS
            for alpha in ALPHAS
        }
        self.compared = {key: tfm.compare(image, self.dual) for key, image in self.images.items()}

    @cached_property
    def frames(self) -> Timings:
        """Device seconds of frames with each number, and of the dual march, in `SETTINGS`."""
        placed = tfm.Scene(self.scene.grids[0], self.scene.medium, map=self.scene.map, march=self.scene.march)
        filled = placed.replace(camera=placed.camera.replace(res=self._lab.sizes.frame))
        scenes = (with_march(hazy(filled), **PLAIN_MARCH), filled, self.scene)
        measurements: dict[Any, Callable[[], Seconds]] = {}
        for setting, scene in zip(SETTINGS, scenes, strict=True):
            for n in NUMBERS:
                mapped = with_map(scene, coeffs=n, density_weighting=10.0)
                measurements[setting, n] = lambda mapped=mapped: self._lab.frame_seconds(mapped)  # type: ignore[misc]
            measurements[setting, "dual"] = lambda scene=scene: self._lab.frame_seconds(scene, "dual")  # type: ignore[misc]
        return self._lab.least(measurements)


def tfm_table1(lab: Lab) -> Study:
    """Quality with and without density weighting."""
    rows = [["volume", "n", "α", "SSIM", "paper", "PSNR", "paper", "lit SSIM", "fps / fps at n = 2", "paper"]]
    enough, better, psnr_paper, steady = [], [], [], []
    psnr_rises: list[Case] = []
    falls: list[Case] = []
    for name in (SMOKE, HARD):
        table = lab.table(name)
        fps = {n: 1 / table.frames.least["every step marched", n]["frame"] for n in NUMBERS}
        for i, n in enumerate(NUMBERS):
            for alpha in ALPHAS:
                found = table.compared[n, alpha]
                ssim, psnr = PAPER_SSIM[name, alpha][i], PAPER_PSNR[name, alpha][i]
                speed = [shown(fps[n] / fps[2]), shown(PAPER_FPS[name][i] / PAPER_FPS[name][0])]
                lit = shown(found.lit.ssim) if found.lit else "-"
                quality = [shown(found.ssim), shown(ssim), shown(found.psnr), shown(psnr), lit]
                rows.append([name, str(n), f"{alpha:g}", *quality, *speed])
            with_weighting, without = table.compared[n, 10.0], table.compared[n, 1.0]
            better.append(
                Case(
                    f"{name}, n = {n}",
                    {"ΔSSIM": with_weighting.ssim - without.ssim, "ΔdB": with_weighting.psnr - without.psnr},
                    with_weighting.ssim > without.ssim and with_weighting.psnr > without.psnr,
                )
            )
            if n >= 8:  # noqa: PLR2004 - the paper's
                enough.append(at_least(f"{name}, n = {n}", with_weighting.ssim, INDISTINGUISHABLE))
                psnr_paper.append(
                    at_least(f"{name}, n = {n}", with_weighting.psnr, PAPER_PSNR[name, 10.0][i], "dB")
                )
        for alpha, cases, rising in ((10.0, psnr_rises, True), (1.0, falls, False)):
            series = [table.compared[n, alpha].psnr for n in NUMBERS]
            ordered = bool((np.diff(series) > 0).all() if rising else series[-1] < series[0])
            cases.append(Case(name, {f"n = {n}": dB for n, dB in zip(NUMBERS, series, strict=True)}, ordered))
        steady.append(at_least(name, fps[16] / fps[2], STEADY))
    claims = [
        Claim(
            "TFM 7.2.1: with 8 or more coefficients and α = 10 almost indistinguishable from the dual march",
            "SSIM 0.9974 (smoke), 0.9903 and 0.9905 (hard edges)",
            tuple(enough),
        ),
        Claim("TFM table 1: α = 10 is better than α = 1 in SSIM and PSNR", "in all rows", tuple(better)),
        Claim(
            "TFM table 1: with α = 10 PSNR rises with n",
            "54.5, 58.6, 60.0 dB; 35.6, 43.3, 46.2 dB",
            tuple(psnr_rises),
        ),
        Claim(
            "TFM table 1: PSNR with α = 10 is at least the paper's",
            "58.6 and 60.0 dB (smoke), 43.3 and 46.2 dB (hard edges)",
            tuple(psnr_paper),
        ),
        Claim(
            "TFM table 1: without density weighting hard edges get worse with more coefficients",
            "PSNR 16.7, 15.1, 14.3 dB (hard edges only)",
            tuple(case for case in falls if case.where == HARD),
        ),
        Claim(
            "TFM table 1: 16 coefficients cost little more than 2 (fps at 16 over fps at 2)",
            "0.81 (smoke), 0.97 (hard edges)",
            tuple(steady),
        ),
    ]
    figure, axes = plots(2)
    for plot, name in zip(axes, (SMOKE, HARD), strict=True):
        for alpha, colour in zip(ALPHAS, COLOURS, strict=False):
            series = [lab.table(name).compared[n, alpha].psnr for n in NUMBERS]
            plot.plot(NUMBERS, series, color=colour, marker="o", label=f"α = {alpha:g}")
            label = f"α = {alpha:g}, paper"
            plot.plot(NUMBERS, PAPER_PSNR[name, alpha], color=colour, linestyle=":", marker="s", label=label)
        plot.set_title(f"{name}: PSNR against the dual march", fontsize=9)
        plot.set_xlabel("coefficients per texel")
        plot.set_ylabel("dB")
        plot.legend(fontsize=7)
    how = (
        "Other volumes and lights than the paper's, two lights each. SSIM and PSNR of sRGB luma over the "
        "frame, as the paper's presumably; 'lit SSIM' leaves the background out. fps with every step "
        "marched, see figure 10."
    )
    return Study(
        "TFM table 1: quality and speed, with and without density weighting", how, claims, rows, figure
    )


def tfm_fig5(lab: Lab) -> Study:
    """Compare few samples, uniform in the light's projective space and in the world."""
    smoke = with_map(lab.scene(SMOKE), density_weighting=10.0)
    collinear, across = gobo_scenes(lab)
    views = {
        "along the light, max_stretch = 10⁶ (paper)": with_march(collinear, max_stretch=1e6),
        "along the light, max_stretch = 4": collinear,
        "across the light": across,
        SMOKE: smoke,
    }
    rows = [["view", "projective, visible error", "world"]]
    cases, shown_rows = [], []
    for where, scene in views.items():
        maps = lab.renderer.build_maps(scene)

        def few(sampling: str, steps: int, scene: tfm.Scene = scene, maps: Any = maps) -> Image:
            marched = with_march(scene, sampling=sampling, steps=steps)
            return lab.renderer.render(marched, maps=maps).image

        truth = few("world", lab.sizes.fine_steps)
        images = {sampling: few(sampling, 10) for sampling in ("projective", "world")}
        errors = {sampling: lab.error(image, truth) for sampling, image in images.items()}
        rows.append([where, *map(shown, errors.values())])
        cases.append(smaller(where, **errors))
        if where != SMOKE:
            white = white_of(truth.astype(np.float64))
            captions = {f"10 samples, {sampling}": image for sampling, image in images.items()}
            panels = {f"{where}:\n{lab.sizes.fine_steps} samples": truth, **captions}
            shown_rows.append([(caption, image, white) for caption, image in panels.items()])
    claim = Claim(
        "TFM 4.2: few samples uniform in projective space are nearer to many than those uniform in the "
        "world, especially when light and view are nearly collinear",
        "pictures only",
        tuple(cases),
    )
    how = (
        "The projective texture is a sheet of dense voxels with holes, close to the light, before "
        "homogeneous fog; all three pictures look up the same map."
    )
    title = "TFM figure 5: 10 samples in projective space and in the world"
    return Study(title, how, [claim], rows, pictures(shown_rows, 3.0))


GOBO_VOXEL = (0.0125, 0.0125, 0.025)
GOBO_PERIOD = 8
"""Distance between holes in voxels; the cone meets five holes."""
GOBO_SHEET = (2, 5)
"""Indices along the light of the first voxel of the sheet, and of the first one behind it."""


def gobo_scenes(lab: Lab) -> tuple[tfm.Scene, tfm.Scene]:
    """Return fog lit through a sheet with holes, seen along the light and across it."""
    side, length = 264, 160
    density = np.full((length, side, side), 0.12, np.float32)
    y, x = np.mgrid[:side, :side] % GOBO_PERIOD < GOBO_PERIOD // 2
    begin, end = GOBO_SHEET
    density[begin:end] = np.where(x & y, 0.0, 250.0)
    corner = (-side / 2 * GOBO_VOXEL[0], -side / 2 * GOBO_VOXEL[1], 0.0)
    volume = tfm.Volume(density, voxel_size=GOBO_VOXEL, origin=corner)
    light = tfm.SpotLight(from_=(0, 0, -0.7), to=(0, 0, 4), cone=18, intensity=(30, 30, 30))
    width, height = (max(16, round(lab.sizes.picture * pixels)) for pixels in (480, 360))
    # Behind the sheet, so that it does not hide the lit fog.
    along = tfm.Camera(from_=(0.33, 0.12, 0.16), to=(-0.1, 0, 4), fov=50, res=(width, height))
    across = tfm.Camera(from_=(4.8, 0.8, 2.6), to=(0, 0, 2.6), fov=32, res=(width, height))
    steps = 4 * length
    scene = tfm.Scene(
        volume,
        tfm.Medium(sigma_s=(1, 1, 1), sigma_a=(0, 0, 0)),
        along,
        [light],
        # Coefficients whose interpolation resolves the sheet, since the sampling is to be compared.
        tfm.MapSettings(
            basis="slices", coeffs=32, slicing="gamma", range="box", res=lab.sizes.map_res, steps=steps
        ),
        tfm.MarchSettings(cutoff=0.0),
    )
    return scene, scene.replace(camera=across)


def tfm_fig7(lab: Lab) -> Study:
    """Ringing with 16 coefficients, with and without density weighting."""
    cases, shown_rows = [], []
    rows = [["volume", "α = 1, visible error", "α = 10", "ratio"]]
    for name in (CLOUD, SMOKE, HARD):
        scene = lab.scene(name)
        truth = lab.renderer.render(scene, method="dual").image
        images = {alpha: lab.image(scene, coeffs=16, density_weighting=alpha) for alpha in (1.0, 10.0)}
        plain, weighted = (lab.error(image, truth) for image in images.values())
        rows.append([name, shown(plain), shown(weighted), shown(plain / weighted)])
        cases.append(at_least(name, plain / weighted, DRASTIC))
        white, part = white_of(truth.astype(np.float64)), lit_window(truth)
        difference = [
            (f"|difference| × 10, α = {alpha:g}", 10 * np.abs(image - truth)[part], white)
            for alpha, image in images.items()
        ]
        captioned = [(f"{name}, α = {alpha:g}", image[part], white) for alpha, image in images.items()]
        if name == CLOUD:
            shown_rows.append([("dual march", truth[part], white), *captioned, *difference])
    claim = Claim(
        "TFM 6.2: density weighting drastically reduces ringing in dense media (16 coefficients: error with "
        "α = "
        f"1 over error with α = 10, at least {DRASTIC:g})",
        "pictures only",
        tuple(cases),
    )
    title = "TFM figure 7: 16 coefficients with α = 1 and α = 10"
    return Study(
        title,
        "Visible error: RMS of sRGB luma over the lit pixels.",
        [claim],
        rows,
        pictures(shown_rows, 2.8),
    )


def tfm_fig8(lab: Lab) -> Study:
    """Show the transmittance along a ray, and how fast its series converges."""
    counts = (2, 4, 8, 16, 32)
    rows = [["volume", "α", *(f"median L2 error, n = {n}" for n in counts), "rays with falling error"]]
    monotone, rapid = [], []
    figure, axes = plots(3)
    for name in (SMOKE, CLOUD, HARD):
        steps = profiles(lab, name, per_ray=True)
        depth = accumulated(steps)
        exact = np.exp(-0.5 * (depth[:, 1:] + depth[:, :-1]))
        for alpha in (1.0, 10.0):
            found = {n: cosines(exact, n, alpha) for n in counts}
            errors = np.array([np.sqrt(np.square(found[n] - exact).mean(axis=1)) for n in counts])
            falling = float((np.diff(errors, axis=0) <= 0).all(axis=0).mean())
            median = np.median(errors, axis=1)
            rows.append([name, f"{alpha:g}", *map(shown, median), f"{falling:.1%}"])
            where = f"{name}, α = {alpha:g}"
            monotone.append(Case(where, {"of the rays": falling}, falling == 1))
            rapid.append(at_least(where, float(median[0] / median[2]), 4.0, "times"))
            if name == SMOKE:
                ray = most_features(steps)
                plot = axes[0 if alpha == 1 else 1]
                plot.plot(MIDDLES, exact[ray], **EXACT)
                for (n, values), colour in zip(found.items(), COLOURS, strict=False):
                    plot.plot(MIDDLES, values[ray], color=colour, linewidth=1.1, label=f"n = {n}")
                plot.set_title(f"{name}: a light ray, α = {alpha:g}", fontsize=9)
                plot.set_xlabel("depth")
                plot.set_ylabel("transmittance")
                plot.legend(fontsize=7)
            style = "-" if alpha == 1 else "--"
            colour = COLOURS[(SMOKE, CLOUD, HARD).index(name)]
            axes[2].plot(counts, median, style, color=colour, marker="o", markersize=3, label=where)
    axes[2].set_xscale("log", base=2)
    axes[2].set_yscale("log")
    axes[2].set_xlabel("coefficients n")
    axes[2].set_title("median L2 error of T", fontsize=9)
    axes[2].legend(fontsize=6)
    claims = [
        Claim(
            "TFM figure 8: the L2 error of T falls with every doubling of n, on every ray",
            "–",
            tuple(monotone),
        ),
        Claim(
            "TFM figure 8: the error drops rapidly (n = 2 over n = 8, median of the rays, at least 4)",
            "plot only",
            tuple(rapid),
        ),
    ]
    how = "Rays of a light from the left, between the sides of the medium's box; T̂ clamped to [0, 1]."
    return Study("TFM figure 8: reconstructions of T along a ray", how, claims, rows, figure)


def cosines(exact: Floats, n: int, alpha: float) -> Floats:
    """T̂ of TFM eq. 8–10, 19 and 20 at the steps' midpoints, clamped."""
    make = BASES["dct"].functions
    assert make is not None  # noqa: S101 - it has
    functions = make(resolve(tfm.MapSettings(basis="dct", coeffs=n)), None)
    numbers = exact ** (1 / alpha) @ functions.analysis(CELLS)
    found: Floats = np.clip(numbers @ functions.values(MIDDLES).T, 0, 1) ** alpha
    return found


def tfm_fig10(lab: Lab) -> Study:
    """Pictures and speed of 2, 8 and 16 coefficients against the dual march."""
    rows = [["volume", "march", *(f"dual / TFM, n = {n}" for n in NUMBERS)]]
    rows.append(["paper", "hard edges, GTX 480", *map(shown, PAPER_SPEEDUP)])
    faster, plausible, shown_rows = [], [], []
    for name in (SMOKE, HARD):
        table = lab.table(name)
        for march in SETTINGS:
            dual = table.frames.least[march, "dual"]["frame"]
            ratios = [dual / table.frames.least[march, n]["frame"] for n in NUMBERS]
            rows.append([name, march, *map(shown, ratios)])
            measured = {f"n = {n}": ratio for n, ratio in zip(NUMBERS, ratios, strict=True)}
            enough = all(ratio >= paper for ratio, paper in zip(ratios, PAPER_SPEEDUP, strict=True))
            faster.append(Case(f"{name}, {march}", measured, enough))
        plausible.append(at_least(name, table.compared[2, 10.0].ssim, PLAUSIBLE))
        white = white_of(table.dual.astype(np.float64))
        shown_rows.append(
            [
                ("dual march", table.dual, white),
                *(
                    (
                        f"n = {n}: SSIM {shown(table.compared[n, 10.0].ssim)}",
                        table.images[n, 10.0],
                        white,
                    )
                    for n in NUMBERS
                ),
            ]
        )
    claims = [
        Claim(
            "TFM figure 10: a frame, its map included, is faster than the dual march by at least as much",
            ", ".join(f"{ratio:.1f} ×" for ratio in PAPER_SPEEDUP) + " for n = 2, 8, 16",
            tuple(faster),
        ),
        Claim(
            "TFM 7.2.1: 2 coefficients are visually plausible (SSIM with α = 10, at least the paper's)",
            "0.9973 (smoke), 0.9868 (hard edges)",
            tuple(plausible),
        ),
    ]
    how = (
        f"Every step marched: as the paper's shaders do, {'×'.join(map(str, lab.sizes.frame))} pixels, one "
        "light and camera placed so that the medium fills the frame. Samples without density need no light "
        f"here, so every voxel gets {HAZE:g} of the largest density, which cannot be seen. Empty space "
        "skipped: the same without that and with this renderer's defaults, which serve both methods. Scene "
        "file: what the pictures show, defaults, two lights and so two maps. " + lab.table(SMOKE).frames.note
    )
    title = "TFM figure 10: pictures and speed against the dual march"
    return Study(title, how, claims, rows, pictures(shown_rows))


# Fourier Opacity Mapping.


def fom_fig1(lab: Lab) -> Study:
    """Fifteen coefficients in one dimension."""
    rows = [["volume", "density", "largest |T̂ - T|, median of the rays", "worst ray"]]
    cases = []
    figure, axes = plots(3)
    for plot, name in zip(axes, (SMOKE, CLOUD, HARD), strict=True):
        steps = profiles(lab, name)
        for scale in (1.0, 0.25):
            exact = np.exp(-scale * accumulated(steps))
            found = np.exp(-np.maximum(reconstructed("fourier", 15, scale * steps), 0))
            largest = np.abs(found - exact).max(axis=1)
            rows.append([name, f"× {scale:g}", shown(float(np.median(largest))), shown(float(largest.max()))])
            cases.append(at_most(f"{name}, density × {scale:g}", float(np.median(largest)), COINCIDES))
            if scale == 1:
                ray = most_features(steps)
                curves(plot, f"{name}: the ray with most features", exact[ray], {"FOM, n = 15": found[ray]})
    claim = Claim(
        "FOM figure 1(c): with 15 coefficients exact and reconstructed T coincide almost exactly, in spite "
        "of "
        f"several features (median over rays of the largest difference, at most {COINCIDES:g})",
        "plot only",
        tuple(cases),
    )
    how = "Rays of a light from the left; one range for all, from the nearest to the farthest density."
    return Study("FOM figure 1(c): reconstruction with 15 coefficients", how, [claim], rows, figure)


METHODS = {"FOM": "fourier", "OSM": "slices"}


def roughness(image: Image, truth: Image) -> float:
    """RMS of the Laplacian of the error's luminance over the lit pixels, over the reference's mean there."""
    error = (image - truth)[..., :3].astype(np.float64) @ REC709
    laplacian = sum(np.roll(error, shift, axis) for shift in (1, -1) for axis in (0, 1)) - 4 * error
    lit = lit_mask(truth)
    return _rms(laplacian[lit]) / float((truth[lit, :3] @ REC709).mean())


def fom_fig4(lab: Lab) -> Study:
    """Numbers and resolution, FOM against OSM."""
    scene = lab.side(SMOKE)
    truth = lab.renderer.render(scene, method="dual").image
    white = white_of(truth.astype(np.float64))
    coarse, fine = lab.sizes.coarse_and_fine
    rows = [["map", "n", "method", "SSIM", "visible error", "roughness of the error"]]
    nearer, smoother, good, shown_rows = [], [], [], []
    for res, n in ((fine, 3), (fine, 15), (coarse, 3), (coarse, 15)):
        images = {
            method: lab.image(scene, basis=basis, coeffs=n, range="global", res=res)
            for method, basis in METHODS.items()
        }
        errors = {method: lab.error(image, truth) for method, image in images.items()}
        stripes = {method: roughness(image, truth) for method, image in images.items()}
        for method, image in images.items():
            ssim = tfm.compare(image, truth).ssim
            rows.append([f"{res}²", str(n), method, *map(shown, (ssim, errors[method], stripes[method]))])
        where = f"n = {n}, {res}² map"
        nearer.append(smaller(where, **errors))
        smoother.append(smaller(where, **stripes))
        if (res, n) == (fine, 15):
            good.append(at_least(where, tfm.compare(images["FOM"], truth).ssim, INDISTINGUISHABLE))
        shown_rows.append(
            [
                *((f"{method}, {where}", image, white) for method, image in images.items()),
                *(
                    (f"{method}: |error| × 4", 4 * np.abs(image - truth), white)
                    for method, image in images.items()
                ),
            ]
        )
    claims = [
        Claim(
            "FOM figure 4: 15 coefficients give smoke without artefacts (SSIM at least 0.99)",
            "pictures only",
            tuple(good),
        ),
        Claim(
            "FOM figure 4, section 1: no slice-like artefacts: FOM's error is smoother than OSM's with as "
            "many coefficients (RMS Laplacian)",
            "pictures only",
            tuple(smoother),
        ),
        Claim(
            "FOM figure 4: FOM's picture is nearer to the truth than OSM's with as many coefficients "
            "(visible "
            "error)",
            "pictures only",
            tuple(nearer),
        ),
    ]
    how = (
        "The plume under one light from the left; one depth range for all rays, planes and series alike; "
        "against the dual march."
    )
    title = f"FOM figure 4: 3 and 15 coefficients, maps of {coarse}² and {fine}²"
    return Study(title, how, claims, rows, pictures(shown_rows[:2] + shown_rows[3:], 2.2))


PADDING = 36
"""Empty voxels along the light before and behind the medium, with room for puffs that mark a depth bound."""
MARK = 1e-6
"""Density of a mark, as a fraction of the largest: enough to set a bound, far too little to be visible."""
MARK_RADIUS = 3.0
"""Radius of a marking puff in voxels."""
RANGE_MARGIN = 0.02
"""Margin at either end of the range ``global`` (`tfm_cl.maps.probe.GLOBAL_MARGIN`)."""


def padded(
    volume: tfm.Volume, before: int, behind: int
) -> tuple[NDArray[np.float32], tuple[float, float, float]]:
    """Return the voxels with empty ones before and behind along x, and their origin."""
    data = np.pad(volume.data, ((0, 0), (0, 0), (before, behind)))
    x, y, z = volume.bounds[0] + volume.voxel_size / 2  # bounds end at the centres of a border of voxels
    return data, (float(x - before * volume.voxel_size[0]), float(y), float(z))


def with_puffs(
    scene: tfm.Scene, before: int, behind: int, puffs: Iterable[tuple[float, float, float]]
) -> tfm.Scene:
    """Pad the volume along x and add puffs on the light's axis: world x, radius in voxels, stored density."""
    volume, light = scene.grids[0], scene.lights[0]
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - as `Lab.side` makes it
    data, origin = padded(volume, before, behind)
    z, y, x = np.meshgrid(*map(np.arange, data.shape), indexing="ij", sparse=True)
    for at, radius, density in puffs:
        centre = (np.array([at, light.to[1], light.to[2]]) - origin) / volume.voxel_size - 0.5
        inside = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2 <= radius**2
        data[inside] = np.maximum(data[inside], np.float32(density))
    size = tuple(map(float, volume.voxel_size))
    return scene.replace(
        volume=tfm.Volume(data, voxel_size=size, origin=origin, density_scale=volume.density_scale)  # type: ignore[arg-type]
    )


def depth_range(maps: list[tfm.TransmittanceMap]) -> tuple[float, float]:
    """Nearest and farthest depth of a map of the range ``global``, without its margin."""
    begin, end = map(float, maps[0].field[0, 0, :2])
    margin = RANGE_MARGIN * (end - begin) / (1 + 2 * RANGE_MARGIN)
    return begin + margin, end - margin


def fom_fig5(lab: Lab) -> Study:
    """Measure the effect of inflated and moved depth bounds."""
    base = lab.side(SMOKE)
    light_x = base.lights[0].frame().world_from_light[0, 3]
    settings = {"coeffs": 7, "range": "global"}
    near, far = depth_range(lab.renderer.build_maps(with_map(base, basis="fourier", **settings)))
    length = far - near
    density = MARK * float(base.grids[0].data.max())

    def bounded(low: float, high: float) -> tfm.Scene:
        """Extend the map's range by low and high beyond the medium, as fractions of its length."""
        radius = MARK_RADIUS * float(base.grids[0].voxel_size[0])
        ends = (near - low * length + radius, far + high * length - radius)
        marks = [(light_x + at, MARK_RADIUS, density) for at in ends] if low or high else []
        return with_puffs(base, PADDING, PADDING, marks)

    pairs = {
        "bounds inflated by 10 %": (bounded(0, 0), bounded(0.05, 0.05)),
        "bounds moved by 5 %": (bounded(0.1, 0.1), bounded(0.05, 0.15)),
    }
    rows = [
        ["change", "method", "largest change of the picture", "RMS change", "range, before", "range, after"]
    ]
    cases, shown_rows = [], []
    for what, (one, other) in pairs.items():
        truth = lab.renderer.render(one, method="dual").image
        white, lit = white_of(truth.astype(np.float64)), lit_mask(truth)
        control = np.abs(lab.renderer.render(other, method="dual").image - truth)[..., :3].max() / white
        rows.append([what, "dual march (control)", shown(float(control)), "", "", ""])
        largest, mean, panels = {}, {}, []
        for method, basis in METHODS.items():
            images, ranges = [], []
            for scene in (with_map(one, basis=basis, **settings), with_map(other, basis=basis, **settings)):
                maps = lab.renderer.build_maps(scene)
                ranges.append(" to ".join(f"{depth:.3f}" for depth in depth_range(maps)))
                images.append(lab.renderer.render(scene, maps=maps).image)
            change = np.abs(images[0] - images[1])[..., :3].astype(np.float64)
            largest[method] = float((change @ REC709).max()) / white
            mean[method] = _rms((change @ REC709)[lit]) / white
            rows.append([what, method, shown(largest[method]), shown(mean[method]), *ranges])
            panels += [
                (f"{method}, {what}", images[1], white),
                (f"{method}: |change| × 10", 10 * change, white),
            ]
        cases += [smaller(f"largest, {what}", **largest), smaller(f"RMS, {what}", **mean)]
        shown_rows.append(panels)
    claim = Claim(
        "FOM 7.1, figure 5: pictures change less than OSM's when the depth bounds change (7 coefficients, "
        "part "
        "of the picture's white)",
        "pictures only",
        tuple(cases),
    )
    how = (
        "The map's range is the same for all rays, from the nearest to the farthest density; the volume is "
        f"padded with empty voxels, and on the light's axis a puff of {MARK:g} of the largest density sets "
        "each new bound. Moved: from 10 % beyond the medium at both ends to 5 % before and 15 % behind, "
        "which moves the medium in the range. The ranges are those that the map's coarse rays found. The "
        "control is what the puffs change by themselves."
    )
    return Study("FOM figure 5: stability of the picture", how, [claim], rows, pictures(shown_rows))


def fom_fig6(lab: Lab) -> Study:
    """Measure the effect of a shift in depth, in one dimension."""
    n, room = 7, CELLS // 4
    shifts = range(0, CELLS // n + 1, 4)
    rows = [
        ["volume", "method", "largest change of T̂, median of the rays", "spread of the depth where T̂ = ½"]
    ]
    shape, place = [], []
    figure, axes = plots(2)
    for name in (SMOKE, CLOUD, HARD):
        squeezed = _squeezed(profiles(lab, name), room)
        dark = np.exp(-squeezed.sum(axis=1)) < 0.5  # noqa: PLR2004 - half the light
        change, spread = {}, {}
        for plot, (method, basis) in zip(axes, METHODS.items(), strict=True):
            moved = []
            for shift in shifts:
                depth = reconstructed(basis, n, np.roll(squeezed, shift, axis=1))
                moved.append(np.exp(-np.maximum(depth, 0))[:, shift : CELLS + 1 - CELLS // n + shift])
            stack = np.array(moved)
            change[method] = float(np.median((stack.max(axis=0) - stack.min(axis=0)).max(axis=1)))
            half = (stack[:, dark] <= 0.5).argmax(axis=-1) / CELLS  # noqa: PLR2004 - half the light
            spread[method] = float(np.median(half.max(axis=0) - half.min(axis=0)))
            rows.append([name, method, shown(change[method]), shown(spread[method])])
            if name == SMOKE:
                ray = most_features(squeezed)
                plot.plot(EDGES, np.exp(-accumulated(squeezed[ray : ray + 1])[0]), **EXACT)
                for i, colour in zip((0, len(shifts) // 3, 2 * len(shifts) // 3), COLOURS, strict=False):
                    label = f"moved by {shifts[i] / CELLS:.3f}, moved back"
                    plot.plot(
                        EDGES[: stack.shape[2]], stack[i, ray], color=colour, linewidth=1.1, label=label
                    )
                plot.set_title(f"{name}: {method}, {n} coefficients", fontsize=9)
                plot.set_xlabel("depth")
                plot.set_ylabel("transmittance")
                plot.legend(fontsize=7)
        shape.append(smaller(name, **change))
        place.append(smaller(name, **spread))
    claims = [
        Claim(
            "FOM 7.1, figure 6: T̂ changes less than OSM's when the density moves in depth (7 coefficients, "
            "largest change of T̂ over shifts of up to a slice)",
            "plot only",
            tuple(shape),
        ),
        Claim(
            "FOM figure 6: the place of the light-to-dark transition moves less (T̂ = ½, parts of the range)",
            "plot only",
            tuple(place),
        ),
    ]
    how = "The density fills the middle half of a fixed range; every reconstruction is moved back."
    return Study("FOM figure 6: stability under translation", how, claims, rows, figure)


def _squeezed(steps: Floats, room: int) -> Floats:
    """Put rays into the middle of the range, with ``room`` empty cells at either end."""
    depth, inner = accumulated(steps), CELLS - 2 * room
    at = np.arange(inner + 1) / inner
    inside = np.array([np.diff(np.interp(at, EDGES, row)) for row in depth])
    return np.pad(inside, ((0, 0), (room, room)))


PUFF = {"voxels": 8.0, "away": 75, "behind": 95}
"""FOM figure 7 in three dimensions: radius, distance behind the medium and padding, in voxels."""


def fom_fig7(lab: Lab) -> Study:
    """Measure the effect of a far, faint outlier."""
    n = 7
    centre = MIDDLES - 0.3
    body = 2.0 * np.exp(-np.square(centre / 0.09)) + 1.2 * np.exp(-np.square((centre - 0.14) / 0.05))
    body *= 1.5 / body.sum()
    bump = np.exp(-np.square((MIDDLES - 0.88) / 0.02))
    bump /= bump.sum()
    before = EDGES < 0.8  # noqa: PLR2004 - the outlier begins behind
    rows = [["outlier", "method", "range", "largest change of T̂ before the outlier", "RMS"]]
    cases = []
    figure, axes = plots(2)
    without = np.exp(-np.maximum(reconstructed("fourier", n, body[None])[0], 0))
    for opacity in (0.02, 0.05, 0.1, 0.3):
        steps = body - np.log1p(-opacity) * bump
        found = np.exp(-np.maximum(reconstructed("fourier", n, steps[None])[0], 0))
        change = np.abs(found - without)[before]
        rows.append([f"1-D, opacity {opacity:g}", "FOM", "fixed", shown(change.max()), shown(_rms(change))])
        cases.append(at_most(f"1-D, opacity {opacity:g}", float(change.max()), NEGLIGIBLE))
        if opacity in (0.05, 0.3):
            exact = np.exp(-accumulated(steps[None])[0])
            title = f"outlier of opacity {opacity:g} at 0.88"
            found_curves = {f"FOM, n = {n}": found, "FOM without the outlier": without}
            curves(axes[0 if opacity < 0.1 else 1], title, exact, found_curves)  # noqa: PLR2004 - the larger
    changes = _outlier_changes(lab, n)
    for (method, range_), (largest, rms) in changes.items():
        rows.append(["3-D, opacity 0.05", method, range_, shown(largest), shown(rms)])
    cases.append(at_most("3-D, opacity 0.05, fixed range", changes["FOM", "fixed"][0], NEGLIGIBLE))
    claims = [
        Claim(
            "FOM 7.2, figure 7: an outlier has negligible effect on the reconstruction (7 coefficients, at "
            "most "
            f"{NEGLIGIBLE:g})",
            "negligible",
            tuple(cases),
        ),
        Claim(
            "FOM 7.2: methods that narrow the depth range to the density suffer more (RMS change of T̂, FOM "
            "in a fixed range against narrowed ranges)",
            "–",
            tuple(
                smaller(f"against {method}, narrowed", fixed=changes["FOM", "fixed"][1], narrowed=rms)
                for (method, range_), (_, rms) in changes.items()
                if range_ == "narrowed"
            ),
        ),
    ]
    how = (
        "3-D: the plume in a volume padded with empty voxels behind it, and there a puff on the light's "
        "axis; T̂ at the plume's own voxels, which the puff does not shadow. Fixed range: that of the "
        "volume's box; narrowed: from the nearest to the farthest density."
    )
    return Study("FOM figure 7: outliers", how, claims, rows, figure)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.square(values).mean()))


def _outlier_changes(lab: Lab, n: int) -> dict[tuple[str, str], tuple[float, float]]:
    """Largest and RMS change of T̂ at the plume's voxels due to a puff behind it."""
    scene = lab.side(SMOKE)
    volume, light = scene.grids[0], scene.lights[0]
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - as `Lab.side` makes it
    voxel, sigma_t = float(volume.voxel_size[0]), float(scene.medium.sigma_t.mean())
    across = 2 * PUFF["voxels"] * voxel * sigma_t * volume.density_scale
    puff = (float(volume.bounds[1, 0]) + PUFF["away"] * voxel, PUFF["voxels"], -np.log1p(-0.05) / across)
    pair = [with_puffs(scene, 0, int(PUFF["behind"]), puffs) for puffs in ((), (puff,))]
    index = np.argwhere(volume.data > 0.02 * volume.data.max())[:, ::-1].astype(np.float64)
    index = index[np.random.default_rng(1).permutation(len(index))[:20_000]]
    points = index @ volume.world_from_index[:3, :3].T + volume.world_from_index[:3, 3]
    found = {}
    for method, basis in METHODS.items():
        for name, range_ in (("fixed", "box"), ("narrowed", "global")):
            changes = {"basis": basis, "coeffs": n, "range": range_, "steps": 2 * lab.sizes.steps}
            one, other = (
                lab.renderer.build_maps(with_map(padded_scene, **changes))[0].evaluate(points, sigma_t)
                for padded_scene in pair
            )
            difference = np.abs(other.astype(np.float64) - one)
            found[method, name] = float(difference.max()), _rms(difference)
    return found


def slab(width: float, depth: float, *, hard: bool) -> Floats:
    """Optical depths of the steps of a feature in the middle of the range, [1, `CELLS`]."""
    at = np.abs(MIDDLES - 0.5) / (width / 2)
    shape = (
        (at < 1).astype(np.float64) if hard else np.where(at < 1, 1 + np.cos(np.pi * np.minimum(at, 1)), 0)
    )
    steps: Floats = (depth * shape / shape.sum())[None]
    return steps


def ringing(n: int, steps: Floats) -> float:
    """Largest rise of the unclamped T̂ on its way down: 0 without ringing."""
    found = np.exp(-reconstructed("fourier", n, steps)[0])
    return float((found - np.minimum.accumulate(found)).max())


def critical_width(n: int, depth: float, *, hard: bool) -> float:
    """Return the widest feature with noticeable ringing, as a fraction of the range; 0 if none."""
    widths = np.arange(0.02, 1.0, 0.01)
    rings = [ringing(n, slab(float(width), depth, hard=hard)) > NEGLIGIBLE for width in widths]
    return float(widths[np.flatnonzero(rings)[-1]]) if any(rings) else 0.0


def fom_fig8(lab: Lab) -> Study:
    """Measure ringing by the feature's size and opacity."""
    del lab
    width, thin, dense = 0.12, 0.7, 2.8
    rows = [["feature", "n", "optical depth", "ringing", "widest that rings"]]
    fewer, opacity, sizes, of_size, clamp = [], [], [], [], []
    figure, axes = plots(3)
    for hard, shape in ((False, "smooth"), (True, "hard-edged")):
        rises = {}
        critical = {}
        for n, depth in ((15, thin), (7, thin), (7, dense), (15, dense)):
            steps = slab(width, depth, hard=hard)
            rises[n, depth] = ringing(n, steps)
            critical[n, depth] = critical_width(n, depth, hard=hard)
            rows.append([shape, str(n), f"{depth:g}", shown(rises[n, depth]), shown(critical[n, depth])])
            exact = np.exp(-accumulated(steps)[0])
            raw = np.exp(-reconstructed("fourier", n, steps)[0])
            errors = [_rms(t - exact) for t in (np.clip(raw, 0, 1), raw)]
            clamp.append(
                smaller(f"{shape}, n = {n}, depth {depth:g}", clamped=errors[0], unclamped=errors[1])
            )
        fewer += [
            smaller(f"{shape}, depth {depth:g}", n_15=rises[15, depth], n_7=rises[7, depth])
            for depth in (thin, dense)
        ]
        opacity += [
            smaller(f"{shape}, n = {n}", once=rises[n, thin], four_times=rises[n, dense]) for n in (7, 15)
        ]
        sizes.append(smaller(shape, n_15=critical[15, dense], n_7=critical[7, dense]))
        of_size += [
            at_most(
                f"{shape}, n = {n}", critical[n, dense] / max(critical[n, thin], 1e-9), SAME_SIZE, "ratio"
            )
            for n in (7, 15)
        ]
    for plot, (n, depth) in zip(axes, ((15, thin), (7, thin), (7, dense)), strict=True):
        steps = slab(width, depth, hard=False)
        raw = np.exp(-reconstructed("fourier", n, steps)[0])
        title = f"a thin feature of optical depth {depth:g}"
        curves(plot, title, np.exp(-accumulated(steps)[0]), {f"FOM, n = {n}, not clamped": raw})
        plot.set_ylim(-0.05, 1.45)
    claims = [
        Claim(
            "FOM figure 8(a, b): more coefficients ring less (largest rise of T̂)", "plot only", tuple(fewer)
        ),
        Claim("FOM figure 8(b, c): four times the opacity rings more", "plot only", tuple(opacity)),
        Claim(
            "FOM 7.3: with more coefficients only smaller features ring (widest that rings, part of the "
            "range)",
            "–",
            tuple(sizes),
        ),
        Claim(
            "FOM 7.3: whether it rings is a matter of size, not of opacity (widest that rings, four times "
            f"the opacity over once, at most {SAME_SIZE:g})",
            "found empirically",
            tuple(of_size),
        ),
        Claim("FOM 7.3: clamping T̂ to [0, 1] lessens the error (RMS)", "–", tuple(clamp)),
    ]
    how = (
        f"A feature as wide as {width:g} of the range, in one dimension; a rise of T̂ below {NEGLIGIBLE:g} "
        "does not count."
    )
    return Study("FOM figure 8: ringing", how, claims, rows, figure)


PAPER_FOM_MAP = {1024: (15.5 / 10.1, 15.9 / 11.1), 512: (4.3 / 3.0, 4.2 / 2.8), 256: (1.7 / 1.5, 1.6 / 1.5)}
"""Time of FOM's map over that of OSM's, from FOM tables 1 and 2."""


def fom_tables(lab: Lab) -> Study:
    """Measure the cost of maps and views."""
    bases = {"FOM": "fourier", "OSM (slices)": "slices", "OSM (piecewise)": "piecewise"}
    volume_scene = lab.side(SMOKE)
    measurements: dict[Any, Callable[[], Seconds]] = {}
    for res in lab.sizes.map_sizes:
        for method, basis in bases.items():
            scene = with_map(volume_scene, basis=basis, coeffs=7, range="box", res=res)
            measurements[method, res] = lambda scene=scene: _costs(lab, scene)  # type: ignore[misc]
    timings = lab.least(measurements)
    found = timings.least
    largest = max(lab.sizes.map_sizes)
    unit = found["OSM (piecewise)", largest]["map"]
    views = [f"view {width}×{height}, × OSM's" for width, height in lab.sizes.screens]
    rows = [
        [
            "map",
            "method",
            f"map, × OSM (piecewise) at {largest}²",
            "× OSM (piecewise), same size",
            "paper",
            *views,
        ]
    ]
    price, view_price, area = [], [], []
    for res in lab.sizes.map_sizes:
        for method in bases:
            cost, osm = found[method, res], found["OSM (piecewise)", res]
            relative = [cost[view] / osm[view] for view in cost if view != "map"]
            paper = PAPER_FOM_MAP.get(res) if method == "FOM" else None
            quoted = " and ".join(f"{ratio:.2f}" for ratio in paper) if paper else ""
            own = [shown(cost["map"] / unit), shown(cost["map"] / osm["map"])]
            rows.append([f"{res}²", method, *own, quoted, *map(shown, relative)])
            if method != "FOM":
                fom = found["FOM", res]
                price.append(at_most(f"{res}², {method}", fom["map"] / cost["map"], MAP_PRICE))
                ratio = max(fom[view] / cost[view] for view in cost if view != "map")
                view_price.append(at_most(f"{res}², {method}", ratio, SAME_SIZE))
    figure, (plot,) = plots(1)
    for method, colour in zip(bases, COLOURS, strict=False):
        series = [found[method, res]["map"] / unit for res in lab.sizes.map_sizes]
        plot.loglog([res**2 for res in lab.sizes.map_sizes], series, "o-", color=colour, label=method)
    plot.set_xlabel("texels")
    plot.set_ylabel(f"map, × OSM (piecewise) at {largest}²")
    plot.legend(fontsize=7)
    for method in bases:
        for small, large in pairwise(lab.sizes.map_sizes):
            ratio = found[method, large]["map"] / found[method, small]["map"]
            per_four = float(ratio ** (np.log(4) / np.log((large / small) ** 2)))
            low, high = FOURFOLD
            area.append(Case(f"{method}, {small}² to {large}²", {"×": per_four}, low <= per_four <= high))
    claims = [
        Claim(
            "FOM section 8: FOM's map costs at most 1.5 times OSM's (7 coefficients)",
            "1.53 and 1.43 at 1024², 1.43 and 1.50 at 512², 1.13 and 1.07 at 256²",
            tuple(price),
        ),
        Claim(
            "FOM section 8: the cost of the map is approximately proportional to its area (four times the "
            f"texels cost {FOURFOLD[0]:g} to {FOURFOLD[1]:g} times as much)",
            "2.5 and 3.6, 2.6 and 3.8 (FOM); 2.0 and 3.4, 1.9 and 4.0 (OSM)",
            tuple(area),
        ),
        Claim(
            "FOM section 8: rendering the scene costs about the same with both (ratio at most "
            f"{SAME_SIZE:g})",
            "1.05 or less",
            tuple(view_price),
        ),
    ]
    how = (
        "The plume under one light from the left, ranges of the box. 'slices' holds the depths at planes "
        "and looks at the light's rays first to place them; 'piecewise' is OSM as FOM section 5.1 writes "
        "it. Of the view the larger of both screens' ratios counts. " + timings.note
    )
    return Study("FOM tables 1 and 2: cost of maps and views", how, claims, rows, figure)


BRIEF = 4
"""Number of times that a measurement of a tenth of a second is repeated in a round."""


def _costs(lab: Lab, scene: tfm.Scene) -> Seconds:
    """Device seconds of a scene's maps, and of its view on every screen."""
    costs = {"map": np.inf, **{f"view {res}": np.inf for res in lab.sizes.screens}}
    for _ in range(BRIEF):
        maps = lab.renderer.build_maps(scene)
        costs["map"] = min(costs["map"], sum(built.buffers.seconds for built in maps))
        for res in lab.sizes.screens:
            view = scene.replace(camera=scene.camera.replace(res=res))
            spent = lab.renderer.render(view, maps=maps).stats.seconds["view_pass"]
            costs[f"view {res}"] = min(costs[f"view {res}"], spent)
    return costs


# Opacity Shadow Maps.

SLICINGS = ("uniform", "density", "gamma")


def osm_fig3(lab: Lab) -> Study:
    """Compare three ways of placing the planes."""
    cube = tfm.Volume(
        np.ones((48, 48, 48), np.float32), voxel_size=2 / 48, origin=(-1, -1, -1), density_scale=2.5
    )
    placed = lab.side(SMOKE)
    camera = tfm.Camera(from_=(2.2, 1.6, 4.6), to=(0, 0, 0), fov=32, res=placed.camera.res)
    light = tfm.SpotLight(from_=(-8, 0, 0), to=(0, 0, 0), cone=14, intensity=WHITE)
    scenes = {
        "homogeneous cube": placed.replace(volume=cube, camera=camera, lights=(light,), medium=tfm.Medium())
    }
    scenes |= {name: lab.side(name) for name in (SMOKE, CLOUD, HARD)}
    counts = (4, 8, 16)
    rows = [["volume", "N", *(f"{slicing}, visible error" for slicing in SLICINGS)]]
    density, gamma = [], []
    figure, axes = plots(len(scenes), 2.8)
    for plot, (name, scene) in zip(axes, scenes.items(), strict=True):
        truth = lab.renderer.render(scene, method="dual").image
        errors: dict[str, list[float]] = {slicing: [] for slicing in SLICINGS}
        for n in counts:
            for slicing in SLICINGS:
                image = lab.image(scene, basis="slices", coeffs=n, slicing=slicing, range="global")
                errors[slicing].append(lab.error(image, truth))
            uniform, by_density, by_gamma = (errors[slicing][-1] for slicing in SLICINGS)
            rows.append([name, str(n), *map(shown, (uniform, by_density, by_gamma))])
            density.append(smaller(f"{name}, N = {n}", density=by_density, uniform=uniform))
            gamma.append(smaller(f"{name}, N = {n}", gamma=by_gamma, uniform=uniform))
        for (slicing, series), colour in zip(errors.items(), COLOURS, strict=False):
            plot.plot(counts, series, color=colour, marker="o", label=slicing)
        plot.set_xscale("log", base=2)
        plot.set_yscale("log")
        plot.set_title(name, fontsize=9)
        plot.set_xlabel("planes")
        plot.legend(fontsize=7)
    axes[0].set_ylabel("visible error")
    claims = [
        Claim(
            "OSM section 2, figure 3(b): where density is uneven, planes placed by it err less than uniform "
            "ones",
            "–",
            tuple(case for case in density if not case.where.startswith("homogeneous")),
        ),
        Claim(
            "OSM figure 3(a): for evenly distributed volumes uniform planes are reasonable (error at most "
            "that of the others, or 1.25 times as much)",
            "–",
            tuple(
                at_most(case.where, *_of_others(case, other))
                for case, other in zip(density, gamma, strict=True)
                if case.where.startswith("homogeneous")
            ),
        ),
        Claim(
            "OSM figure 3(c): planes closer near the light err less than uniform ones",
            "perceptual argument only",
            tuple(gamma),
        ),
    ]
    how = (
        "Pictures with N planes across one light from the left, between the nearest and the farthest "
        "density, against the dual march. gamma: depths (j/N)²."
    )
    return Study("OSM figure 3: slicing schemes at equal N", how, claims, rows, figure)


def _of_others(by_density: Case, by_gamma: Case) -> tuple[float, float, str]:
    """Ratio of the error of uniform planes to the smallest of the others, its bound, and its name."""
    least = min(by_density.measured["density"], by_gamma.measured["gamma"])
    return by_density.measured["uniform"] / least, SAME_SIZE, "uniform / best other"


def osm_fig4(lab: Lab) -> Study:
    """Measure time against the number of planes."""
    counts = lab.sizes.slice_counts
    base = lab.side(SMOKE)
    scenes = {n: with_map(base, basis="slices", coeffs=n, range="global") for n in counts}
    measurements: dict[Any, Callable[[], Seconds]] = {
        n: lambda scene=scene: lab.frame_seconds(scene, times=BRIEF)  # type: ignore[misc]
        for n, scene in scenes.items()
    }
    timings = lab.least(measurements)
    found = timings.least
    unit = found[counts[0]]["frame"]
    rows = [["N", *(f"{what}, × frame at N = {counts[0]}" for what in ("map", "view", "frame"))]]
    rows += [[str(n), *(shown(seconds / unit) for seconds in found[n].values())] for n in counts]
    cases = []
    figure, (plot,) = plots(1)
    for what, colour in zip(("map", "view", "frame"), COLOURS, strict=False):
        series = np.array([found[n][what] / unit for n in counts])
        slope, constant = np.polyfit(counts, series, 1)
        left = series - (slope * np.array(counts) + constant)
        r2 = 1 - float(np.square(left).sum() / np.square(series - series.mean()).sum())
        share = float(slope * counts[-1] / series[-1])
        measured = {"R²": r2, f"share of time ∝ N at N = {counts[-1]}": share}
        cases.append(Case(what, measured, bool(r2 >= LINEAR and slope > 0)))
        plot.plot(counts, series, "o", color=colour, label=what)
        plot.plot([0, counts[-1]], [constant, slope * counts[-1] + constant], color=colour, linewidth=1)
    plot.set_xlabel("planes N")
    plot.set_ylabel(f"time, × frame at N = {counts[0]}")
    plot.legend(fontsize=7)
    claim = Claim(
        "OSM section 3, figure 4: time is linear in the number of maps (R² of the line, at least "
        f"{LINEAR:g})",
        "plot only",
        tuple(cases),
    )
    how = (
        "The plume under one light from the left; a map holds all its planes, and a look-up reads two. "
        + timings.note
    )
    return Study("OSM figure 4: time against the number of planes", how, [claim], rows, figure)


STUDIES: dict[str, Callable[[Lab], Study]] = {
    study.__name__: study
    for study in (
        *(tfm_table1, tfm_fig5, tfm_fig7, tfm_fig8, tfm_fig10),
        *(fom_fig1, fom_fig4, fom_fig5, fom_fig6, fom_fig7, fom_fig8, fom_tables),
        *(osm_fig3, osm_fig4),
    )
}
"""Studies by the name used for ``--only`` and for the picture."""


# Output.


def markdown(studies: dict[str, Study], facts: dict[str, Any]) -> str:
    """Write the report."""
    lines = [
        "# The papers' figures and tables, reproduced",
        "",
        f"By `scripts/reproduce_papers.py` on {facts['device']}; sizes: "
        + ", ".join(f"{name} {value}" for name, value in facts["sizes"].items())
        + ". Every verdict is computed from the measurements; speeds are ratios within this run.",
        "",
        "| where | claim | verdict | measured | paper |",
        "|---|---|---|---|---|",
    ]
    for name, study in studies.items():
        for claim in study.claims:
            cells = (claim.text, f"**{claim.verdict}**", claim.measured, claim.paper)
            lines.append(f"| [{name}](#{name}) | " + " | ".join(map(_cell, cells)) + " |")
    for name, study in studies.items():
        lines += ["", f'<a id="{name}"></a>', f"## {study.title}", study.how, ""]
        head, *rows = study.rows
        lines += [_row(head), "|" + "---|" * len(head), *map(_row, rows), ""]
        if study.figure is not None:
            lines.append(f"![{study.title}]({name}.png)")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(map(_cell, cells)) + " |"


def numbers(studies: dict[str, Study], facts: dict[str, Any]) -> dict[str, Any]:
    """Return all numbers for JSON."""
    found = {}
    for name, study in studies.items():
        claims = [{**asdict(claim), "verdict": claim.verdict} for claim in study.claims]
        found[name] = {"title": study.title, "how": study.how, "claims": claims, "rows": study.rows}
    return {**facts, "studies": _finite(found)}


def _finite(value: Any) -> Any:
    """Replace values that JSON cannot hold by None, and NumPy's numbers by Python's."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return float(value) if np.isfinite(value) else None
    return bool(value) if isinstance(value, np.bool_) else value


def reproduce(names: Iterable[str], sizes: Sizes, out: Path, device: str | None = None) -> dict[str, Study]:
    """Run studies and write the report."""
    studies = {}
    with tfm.Renderer(device) as renderer:
        lab = Lab(renderer, sizes)
        for name in names:
            began = time.perf_counter()
            studies[name] = STUDIES[name](lab)
            print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
        facts = {"device": renderer.device_name, "sizes": asdict(sizes)}
    for name, study in studies.items():
        if study.figure is not None:
            with replacing(out / f"{name}.png") as temporary:
                study.figure.savefig(temporary, format="png")
    write_text(out / "papers.md", markdown(studies, facts))
    write_text(out / "papers.json", json.dumps(numbers(studies, facts), indent=1) + "\n")
    return studies


# The command line.


def _names(text: str) -> list[str]:
    names = [name for name in text.split(",") if name]
    for name in names:
        if name not in STUDIES:
            raise argparse.ArgumentTypeError(f"'{name}' is unknown; known: {', '.join(STUDIES)}")
    return names


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--quick", action="store_true", help="smaller maps and pictures, for a quick trial")
    parser.add_argument(
        "--only", type=_names, default=list(STUDIES), metavar="NAME[,NAME]", help=", ".join(STUDIES)
    )
    parser.add_argument("--device", metavar="NAME", help="part of the OpenCL device's name")
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("out/papers"), metavar="DIR", help="default out/papers"
    )
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the studies; returns the exit code."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        try:
            options.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{options.out}: cannot be made a directory ({error.strerror})") from error
        studies = reproduce(options.only, QUICK if options.quick else Sizes(), options.out, options.device)
    except tfm.TfmError as error:
        print(f"reproduce_papers.py: {error}", file=sys.stderr)
        return error.exit_code
    for name, study in studies.items():
        for claim in study.claims:
            print(f"{name}: {claim.text}\n    {claim.verdict}. {claim.measured}. Paper: {claim.paper}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
