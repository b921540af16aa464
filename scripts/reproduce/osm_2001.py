"""Kim and Neumann, "Opacity Shadow Maps", Eurographics Workshop on Rendering 2001.

Figures 1 and 2 are sketches of the method; all others, and all plates, have their studies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

import tfm_cl as tfm
from reproduce.claims import (
    COINCIDES,
    DRASTIC,
    INDISTINGUISHABLE,
    LINEAR,
    NEGLIGIBLE,
    SAME_SIZE,
    Case,
    Claim,
    Study,
    at_least,
    at_most,
    shown,
    smaller,
)
from reproduce.lab import (
    BRIEF,
    CLOUD,
    FUR,
    HAIR,
    HARD,
    LINES,
    PARTICLES,
    SMOKE,
    WHITE,
    Floats,
    Image,
    Lab,
    Seconds,
    busyness,
    opacity_map,
    rms,
    roughness,
)
from reproduce.plotting import COLOURS, lit_window, pictures, plots
from tfm_cl import reference
from tfm_cl.metrics import REC709, display_luma, lit_mask, white_of
from tfm_cl.scene.lights.base import texel_positions

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
    scenes |= {name: lab.side(name) for name in (PARTICLES, HAIR, SMOKE, CLOUD, HARD)}
    counts = lab.sizes.plane_counts
    rows = [["what", "N", *(f"{slicing}, visible error" for slicing in SLICINGS)]]
    density, gamma = [], []
    figure, axes = plots(len(scenes), 2.8)
    for plot, (name, scene) in zip(axes, scenes.items(), strict=True):
        truth = lab.image(scene, "dual")
        errors: dict[str, list[float]] = {slicing: [] for slicing in SLICINGS}
        for n in counts:
            for slicing in SLICINGS:
                image = lab.renderer.render(opacity_map(scene, "OSM", n, slicing=slicing)).image
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


SHARES = (0.25, 0.5, 0.75, 1.0)
"""Of a picture's pixels, for the numbers of shadow samples in figure 4."""
MODEL = "straight"
"""Style of the hair model of figure 4 and plate 1; as large as the paper's it has 350,000 lines."""


def osm_fig4(lab: Lab) -> Study:
    """Measure time against the number of planes, and of samples."""
    counts = lab.sizes.slice_counts
    scenes = {LINES: lab.tuft(MODEL, full=lab.sizes.full_hair), SMOKE: lab.side(SMOKE)}
    variants: dict[str, dict[tuple[str, float], tfm.Scene]] = {
        name: {
            **{("N", n): opacity_map(scene, "OSM", n) for n in counts},
            **{("pixels", share): opacity_map(_part(scene, share), "OSM", counts[-1]) for share in SHARES},
        }
        for name, scene in scenes.items()
    }
    measurements: dict[Any, Callable[[], Seconds]] = {
        (name, *key): lambda scene=scene: lab.frame_seconds(scene, times=BRIEF)  # type: ignore[misc]
        for name, of_name in variants.items()
        for key, scene in of_name.items()
    }
    timings = lab.least(measurements)
    whats = ("map", "view", "frame")
    rows = [["what", "N", "pixels", *(f"{what}, × frame at N = {counts[0]}" for what in whats)]]
    of_maps, of_samples = [], []
    figure, axes = plots(2 * len(scenes))
    for i, (name, of_name) in enumerate(variants.items()):
        unit = timings.least[name, "N", counts[0]]["frame"]
        found = {key: {w: timings.least[(name, *key)][w] / unit for w in whats} for key in of_name}
        pixels = {key: int(np.prod(scene.camera.res)) for key, scene in of_name.items()}
        for key, scene in of_name.items():
            spent = (shown(found[key][what]) for what in whats)
            rows.append([name, str(scene.map.coeffs), str(pixels[key]), *spent])
        for what, colour in zip(whats, COLOURS, strict=False):
            series = [found["N", n][what] for n in counts]
            of_maps.append(_line(f"{name}, {what}", counts, series, axes[2 * i], colour))
        several = [pixels["pixels", share] / 1000 for share in SHARES]
        series = [found["pixels", share]["view"] for share in SHARES]
        of_samples.append(_line(f"{name}, view", several, series, axes[2 * i + 1], COLOURS[1]))
        for plot, along in zip(axes[2 * i :], ("planes N", "thousand pixels"), strict=False):
            plot.set_xlabel(along)
            plot.set_ylabel(f"{name}: time, × frame at N = {counts[0]}")
            plot.legend(fontsize=7)
    claims = [
        Claim(
            "OSM section 3, figure 4: time is linear in the number of maps (R² of the line, at least "
            f"{LINEAR:g})",
            "plot only",
            tuple(of_maps),
        ),
        Claim(
            f"OSM section 2: time is linear in the number of samples (R² of the line, at least {LINEAR:g})",
            "linear",
            tuple(of_samples),
        ),
    ]
    (body,) = scenes[LINES].primitives
    how = (
        f"A hair model of {len(body.positions):,} lines and the plume of voxels, each under one light. A map "
        "here holds all its planes, and is made in one march instead of a pass each; a look-up reads them "
        "all. Samples are those of the camera's rays, as many on each: their number is that of the pixels. "
        + timings.note
    )
    return Study("OSM figure 4: time against planes and samples", how, claims, rows, figure)


