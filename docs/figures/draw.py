"""Draw the figures of the documentation with the library itself: ``python docs/figures/draw.py``, a minute.

All of them show the sample scene ``volumes/cumulus.toml``, or the volume of it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import CenteredNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

import tfm_cl as tfm
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.resolved import resolve
from tfm_cl.metrics import display_rgb, white_of

HERE = Path(__file__).resolve().parent
SCENE = HERE.parents[1] / "volumes" / "cumulus.toml"
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F", "#000000")
EXACT, GREY = "#222222", "#8c8c8c"
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "tfm_cl",  # the same file each time
    "figure.facecolor": "white",
}
RAY = 0.52, 0.47
"""Place on the map of the light ray that is followed: through several puffs of the cloud."""
THIN = 4.0
"""Density scale with which much of that ray has light."""
COUNTS = 2, 4, 8
BASES_SHOWN: dict[str, dict[str, Any]] = {
    "klt, the default": {"basis": "klt"},
    "cosines of T (TFM, α = 10)": {"basis": "dct", "density_weighting": 10},
    "cosines of T (α = 1)": {"basis": "dct", "density_weighting": 1},
    "Fourier series (FOM)": {"basis": "fourier", "range": "box"},
    "planes (opacity shadow maps)": {"basis": "slices", "range": "box"},
    "power moments": {"basis": "moments"},
}
"""Label -> settings of the map."""
CURVE_COUNTS = 2, 4, 6, 8, 12, 16, 24, 32

Floats = NDArray[np.floating]


class Lab:
    """A renderer, and the scene in the sizes of the figures."""

    def __init__(self, renderer: tfm.Renderer) -> None:
        self.renderer = renderer
        scene = tfm.Scene.load(SCENE)
        self.scene = scene.replace(
            lights=scene.lights[:1],
            camera=scene.camera.replace(res=(320, 180)),
            map=tfm.MapSettings(res=256),
        )
        self.dual = renderer.render(self.scene, method="dual").image

    def with_map(self, **settings: object) -> tfm.Scene:
        """Return the scene with other settings of the map."""
        return self.scene.replace(map=self.scene.map.replace(**settings))

    def map(self, scene: tfm.Scene) -> tfm.TransmittanceMap:
        """Return the map of the light."""
        return self.renderer.build_maps(scene)[0]


def _plot(width: float, height: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, [figure.add_subplot(1, columns, i + 1) for i in range(columns)]


def two_marches(lab: Lab) -> Figure:
    """Draw the march to the light at every sample, and the look-up in a map."""
    volume = lab.scene.grids[0]
    low, high = volume.bounds
    slab = volume.data[volume.shape[0] // 2]
    eye, begin, step = np.array([-1.9, -0.55]), np.array([-0.9, -0.35]), np.array([0.26, 0.052])
    samples = begin + np.arange(8)[:, None] * step
    light = np.array([0.9, 1.75])
    figure, axes = _plot(8.4, 3.7, 2)
    titles = ("Dual march: from each sample to the light", "Map: light rays once, then a look-up a sample")
    for one, title in zip(axes, titles, strict=True):
        one.imshow(slab, origin="lower", cmap="Greys", vmax=1.6, extent=(low[0], high[0], low[1], high[1]))
        one.plot(*zip(eye, samples[-1] + step, strict=True), color=COLOURS[0], lw=1.2)
        one.plot(*samples.T, "o", color=COLOURS[0], ms=4)
        one.plot(*light, marker="*", color=COLOURS[4], ms=15, clip_on=False)
        one.text(eye[0] - 0.12, eye[1] + 0.12, "camera", color=COLOURS[0])
        one.set_title(title, fontsize=9)
        one.set(xlim=(-2.05, 1.4), ylim=(-0.95, 1.8))
        one.set_axis_off()
    for sample in samples:
        along = sample + np.linspace(0, 1, 13)[:, None] * (light - sample)
        axes[0].plot(*along.T, "-o", color=COLOURS[1], lw=0.7, ms=1.8)
    for angle in np.linspace(-2.62, -1.65, 9):
        ray = light + np.array([[0.0], [2.7]]) * [np.cos(angle), np.sin(angle)]
        axes[1].plot(*ray.T, color=COLOURS[2], lw=0.9)
    for sample in samples:
        towards = (light - sample) / np.linalg.norm(light - sample)
        axes[1].annotate(
            "",
            sample + 0.02 * towards,
            sample + 0.2 * towards,
            arrowprops={"arrowstyle": "->", "color": COLOURS[1]},
        )
    axes[1].text(0.32, 1.45, "a few coefficients\nper light ray", color=COLOURS[2], ha="right")
    return figure


def ray(lab: Lab) -> Figure:
    """Draw one light ray: density, transmittance, and what few coefficients make of it."""
    figure, axes = _plot(8.4, 3.1, 2)
    thin = lab.scene.replace(volume=lab.scene.grids[0].with_density_scale(THIN))
    maps = {n: lab.map(thin.replace(map=thin.map.replace(coeffs=n))) for n in COUNTS}
    distance, exact, _ = maps[COUNTS[0]].curve(*RAY)
    depth = -np.log(np.maximum(exact, 1e-12))
    extinction = np.gradient(depth, distance)
    axes[0].fill_between(distance, extinction, color=GREY, alpha=0.35, lw=0)
    axes[0].set(
        xlabel="distance from the light, world units", ylabel="extinction σ, per world unit", ylim=(0, None)
    )
    axes[0].set_title("What the light ray meets", fontsize=9)
    axes[1].plot(distance, exact, color=EXACT, lw=3, alpha=0.35, label="exact")
    for (n, light_map), colour in zip(maps.items(), COLOURS, strict=False):
        _, _, found = light_map.curve(*RAY)
        axes[1].plot(distance, found, color=colour, lw=1.2, label=f"klt, {n} coefficients")
    cosines = lab.map(thin.replace(map=thin.map.replace(basis="dct", coeffs=4, density_weighting=1)))
    axes[1].plot(distance, cosines.curve(*RAY)[2], color=GREY, lw=1, ls="--", label="4 cosines")
    axes[1].set(xlabel="distance from the light, world units", ylabel="transmittance T", ylim=(0, 1.05))
    axes[1].set_title("How much of the light is left", fontsize=9)
    axes[1].legend(frameon=False)
    return figure


def bases(lab: Lab) -> Figure:
    """Draw the first functions of two bases."""
    figure, axes = _plot(8.4, 2.9, 2)
    v = np.linspace(0, 1, 400)
    cosines = BASES["dct"].functions
    learnt = lab.map(lab.with_map(coeffs=4)).functions
    assert cosines is not None and learnt is not None  # noqa: S101, PT018 - both have functions
    fixed = cosines(resolve(tfm.MapSettings(basis="dct", coeffs=4)), None)
    for one, functions, title in (
        (axes[0], fixed, "dct: the same cosines for every scene"),
        (axes[1], learnt, "klt: learnt from this light's rays"),
    ):
        for j, values in enumerate(functions.values(v).T):
            one.plot(v, values / np.abs(values).max(), color=COLOURS[j], label=f"function {j + 1}")
        one.axhline(0, color=GREY, lw=0.6)
        one.set(xlabel="part of the ray's range", ylim=(-1.1, 1.5), yticks=[-1, 0, 1])
        one.set_title(title, fontsize=9)
    axes[1].legend(frameon=False, fontsize=8, ncols=2, loc="upper center")
    return figure


def coefficients(lab: Lab) -> Figure:
    """Show what a map holds: one picture of each coefficient, seen from the light."""
    light_map = lab.map(lab.with_map(coeffs=4))
    figure, axes = _plot(8.4, 2.3, 4)
    for j, one in enumerate(axes):
        one.imshow(light_map.coefficients[..., j], origin="lower", cmap="RdBu_r", norm=CenteredNorm())
        one.set_title(f"coefficient {j + 1}", fontsize=9)
        one.set_axis_off()
    return figure


def counts(lab: Lab) -> Figure:
    """Show pictures from maps of few coefficients, and their errors."""
    white = white_of(lab.dual)
    shown = [("dual march", lab.dual)]
    shown += [(f"{n} coefficients", lab.renderer.render(lab.with_map(coeffs=n)).image) for n in COUNTS]
    figure = Figure(figsize=(8.4, 2.6), layout="constrained", dpi=120)
    for i, (title, image) in enumerate(shown):
        above = figure.add_subplot(2, 4, i + 1)
        above.imshow(display_rgb(image, white)[:, 60:260])
        above.set_title(title, fontsize=9)
        above.set_axis_off()
        if i:
            below = figure.add_subplot(2, 4, i + 5)
            error = (image - lab.dual)[:, 60:260, :3].mean(axis=-1) / white
            drawn = below.imshow(100 * error, cmap="RdBu_r", vmin=-5, vmax=5)
            below.set_axis_off()
    figure.colorbar(drawn, ax=figure.axes, shrink=0.4, anchor=(0, 0.1), label="error, % of white")
    return figure


def errors(lab: Lab) -> Figure:
    """Plot the error of the picture against the number of coefficients, of several bases."""
    figure, (axes,) = _plot(6.2, 3.6)
    for (label, settings), colour in zip(BASES_SHOWN.items(), COLOURS, strict=False):
        has = BASES[settings["basis"]].counts
        numbers = [min((m for m in has if m >= n), default=0) for n in CURVE_COUNTS]
        found = [(n, _error(lab, n, settings)) for n in dict.fromkeys(numbers) if n]
        axes.plot(*zip(*found, strict=True), "-o", ms=3, color=colour, label=label)
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks([2, 4, 8, 16, 32], ["2", "4", "8", "16", "32"])
    axes.set_yticks([0.003, 0.01, 0.03, 0.1, 0.3], ["0.3 %", "1 %", "3 %", "10 %", "30 %"])
    axes.minorticks_off()
    axes.set(xlabel="coefficients per texel", ylabel="RMSE of the lit pixels, of their mean")
    axes.legend(frameon=False, fontsize=8)
    axes.grid(alpha=0.25)
    return figure


def _error(lab: Lab, n: int, settings: dict[str, Any]) -> float:
    found = tfm.compare(lab.renderer.render(lab.with_map(coeffs=n, **settings)).image, lab.dual)
    assert found.lit is not None  # noqa: S101 - the cloud is lit
    return found.lit.rmse


FIGURES: dict[str, Callable[[Lab], Figure]] = {
    "two_marches.png": two_marches,
    "ray.svg": ray,
    "bases.svg": bases,
    "coefficients.png": coefficients,
    "counts.png": counts,
    "errors.svg": errors,
}
"""File's name -> what draws it."""


def draw(names: list[str], folder: Path) -> Iterator[Path]:
    """Draw figures into a folder, one after another."""
    with tfm.Renderer() as renderer, rc_context(STYLE):
        lab = Lab(renderer)
        for name in names:
            FIGURES[name](lab).savefig(
                folder / name, dpi=140, metadata={"Date": None} if name.endswith("svg") else None
            )
            yield folder / name


def main() -> None:
    """Draw what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=", ".join(FIGURES))
    parser.add_argument("-o", dest="folder", type=Path, default=HERE, metavar="DIR")
    asked = parser.parse_args()
    for path in draw(asked.names or list(FIGURES), asked.folder):
        print(path)


if __name__ == "__main__":
    main()
