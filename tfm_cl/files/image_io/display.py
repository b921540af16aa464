"""From scene-linear pictures to the light of a display: exposure, alpha and view."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.limits import MOST_STOPS

Floats = NDArray[np.floating[Any]]

BRIGHT = 0.98
"""Part of what is lit that is no brighter than what the automatic exposure goes by."""
SHOWN_AS = 0.7
"""What the automatic exposure shows that as, of the display's white: 0.85 of the codes."""
LIT = 1e-3
"""Of the brightest but a thousandth, by which what is lit is told from what is as good as dark."""
WHY_AUTOMATIC = f"shows the brightest {1 - BRIGHT:.0%} of what is lit at {SHOWN_AS:g} of white, and above"

_REC_709 = (0.2126, 0.7152, 0.0722)


def straight(rgba: Floats) -> Floats:
    """Divide premultiplied colours [..., 4] by their alpha: [..., 3]; black where there is none."""
    alpha = rgba[..., 3:].astype(np.float64)
    return np.divide(rgba[..., :3], alpha, out=np.zeros((*rgba.shape[:-1], 3)), where=alpha > 0)


def shown(rgb: Floats, stops: float, view: str) -> NDArray[np.float64]:
    """Return what a display shows of scene-linear colours.

    Parameters
    ----------
    rgb
        [..., 3].
    stops
        Exposure; the colours are multiplied by 2 to this power.
    view
        Of `VIEWS`.

    Returns
    -------
    NDArray
        [..., 3], linear, 0 to 1.
    """
    exposed = np.maximum(rgb.reshape(-1, 3).T.astype(np.float64, order="C"), 0) * 2.0**stops
    return np.asarray(VIEWS[view].display(exposed).T, np.float64).reshape(rgb.shape)


def grey_shown_as(light: float, view: str) -> float:
    """Return the scene-linear grey that a view shows as a light of a display, above 0 and below white."""
    low, high = -50.0, 50.0  # stops
    for _ in range(60):
        middle = (low + high) / 2
        below = bool(shown(np.ones(3), middle, view)[0] < light)
        low, high = (middle, high) if below else (low, middle)
    return float(2.0**high)


def automatic_exposure(rgba: Floats, view: str, *, transparent: bool = False) -> float:
    """Choose an exposure from the luminances of a picture.

    Pixels count by their alpha. Of those that are lit, `BRIGHT` are no brighter than what is shown as
    `SHOWN_AS`. Few bright pixels, or dark surroundings of any size, change nothing.

    Parameters
    ----------
    rgba
        [..., 4], or [..., 3], where all pixels count alike.
    view
        Of `VIEWS`.
    transparent
        Whether `straight` colours are to be shown.

    Returns
    -------
    float
        Stops, in hundredths; 0 if the picture is black.
    """
    colours = straight(rgba) if transparent else rgba
    red, green, blue = (colours[..., i].ravel() * np.float32(weight) for i, weight in enumerate(_REC_709))
    luminance = red + green + blue
    has_alpha = rgba.shape[-1] > 3 and bool((rgba[..., 3] > 0).any())  # noqa: PLR2004 - red, green, blue
    weights = rgba[..., 3].ravel() if has_alpha else np.ones_like(luminance)
    counted = (luminance > 0) & (weights > 0)
    order = np.argsort(luminance[counted])
    luminance, weights = luminance[counted][order], weights[counted][order]
    if luminance.size == 0:
        return 0.0
    dark = np.searchsorted(luminance, LIT * _quantile(luminance, weights, 1 - LIT))
    bright = _quantile(luminance[dark:], weights[dark:], BRIGHT)
    stops = math.log2(grey_shown_as(SHOWN_AS, view)) - math.log2(bright)
    return round(min(max(stops, -MOST_STOPS), MOST_STOPS), 2)


def _quantile(values: Floats, weights: Floats, part: float) -> float:
    """Return the value that a part of the weight does not exceed, but never the largest of several.

    The values rise.
    """
    weight = np.cumsum(weights, dtype=np.float64)
    place = int(np.searchsorted(weight, part * weight[-1]))
    return float(values[min(place, max(values.size - 2, 0))])