def _part(scene: tfm.Scene, share: float) -> tfm.Scene:
    """Return the scene with a part of its pixels."""
    width, height = (max(8, round(side * share**0.5)) for side in scene.camera.res)
    return scene.replace(camera=scene.camera.replace(res=(width, height)))


def _line(where: str, at: Sequence[float], series: Sequence[float], plot: Axes, colour: str) -> Case:
    """Fit a line to times, draw it, and say whether it is one that rises."""
    x, y = np.asarray(at, dtype=np.float64), np.asarray(series)
    slope, constant = np.polyfit(x, y, 1)
    left = y - (slope * x + constant)
    r2 = 1 - float(np.square(left).sum() / np.square(y - y.mean()).sum())
    plot.plot(x, y, "o", color=colour, label=where)
    plot.plot([0, x[-1]], [constant, slope * x[-1] + constant], color=colour, linewidth=1)
    measured = {"R²": r2, "growing share of the last time": float(slope * x[-1] / y[-1])}
    return Case(where, measured, bool(r2 >= LINEAR and slope > 0))


PAPER_MAPS, PAPER_SHOWN = 60, (1, 6, 14, 26, 40, 52, 60)
"""Number of maps, and those that figure 5 shows."""
ROUNDING = 1e-5
"""Of the largest optical depth: what a sum of float32 may fall by without being less."""
DEVIATIONS = 3.0
"""Standard errors by which a mean over rays may differ from the true one."""


def osm_fig5(lab: Lab) -> Study:
    """Show some opacity maps, and the depth map of the head."""
    scene = lab.side(HAIR)
    # Behind a solid a map holds nothing: the paper's maps are of hair alone, and the head has one of its own.
    (found,) = lab.renderer.build_maps(opacity_map(scene.replace(solids=()), "OSM", PAPER_MAPS))
    depths = found.coefficients.astype(np.float64)
    fall = float(-np.diff(depths, axis=-1).min() / depths.max())
    begin, end = map(float, found.field[0, 0, :2])
    places = begin + (end - begin) * np.array(PAPER_SHOWN) / PAPER_MAPS
    taken = -np.expm1(-_sums_before(lab, found, places))
    rows = [["map", "mean opacity of the texels", "mean of lines followed on the host", "standard error"]]
    alike = []
    for i, plane in enumerate(PAPER_SHOWN):
        mean, expected = float(-np.expm1(-depths[..., plane - 1]).mean()), float(taken[:, i].mean())
        error = float(taken[:, i].std(ddof=1) / np.sqrt(len(taken)))
        rows.append([f"{plane} of {PAPER_MAPS}", *map(shown, (mean, expected, error))])
        measured = {"texels": mean, "lines": expected, "±": error}
        alike.append(Case(f"map {plane}", measured, abs(mean - expected) <= DEVIATIONS * error))
    claims = [
        Claim(
            "OSM eq. 1, figure 5: Ω never falls from one map to the next (largest fall over the largest Ω, "
            f"at most {ROUNDING:g})",
            "pictures only",
            (at_most("", max(0.0, fall), ROUNDING),),
        ),
        Claim(
            "OSM section 2: each pixel stores the opacity relative to the light at its position (mean of "
            f"1 - exp(-Ω), within {DEVIATIONS:g} standard errors of the exact one)",
            "–",
            tuple(alike),
        ),
    ]
    how = (
        f"The sample of wavy hair under one light from the left; the paper's choice of {PAPER_MAPS} maps, as "
        "bright as they are opaque. The exact mean is that of lines through a grid of places in the map, "
        "each with all strands that it crosses. The last picture is the distance to the opaque head."
    )
    distance = reference.solid_distances(scene, scene.lights[0])
    figure = _maps_figure(depths, distance)
    return Study("OSM figure 5: opacity maps", how, claims, rows, figure)


def _sums_before(lab: Lab, found: tfm.TransmittanceMap, places: Floats) -> Floats:
    """Return what lines from the light cross before each of some distances, [lines, places]."""
    side = 2 * lab.sizes.rays
    # At random in each cell of a grid: the mean is without bias, and varies less than that of random places.
    cells = np.stack(np.meshgrid(*2 * [np.arange(side)]), axis=-1).reshape(-1, 2)
    rays = reference.map_rays(found.light, (cells + np.random.default_rng(5).random(cells.shape)) / side)
    edges = np.concatenate([[0.0], places])
    (body,) = found.bodies
    each = [body.depths_along(o, d, edges)[:, 0] for o, d in zip(*rays, strict=True)]
    sums: Floats = np.cumsum(each, axis=1)
    return sums


