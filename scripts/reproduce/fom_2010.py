"""Jansen and Bavoil, "Fourier Opacity Mapping", I3D 2010."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import tfm_cl as tfm
from reproduce.claims import (
    COINCIDES,
    FOURFOLD,
    INDISTINGUISHABLE,
    MAP_PRICE,
    NEGLIGIBLE,
    PLAUSIBLE,
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
    HAIR,
    HARD,
    KNOT,
    LONG,
    METHODS,
    PAIR,
    PARTICLES,
    SMOKE,
    Floats,
    Lab,
    Seconds,
    busyness,
    least_of,
    opacity_map,
    rms,
    roughness,
)
from reproduce.plotting import COLOURS, EXACT, curves, lit_window, pictures, plots
from reproduce.rays import (
    CELLS,
    EDGES,
    MIDDLES,
    accumulated,
    depths_of_steps,
    most_features,
    profiles,
    reconstructed,
)
from tfm_cl import reference
from tfm_cl.metrics import REC709, lit_mask, white_of
from tfm_cl.scene.bodies.points import PROFILES
from tfm_cl.scene.lights.base import texel_positions

SHAPES = (PARTICLES, KNOT, SMOKE, CLOUD, HARD)
"""Whose rays are studied one by one: particles as in the paper, then voxels."""
USUAL = 7
"""Coefficients of the paper's tables and most of its figures: 'we found that 7 coefficients worked well'."""
HALF = 2.0**-11
"""Relative rounding of the 16-bit targets in which the paper sums coefficients: what 'exactly (with
floating-point precision)' can mean there."""


def fom_fig1ab(lab: Lab) -> Study:
    """Pictures of particles."""
    rows = [["particles", "n", "SSIM against the dual march", "visible error"]]
    cases, shown_rows = [], []
    for name in (PARTICLES, KNOT):
        scene = lab.scene(name)
        truth = lab.image(scene, "dual")
        image = lab.renderer.render(opacity_map(scene, "FOM", USUAL)).image
        ssim, white = tfm.compare(image, truth).ssim, white_of(truth.astype(np.float64))
        rows.append([name, str(USUAL), shown(ssim), shown(lab.error(image, truth))])
        cases.append(at_least(name, ssim, PLAUSIBLE))
        shown_rows.append(
            [(f"{name}: FOM, n = {USUAL}", image, white), (f"{name}: dual march", truth, white)]
        )
    claim = Claim(
        f"FOM figure 1(a, b), 4.1: {USUAL} coefficients work well for particles (SSIM at least "
        f"{PLAUSIBLE:g})",
        "pictures only",
        tuple(cases),
    )
    how = f"The sample scenes as they are: two lights, and 16,384 points. Maps of {lab.sizes.paper_res}²."
    title = "FOM figure 1(a, b): a plume and a complex structure of particles"
    return Study(title, how, [claim], rows, pictures(shown_rows, 5.0))


def fom_fig1(lab: Lab) -> Study:
    """Fifteen coefficients in one dimension."""
    rows = [["what", "density", "largest |T̂ - T|, median of the rays", "worst ray"]]
    cases = []
    figure, axes = plots(len(SHAPES))
    for plot, name in zip(axes, SHAPES, strict=True):
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
        f"of several features (median over rays of the largest difference, at most {COINCIDES:g})",
        "plot only",
        tuple(cases),
    )
    how = (
        "Rays of a light from the left; one range for all, from the nearest to the farthest density. "
        "Particles, then voxels."
    )
    return Study("FOM figure 1(c): reconstruction with 15 coefficients", how, [claim], rows, figure)


FIG2_RES = 512
"""Size of the map of figure 2, whatever that of others: texels narrower than any particle, none of which
then has to be widened."""
FIG2_STEPS = (1, 4)
"""Steps of the maps of figure 2, times those of other maps."""
EXACT_STEPS = 2048
"""Steps of rays on the host, in closed form: their harmonics are right to 1e-6."""


