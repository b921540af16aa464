"""How far apart two pictures are: A against the dual march, or against the settings kept as B."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from tfm_cl.files.image_io.image import Picture
from tfm_cl.files.image_io.overlap import overlap
from tfm_cl.metrics import compare
from tfm_cl.viewer.pictures import error_picture, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tfm_cl.render.shown import Shown
    from tfm_cl.viewer.messages import Show
    from tfm_cl.viewer.pictures import Result


FIGURES = ("ssim", "psnr", "rmse")


class Beside(NamedTuple):
    """Two pictures shown alike, and their difference."""

    a: Shown
    b: Shown
    error: NDArray[np.uint8]
    """[H, W, 3], sRGB: blue where A is too dark, orange where it is too bright."""
    gain: float
    """By which the difference is multiplied."""


def figures(a: Result, b: Result) -> dict[str, float | None]:
    """Measure a picture against another that is taken for right.

    Parameters
    ----------
    a, b
        Of one size, or crops of one frame, of which the pixels that both have are compared.

    Returns
    -------
    dict
        ``ssim``, ``psnr`` (decibels) and ``rmse`` (of the reference's mean) over the pixels where B shows
        anything, or over all where it shows nothing; None for what is infinite, as the PSNR of equal ones.

    Raises
    ------
    InputError
        scikit-image is not installed.
    ImageError
        Pictures of different sizes, or that are not finite.
    """
    picture, other = (Picture(of.image, of.crop, (0, 0, *of.scene.camera.res)) for of in (a, b))
    common = overlap(picture, other, "the picture", "what it is compared with")
    found = compare(common.test, common.reference)
    measured = (found.lit or found).to_dict()
    return {name: measured[name] for name in FIGURES}


def beside(a: Result, b: Result, show: Show) -> Beside:
    """Show a picture beside another: exposure and range of colours of both are those of A.

    Raises
    ------
    InputError
        One of them has no such layer; sizes differ.
    """
    of_a = shown(a, show)
    of_b = shown(b, show, like=of_a)
    return Beside(of_a, of_b, *error_picture(of_a.pixels, of_b.pixels))
