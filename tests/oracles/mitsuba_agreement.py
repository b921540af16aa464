"""Whether an image agrees with Mitsuba's, given its Monte Carlo noise, known from independent batches.

The quick budgets find a difference of about 1 % in the mean, the slow ones of about 0.4 %.
"""

import logging
from contextlib import contextmanager
from functools import cache
from types import SimpleNamespace

import numpy as np
from oracles.mitsuba_scene import MitsubaScene, mitsuba_variant, write_exr

LOG = logging.getLogger(__name__)
BATCHES = 32
QUICK, SLOW = 48, 320
"""Samples per pixel and batch."""
SCALAR_SHARE = 8
"""The scalar variant takes so many times fewer samples."""

# What the images may differ by. All are parts of a channel's mean over the image, but for the last three.
SYSTEMATIC = 1e-3
"""Bias of the mean beyond noise: 1600 × 1600 steps move the mean of these scenes by less than 1e-4; the
rest is for Mitsuba's float32 (a coordinate that ends up in the next voxel or outside of the cone)."""
FLOOR = 1e-2
"""Added to a pixel's standard error: where few samples carry the light, Mitsuba's estimate of it is worth
nothing (0 where none hit)."""
LIT = 5e-2
"""Pixels above it are lit."""
STANDARD_ERROR = 5e-3
"""Most that the mean's standard error may be, for the test to say something."""
OUTLIERS = 0.02
"""Share of the lit pixels beyond three standard errors: 0.5 % by Student's t of 32 batches, more as single
samples are skewed."""
MEAN_Z = 0.3
"""Mean z-score: three standard errors of 130 independent lit pixels, and each scene has more."""
RMS_Z = 1.3
"""Root mean square z-score: 1.03 by Student's t; more as the errors of skewed samples are underestimated."""


@contextmanager
def mitsuba_batches():
    """Yield what gives batches of a scene, ``[batches, height, width, RGB]``, each rendered once."""
    with mitsuba_variant() as variant:

        @cache
        def batches(make_scene, samples, *arguments, **options):
            samples = samples if "llvm" in variant else samples // SCALAR_SHARE
            return MitsubaScene(make_scene(*arguments), **options).batches(BATCHES, samples, seed=1)

        batches.is_scalar = variant.startswith("scalar")
        yield batches


def image_of(renderer, scene):
    return renderer.render(scene).image[..., :3].astype(np.float64)


def agreement(image, batches):
    """Compare an image with independent estimates of it: biases relative to the channels' means.

    ``pytest --log-cli-level=INFO`` shows the figures.
    """
    mean, error = batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(BATCHES)
    totals = batches.mean(axis=(1, 2))
    level = totals.mean(axis=0)
    lit = np.maximum(image, mean) > LIT * level
    z = ((image - mean) / np.hypot(error, FLOOR * level))[lit]
    found = SimpleNamespace(
        bias=image.mean(axis=(0, 1)) / level - 1,
        standard_error=totals.std(axis=0, ddof=1) / np.sqrt(BATCHES) / level,
        rms=np.sqrt(np.maximum(((image - mean) ** 2 - error**2).mean(axis=(0, 1)), 0)) / level,
        lit=float(lit.mean()),
        outliers=float((np.abs(z) > 3).mean()),
        mean_z=float(z.mean()),
        rms_z=float(np.sqrt((z**2).mean())),
        lit_where_ours_is_black=float(mean[image == 0].max(initial=0.0)),
    )
    LOG.info("%s", vars(found))
    return found


def failures(found, scalar=False, systematic=SYSTEMATIC):
    """Names of the criteria that were missed; ``systematic`` is what the bias may be beyond noise."""
    checks = {
        "standard_error": (found.standard_error < STANDARD_ERROR).all() or scalar,
        "bias": (np.abs(found.bias) < 3 * found.standard_error + systematic).all(),
        "lit": found.lit > 0.3,
        "outliers": found.outliers < OUTLIERS,
        "mean_z": abs(found.mean_z) < MEAN_Z,
        "rms_z": found.rms_z < RMS_Z,
        "lit_where_ours_is_black": found.lit_where_ours_is_black == 0,
    }
    return [name for name, passed in checks.items() if not passed]


def write_report(folder, found, image, batches):
    """Write the images as evidence, and give the message of the assertion."""
    expected = batches.mean(axis=0)
    for name, pixels in ("ours", image), ("mitsuba", expected), ("difference", image - expected):
        write_exr(folder / f"{name}.exr", pixels)
    np.save(folder / "batches.npy", batches)
    return f"{vars(found)}; see ours, mitsuba, difference .exr and batches.npy in {folder}"