def fom_fig2(lab: Lab) -> Study:
    """Show the coefficient map, and compare it with sums over the particles."""
    base = lab.side(PARTICLES)
    rows = [["particles", "texels", "largest error", "RMS error", "largest error of T behind all"]]
    exactly, ends = [], []
    kinds: dict[str, tuple[dict[str, Any], Callable[..., Found]]] = {
        "at their own depths": ({}, _at_own_depths)
    }
    for times in FIG2_STEPS:
        steps = times * lab.sizes.steps
        kinds[f"in {steps} steps"] = {"deposits": "steps", "steps": steps}, _along_rays
    for name, (changes, summed) in kinds.items():
        (found,) = lab.renderer.build_maps(opacity_map(base, "FOM", USUAL, res=FIG2_RES, **changes))
        texels, expected = summed(lab, base, found)
        numbers = found.coefficients.reshape(-1, USUAL)[texels].astype(np.float64)
        error = np.abs(numbers - expected).max(axis=1) / np.maximum(expected[:, 0], 1)
        behind = np.abs(np.exp(-numbers[:, 0]) - np.exp(-expected[:, 0])).max()
        worst, typical = float(error.max()), rms(error)
        rows.append([name, str(len(texels)), *map(shown, (worst, typical, float(behind)))])
        exactly.append(at_most(name, worst, HALF, "largest"))
        ends.append(at_most(name, float(behind), HALF))
    claims = [
        Claim(
            "FOM eq. 5, 6, section 1: the coefficients of a ray are computed exactly (largest error over the "
            f"ray's optical depth, or 1 if that is less; at most {HALF:.2g})",
            "with floating-point precision",
            tuple(exactly),
        ),
        Claim(
            "FOM eq. 3: at the far end of the range T is exact, whatever the number of coefficients",
            "T(1) = exp(-∫σ)",
            tuple(ends),
        ),
    ]
    how = (
        f"The plume of particles under one light from the left, {USUAL} coefficients; some of the texels "
        "that meet particles, against sums on the host: of points at the particles' depths, as in the paper, "
        "or of balls. A map in steps lets the density of balls be constant within a step."
    )
    return Study("FOM figure 2: the coefficient map", how, claims, rows, _map_figure(found))


Found = tuple[NDArray[np.intp], Floats]
"""Texels, and their coefficients."""


