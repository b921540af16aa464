"""Kim and Neumann, "Opacity Shadow Maps", Eurographics Workshop on Rendering 2001."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import tfm_cl as tfm
from reproduce.claims import (
    COINCIDES,
    DRASTIC,
    INDISTINGUISHABLE,
    LINEAR,
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
    opacity_map,
    rms,
)
from reproduce.plotting import COLOURS, lit_window, pictures, plots
from tfm_cl import reference
from tfm_cl.metrics import REC709, display_luma, lit_mask, white_of

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
        "here holds all its planes, and is made in one march instead of a pass each; a look-up reads two. "
        "Samples are those of the camera's rays, as many on each: their number is that of the pixels. "
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
MOST_PLANES = 32
"""That a map holds."""
ROUNDING = 1e-5
"""Of the largest optical depth: what a sum of float32 may fall by without being less."""
DEVIATIONS = 3.0
"""Standard errors by which a mean over rays may differ from the true one."""


def osm_fig5(lab: Lab) -> Study:
    """Show some opacity maps, and the depth map of the head."""
    scene = lab.side(HAIR)
    # Behind a solid a map holds nothing: the paper's maps are of hair alone, and the head has one of its own.
    (found,) = lab.renderer.build_maps(opacity_map(scene.replace(solids=()), "OSM", MOST_PLANES))
    depths = found.coefficients.astype(np.float64)
    planes = [max(1, round(i * MOST_PLANES / PAPER_MAPS)) for i in PAPER_SHOWN]
    fall = float(-np.diff(depths, axis=-1).min() / depths.max())
    begin, end = map(float, found.field[0, 0, :2])
    places = begin + (end - begin) * np.array(planes) / MOST_PLANES
    taken = -np.expm1(-_sums_before(lab, found, places))
    rows = [["map", "mean opacity of the texels", "mean of lines followed on the host", "standard error"]]
    alike = []
    for i, plane in enumerate(planes):
        mean, expected = float(-np.expm1(-depths[..., plane - 1]).mean()), float(taken[:, i].mean())
        error = float(taken[:, i].std(ddof=1) / np.sqrt(len(taken)))
        rows.append([f"{plane} of {MOST_PLANES}", *map(shown, (mean, expected, error))])
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
        f"The sample of wavy hair under one light from the left; the same parts of {MOST_PLANES} maps as the "
        f"paper's of {PAPER_MAPS}, as bright as they are opaque. The exact mean is that of lines through a "
        "grid of places in the map, each with all strands that it crosses. The last picture is the distance "
        "to the opaque head."
    )
    distance = reference.solid_distances(scene, scene.lights[0])
    figure = _maps_figure(depths, planes, distance)
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


def _maps_figure(depths: Floats, planes: Sequence[int], distance: NDArray[np.float32]) -> Figure:
    """Draw opacity maps as bright as they are opaque, and the distances to a head."""
    figure = Figure(figsize=(10.0, 5.4), dpi=90, layout="constrained")
    panels = [figure.add_subplot(2, 4, i + 1) for i in range(len(planes) + 1)]
    for axes, plane in zip(panels, planes, strict=False):
        axes.imshow(-np.expm1(-depths[..., plane - 1]), cmap="gray", vmin=0, vmax=1)
        axes.set_title(f"map {plane} of {MOST_PLANES}", fontsize=9)
    panels[-1].imshow(np.where(np.isfinite(distance), distance, np.nan), cmap="gray")
    panels[-1].set_title("distance to the head", fontsize=9)
    for axes in panels:
        axes.set_axis_off()
    return figure


def osm_plate1(lab: Lab) -> Study:
    """Hair without and with self-shadows."""
    scene = lab.tuft(MODEL, full=lab.sizes.full_hair)
    truth = lab.image(scene, "dual")
    lit = lit_mask(truth)
    plain = lab.image(scene.replace(lights=(), ambient=tfm.Ambient(radiance=(1, 1, 1))))
    plain = plain * np.float32((truth[lit, :3] @ REC709).mean() / (plain[lit, :3] @ REC709).mean())
    shadowed = lab.renderer.render(opacity_map(scene, "OSM", MOST_PLANES)).image
    rows = [["picture", "visible error", "SSIM"]]
    errors = {}
    named = {"without self-shadows": plain, f"opacity maps, N = {MOST_PLANES}": shadowed}
    for what, image in named.items():
        errors[what] = lab.error(image, truth)
        rows.append([what, shown(errors[what]), shown(tfm.compare(image, truth).ssim)])
    without, with_maps = errors.values()
    claim = Claim(
        "OSM plate 1, section 1: self-shadows are crucial, and opacity maps give them (visible error without "
        f"over that with maps, at least {DRASTIC:g})",
        "pictures only",
        (at_least("", without / with_maps, DRASTIC, "ratio"),),
    )
    (body,) = scene.primitives
    how = (
        f"A model of {len(body.positions):,} lines under one light, against the dual march. Without shadows: "
        "in light from everywhere, as bright on the whole."
    )
    white, part = white_of(truth.astype(np.float64)), lit_window(truth)
    panels = [(what, image[part], white) for what, image in {**named, "dual march": truth}.items()]
    return Study(
        "OSM plate 1: hair without and with self-shadows", how, [claim], rows, pictures([panels], 4.0)
    )


KEY = tfm.SpotLight(from_=(-3.4, 3.0, -2.6), to=(0, -0.2, 0), cone=22, intensity=(11, 10, 8.5))
FILL = tfm.SpotLight(from_=(4.0, 0.6, -2.0), to=(0, -0.2, 0), cone=22, intensity=(2.0, 2.8, 4.0))
BACK = tfm.SpotLight(from_=(2.4, 2.4, 3.4), to=(0, -0.2, 0), cone=22, intensity=(12, 11, 9))
FRONT_VIEW, BACK_VIEW = (-1.2, 0.5, -4.2), (2.4, 0.7, 3.6)
"""Places of the camera: where hair falls, behind the head, and on the side of its face."""
LIMIT: dict[str, Any] = {"basis": "klt", "coeffs": 32}
"""A map with texels as large, and with the most that it can say of each: in place of hundreds of planes."""
PLATE_COUNTS = (7, 32)
"""Planes of plate 2; the paper's pictures have 80."""


