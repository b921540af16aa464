"""What studies measure with: a renderer, sizes, scenes and times."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import tfm_cl as tfm
from tfm_cl.metrics import REC709, lit_mask
from tfm_cl.scene import placement

VOLUMES = Path(__file__).resolve().parents[2] / "volumes"
sys.path.append(str(VOLUMES))

import hair  # noqa: E402 - a generator there

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

SMOKE, CLOUD, HARD = "plume", "cumulus", "figure"
"""Voxels: smoke, a cloud, and hard edges."""
PARTICLES, KNOT = "particles", "spirals"
"""16,384 points each: FOM's plume, and a structure as complex as that of its figure 1(b)."""
HAIR, FUR = "wavy", "fur"
"""Strands on a head."""
LINES = "hair"
"""What cases call the paper's model of hair."""
STAND_INS = {PARTICLES: SMOKE, LINES: SMOKE}
"""By particles and hair: the voxels that stood for them before there were any."""
METHODS = {"FOM": "fourier", "OSM": "slices", "OSM (piecewise)": "piecewise"}
"""Bases by what the papers call them; the last is OSM as FOM section 5.1 writes it."""
PAIR = ("FOM", "OSM")
"""Those compared in pictures and along rays."""


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
    plane_counts: tuple[int, ...] = (4, 8, 16)
    """Numbers of planes in OSM figure 3."""
    slice_counts: tuple[int, ...] = (4, 8, 16, 24, 32)
    """Numbers of planes in OSM figure 4."""
    rays: int = 24
    """Texels along each side of the map in studies of single rays."""
    paper_res: int = 512
    """Size of the maps of particles and strands: that of FOM's pictures, and of OSM's."""
    portrait: int = 480
    """Pixels along each side of pictures of hair, times `picture`."""
    full_hair: bool = True
    """Hair of 350,000 segments and more, where OSM tells how many there are, and not the samples."""
    samples: int = 400
    """Ends of strands at which shadows are followed on the host."""


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
    paper_res=128,
    full_hair=False,
    samples=100,
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


def least_of(samples: Sequence[Seconds]) -> Seconds:
    """Return the smallest of each."""
    return {name: min(sample[name] for sample in samples) for name in samples[0]}


BRIEF = 4
"""Number of times that a measurement of a tenth of a second is repeated in a round."""
LONG = 1.0
"""Seconds of a measurement that are enough: it is not repeated within the round."""
SIDE_DISTANCE = 5.0
"""Distance from the centre of the medium to the light of `Lab.side`, in radii of the medium."""
WHITE = (10.0, 10.0, 10.0)
"""Intensity of the lights placed by this script."""
OPAQUE_HAIR = 0.85
"""Opacity of a strand, as in ``volumes/hair.toml``."""
HAIR_MEDIUM = tfm.Medium(
    sigma_s=(0.75, 0.55, 0.3), sigma_a=(0.25, 0.45, 0.7), phase=tfm.KajiyaKay(specular=0.35, exponent=50)
)
"""That of wavy hair there."""
HAIR_STEPS = {"map": 3, "march": 2}
"""Steps for strands over those for smoke, as there: what is shorter than a step is averaged."""


