"""Finds the pixels of the full frame that two pictures share."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io.image import Picture, Window


@dataclass(frozen=True)
class Overlap:
    """The pixels that two pictures have in common."""

    test: NDArray[np.float32]
    reference: NDArray[np.float32]
    window: Window | None = None
    """Their window in the full frame; None: all pixels, at an unknown position."""
    note: str = ""
    """A note for the user; empty if the pictures cover the same pixels."""


def overlap(test: Picture, reference: Picture, test_name: str, reference_name: str) -> Overlap:
    """Find the pixels that two pictures have in common, by their data windows.

    If only one of the pictures states its position, the other is assumed to be at the same one. Their sizes
    are not compared here.

    Raises
    ------
    ImageError
        If they have no pixel in common, or their frames differ in size.
    """
    named = {test_name: test, reference_name: reference}
    crops = [picture for picture in named.values() if picture.window != picture.frame]
    if test.window is None or reference.window is None:
        note = ""
        if crops and test.pixels.shape[:2] == reference.pixels.shape[:2]:
            silent = test_name if test.window is None else reference_name
            note = (
                f"{silent} does not say where its pixels lie; taken for the pixels {_shown(crops[0].window)}"
            )
        return Overlap(test.pixels, reference.pixels, crops[0].window if note else None, note)
    if test.frame != reference.frame:
        frames = " and ".join(f"{name} {_size(picture.frame)}" for name, picture in named.items())
        raise ImageError(
            f"the full frames differ ({frames}): their pixels are not the same; render both alike"
        )
    if test.window == reference.window:
        return Overlap(test.pixels, reference.pixels)
    held = "; ".join(f"{name} holds {_shown(picture.window)}" for name, picture in named.items())
    (a0, b0, a1, b1), (c0, d0, c1, d1) = test.window, reference.window
    window = max(a0, c0), max(b0, d0), min(a1, c1), min(b1, d1)
    if window[0] >= window[2] or window[1] >= window[3]:
        raise ImageError(f"there is no pixel in both: {held}")
    note = f"compared are the pixels {_shown(window)}, which both have: {held}"
    return Overlap(test.part(window), reference.part(window), window, note)


def _shown(window: Window | None) -> str:
    return ",".join(map(str, window or ()))


def _size(window: Window | None) -> str:
    x0, y0, x1, y1 = window or (0, 0, 0, 0)
    return f"{x1 - x0}×{y1 - y0}" + (f" at {x0},{y0}" if (x0, y0) != (0, 0) else "")