def osm_plate2(lab: Lab) -> Study:
    """Hair in several lights, from several sides."""
    base = lab.scene(HAIR)
    views = {
        "three lights": (FRONT_VIEW, (KEY, FILL, BACK)),
        "another view": (BACK_VIEW, (KEY, FILL, BACK)),
        "backlight": (FRONT_VIEW, (BACK,)),
    }
    rows = [["picture", "N", "SSIM", "visible error"]]
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
            rows.append([what, str(n), shown(ssim), shown(lab.error(image, truth))])
            cases.append(at_least(f"{what}, N = {n}", ssim, INDISTINGUISHABLE))
            panels.append((f"{what}: N = {n}", image[part], white))
        limit = lab.image(scene, **LIMIT)
        rows.append(
            [what, "as many as needed", shown(tfm.compare(limit, truth).ssim), shown(lab.error(limit, truth))]
        )
        shown_rows.append([*panels, (f"{what}: dual march", truth[part], white)])
    claim = Claim(
        "OSM plate 2: opacity maps give hair in several lights, and in light from behind, as exact shadows "
        f"do (SSIM at least {INDISTINGUISHABLE:g})",
        "pictures only, N = 80",
        tuple(cases),
    )
    how = (
        "The sample of wavy hair on its opaque head, against the dual march; three lights are three maps. A "
        f"map holds {MOST_PLANES} planes at most: for more see plate 3. 'As many as needed' is a map of the "
        "same texels with 32 learnt functions each: what it lacks is due to the texels."
    )
    return Study("OSM plate 2: hair in several lights", how, [claim], rows, pictures(shown_rows, 3.2))


FEW = 6
"""Maps with which plate 3 shows artefacts."""
NUMBERS_OF_MAPS = (7, 15, 32, 60, 80, 500)
"""Those of FOM's tables and pictures of OSM, and of OSM's figure 5 and plates."""


