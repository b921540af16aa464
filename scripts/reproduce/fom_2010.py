"""Jansen and Bavoil, "Fourier Opacity Mapping", I3D 2010."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tfm_cl as tfm
from reproduce.claims import (
    COINCIDES,
    FOURFOLD,
    INDISTINGUISHABLE,
    MAP_PRICE,
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
from reproduce.lab import BRIEF, CLOUD, HARD, SMOKE, Floats, Lab, Seconds, rms, roughness, with_map
from reproduce.plotting import COLOURS, EXACT, curves, pictures, plots
from reproduce.rays import CELLS, EDGES, MIDDLES, accumulated, most_features, profiles, reconstructed
from tfm_cl.metrics import REC709, lit_mask, white_of

METHODS = {"FOM": "fourier", "OSM": "slices"}


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
            mean[method] = rms((change @ REC709)[lit]) / white
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
        rows.append([f"1-D, opacity {opacity:g}", "FOM", "fixed", shown(change.max()), shown(rms(change))])
        cases.append(at_most(f"1-D, opacity {opacity:g}", float(change.max()), NEGLIGIBLE))
        if opacity in (0.05, 0.3):
            exact = np.exp(-accumulated(steps[None])[0])
            title = f"outlier of opacity {opacity:g} at 0.88"
            found_curves = {f"FOM, n = {n}": found, "FOM without the outlier": without}
            curves(axes[0 if opacity < 0.1 else 1], title, exact, found_curves)  # noqa: PLR2004 - the larger
    changes = _outlier_changes(lab, n)
    for (method, range_), (largest, typical) in changes.items():
        rows.append(["3-D, opacity 0.05", method, range_, shown(largest), shown(typical)])
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
                smaller(f"against {method}, narrowed", fixed=changes["FOM", "fixed"][1], narrowed=typical)
                for (method, range_), (_, typical) in changes.items()
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
            found[method, name] = float(difference.max()), rms(difference)
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
            errors = [rms(t - exact) for t in (np.clip(raw, 0, 1), raw)]
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


STUDIES = (fom_fig1, fom_fig4, fom_fig5, fom_fig6, fom_fig7, fom_fig8, fom_tables)