def _maps_figure(depths: Floats, distance: NDArray[np.float32]) -> Figure:
    """Draw opacity maps as bright as they are opaque, and the distances to a head."""
    figure = Figure(figsize=(10.0, 5.4), dpi=90, layout="constrained")
    panels = [figure.add_subplot(2, 4, i + 1) for i in range(len(PAPER_SHOWN) + 1)]
    for axes, plane in zip(panels, PAPER_SHOWN, strict=False):
        axes.imshow(-np.expm1(-depths[..., plane - 1]), cmap="gray", vmin=0, vmax=1)
        axes.set_title(f"map {plane} of {PAPER_MAPS}", fontsize=9)
    panels[-1].imshow(np.where(np.isfinite(distance), distance, np.nan), cmap="gray")
    panels[-1].set_title("distance to the head", fontsize=9)
    for axes in panels:
        axes.set_axis_off()
    return figure


BOX = {"blur": 3, "blur_kernel": "box"}
"""The paper's filter, 3×3 texels, on the map before it is looked up."""
FILTERS: dict[str, dict[str, Any]] = {
    "unfiltered": {},
    "3×3 box": BOX,
    "Gaussian": {**BOX, "blur_kernel": "gaussian"},
}
"""By name; the Gaussian has the variance of the box."""
COARSER = 4
"""Times fewer texels a side: a map whose texels the camera's pixels show."""
FILTER_MAPS = 60
FEWER = 4
"""Times fewer samples where each takes nine lines."""