def osm_plate3(lab: Lab) -> Study:
    """Fur in few and in many maps: bright and dark parts of pictures, and single samples."""
    scene = lab.side(FUR)
    images = {n: lab.renderer.render(opacity_map(scene, "OSM", n)).image for n in (FEW, MOST_PLANES)}
    truths = {"many maps": lab.image(scene, **LIMIT), "exact shadows": lab.image(scene, "dual")}
    rows = [["what", "against", "N", "error in bright parts", "in dark parts", "RMS error of T"]]
    visible, only_few = [], []
    for against, truth in truths.items():
        errors = {n: _bright_and_dark(image, truth) for n, image in images.items()}
        rows += [["fur, picture", against, str(n), *map(shown, errors[n]), ""] for n in images]
        visible.append(smaller(f"against {against}", dark=errors[FEW][1], bright=errors[FEW][0]))
        ratio = errors[FEW][0] / errors[MOST_PLANES][0]
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
            f"{MOST_PLANES}, at least {DRASTIC:g})",
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
        "Balls of fur and of hair under one light from the left. Pictures with as many planes as a map "
        "holds, against exact shadows, the dual march's, and against many maps: texels as large, with 32 "
        "learnt functions each. Brighter and darker than the median of what is lit. More planes: on the "
        "host, at the ends of strands, which are the paper's samples, with Ω at each plane from all "
        "crossings on the sample's own ray, and so without texels."
    )
    many = truths["many maps"]
    white, part = white_of(many.astype(np.float64)), lit_window(many)
    panels = [(f"fur, N = {n}", image[part], white) for n, image in images.items()]
    differences = [
        (f"N = {n}: |difference| × 4 to many maps", 4 * np.abs(image - many)[part], white)
        for n, image in images.items()
    ]
    seen = [(what, image[part], white) for what, image in truths.items()]
    figure = pictures([[*panels, seen[0]], [*differences, seen[1]]], 3.4)
    return Study("OSM plate 3: fur with few and many maps", how, claims, rows, figure)


def _bright_and_dark(image: Image, truth: Image) -> tuple[float, float]:
    """Visible error where the truth is brighter than its median, and where it is darker."""
    white, lit = white_of(truth.astype(np.float64)), lit_mask(truth)
    luma = display_luma(truth[..., :3], white)
    bright = lit & (luma > np.median(luma[lit]))
    difference = display_luma(image[..., :3], white) - luma
    return rms(difference[bright]), rms(difference[lit & ~bright])


def _errors_of_samples(lab: Lab, scene: tfm.Scene) -> dict[int, float]:
    """RMS error of T at the ends of strands, by the number of maps; sorted crossings are the truth."""
    (body,), light = scene.primitives, scene.lights[0]
    assert isinstance(body, tfm.Curves)  # noqa: S101 - hair and fur are
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - as `Lab.side` makes it
    sigma_t = float(scene.medium_of(body).sigma_t.mean())
    ends = body.corners[np.linspace(0, len(body.corners) - 1, lab.sizes.samples).astype(int), 1]
    away = ends - np.asarray(light.from_)
    # Just before they are crossed themselves.
    distances = np.linalg.norm(away, axis=1) - 2 * body.thickness
    directions = away / np.linalg.norm(away, axis=1, keepdims=True)
    near, far = distances.min(), distances.max()
    errors: dict[int, list[float]] = {n: [] for n in NUMBERS_OF_MAPS}
    for direction, distance in zip(directions, distances, strict=True):
        met, at = body.crossed(np.asarray(light.from_, dtype=np.float64), direction)
        order = np.argsort(at)
        at, sums = at[order], np.concatenate([[0.0], np.cumsum(sigma_t * body.densities[met][order])])
        exact = np.exp(-sums[np.searchsorted(at, distance)])
        for n, found in errors.items():
            planes = np.linspace(near, far, n + 1)
            opacity = np.interp(distance, planes, sums[np.searchsorted(at, planes)])
            found.append(float(np.exp(-opacity) - exact))
    return {n: rms(np.array(found)) for n, found in errors.items()}


STUDIES = (osm_fig3, osm_fig4, osm_fig5, osm_plate1, osm_plate2, osm_plate3)