class Lab:
    """A renderer, sizes, and data shared by several studies."""

    def __init__(self, renderer: tfm.Renderer, sizes: Sizes) -> None:
        self.renderer = renderer
        self.sizes = sizes
        self.scene = cache(self._scene)
        self.side = cache(self._side)

    def _scene(self, name: str) -> tfm.Scene:
        if name in (HAIR, FUR):
            return self.tuft(name)
        scene = self._small(tfm.Scene.load(VOLUMES / f"{name}.toml"))
        res = self.sizes.map_res if scene.grids else self.sizes.paper_res
        return scene.replace(
            map=tfm.MapSettings(basis="dct", coeffs=8, res=res, steps=self.sizes.steps),
            march=tfm.MarchSettings(steps=self.sizes.steps),
        )

    def _side(self, name: str) -> tfm.Scene:
        """Return a sample under one white light from the left, along x; of solids only heads stay."""
        scene = self.scene(name)
        low, high = scene.occupied_bounds
        centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        at = centre - (SIDE_DISTANCE * radius, 0, 0)
        cone = float(np.degrees(np.arcsin(1 / SIDE_DISTANCE))) + 0.5
        light = tfm.SpotLight(from_=tuple(at), to=tuple(centre), cone=cone, intensity=WHITE)
        return scene.replace(lights=(light,), solids=scene.solids if name in (HAIR, FUR) else ())

    def tuft(self, style: str, opacity: float = OPAQUE_HAIR, *, full: bool = False) -> tfm.Scene:
        """Return hair or fur on an opaque head, in one light; ``full``: as large as the papers' models."""
        if full:
            held = hair.STYLES[style].full_tuft()
        else:
            with np.load(VOLUMES / f"{style}.npz") as stored:
                held = dict(stored)
        strands = tfm.Curves(
            held["points"], held["counts"], held["width"], opacity=opacity, medium=HAIR_MEDIUM
        )
        side = max(16, round(self.sizes.portrait * self.sizes.picture))
        res, steps = self.sizes.paper_res, self.sizes.steps
        return tfm.Scene(
            strands,
            camera=placement.camera_for([strands], res=(side, side)),
            map=tfm.MapSettings(basis="slices", coeffs=32, res=res, steps=HAIR_STEPS["map"] * steps),
            march=tfm.MarchSettings(steps=HAIR_STEPS["march"] * steps),
            solids=[tfm.SphereSolid(radius=hair.BALL, albedo=(0.3, 0.2, 0.15))],
        )

    def _small(self, scene: tfm.Scene) -> tfm.Scene:
        width, height = (max(16, round(side * self.sizes.picture)) for side in scene.camera.res)
        return scene.replace(camera=scene.camera.replace(res=(width, height)))

    def image(self, scene: tfm.Scene, method: str = "tfm", **changes: Any) -> Image:
        """Render, with other settings of the map where some are given."""
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
        least = {key: least_of(samples) for key, samples in found.items()}
        noise = [
            float(np.median([sample[name] for sample in samples])) / least[key][name]
            for key, samples in found.items()
            for name in samples[0]
            if least[key][name] > 0
        ]
        return Timings(least, float(np.median(noise)))

    def frame_seconds(self, scene: tfm.Scene, method: str = "tfm", times: int = 1) -> Seconds:
        """Device seconds of both passes, the smallest of several measurements."""
        samples: list[Seconds] = []
        while len(samples) < times and not (samples and sum(samples[-1].values()) > LONG):
            maps = self.renderer.build_maps(scene) if method == "tfm" else []
            view = self.renderer.render(scene, maps=maps, method=method).stats.seconds["view_pass"]
            samples.append({"map": sum(built.buffers.seconds for built in maps), "view": view})
        least = least_of(samples)
        return {**least, "frame": sum(least.values())}


def with_map(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the map."""
    return scene.replace(map=scene.map.replace(**changes))


def opacity_map(scene: tfm.Scene, method: str, n: int, **changes: Any) -> tfm.Scene:
    """Return the scene with a map of n numbers a texel by FOM or OSM (`METHODS`).

    All studies of theirs make their maps here: one range of depths for all rays, and primitives at their own
    depths (FOM eq. 5, 6), as in both papers, unless ``changes`` say otherwise.
    """
    as_theirs = {"basis": METHODS[method], "coeffs": n, "range": "global"}
    deposits = {"deposits": "depth"} if scene.primitives else {}
    return with_map(scene, **{**as_theirs, **deposits, **changes})


def with_march(scene: tfm.Scene, **changes: Any) -> tfm.Scene:
    """Return the scene with other settings of the march."""
    return scene.replace(march=scene.march.replace(**changes))


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.square(values).mean()))


def roughness(image: Image, truth: Image) -> float:
    """RMS of the Laplacian of the error's luminance over the lit pixels, over the reference's mean there."""
    return _roughness(image - truth, truth)


def busyness(image: Image) -> float:
    """Return the same of a picture itself: how much neighbouring pixels differ."""
    return _roughness(image, image)


def _roughness(image: Image, reference: Image) -> float:
    luminance = image[..., :3].astype(np.float64) @ REC709
    laplacian = sum(np.roll(luminance, shift, axis) for shift in (1, -1) for axis in (0, 1)) - 4 * luminance
    lit = lit_mask(reference)
    return rms(laplacian[lit]) / float((reference[lit, :3] @ REC709).mean())