def osm_filter(lab: Lab) -> Study:
    """Filter opacities over neighbouring texels, as the paper does at look-up."""
    scenes = {LINES: lab.tuft(MODEL, full=lab.sizes.full_hair), HAIR: lab.side(HAIR), FUR: lab.side(FUR)}
    rows = [["what", "texels", "filter", "visible error", "its roughness", "SSIM with box", "error of T"]]
    low_pass, calmer, alike, held, panels = [], [], [], [], []
    for name, scene in scenes.items():
        truth = lab.image(scene, "dual")
        for res in (lab.sizes.paper_res // COARSER, lab.sizes.paper_res):
            where = f"{name}, {res}² texels"
            images = {
                what: lab.renderer.render(opacity_map(scene, "OSM", FILTER_MAPS, res=res, **changes)).image
                for what, changes in FILTERS.items()
            }
            rough = {what: roughness(image, truth) for what, image in images.items()}
            same = {what: tfm.compare(image, images["3×3 box"]).ssim for what, image in images.items()}
            for what, image in images.items():
                measured = (lab.error(image, truth), rough[what], same[what])
                rows.append([name, f"{res}²", what, *map(shown, measured), ""])
            busy = {what: busyness(image) for what, image in {**images, "exact": truth}.items()}
            low_pass.append(smaller(where, maps=busy["unfiltered"], exact=busy["exact"]))
            calmer.append(smaller(where, filtered=busy["3×3 box"], unfiltered=busy["unfiltered"]))
            alike.append(at_least(where, same["Gaussian"], INDISTINGUISHABLE))
            held.append(at_most(where, _far_from_means(lab, scene, res), ROUNDING))
            white, part = white_of(truth.astype(np.float64)), lit_window(truth)
            shown_images = {**images, "dual march": truth}
            panels.append([(f"{where}: {what}", image[part], white) for what, image in shown_images.items()])
    averaged = []
    for name in (HAIR, FUR):
        of_opacity, of_depth = _errors_of_averages(lab, scenes[name])
        rows.append([f"{name}, lines", "", "mean Ω", "", "", "", shown(of_opacity)])
        rows.append([f"{name}, lines", "", "mean depth", "", "", "", shown(of_depth)])
        averaged.append(smaller(name, opacity=of_opacity, depth=of_depth))
    claims = [
        Claim(
            "OSM section 2: a 3×3 averaging kernel (what a filtered map holds, farthest from the mean of "
            f"nine texels, part of the largest Ω, at most {ROUNDING:g})",
            "3×3",
            tuple(held),
        ),
        Claim(
            "OSM section 2: filtering is possible because opacities are stored instead of depths (RMS error "
            "of what passes on 3×3 lines, from their mean Ω and from their mean depth)",
            "–",
            tuple(averaged),
        ),
        Claim(
            "OSM section 2: the filter can be any standard one (pictures by a Gaussian and by the box, SSIM "
            f"at least {INDISTINGUISHABLE:g})",
            "–",
            tuple(alike),
        ),
        Claim(
            "OSM section 4: opacity maps are like a low-pass filter of shadows (RMS Laplacian of the "
            "picture, less than with exact ones)",
            "–",
            tuple(low_pass),
        ),
        Claim("OSM section 2, 4: and more so when filtered (the same)", "–", tuple(calmer)),
    ]
    how = (
        f"Hair and fur with {FILTER_MAPS} maps, against the dual march. The average is taken before look-up, "
        "by `map.blur` 3 with `blur_kernel` box, and then interpolated between texels. It is what the paper "
        "samples: the mean of texels and the interpolation between two maps may be taken in either order. Of "
        "its other filters the product has the Gaussian, and no Bartlett. Lines: 3×3 of them, a texel apart, "
        "around ends of strands; a depth is that of the first strand, behind which nothing is lit."
    )
    return Study("OSM section 2: filtering 3×3 texels", how, claims, rows, pictures(panels, 2.6))


def _far_from_means(lab: Lab, scene: tfm.Scene, res: int) -> float:
    """Largest difference of a filtered map from the means of 3×3 texels, part of its largest Ω."""
    plain, filtered = (
        lab.renderer.build_maps(opacity_map(scene, "OSM", FILTER_MAPS, res=res, **changes))[0].coefficients
        for changes in ({}, BOX)
    )
    wider = np.pad(plain.astype(np.float64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    means = sum(wider[y : y + res, x : x + res] for y in range(3) for x in range(3)) / 9
    return float(np.abs(filtered - means).max() / plain.max())


def _errors_of_averages(lab: Lab, scene: tfm.Scene) -> tuple[float, float]:
    """RMS error of T over 3×3 lines around samples, by their mean optical depth and by their mean depth."""
    body, light = _strands(scene)
    samples = _samples(body, light, lab.sizes.samples // FEWER)
    side = np.arange(-1, 2) / lab.sizes.paper_res
    around = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    of_opacity, of_depth = [], []
    for position, at in zip(light.arrival(samples.points).position, samples.distances, strict=True):
        lines = [
            _crossings(scene, *ray) for ray in zip(*reference.map_rays(light, position + around), strict=True)
        ]
        before = np.array([sums[np.searchsorted(places, at)] for places, sums in lines])
        first = np.mean([places[0] if len(places) else samples.distances.max() for places, _ in lines])
        exact = np.exp(-before).mean()
        of_opacity.append(float(np.exp(-before.mean()) - exact))
        of_depth.append(float((first >= at) - exact))
    return rms(np.array(of_opacity)), rms(np.array(of_depth))


class Samples(NamedTuple):
    """Ends of strands, which are the paper's shadow samples, just before they are crossed themselves."""

    points: Floats
    directions: Floats
    distances: Floats


def _strands(scene: tfm.Scene) -> tuple[tfm.Curves, tfm.SpotLight]:
    (body,), light = scene.primitives, scene.lights[0]
    assert isinstance(body, tfm.Curves)  # noqa: S101 - hair and fur are
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - as all lights of strands here
    return body, light


def _samples(body: tfm.Curves, light: tfm.SpotLight, count: int) -> Samples:
    points = body.corners[np.linspace(0, len(body.corners) - 1, count).astype(int), 1]
    away = points - np.asarray(light.from_)
    lengths = np.linalg.norm(away, axis=1)
    return Samples(points, away / lengths[:, None], lengths - 2 * body.thickness)


def _crossings(scene: tfm.Scene, origin: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Where a ray crosses strands, [k] in order, and the optical depths before each and after, [k + 1]."""
    (body,) = scene.primitives
    assert isinstance(body, tfm.Curves)  # noqa: S101 - hair and fur are
    met, at = body.crossed(origin, direction)
    order = np.argsort(at)
    depths = float(scene.medium_of(body).sigma_t.mean()) * body.densities[met][order]
    return at[order], np.concatenate([[0.0], np.cumsum(depths)])


def osm_plate1(lab: Lab) -> Study:
    """Hair without and with self-shadows, and where the maps lie."""
    placed = lab.tuft(MODEL, full=lab.sizes.full_hair)
    (spot,) = placed.lights
    assert isinstance(spot, tfm.SpotLight)  # noqa: S101 - it places itself
    sun = tfm.SunLight(from_=spot.from_, to=spot.to, intensity=spot.intensity)
    scene = placed.replace(lights=(sun,))
    truth = lab.image(scene, "dual")
    lit = lit_mask(truth)
    plain = lab.image(scene.replace(lights=(), ambient=tfm.Ambient(radiance=(1, 1, 1))))
    plain = plain * np.float32((truth[lit, :3] @ REC709).mean() / (plain[lit, :3] @ REC709).mean())
    shadowed = lab.renderer.render(opacity_map(scene, "OSM", PAPER_MAPS)).image
    rows = [
        ["picture", "visible error", "SSIM", "out of plane, spacings", "samples outside", "D_0 to nearest"]
    ]
    errors = {}
    named = {"(a) without self-shadows": plain, f"(c) opacity maps, N = {PAPER_MAPS}": shadowed}
    for what, image in named.items():
        errors[what] = lab.error(image, truth)
        rows.append([what, shown(errors[what]), shown(tfm.compare(image, truth).ssim), "", "", ""])
    without, with_maps = errors.values()
    (body,) = scene.primitives
    assert isinstance(body, tfm.Curves)  # noqa: S101 - hair is
    flat, first, enclosing = [], [], []
    found = {}
    for what, light in {"sun": sun, "spot": spot}.items():
        # Behind the head a map holds nothing.
        alone = opacity_map(scene.replace(lights=(light,), solids=()), "OSM", PAPER_MAPS)
        (found[what],) = lab.renderer.build_maps(alone)
        bent = _out_of_plane(found[what])
        outside, gap = _outside(found[what], body.corners.reshape(-1, 3))
        rows.append([f"(b) maps of a {what}", "", "", *map(shown, (bent, outside, gap))])
        flat.append(at_most(what, bent, NEGLIGIBLE))
        first.append(Case(what, {"": gap}, abs(gap) <= COINCIDES))
        enclosing.append(at_most(what, outside, 0.0))
    claims = [
        Claim(
            "OSM plate 1(a, c), section 1: self-shadows are crucial, and opacity maps give them (visible "
            f"error without over that with maps, at least {DRASTIC:g})",
            "pictures only",
            (at_least("", without / with_maps, DRASTIC, "ratio"),),
        ),
        Claim(
            "OSM plate 1(b), section 2: the maps are parallel planes, perpendicular to the light's direction "
            f"(farthest out of plane, part of their spacing, at most {NEGLIGIBLE:g})",
            "drawn as rectangles",
            tuple(flat),
        ),
        Claim(
            "OSM plate 1(b), algorithm: D_0 is at the nearest sample (from there to it, part of the maps' "
            f"range, at most {COINCIDES:g})",
            "line 1",
            tuple(first),
        ),
        Claim(
            "OSM plate 1(b), algorithm: each sample lies between two maps (part of the samples that do not)",
            "line 5",
            tuple(enclosing),
        ),
    ]
    how = (
        f"A model of {len(body.positions):,} lines in parallel light, against the dual march. Without "
        "shadows: in light from everywhere, as bright on the whole. Green: the maps themselves, faint where "
        "hair hides them. Those of a spot are measured too: distances are from the light, and so its maps "
        "are spheres. A map's range has a margin, as coarse rays find it."
    )
    white = white_of(truth.astype(np.float64))
    without_maps, with_shadows = ((what, image, white) for what, image in named.items())
    to = np.asarray(scene.camera.to)
    camera = scene.camera.replace(from_=tuple(to + FARTHER * (np.asarray(scene.camera.from_) - to)))
    result = lab.renderer.render(opacity_map(scene.replace(camera=camera), "OSM", PAPER_MAPS))
    illustrated = (f"(b) the {PAPER_MAPS} maps, from farther away", result.image, white)
    figure = pictures([[without_maps, illustrated, with_shadows, ("dual march", truth, white)]], 4.0)
    _draw_maps(figure.axes[1], camera, found["sun"], _nearest(result))
    return Study("OSM plate 1: hair without and with self-shadows", how, claims, rows, figure)


FARTHER = 1.8
"""Times as far away is the camera that sees all the maps."""


def _planes_of(found: tfm.TransmittanceMap) -> Floats:
    """Distances of the maps from where the light's rays begin, from that of D_0 on, [N + 1]."""
    begin, end = map(float, found.field[0, 0, :2])
    return np.linspace(begin, end, found.settings.coeffs + 1)


def _out_of_plane(found: tfm.TransmittanceMap) -> float:
    """How far a map's places are from lying in one plane across the light's axis, in spacings of maps."""
    positions = texel_positions(16).reshape(-1, 2)
    seen = np.linalg.norm(2 * positions - 1, axis=1) <= 1  # the corners are outside of a spot's cone
    rays, planes = reference.map_rays(found.light, positions[seen]), _planes_of(found)
    axis = found.light.frame().world_from_light[:3, 2]
    along = (rays.origins @ axis)[:, None] + (rays.directions @ axis)[:, None] * planes
    return float(np.ptp(along, axis=0).max() / (planes[1] - planes[0]))


def _outside(found: tfm.TransmittanceMap, samples: Floats) -> tuple[float, float]:
    """Part of the samples not between D_0 and the last map; from D_0 to the nearest, part of the range."""
    distances, planes = found.light.arrival(samples).distance, _planes_of(found)
    outside = (distances < planes[0]) | (distances > planes[-1])
    return float(outside.mean()), float((distances.min() - planes[0]) / np.ptp(planes))


def _nearest(result: tfm.RenderResult) -> Floats:
    """Distance to the hair or the head that a pixel shows; infinite without."""
    covered = result.aovs["transmittance"].mean(axis=-1) < 0.5  # noqa: PLR2004 - more than half
    medium = np.where(covered, result.aovs["depth"], np.inf)
    solid = result.aovs["solid_distance"]
    return np.minimum(medium, np.where(solid > 0, solid, np.inf)).astype(np.float64)


def _draw_maps(axes: Axes, camera: tfm.Camera, found: tfm.TransmittanceMap, nearest: Floats) -> None:
    """Draw the outlines of a sun's maps over a picture, faint where something is nearer."""
    outline = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)], dtype=np.float64)
    rays = reference.map_rays(found.light, outline)
    corners = rays.origins + _planes_of(found)[1:, None, None] * rays.directions
    along = np.linspace(0, 1, 48)[:, None]
    points = corners[:, :-1, None] + along * (corners[:, 1:] - corners[:, :-1])[:, :, None]
    (width, height), world_from_camera = camera.res, camera.world_from_camera
    local = (points - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    scale = 1 / (camera.pixel_width * local[..., 2])
    pixels = np.stack([width / 2 + local[..., 0] * scale, height / 2 - local[..., 1] * scale], axis=-1) - 0.5
    x, y = (np.clip(np.rint(pixels[..., i]).astype(int), 0, size - 1) for i, size in enumerate(camera.res))
    hidden = np.linalg.norm(local, axis=-1) > nearest[y, x]
    pieces = np.stack([pixels[..., :-1, :], pixels[..., 1:, :]], axis=-2).reshape(-1, 2, 2)
    colours = np.where(hidden[..., 1:].reshape(-1, 1), (0.2, 0.9, 0.3, 0.06), (0.2, 0.9, 0.3, 0.8))
    axes.add_collection(LineCollection(list(pieces), colors=colours, linewidths=0.5), autolim=False)


KEY = tfm.SpotLight(from_=(-3.4, 3.0, -2.6), to=(0, -0.2, 0), cone=22, intensity=(11, 10, 8.5))
FILL = tfm.SpotLight(from_=(4.0, 0.6, -2.0), to=(0, -0.2, 0), cone=22, intensity=(2.0, 2.8, 4.0))
BACK = tfm.SpotLight(from_=(2.4, 2.4, 3.4), to=(0, -0.2, 0), cone=22, intensity=(12, 11, 9))
FRONT_VIEW, BACK_VIEW = (-1.2, 0.5, -4.2), (2.4, 0.7, 3.6)
"""Places of the camera: where hair falls, behind the head, and on the side of its face."""
PLATE_COUNTS = (7, 80)
"""Planes of plate 2: as few as FOM compares, and the paper's."""
MANY = 500
"""Maps of plate 3, on the left."""
KAPPA = 8 * float(np.log(2))
"""Optical depth at which an alpha of 8 bits is opaque: e^-κ = 2^-8."""


def osm_plate2(lab: Lab) -> Study:
    """Hair in several lights, from several sides."""
    base = lab.tuft(HAIR, full=lab.sizes.full_hair)
    views = {
        "three lights": (FRONT_VIEW, (KEY, FILL, BACK)),
        "another view": (BACK_VIEW, (KEY, FILL, BACK)),
        "backlight": (FRONT_VIEW, (BACK,)),
    }
    rows = [["picture", "N", "SSIM", "visible error", "RMS error of T"]]
    cases, shown_rows = [], []
    for what, (place, lights) in views.items():
        camera = base.camera.replace(from_=place, to=(0, -0.2, 0), fov=24)
        scene = base.replace(camera=camera, lights=lights)
        truth = lab.image(scene, "dual")
        white, part = white_of(truth.astype(np.float64)), lit_window(truth)
        panels = []
        for n in PLATE_COUNTS:
            image = lab.renderer.render(opacity_map(scene, "OSM", n)).image
            ssim = tfm.compare(image, truth).ssim
            rows.append([what, str(n), shown(ssim), shown(lab.error(image, truth)), ""])
            cases.append(at_least(f"{what}, N = {n}", ssim, INDISTINGUISHABLE))
            panels.append((f"{what}: N = {n}", image[part], white))
        shown_rows.append([*panels, (f"{what}: dual march", truth[part], white)])
    camera = base.camera.replace(from_=FRONT_VIEW, to=(0, -0.2, 0), fov=24)
    bald = lab.tuft(HAIR, INVISIBLE).replace(camera=camera, lights=(KEY, FILL, BACK))
    head = lab.image(opacity_map(bald, "OSM", FEW))
    shown_rows.append([("(c) the opaque head", head[part], white)])
    by_depth, by_maps = _errors_of_head(lab, base.replace(lights=(KEY,)))
    rows.append(["head, by a depth map", "", "", "", shown(by_depth)])
    rows += [["head, in the maps", str(n), "", "", shown(error)] for n, error in by_maps.items()]
    fewest, most = NUMBERS_OF_MAPS[0], NUMBERS_OF_MAPS[-1]
    claims = [
        Claim(
            "OSM plate 2(a, b, d): opacity maps give hair in several lights, and in light from behind, as "
            f"exact shadows do (SSIM at least {INDISTINGUISHABLE:g})",
            "pictures only, N = 80",
            tuple(cases),
        ),
        Claim(
            "OSM plate 2(c), section 2: opaque objects are more efficiently integrated by a depth map (RMS "
            "error of the head's T, against that of the head in opacity maps)",
            "–",
            tuple(smaller(f"N = {n}", depth_map=by_depth, maps=error) for n, error in by_maps.items()),
        ),
        Claim(
            f"OSM section 2: a large number of maps approximates its step (error with {fewest} over that "
            f"with {most}, at least {DRASTIC:g})",
            "–",
            (at_least("", by_maps[fewest] / by_maps[most], DRASTIC, "ratio"),),
        ),
    ]
    how = (
        f"Wavy hair of {len(base.primitives[0].positions):,} lines on its opaque head, against the dual "
        "march; three lights are three maps. (c): the head without its hair; its shadow in the first light "
        "at the ends of strands, by its depth map, and on the host, without texels, by opacity maps that "
        f"hold it as an optical depth of {KAPPA:.3g}, which is opaque in 8 bits."
    )
    return Study("OSM plate 2: hair in several lights", how, claims, rows, pictures(shown_rows, 3.2))


INVISIBLE = 1e-6
"""Opacity of hair that does not show."""
HEAD_SAMPLES = 10
"""Times as many samples of a ball's shadow, which costs little."""


def _errors_of_head(lab: Lab, scene: tfm.Scene) -> tuple[float, dict[int, float]]:
    """RMS error of the head's T at samples: by its depth map, and in opacity maps, by their number."""
    body, light = _strands(scene)
    samples = _samples(body, light, HEAD_SAMPLES * lab.sizes.samples)
    (head,) = scene.solids
    assert isinstance(head, tfm.SphereSolid)  # noqa: S101 - as `Lab.tuft` makes it
    exact, by_depth = (
        reference.solid_visibility(scene, light, samples.points, how) for how in ("exact", "map")
    )
    origins = np.broadcast_to(np.asarray(light.from_, dtype=np.float64), samples.directions.shape)
    entries = head.distances(origins, samples.directions)
    near, far = samples.distances.min(), samples.distances.max()
    in_maps = {}
    for n in NUMBERS_OF_MAPS:
        place = (samples.distances - near) / (far - near) * n
        before = near + np.floor(place) * (far - near) / n
        after = before + (far - near) / n
        part = np.where(after > entries, place - np.floor(place), 0)
        in_maps[n] = rms(np.exp(-KAPPA * np.where(before > entries, 1, part)) - exact)
    return rms(by_depth - exact), in_maps


FEW, MORE = 6, 32
"""Maps with which plate 3 shows artefacts, and with which it should not."""
NUMBERS_OF_MAPS = (7, 15, 32, 60, 80, 500)
"""Those of FOM's tables and pictures of OSM, and of OSM's figure 5 and plates."""


def osm_plate3(lab: Lab) -> Study:
    """Fur in few and in many maps: bright and dark parts of pictures, and single samples."""
    scene = lab.side(FUR)
    images = {n: lab.renderer.render(opacity_map(scene, "OSM", n)).image for n in (FEW, MORE)}
    many = lab.renderer.render(opacity_map(scene, "OSM", MANY)).image
    truths = {f"{MANY} maps": many, "exact shadows": lab.image(scene, "dual")}
    rows = [["what", "against", "N", "error in bright parts", "in dark parts", "RMS error of T"]]
    visible, only_few = [], []
    for against, truth in truths.items():
        errors = {n: _bright_and_dark(image, truth) for n, image in images.items()}
        rows += [["fur, picture", against, str(n), *map(shown, errors[n]), ""] for n in images]
        visible.append(smaller(f"against {against}", dark=errors[FEW][1], bright=errors[FEW][0]))
        ratio = errors[FEW][0] / errors[MORE][0]
        only_few.append(at_least(f"against {against}", ratio, DRASTIC, "ratio"))
    falling, right = [], []
    for name in (FUR, HAIR):
        samples = _errors_of_samples(lab, lab.side(name))
        rows += [[f"{name}, ends", "exact", str(n), "", "", shown(error)] for n, error in samples.items()]
        measured = {f"N = {n}": error for n, error in samples.items()}
        falling.append(Case(name, measured, bool((np.diff(list(samples.values())) < 0).all())))
        right.append(at_most(name, samples[NUMBERS_OF_MAPS[-1]], COINCIDES))
    claims = [
        Claim(
            f"OSM plate 3: with {FEW} maps artefacts are visible in brighter parts (visible error larger "
            "than in darker ones)",
            "visible",
            tuple(visible),
        ),
        Claim(
            f"OSM plate 3: but only with few maps (error in brighter parts with {FEW} over that with "
            f"{MORE}, at least {DRASTIC:g})",
            "visible only with N = 6",
            tuple(only_few),
        ),
        Claim(
            "OSM section 4: quality grows with the number of maps (RMS error of T at the ends of strands)",
            "–",
            tuple(falling),
        ),
        Claim(
            f"OSM plate 3: 500 maps show no artefacts (the same error, at most {COINCIDES:g})",
            "pictures only",
            tuple(right),
        ),
    ]
    how = (
        "Balls of fur and of hair under one light from the left. Pictures against exact shadows, the dual "
        f"march's, and against the paper's {MANY} maps. Brighter and darker than the median of what is lit; "
        "close-ups of the brightest square and of a dark one. At the ends of strands, which are the paper's "
        "samples: on the host, with Ω at each plane from all crossings on the sample's own ray, and so "
        "without texels."
    )
    white, part = white_of(many.astype(np.float64)), lit_window(many)
    everything = {f"N = {MANY}": many, **{f"N = {n}": image for n, image in images.items()}}
    everything["exact"] = truths["exact shadows"]
    panels = [(f"fur, {what}", image[part], white) for what, image in everything.items()]
    differences = [
        (f"{what}: |difference| × 4 to N = {MANY}", 4 * np.abs(image - many)[part], white)
        for what, image in everything.items()
    ]
    closer = _closeups(many)
    near = [
        [(f"{which} area, {what}", image[window], white) for what, image in everything.items()]
        for which, window in closer.items()
    ]
    figure = pictures([panels, differences, *near], 3.0)
    for (down, across), colour in zip(closer.values(), ("#2060ff", "#ffd000"), strict=True):
        corner = across.start - part[1].start, down.start - part[0].start
        side = across.stop - across.start
        figure.axes[0].add_patch(Rectangle(corner, side, side, fill=False, edgecolor=colour, linewidth=1.2))
    return Study("OSM plate 3: fur with few and many maps", how, claims, rows, figure)


CLOSE_UP = 7
"""Times smaller than the picture is the side of a close-up."""
DARKER = 0.3
"""Brightness of the dark area over that of the bright one."""
ALL_LIT = 0.98
"""Part of a close-up's pixels that show fur."""


def _closeups(image: Image) -> dict[str, tuple[slice, slice]]:
    """Return the brightest square of what is lit, and one that is as much darker as `DARKER` says."""
    side = max(4, min(image.shape[:2]) // CLOSE_UP)
    lit, luma = lit_mask(image), display_luma(image[..., :3], white_of(image.astype(np.float64)))

    def means(values: Floats) -> Floats:
        sums = np.pad(np.cumsum(np.cumsum(values, axis=0), axis=1), ((1, 0), (1, 0)))
        both = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
        mean: Floats = both / side**2
        return mean

    shares, brightness = means(lit.astype(np.float64)), means(luma.astype(np.float64))
    full = shares >= min(ALL_LIT, float(shares.max()))
    chosen = {
        "bright": np.where(full, brightness, -np.inf).argmax(),
        "dark": np.abs(np.where(full, brightness / brightness[full].max(), np.inf) - DARKER).argmin(),
    }
    corners = {which: divmod(int(at), full.shape[1]) for which, at in chosen.items()}
    return {which: (slice(y, y + side), slice(x, x + side)) for which, (y, x) in corners.items()}


def _bright_and_dark(image: Image, truth: Image) -> tuple[float, float]:
    """Visible error where the truth is brighter than its median, and where it is darker."""
    white, lit = white_of(truth.astype(np.float64)), lit_mask(truth)
    luma = display_luma(truth[..., :3], white)
    bright = lit & (luma > np.median(luma[lit]))
    difference = display_luma(image[..., :3], white) - luma
    return rms(difference[bright]), rms(difference[lit & ~bright])


def _errors_of_samples(lab: Lab, scene: tfm.Scene) -> dict[int, float]:
    """RMS error of T at the ends of strands, by the number of maps; sorted crossings are the truth."""
    body, light = _strands(scene)
    samples, origin = _samples(body, light, lab.sizes.samples), np.asarray(light.from_, dtype=np.float64)
    near, far = samples.distances.min(), samples.distances.max()
    errors: dict[int, list[float]] = {n: [] for n in NUMBERS_OF_MAPS}
    for direction, distance in zip(samples.directions, samples.distances, strict=True):
        at, sums = _crossings(scene, origin, direction)
        exact = np.exp(-sums[np.searchsorted(at, distance)])
        for n, found in errors.items():
            planes = np.linspace(near, far, n + 1)
            opacity = np.interp(distance, planes, sums[np.searchsorted(at, planes)])
            found.append(float(np.exp(-opacity) - exact))
    return {n: rms(np.array(found)) for n, found in errors.items()}


STUDIES = (osm_fig3, osm_fig4, osm_fig5, osm_filter, osm_plate1, osm_plate2, osm_plate3)
