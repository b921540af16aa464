"""Multiple scattering beside Mitsuba's path tracer: ``python scripts/scattering_table.py -o out/scattering``.

Three volumes, each as dense as makes its deepest line of sight `DEPTH` deep, of albedo 1 and 0.9, isotropic
and with a lobe of g = 0.85, lit by one sun that shines across the view, or evenly from all around. Orders of
scattering are compared with ``volpath`` of one more depth (its first is light that is not scattered at all),
octaves with `LAST` orders.

Told of each are: the difference of the mean; the RMSE over the pixels that the volume covers, relative to
their mean, without Mitsuba's noise, whose variance is known from independent batches; how small a RMSE that
noise lets one see; PSNR as ``tfm compare`` finds it, noise left out likewise; and the CPU seconds of a volume
that was never rendered, by kernels that are compiled. Writes ``scattering.md`` and ``scattering.json``, and
keeps Mitsuba's pictures beside them for the next time. ``make oracles`` installs what it needs. Takes an hour
of one core, most of it for light from all around.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from oracles.mitsuba_scene import MitsubaScene, mitsuba_variant  # type: ignore[import-not-found]

import tfm_cl as tfm
from tfm_cl.metrics import LIT_ALPHA, REC709, display_luma, white_of

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("TFM_VOLUMES", REPOSITORY.parent / "shared" / "volumes"))
VOLUMES = {
    "Disney cloud": SHARED / "wdas_cloud_sixteenth.vdb",
    "cumulus": REPOSITORY / "volumes" / "cumulus.npz",
    "OpenVDB smoke": SHARED / "cortex_smoke.vdb",
}
DEPTH = 10.0
PHASES = ("isotropic", "hg:0.85")
ALBEDOS = (1.0, 0.9)
LIGHTS = {
    "sun": tfm.SunLight(from_=(-1, 0.5, 0.3), to=(0, 0, 0), intensity=1.0),
    "all around": tfm.EnvironmentLight(samples=64),
}
FEW = {"all around": tfm.EnvironmentLight(samples=2)}
"""The same light in few directions, for a first picture that compiles the kernels."""
COUNTS = (1, 2, 4, 8)
LAST = 63
"""Orders that octaves stand for: ``volpath`` of depth 64."""
OCTAVES = 4
RES = (96, 54)
BATCHES = 8
SAMPLES = {1: 8, 2: 12, 4: 16, 8: 16, LAST: 16}
"""Of Mitsuba, per pixel and batch, by orders."""
MORE = 4
"""Times as many of a sun's light that a lobe scatters again: few paths carry it."""
UNLIKE = 1.002
"""Density of that picture beside what is measured."""

Floats = NDArray[np.float64]


class Case(NamedTuple):
    """What is lit, and how."""

    volume: str
    phase: str
    albedo: float
    light: str

    def scene(self, *, orders: int = 1, octaves: int = 1, unlike: float = 1.0) -> tfm.Scene:
        """Return it as a scene."""
        path = VOLUMES[self.volume]
        scale = unlike * DEPTH / depth_of(tfm.Volume.load(path))
        volume = tfm.Volume.load(path, density_scale=scale)
        low, high = volume.occupied_bounds
        middle, (width, height, depth) = (low + high) / 2, high - low
        away = 3 * float(np.linalg.norm(high - low))
        half = max(height, width * RES[1] / RES[0]) / 2
        return tfm.Scene(
            volume,
            tfm.Medium(
                sigma_s=self.albedo,
                sigma_a=1 - self.albedo,
                phase=self.phase,
                orders=orders,
                octaves=octaves,
            ),
            camera=tfm.Camera(
                from_=np.add(middle, (0, 0, away)),
                to=middle,
                fov=2 * np.degrees(np.arctan(half / (away - depth / 2))),
                res=RES,
            ),
            lights=[LIGHTS[self.light]],
        )


