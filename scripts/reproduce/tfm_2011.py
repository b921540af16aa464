"""Delalandre et al., "Transmittance Function Mapping", I3D 2011."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import numpy as np

import tfm_cl as tfm
from reproduce.claims import (
    DRASTIC,
    INDISTINGUISHABLE,
    PLAUSIBLE,
    STEADY,
    Case,
    Claim,
    Study,
    at_least,
    shown,
    smaller,
)
from reproduce.lab import CLOUD, HARD, SMOKE, Floats, Image, Lab, Seconds, Timings, with_map, with_march
from reproduce.plotting import COLOURS, EXACT, lit_window, pictures, plots
from reproduce.rays import CELLS, MIDDLES, accumulated, most_features, profiles
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.resolved import resolve
from tfm_cl.metrics import white_of

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


@cache
def table_of(lab: Lab, name: str) -> Table1:
    """Return what a volume's rows are made of, for both studies."""
    return Table1(lab, lab.scene(name))


def tfm_table1(lab: Lab) -> Study:
    """Quality with and without density weighting."""
    rows = [["volume", "n", "α", "SSIM", "paper", "PSNR", "paper", "lit SSIM", "fps / fps at n = 2", "paper"]]
    enough, better, psnr_paper, steady = [], [], [], []
    psnr_rises: list[Case] = []
    falls: list[Case] = []
    for name in (SMOKE, HARD):
        table = table_of(lab, name)
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
            series = [table_of(lab, name).compared[n, alpha].psnr for n in NUMBERS]
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
        f"α = 1 over error with α = 10, at least {DRASTIC:g})",
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
        table = table_of(lab, name)
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
        "file: what the pictures show, defaults, two lights and so two maps. "
        + table_of(lab, SMOKE).frames.note
    )
    title = "TFM figure 10: pictures and speed against the dual march"
    return Study(title, how, claims, rows, pictures(shown_rows))


STUDIES = (tfm_table1, tfm_fig5, tfm_fig7, tfm_fig8, tfm_fig10)
