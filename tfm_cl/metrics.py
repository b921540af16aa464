"""Differences between images: SSIM, PSNR and RMSE, each over the frame and over the lit pixels.

SSIM and PSNR compare what a viewer sees, the *display luma*: the image is divided by the reference's white
(99.9th percentile of its Rec. 709 luminance), clipped to [0, 1], sRGB-encoded, and weighted to luma. RMSE
compares the linear RGB values and is relative to the reference's mean. Every method gets an empty background
right, which makes these values look better than they are. All three are therefore also given over the *lit
mask*: reference alpha > 0.001.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.errors import ImageError, InputError
from tfm_cl.extras import needs

REC709 = np.array([0.2126, 0.7152, 0.0722])
"""Rec. 709 weights of R, G and B, for luminance (of linear RGB) and for luma (of encoded RGB)."""
WHITE_PERCENTILE = 99.9
"""Percentile of the reference's luminance that is displayed as white: a few very bright pixels must not
darken the display image."""
LIT_ALPHA = 0.001
SSIM_RADIUS = 5
"""Width in pixels of the SSIM window: the 11×11 Gaussian of Wang et al. 2004, as in scikit-image for sigma =
1.5."""
FLIP_EXPOSURES = 5
"""Number of exposures of HDR-FLIP, one stop apart; the first shows the reference's white as 1."""


@dataclass(frozen=True)
class Metrics:
    """SSIM, PSNR and RMSE over one set of pixels."""

    ssim: float
    """Structural similarity of display luma, ≤ 1; 1 is identical."""
    psnr: float
    """Peak signal-to-noise ratio of display luma, dB; infinite when identical."""
    rmse: float
    """Root mean square error of linear RGB over the reference's mean; infinite if only that mean is 0."""

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON; infinite values become None (JSON ``null``)."""
        return {key: value if np.isfinite(value) else None for key, value in asdict(self).items()}


@dataclass(frozen=True)
class Comparison(Metrics):
    """SSIM, PSNR and RMSE over the whole frame and over the lit pixels."""

    lit: Metrics | None
    """The values over the lit mask; None if the reference has no lit pixels."""

    def to_dict(self) -> dict[str, Any]:
        """Return ``{"ssim", "psnr", "rmse", "lit": {…}}`` for JSON; see `Metrics.to_dict`."""
        whole = Metrics(self.ssim, self.psnr, self.rmse).to_dict()
        return {**whole, "lit": None if self.lit is None else self.lit.to_dict()}


def compare(test: ArrayLike, reference: ArrayLike) -> Comparison:
    """Measure ``test`` against ``reference``.

    SSIM over the frame leaves out a border of five pixels, as scikit-image does; over the lit mask it is
    the mean of the SSIM map. If a side of the image is shorter than 11 pixels, nothing would be left; the
    image is then mirrored at its borders, and nothing is left out.

    Parameters
    ----------
    test, reference
        Scene-linear, premultiplied images [H, W, 3 or 4] of floating-point type. Only the reference's
        alpha is used, so only one of the two may have one; without it, lit means luminance > 0.

    Raises
    ------
    ImageError
        When an array is not such an image, is empty, or holds NaN or infinity, or when the sizes differ.
    """
    shown, truth = _checked_pair(test, reference)
    white = white_of(truth)
    shown_luma, truth_luma = display_luma(shown, white), display_luma(truth, white)
    ssim, ssim_map = _ssim(shown_luma, truth_luma)

    def over(mask: NDArray[np.bool_], ssim: float) -> Metrics:
        squared = np.square(shown[mask, :3] - truth[mask, :3])
        return Metrics(
            ssim=ssim,
            psnr=_psnr(shown_luma[mask], truth_luma[mask]),
            rmse=_ratio(float(np.sqrt(squared.mean())), float(truth[mask, :3].mean())),
        )

    lit = lit_mask(truth)
    whole = over(np.ones_like(lit), ssim)
    return Comparison(
        ssim=whole.ssim,
        psnr=whole.psnr,
        rmse=whole.rmse,
        lit=over(lit, float(ssim_map[lit].mean())) if lit.any() else None,
    )


def flip(test: ArrayLike, reference: ArrayLike) -> float:
    """Mean HDR-FLIP error (Andersson et al. 2021), 0 to 1; 0 is identical.

    The reference determines the exposures (`FLIP_EXPOSURES` of them, from its white upwards), so values of
    different images against the same reference can be compared.

    Parameters
    ----------
    test, reference
        As in `compare`; negative values count as 0.

    Raises
    ------
    InputError
        When the package ``flip-evaluator`` is not installed.
    ImageError
        As in `compare`.
    """
    with needs("flip", "FLIP", InputError):
        import flip_evaluator  # noqa: PLC0415 - an optional extra
    shown, truth = _checked_pair(test, reference)
    start = -float(np.log2(white_of(truth)))
    exposures = {
        "startExposure": start,
        "stopExposure": start + FLIP_EXPOSURES - 1,
        "numExposures": FLIP_EXPOSURES,
    }
    images = (np.ascontiguousarray(image[..., :3].clip(min=0), np.float32) for image in (truth, shown))
    _, mean, _ = flip_evaluator.evaluate(*images, "HDR", applyMagma=False, parameters=exposures)
    return float(mean)


def white_of(reference: NDArray[np.floating[Any]]) -> float:
    """Luminance shown as white: the 99.9th percentile, or the maximum if that is 0, or 1 if all is black."""
    luminance = reference[..., :3] @ REC709
    for white in (np.percentile(luminance, WHITE_PERCENTILE), luminance.max()):
        if white > 0:
            return float(white)
    return 1.0


def display_rgb(image: NDArray[np.floating[Any]], white: float) -> NDArray[np.float64]:
    """Return linear RGB [H, W, 3] over ``white``, clipped to [0, 1] and sRGB-encoded (IEC 61966-2-1)."""
    with np.errstate(over="ignore"):  # a tiny white causes infinities, which are clipped
        linear = np.clip(image[..., :3].astype(np.float64) / white, 0.0, 1.0)
    encoded: NDArray[np.float64] = np.where(
        linear <= 0.0031308,  # noqa: PLR2004 - the standard's constants
        12.92 * linear,
        1.055 * linear ** (1 / 2.4) - 0.055,
    )
    return encoded


def display_luma(image: NDArray[np.floating[Any]], white: float) -> NDArray[np.float64]:
    """Luma [H, W] of `display_rgb`, 0 to 1."""
    luma: NDArray[np.float64] = display_rgb(image, white) @ REC709
    return luma


def lit_mask(reference: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Pixels [H, W] where the reference shows a medium or a solid."""
    if reference.shape[2] > 3:  # noqa: PLR2004 - RGB and alpha
        return np.asarray(reference[..., 3] > LIT_ALPHA)
    return np.asarray(reference @ REC709 > 0)