def _some_rays(lab: Lab, found: tfm.TransmittanceMap) -> tuple[NDArray[np.intp], reference.Rays]:
    """Return some texels that meet particles, and their rays."""
    res = found.settings.res
    every = max(1, res // lab.sizes.rays)
    y, x = np.mgrid[every // 2 : res : every, every // 2 : res : every]
    texels = (y * res + x).ravel()
    texels = texels[found.coefficients.reshape(-1, USUAL)[texels, 0] > 0]
    return texels, reference.map_rays(found.light, texel_positions(res).reshape(-1, 2)[texels])


def _along_rays(lab: Lab, scene: tfm.Scene, found: tfm.TransmittanceMap) -> Found:
    """Sum the coefficients of some texels over rays through the particles, in float64."""
    texels, rays = _some_rays(lab, found)
    begin, end = (np.full(len(texels), float(found.field[0, 0, i])) for i in range(2))
    depths = depths_of_steps(scene, rays, begin, end, EXACT_STEPS)
    met = depths.sum(axis=1) > 0
    assert found.functions is not None  # noqa: S101 - a Fourier series is functions
    return texels[met], depths[met] @ found.functions.analysis(EXACT_STEPS)


def _at_own_depths(lab: Lab, scene: tfm.Scene, found: tfm.TransmittanceMap) -> Found:
    """Sum them over the particles, each a point of the ray (eq. 5, 6)."""
    texels, rays = _some_rays(lab, found)
    begin, end = (float(found.field[0, 0, i]) for i in range(2))
    sums = np.zeros((len(texels), USUAL))
    for body in scene.primitives:
        ray, distance, held = reference.primitives.meet(body, rays).whole()
        v = (distance - begin) / (end - begin)
        angles = 2 * np.pi * np.arange(1, USUAL // 2 + 1) * v[:, None]
        waves = 2 * np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(len(v), -1)
        np.add.at(sums, ray, held[:, :1] * np.column_stack([np.ones_like(v), waves]))
    met = sums[:, 0] > 0
    return texels[met], sums[met]


def _map_figure(found: tfm.TransmittanceMap) -> Figure:
    """Draw every number of a map, and T behind all."""
    names = [f"{letter}{k}" for k in range(1, USUAL // 2 + 1) for letter in "ab"]
    numbers = dict(zip(["a0 / 2", *names], np.moveaxis(found.coefficients, -1, 0), strict=True))
    figure = Figure(figsize=(10.4, 5.6), dpi=90, layout="constrained")
    panels = [figure.add_subplot(2, 4, i + 1) for i in range(8)]
    for axes, (name, values) in zip(panels, numbers.items(), strict=False):
        most = float(np.abs(values).max())
        drawn = axes.imshow(values, cmap="RdBu_r", vmin=-most, vmax=most)
        axes.set_title(name, fontsize=9)
        figure.colorbar(drawn, ax=axes, shrink=0.7)
    panels[-1].imshow(np.exp(-numbers["a0 / 2"]), cmap="gray", vmin=0, vmax=1)
    panels[-1].set_title("T behind all", fontsize=9)
    for axes in panels:
        axes.set_axis_off()
    return figure


def fom_fig4(lab: Lab) -> Study:
    """Numbers and resolution, FOM against OSM."""
    coarse, fine = lab.sizes.coarse_and_fine
    rows = [["what", "map", "n", "method", "SSIM", "visible error", "roughness of the error"]]
    nearer, smoother, good, shown_rows = [], [], [], []
    for name in (PARTICLES, SMOKE):
        scene = lab.side(name)
        truth = lab.image(scene, "dual")
        white = white_of(truth.astype(np.float64))
        for res, n in ((fine, 3), (fine, 15), (coarse, 3), (coarse, 15)):
            images = {
                method: lab.renderer.render(opacity_map(scene, method, n, res=res)).image for method in PAIR
            }
            errors = {method: lab.error(image, truth) for method, image in images.items()}
            stripes = {method: roughness(image, truth) for method, image in images.items()}
            for method, image in images.items():
                values = (tfm.compare(image, truth).ssim, errors[method], stripes[method])
                rows.append([name, f"{res}²", str(n), method, *map(shown, values)])
            where = f"{name}, n = {n}, {res}² map"
            nearer.append(smaller(where, **errors))
            smoother.append(smaller(where, **stripes))
            if (res, n) == (fine, 15):
                good.append(at_least(where, tfm.compare(images["FOM"], truth).ssim, INDISTINGUISHABLE))
            panels = [(f"{method}, {where}", image, white) for method, image in images.items()]
            panels += [
                (f"{method}: |error| × 4", 4 * np.abs(image - truth), white)
                for method, image in images.items()
            ]
            if name == PARTICLES:
                part = lit_window(truth)
                shown_rows.append([(caption, image[part], white) for caption, image, white in panels])
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
            "(visible error)",
            "pictures only",
            tuple(nearer),
        ),
    ]
    how = (
        "The plume, of particles and of voxels, under one light from the left; one depth range for all rays, "
        "planes and series alike; against the dual march. Pictured: particles."
    )
    title = f"FOM figure 4: 3 and 15 coefficients, maps of {coarse}² and {fine}²"
    return Study(title, how, claims, rows, pictures(shown_rows, 2.6))


PADDING = 36
"""Empty voxels along the light before and behind the medium, with room for puffs that mark a depth bound."""
MARK = 1e-6
"""Density of a mark, as a fraction of the largest: enough to set a bound, far too little to be visible."""
MARK_RADIUS = 3.0
"""Radius of a marking puff in voxels."""
MARK_SIZE = 0.03
"""The same of a marking particle, as a fraction of the medium's length."""
REACH = 0.2
"""How far the box of marked particles reaches beyond them on either side, in lengths of the medium."""
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


def with_points(
    scene: tfm.Scene, points: Iterable[tuple[float, float, float]], *, reach: Sequence[float] = ()
) -> tfm.Scene:
    """Add particles on the light's axis: world x, radius, density. ``reach``: x of some without density.

    The latter keep the medium's box, and with it the steps of marches, whatever is added within it.
    """
    (body,), light = scene.bodies, scene.lights[0]
    assert isinstance(body, tfm.Points)  # noqa: S101 - asked for particles only
    assert isinstance(light, tfm.SpotLight)  # noqa: S101 - as `Lab.side` makes it
    radius = float(body.radii.max())
    added = [*points, *((x, radius, 0.0) for x in reach)]
    positions = [(x, light.to[1], light.to[2]) for x, _, _ in added]
    more = tfm.Points(
        np.concatenate([body.positions, np.reshape(positions, (-1, 3))]),
        np.concatenate([body.radii, [radius for _, radius, _ in added]]),
        np.concatenate([body.densities, [density for _, _, density in added]]),
        profile=body.profile,
    )
    return scene.replace(volume=more)


def _bounded(lab: Lab, scene: tfm.Scene) -> Callable[[float, float], tfm.Scene]:
    """Return what extends the range of a scene's map by low and high, as fractions of the medium's length."""
    light_x = scene.lights[0].frame().world_from_light[0, 3]
    near, far = depth_range(lab.renderer.build_maps(opacity_map(scene, "FOM", USUAL)))
    length = far - near
    if scene.primitives:
        radius, density = MARK_SIZE * length, MARK * float(scene.primitives[0].densities.max())
    else:
        radius = MARK_RADIUS * float(scene.grids[0].voxel_size[0])
        density = MARK * float(scene.grids[0].data.max())

    def bounded(low: float, high: float) -> tfm.Scene:
        places = [light_x + near - low * length + radius, light_x + far + high * length - radius]
        marks = places if low or high else []
        if scene.primitives:
            reach = (light_x + near - REACH * length, light_x + far + REACH * length)
            return with_points(scene, [(x, radius, density) for x in marks], reach=reach)
        return with_puffs(scene, PADDING, PADDING, [(x, MARK_RADIUS, density) for x in marks])

    return bounded


def fom_fig5(lab: Lab) -> Study:
    """Measure the effect of inflated and moved depth bounds."""
    rows = [["what", "change", "method", "largest change of the picture", "RMS", "range, before", "after"]]
    cases, shown_rows = [], []
    for name in (PARTICLES, SMOKE):
        bounded = _bounded(lab, lab.side(name))
        pairs = {
            "bounds inflated by 10 %": (bounded(0, 0), bounded(0.05, 0.05)),
            "bounds moved by 5 %": (bounded(0.1, 0.1), bounded(0.05, 0.15)),
        }
        for what, (one, other) in pairs.items():
            truth = lab.image(one, "dual")
            white, lit = white_of(truth.astype(np.float64)), lit_mask(truth)
            control = np.abs(lab.image(other, "dual") - truth)[..., :3].max() / white
            rows.append([name, what, "dual march (control)", shown(float(control)), "", "", ""])
            largest, mean, panels = {}, {}, []
            for method in PAIR:
                images, ranges = [], []
                for scene in (opacity_map(one, method, USUAL), opacity_map(other, method, USUAL)):
                    maps = lab.renderer.build_maps(scene)
                    ranges.append(" to ".join(f"{depth:.3f}" for depth in depth_range(maps)))
                    images.append(lab.renderer.render(scene, maps=maps).image)
                change = np.abs(images[0] - images[1])[..., :3].astype(np.float64)
                largest[method] = float((change @ REC709).max()) / white
                mean[method] = rms((change @ REC709)[lit]) / white
                rows.append([name, what, method, shown(largest[method]), shown(mean[method]), *ranges])
                panels += [
                    (f"{method}, {what}", images[1], white),
                    (f"{method}: |change| × 10", 10 * change, white),
                ]
            cases += [
                smaller(f"{name}, largest, {what}", **largest),
                smaller(f"{name}, RMS, {what}", **mean),
            ]
            if name == PARTICLES:
                part = lit_window(truth)
                shown_rows.append([(caption, image[part], white) for caption, image, white in panels])
    claim = Claim(
        "FOM 7.1, figure 5: pictures change less than OSM's when the depth bounds change (7 coefficients, "
        "part of the picture's white)",
        "pictures only",
        tuple(cases),
    )
    how = (
        "The plume, of particles and of voxels, under one light from the left. The map's range is the same "
        "for all rays, from the nearest to the farthest density, and on the light's axis a puff of "
        f"{MARK:g} of the largest density sets each new bound; the medium's box is the same in all cases. "
        "Moved: from 10 % beyond the medium at both ends to 5 % before and 15 % behind, which moves the "
        "medium in the range. The ranges are those that the map's coarse rays found. The control is what the "
        "puffs change by themselves. Pictured: particles."
    )
    return Study("FOM figure 5: stability of the picture", how, [claim], rows, pictures(shown_rows))


def fom_fig6(lab: Lab) -> Study:
    """Measure the effect of a shift in depth, in one dimension."""
    n, room = USUAL, CELLS // 4
    shifts = range(0, CELLS // n + 1, 4)
    rows = [["what", "method", "largest change of T̂, median of the rays", "spread of the depth where T̂ = ½"]]
    shape, place = [], []
    figure, axes = plots(2)
    for name in SHAPES:
        squeezed = _squeezed(profiles(lab, name), room)
        dark = np.exp(-squeezed.sum(axis=1)) < 0.5  # noqa: PLR2004 - half the light
        change, spread = {}, {}
        for plot, method in zip(axes, PAIR, strict=True):
            moved = []
            for shift in shifts:
                depth = reconstructed(METHODS[method], n, np.roll(squeezed, shift, axis=1))
                moved.append(np.exp(-np.maximum(depth, 0))[:, shift : CELLS + 1 - CELLS // n + shift])
            stack = np.array(moved)
            change[method] = float(np.median((stack.max(axis=0) - stack.min(axis=0)).max(axis=1)))
            half = (stack[:, dark] <= 0.5).argmax(axis=-1) / CELLS  # noqa: PLR2004 - half the light
            spread[method] = float(np.median(half.max(axis=0) - half.min(axis=0)))
            rows.append([name, method, shown(change[method]), shown(spread[method])])
            if name == PARTICLES:
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
    how = (
        "The density fills the middle half of a fixed range; every reconstruction is moved back. Particles, "
        "then voxels."
    )
    return Study("FOM figure 6: stability under translation", how, claims, rows, figure)


def _squeezed(steps: Floats, room: int) -> Floats:
    """Put rays into the middle of the range, with ``room`` empty cells at either end."""
    depth, inner = accumulated(steps), CELLS - 2 * room
    at = np.arange(inner + 1) / inner
    inside = np.array([np.diff(np.interp(at, EDGES, row)) for row in depth])
    return np.pad(inside, ((0, 0), (room, room)))


PUFF = {"opacity": 0.05, "voxels": 8.0, "away": 75, "behind": 95, "part": 0.65, "size": 0.07}
"""FOM figure 7 in three dimensions: opacity; radius, distance behind the medium and padding, in voxels; the
same distance and radius of a particle, as fractions of the medium's length."""


def fom_fig7(lab: Lab) -> Study:
    """Measure the effect of a far, faint outlier."""
    n = USUAL
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
        rows.append([f"1-D, opacity {opacity:g}", "FOM", "fixed", shown(change.max()), shown(rms(change))])
        cases.append(at_most(f"1-D, opacity {opacity:g}", float(change.max()), NEGLIGIBLE))
        if opacity in (0.05, 0.3):
            exact = np.exp(-accumulated(steps[None])[0])
            title = f"outlier of opacity {opacity:g} at 0.88"
            found_curves = {f"FOM, n = {n}": found, "FOM without the outlier": without}
            curves(axes[0 if opacity < 0.1 else 1], title, exact, found_curves)  # noqa: PLR2004 - the larger
    changes = _outlier_changes(lab, n)
    for (name, method, range_), (largest, typical) in changes.items():
        rows.append([f"{name}, opacity 0.05", method, range_, shown(largest), shown(typical)])
    for name in (PARTICLES, SMOKE):
        largest = changes[name, "FOM", "fixed"][0]
        cases.append(at_most(f"{name}, opacity 0.05, fixed range", largest, NEGLIGIBLE))
    claims = [
        Claim(
            "FOM 7.2, figure 7: an outlier has negligible effect on the reconstruction (7 coefficients, at "
            f"most {NEGLIGIBLE:g})",
            "negligible",
            tuple(cases),
        ),
        Claim(
            "FOM 7.2: methods that narrow the depth range to the density suffer more (RMS change of T̂, FOM "
            "in a fixed range against narrowed ranges)",
            "–",
            tuple(
                smaller(
                    f"{name}, against {method}, narrowed",
                    fixed=changes[name, "FOM", "fixed"][1],
                    narrowed=typical,
                )
                for (name, method, range_), (_, typical) in changes.items()
                if range_ == "narrowed"
            ),
        ),
    ]
    how = (
        f"{PARTICLES}, {SMOKE}: the plume in a box with room behind it, and there a puff on the light's "
        "axis; T̂ at the plume's own particles or voxels, which the puff does not shadow. Fixed range: that "
        "of the box; narrowed: from the nearest to the farthest density."
    )
    return Study("FOM figure 7: outliers", how, claims, rows, figure)


def _outlier_changes(lab: Lab, n: int) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Largest and RMS change of T̂ at the plume's particles or voxels due to a puff behind it."""
    found = {}
    for name, (pair, points) in {PARTICLES: _particle_outlier(lab), SMOKE: _voxel_outlier(lab)}.items():
        sigma_t = float(pair[0].medium.sigma_t.mean())
        for method in PAIR:
            for label, range_ in (("fixed", "box"), ("narrowed", "global")):
                one, other = (
                    lab.renderer.build_maps(
                        opacity_map(scene, method, n, range=range_, steps=2 * lab.sizes.steps)
                    )[0].evaluate(points, sigma_t)
                    for scene in pair
                )
                difference = np.abs(other.astype(np.float64) - one)
                found[name, method, label] = float(difference.max()), rms(difference)
    return found


Pair = tuple[list[tfm.Scene], Floats]
"""The plume without an outlier and with one, and places within it."""


def _particle_outlier(lab: Lab) -> Pair:
    scene = lab.side(PARTICLES)
    (body,) = scene.primitives
    assert isinstance(body, tfm.Points)  # noqa: S101 - the plume is
    low, high = body.bounds[:, 0]
    x = float(high + PUFF["part"] * (high - low))
    radius = PUFF["size"] * float(high - low)
    # As `tfm.Points` takes an opacity: of a ray through the middle.
    density = -np.log1p(-PUFF["opacity"]) / (PROFILES[body.profile].through * radius)
    pair = [with_points(scene, puffs, reach=(x,)) for puffs in ((), [(x, radius, float(density))])]
    return pair, body.positions


def _voxel_outlier(lab: Lab) -> Pair:
    scene = lab.side(SMOKE)
    volume = scene.grids[0]
    voxel, sigma_t = float(volume.voxel_size[0]), float(scene.medium.sigma_t.mean())
    across = 2 * PUFF["voxels"] * voxel * sigma_t * volume.density_scale
    density = -np.log1p(-PUFF["opacity"]) / across
    puff = (float(volume.bounds[1, 0]) + PUFF["away"] * voxel, PUFF["voxels"], float(density))
    pair = [with_puffs(scene, 0, int(PUFF["behind"]), puffs) for puffs in ((), (puff,))]
    index = np.argwhere(volume.data > 0.02 * volume.data.max())[:, ::-1].astype(np.float64)
    index = index[np.random.default_rng(1).permutation(len(index))[:20_000]]
    return pair, index @ volume.world_from_index[:3, :3].T + volume.world_from_index[:3, 3]


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
    return float(rises(n, steps)[0])


def rises(n: int, steps: Floats) -> Floats:
    """Return the largest rise of the unclamped T̂ of each of several rays, [rays]."""
    found = np.exp(-reconstructed("fourier", n, steps))
    largest: Floats = (found - np.minimum.accumulate(found, axis=1)).max(axis=1)
    return largest


def critical_width(n: int, depth: float, *, hard: bool) -> float:
    """Return the widest feature with noticeable ringing, as a fraction of the range; 0 if none."""
    widths = np.arange(0.02, 1.0, 0.01)
    rings = [ringing(n, slab(float(width), depth, hard=hard)) > NEGLIGIBLE for width in widths]
    return float(widths[np.flatnonzero(rings)[-1]]) if any(rings) else 0.0


def fom_fig8(lab: Lab) -> Study:
    """Measure ringing by the feature's size and opacity."""
    width, thin, dense = 0.12, 0.7, 2.8
    rows = [["feature", "n", "optical depth", "ringing", "widest that rings"]]
    fewer, opacity, sizes, of_size, clamp = [], [], [], [], []
    figure, axes = plots(3)
    for hard, shape in ((False, "smooth"), (True, "hard-edged")):
        largest = {}
        critical = {}
        for n, depth in ((15, thin), (7, thin), (7, dense), (15, dense)):
            steps = slab(width, depth, hard=hard)
            largest[n, depth] = ringing(n, steps)
            critical[n, depth] = critical_width(n, depth, hard=hard)
            rows.append([shape, str(n), f"{depth:g}", shown(largest[n, depth]), shown(critical[n, depth])])
            exact = np.exp(-accumulated(steps)[0])
            raw = np.exp(-reconstructed("fourier", n, steps)[0])
            errors = [rms(t - exact) for t in (np.clip(raw, 0, 1), raw)]
            clamp.append(
                smaller(f"{shape}, n = {n}, depth {depth:g}", clamped=errors[0], unclamped=errors[1])
            )
        fewer += [
            smaller(f"{shape}, depth {depth:g}", n_15=largest[15, depth], n_7=largest[7, depth])
            for depth in (thin, dense)
        ]
        opacity += [
            smaller(f"{shape}, n = {n}", once=largest[n, thin], four_times=largest[n, dense]) for n in (7, 15)
        ]
        sizes.append(smaller(shape, n_15=critical[15, dense], n_7=critical[7, dense]))
        of_size += [
            at_most(
                f"{shape}, n = {n}", critical[n, dense] / max(critical[n, thin], 1e-9), SAME_SIZE, "ratio"
            )
            for n in (7, 15)
        ]
    plume = profiles(lab, PARTICLES)
    plume_rises = {}
    for scale in (1, 4):
        exact_t = np.exp(-accumulated(scale * plume))
        for n in (7, 15):
            plume_rises[n, scale] = float(np.median(rises(n, scale * plume)))
            rows.append([PARTICLES, str(n), f"density × {scale}", shown(plume_rises[n, scale]), ""])
            raw_t = np.exp(-reconstructed("fourier", n, scale * plume))
            errors = [rms(t - exact_t) for t in (np.clip(raw_t, 0, 1), raw_t)]
            where = f"{PARTICLES}, n = {n}, density × {scale}"
            clamp.append(smaller(where, clamped=errors[0], unclamped=errors[1]))
        pair = {"n_15": plume_rises[15, scale], "n_7": plume_rises[7, scale]}
        fewer.append(smaller(f"{PARTICLES}, density × {scale}", **pair))
    opacity += [
        smaller(f"{PARTICLES}, n = {n}", once=plume_rises[n, 1], four_times=plume_rises[n, 4])
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
        f"does not count. {PARTICLES}: rays of a light from the left through the plume, the median of their "
        "largest rises."
    )
    return Study("FOM figure 8: ringing", how, claims, rows, figure)


FIG9 = {"FOM": 5, "OSM": 32}
"""Coefficients and slices of figure 9."""
FIG9_FILTER = {"blur": 33, "blur_kernel": "box"}
OPACITIES = (0.2, 0.4, 0.6)
"""Of the strands of figure 9."""


def fom_fig9(lab: Lab) -> Study:
    """Hair of several opacities, prefiltered."""
    rows = [
        ["opacity", "FOM against OSM: SSIM", "visible error", "method", "busyness, filtered", "unfiltered"]
    ]
    alike, calm, shown_rows = [], [], []
    errors = {}
    for opacity in OPACITIES:
        scene = lab.tuft(HAIR, opacity)
        filtered, plain = (
            {
                method: lab.renderer.render(opacity_map(scene, method, n, **changes)).image
                for method, n in FIG9.items()
            }
            for changes in (FIG9_FILTER, {})
        )
        where = f"opacity {opacity:.0%}"
        ssim = tfm.compare(filtered["FOM"], filtered["OSM"]).ssim
        errors[where] = lab.error(filtered["FOM"], filtered["OSM"])
        alike.append(at_least(where, ssim, PLAUSIBLE))
        for method in PAIR:
            busy = {"filtered": busyness(filtered[method]), "unfiltered": busyness(plain[method])}
            values = [f"{opacity:.0%}", shown(ssim), shown(errors[where]), method, *map(shown, busy.values())]
            rows.append(values)
            calm.append(smaller(f"{method}, {where}", **busy))
        truth = lab.image(scene, "dual")
        white, part = white_of(truth.astype(np.float64)), lit_window(truth)
        panels = {f"{method}, n = {FIG9[method]}, filtered": filtered[method] for method in PAIR}
        panels |= {f"{method}, n = {FIG9[method]}": plain[method] for method in PAIR}
        panels["dual march"] = truth
        shown_rows.append([(f"{where}: {what}", image[part], white) for what, image in panels.items()])
    series = list(errors.values())
    claims = [
        Claim(
            "FOM figure 9: prefiltered shadows of hair with 5 coefficients look like those with 32 slices "
            f"(SSIM at least {PLAUSIBLE:g})",
            "pictures only",
            tuple(alike),
        ),
        Claim(
            "FOM 7.3, figure 9: FOM suits hair of low opacity: the more opaque, the more it differs (visible "
            "error)",
            "pictures only",
            (Case("", errors, bool((np.diff(series) > 0).all())),),
        ),
        Claim(
            "FOM figure 9: a box filter reduces aliasing and softens shadows (RMS Laplacian of the picture)",
            "pictures only",
            tuple(calm),
        ),
    ]
    how = (
        "The sample of wavy hair instead of Maya's, on an opaque head, in the light of a spot; maps of "
        f"{lab.sizes.paper_res}² filtered with a box of 33×33 texels. What the two methods are compared with "
        "is each other, since the filter is meant to change the picture; the dual march has none."
    )
    return Study("FOM figure 9: hair", how, claims, rows, pictures(shown_rows, 2.6))


PAPER_FOM_MAP = {1024: (15.5 / 10.1, 15.9 / 11.1), 512: (4.3 / 3.0, 4.2 / 2.8), 256: (1.7 / 1.5, 1.6 / 1.5)}
"""Time of FOM's map over that of OSM's, from FOM tables 1 and 2."""


def fom_tables(lab: Lab) -> Study:
    """Measure the cost of maps and views."""
    measurements: dict[Any, Callable[[], Seconds]] = {}
    for name in (PARTICLES, SMOKE):
        for res in lab.sizes.map_sizes:
            for method in METHODS:
                scene = opacity_map(lab.side(name), method, USUAL, range="box", res=res)
                measurements[name, method, res] = lambda scene=scene: _costs(lab, scene)  # type: ignore[misc]
    timings = lab.least(measurements)
    found = timings.least
    largest = max(lab.sizes.map_sizes)
    units = {name: found[name, "OSM (piecewise)", largest]["map"] for name in (PARTICLES, SMOKE)}
    views = [f"view {width}×{height}, × OSM's" for width, height in lab.sizes.screens]
    own = (f"map, × OSM (piecewise) at {largest}²", "× OSM (piecewise), same size")
    rows = [["what", "map", "method", *own, "paper", *views]]
    price, view_price = [], []
    area: list[Case] = []
    for name, unit in units.items():
        for res in lab.sizes.map_sizes:
            fom, osm = found[name, "FOM", res], found[name, "OSM (piecewise)", res]
            for method in METHODS:
                cost = found[name, method, res]
                relative = [cost[view] / osm[view] for view in cost if view != "map"]
                paper = PAPER_FOM_MAP.get(res) if method == "FOM" else None
                quoted = " and ".join(f"{ratio:.2f}" for ratio in paper) if paper else ""
                values = [shown(cost["map"] / unit), shown(cost["map"] / osm["map"]), quoted]
                rows.append([name, f"{res}²", method, *values, *map(shown, relative)])
                if method != "FOM":
                    where = f"{name}, {res}², {method}"
                    price.append(at_most(where, fom["map"] / cost["map"], MAP_PRICE))
                    ratio = max(fom[view] / cost[view] for view in cost if view != "map")
                    view_price.append(at_most(where, ratio, SAME_SIZE))
        area += _growth(lab, name, found)
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
        "The plume, of particles and of voxels, under one light from the left, ranges of the box. 'OSM' "
        "holds the depths at planes and looks at the light's rays first to place them; 'piecewise' is OSM as "
        "FOM section 5.1 writes it. Of the view the larger of both screens' ratios counts. " + timings.note
    )
    figure = _cost_figure(lab, found, units)
    return Study("FOM tables 1 and 2: cost of maps and views", how, claims, rows, figure)


def _growth(lab: Lab, name: str, found: dict[Any, Seconds]) -> Iterable[Case]:
    """Compare what maps of one size cost with those of the next."""
    low, high = FOURFOLD
    for method in METHODS:
        for small, large in pairwise(lab.sizes.map_sizes):
            ratio = found[name, method, large]["map"] / found[name, method, small]["map"]
            per_four = float(ratio ** (np.log(4) / np.log((large / small) ** 2)))
            yield Case(f"{name}, {method}, {small}² to {large}²", {"×": per_four}, low <= per_four <= high)


def _cost_figure(lab: Lab, found: dict[Any, Seconds], units: dict[str, float]) -> Figure:
    """Plot the cost of maps against their texels."""
    figure, axes = plots(len(units))
    for plot, (name, unit) in zip(axes, units.items(), strict=True):
        for method, colour in zip(METHODS, COLOURS, strict=False):
            series = [found[name, method, res]["map"] / unit for res in lab.sizes.map_sizes]
            plot.loglog([res**2 for res in lab.sizes.map_sizes], series, "o-", color=colour, label=method)
        plot.set_title(name, fontsize=9)
        plot.set_xlabel("texels")
        plot.set_ylabel(f"map, × OSM (piecewise) at {max(lab.sizes.map_sizes)}²")
        plot.legend(fontsize=7)
    return figure


def _costs(lab: Lab, scene: tfm.Scene) -> Seconds:
    """Device seconds of a scene's maps, and of its view on every screen."""
    samples: list[Seconds] = []
    while len(samples) < BRIEF and not (samples and sum(samples[-1].values()) > LONG):
        maps = lab.renderer.build_maps(scene)
        costs = {"map": sum(built.buffers.seconds for built in maps)}
        for res in lab.sizes.screens:
            view = scene.replace(camera=scene.camera.replace(res=res))
            costs[f"view {res}"] = lab.renderer.render(view, maps=maps).stats.seconds["view_pass"]
        samples.append(costs)
    return least_of(samples)


STUDIES = (
    fom_fig1ab,
    fom_fig1,
    fom_fig2,
    fom_fig4,
    fom_fig5,
    fom_fig6,
    fom_fig7,
    fom_fig8,
    fom_fig9,
    fom_tables,
)
