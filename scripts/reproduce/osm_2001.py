"""Kim and Neumann, "Opacity Shadow Maps", Eurographics Workshop on Rendering 2001."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import tfm_cl as tfm
from reproduce.claims import LINEAR, SAME_SIZE, Case, Claim, Study, at_most, shown, smaller
from reproduce.lab import BRIEF, CLOUD, HARD, SMOKE, WHITE, Lab, Seconds, with_map
from reproduce.plotting import COLOURS, plots

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


STUDIES = (osm_fig3, osm_fig4)