class Estimate:
    """What independent batches of Mitsuba ``[batches, height, width]`` say of a picture."""

    def __init__(self, batches: Floats) -> None:
        self.mean = batches.mean(axis=0)
        self.halves = batches[0::2].mean(axis=0), batches[1::2].mean(axis=0)
        self.variance = batches.var(axis=0, ddof=1) / len(batches)

    def beside(self, picture: Floats) -> dict[str, float]:
        """Return how a picture of ours ``[height, width, RGBA]`` differs."""
        ours, covered = picture[..., :3] @ REC709, picture[..., 3] > LIT_ALPHA
        level, count = self.mean[covered].mean(), covered.sum()
        squares = ((ours - self.mean) ** 2 - self.variance)[covered]
        unsure = np.sqrt(squares.var() / count)
        return {
            "bias": float(ours[covered].mean() / level - 1),
            "bias_error": float(np.sqrt(self.variance[covered].sum()) / count / level),
            "rmse": float(np.sqrt(max(squares.mean(), 0)) / level),
            "rmse_seen": float(np.sqrt(2 * unsure) / level),
            "psnr": self._psnr(ours),
        }

    def _psnr(self, ours: Floats) -> float:
        white = white_of(self.mean[..., None].repeat(3, axis=2))
        shown, one, other = (
            display_luma(values[..., None].repeat(3, axis=2), white) for values in (ours, *self.halves)
        )
        square = float(((shown - one) * (shown - other)).mean())
        return float(-10 * np.log10(max(square, 1e-6)))


def depth_of(volume: tfm.Volume) -> float:
    """Optical depth of the deepest line along z."""
    return float(volume.data.sum(axis=0).max() * np.linalg.norm(volume.world_from_index[:3, 2]))


def mitsuba(case: Case, orders: int, folder: Path) -> tuple[Floats, float]:
    """Return luminances ``[batches, height, width]`` and the CPU seconds that they took; kept in files."""
    path = folder / f"{'_'.join(map(str, (*case, orders))).replace(' ', '_').replace(':', '')}.npz"
    if not path.exists():
        scene = MitsubaScene(case.scene(orders=orders))
        scene.batches(1, 1, seed=1)  # compiles
        began = time.process_time()
        rare = case.phase != "isotropic" and case.light == "sun" and orders > 1
        batches = scene.batches(BATCHES, SAMPLES[orders] * (MORE if rare else 1), seed=2)
        np.savez(path, luminance=batches @ REC709, seconds=time.process_time() - began)
    with np.load(path) as held:
        return held["luminance"], float(held["seconds"])


def rendered(case: Case, **scattering: int) -> tuple[Floats, float]:
    """Return a picture of ours and its CPU seconds."""
    with tfm.Renderer() as renderer:
        scene, other = case.scene(**scattering), case.scene(**scattering, unlike=UNLIKE)
        renderer.render(other.replace(lights=[FEW.get(case.light, LIGHTS[case.light])]))
        began = time.process_time()
        picture = renderer.render(scene).image
        return picture.astype(np.float64), time.process_time() - began


def measured(case: Case, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each number of orders, and one for octaves."""
    for orders in (*COUNTS, 0):
        name = f"{OCTAVES} octaves" if orders == 0 else f"{orders} order{'s' * (orders > 1)}"
        batches, theirs = mitsuba(case, orders or LAST, folder)
        picture, ours = rendered(case, **({"orders": orders} if orders else {"octaves": OCTAVES}))
        found = Estimate(batches).beside(picture)
        yield {**case._asdict(), "what": name, **found, "seconds": ours, "mitsuba_seconds": theirs}


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the table: a line for each case."""
    names = list(dict.fromkeys(row["what"] for row in rows))
    text = ["| volume, phase, albedo, light | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for case in dict.fromkeys(tuple(row[key] for key in Case._fields) for row in rows):
        found = {row["what"]: row for row in rows if tuple(row[key] for key in Case._fields) == case}
        cells = [cell(found[name]) if name in found else "" for name in names]
        text.append(f"| {', '.join(map(str, case))} | " + " | ".join(cells) + " |")
    return "\n".join(text) + "\n"


def cell(row: dict[str, Any]) -> str:
    """Return bias ± its error, RMSE, and seconds."""
    rmse = "<" + f"{row['rmse_seen']:.1%}" if row["rmse"] < row["rmse_seen"] else f"{row['rmse']:.1%}"
    psnr = f", {row['psnr']:.1f} dB" if "octaves" in row["what"] else ""
    return f"{row['bias']:+.1%} ± {row['bias_error']:.1%}, {rmse}{psnr}; {row['seconds']:.2f} s"


def main() -> int:
    """Measure what was asked for, and write what is known so far after each case."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose line of the table holds it")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/scattering"), metavar="DIR")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    with mitsuba_variant():
        for case in map(Case._make, product(VOLUMES, PHASES, ALBEDOS, LIGHTS)):
            if options.only in ", ".join(map(str, case)):
                rows += measured(case, options.out)
                (options.out / "scattering.json").write_text(json.dumps(rows, indent=1) + "\n")
                (options.out / "scattering.md").write_text(markdown(rows))
                print(markdown(rows[-len(COUNTS) - 1 :]).splitlines()[-1], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