def _checked_pair(test: ArrayLike, reference: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    shown, truth = _checked(test, "test image"), _checked(reference, "reference image")
    if shown.shape[:2] != truth.shape[:2]:
        (test_height, test_width), (height, width) = shown.shape[:2], truth.shape[:2]
        raise ImageError(
            f"the test image is {test_width}×{test_height} pixels and the reference {width}×{height}; "
            "render both at the same size"
        )
    return shown, truth


def _checked(image: ArrayLike, what: str) -> NDArray[np.float64]:
    array = np.asarray(image)
    if array.ndim != 3 or array.shape[2] not in (3, 4) or array.size == 0:  # noqa: PLR2004 - [H, W, C]
        raise ImageError(f"{what}: expected an array [H, W, 3 or 4]; this one has the shape {array.shape}")
    if array.dtype.kind != "f":
        raise ImageError(
            f"{what}: expected scene-linear floating-point values; these are of type {array.dtype}"
        )
    # The bound catches NaN and infinity as well, and keeps the squares finite.
    wrong = ~(np.abs(array) <= np.finfo(np.float32).max)
    if wrong.any():
        y, x, channel = (int(i) for i in np.argwhere(wrong)[0])
        raise ImageError(
            f"{what}: {np.count_nonzero(wrong)} values are NaN, infinite or beyond float32, the first "
            f"{array[y, x, channel]} in channel {'RGBA'[channel]} of pixel x={x}, y={y}"
        )
    return array.astype(np.float64)


def _ssim(test: NDArray[np.float64], reference: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Mean SSIM and its map [H, W]."""
    with needs("sweep", "SSIM", InputError):
        from skimage import metrics  # noqa: PLC0415 - slow to import, and `tfm_cl` exports this module

    structural_similarity: Callable[..., Any] = metrics.structural_similarity
    pad = SSIM_RADIUS if min(reference.shape) <= 2 * SSIM_RADIUS else 0
    # The filter mirrors at the border too, so a mirrored margin does not change the map.
    images = (np.pad(image, pad, mode="symmetric") for image in (test, reference))
    mean, full = structural_similarity(
        *images, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1.0, full=True
    )
    height, width = reference.shape
    return float(mean), full[pad : pad + height, pad : pad + width]


def _psnr(test: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    mean_square = float(np.square(test - reference).mean())
    return -10.0 * float(np.log10(mean_square)) if mean_square > 0 else float("inf")


def _ratio(error: float, mean: float) -> float:
    """``error / mean`` for a mean that may be 0 (or, with negative pixels, below)."""
    if error == 0:
        return 0.0
    return error / mean if mean > 0 else float("inf")
