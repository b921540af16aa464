"""Prefiltering of maps: blurring coefficients before they are looked up.

Source: Jansen and Bavoil, *Fourier Opacity Mapping* (I3D 2010), section 6. Where coefficients are linear in
the density, their blur is the map of a density that is blurred across the light's rays: what a point receives
is the geometric mean of what passes these rays, never more than their mean. Soft shadows of an area light are
the mean: `tfm_cl.scene.lights.area`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import pyopencl as cl

if TYPE_CHECKING:
    from tfm_cl.device.launch import Launcher

Axis = Literal["row", "column"]

GAUSSIAN_BOXES = 3
"""Number of successive boxes that make a Gaussian."""

WIDEST = 2.0**40
"""Largest width of the filter, in texels: a wider window gives the same result in float32."""

MOST_GROUP: dict[Axis, int] = {"row": 32, "column": 64}
"""Largest number of floats that a CPU's work-item processes side by side, along rows and down columns: whole
cache lines."""

LAUNCH_FLOATS = 1 << 23
"""Largest number of floats processed by one launch: a few hundredths of a second on a CPU."""


@dataclass(frozen=True)
class Window:
    """Weights of a discrete box: 1 up to `reach` texels on either side of its centre, `part` for the next."""

    reach: int
    part: float

    @classmethod
    def of_width(cls, width: float) -> Window:
        """Make the mean over a box of this width in texels; up to 1 the box lies within its texel."""
        width = max(width, 1.0)
        reach = math.floor((width - 1) / 2)
        return cls(reach, (width - 1) / 2 - reach)

    @classmethod
    def of_variance(cls, variance: float) -> Window:
        """Make the box of exactly this variance, texels² (Gwosdek et al., *Extended Box Filtering*, 2011)."""
        reach = math.floor((math.sqrt(12 * variance + 1) - 1) / 2)
        part = (2 * reach + 1) * (reach * (reach + 1) - 3 * variance) / (6 * (variance - (reach + 1) ** 2))
        return cls(reach, min(max(part, 0.0), 1.0))

    @property
    def total(self) -> float:
        """Sum of the weights."""
        return 1 + 2 * (self.reach + self.part)


def windows(width: float, kernel: Literal["box", "gaussian"]) -> list[Window]:
    """Return the boxes that a blur applies one after the other, along rows and along columns.

    Parameters
    ----------
    width, kernel
        As in `Prefilter.blur`.
    """
    width = min(width, WIDEST)
    if kernel == "box":
        chosen = [Window.of_width(width)]
    else:
        chosen = [Window.of_variance(width**2 / 12 / GAUSSIAN_BOXES)] * GAUSSIAN_BOXES
    return [window for window in chosen if window.total > 1]


class Prefilter:
    """Runs ``prefilter.cl``."""

    def __init__(self, launcher: Launcher) -> None:
        self._launcher = launcher

    def blur(
        self,
        coefficients: cl.Buffer,
        res: int,
        n: int,
        width: float,
        kernel: Literal["box", "gaussian"],
    ) -> tuple[cl.Buffer, float]:
        """Blur a map along its rows and columns; beyond the border, the texels of the border are repeated.

        The cost of a box does not depend on its width. A Gaussian costs as much as its boxes, plus what they
        write beyond the border for one another (`margins`): 1 + 0.6 width / res times as much, up to about 3
        times.

        Parameters
        ----------
        coefficients
            float32 [res, res, n]; not modified.
        width
            Full width in texels, any number ≥ 0; 0 changes nothing.
        kernel
            ``box``: the mean over a square of this side; its outermost texels may count partially.
            ``gaussian``: standard deviation width / √12, the same as that of the box, as three successive
            boxes whose variances add up to exactly that of the Gaussian. For widths of 5 or more, a step
            blurred along one axis differs from the true Gaussian blur by at most 1.2 % of its height, and any
            signal by at most 3.2 % of its range; for widths of more than four maps both are 6.5 %.

        Returns
        -------
        blurred
            float32 [res, res, n] in device memory; ``coefficients`` itself if nothing changes.
        seconds
            Device time.

        Raises
        ------
        DeviceMemoryError
            When the device has no room for two more maps; for a Gaussian, for two with margins (`margins`).
        """
        boxes = windows(width, kernel)
        if not boxes:
            return coefficients, 0.0
        wider = margins(boxes, res)
        nbytes = 4 * res * (res + 2 * max(wider)) * n
        source, seconds = coefficients, 0.0
        spare = [self._launcher.empty("the blurred map", nbytes, reuse=True) for _ in range(2)]
        axes: tuple[Axis, ...] = ("row", "column")
        for axis in axes:
            for window, (before, after) in zip(boxes, pairwise((0, *wider)), strict=True):
                target = spare.pop()
                seconds += self._along(axis, source, target, (res, n, before, after), window)
                if source is not coefficients:
                    spare.append(source)
                source = target
        return source, seconds

    def _along(
        self,
        axis: Axis,
        source: cl.Buffer,
        target: cl.Buffer,
        size: tuple[int, int, int, int],
        window: Window,
    ) -> float:
        """Apply a box to every row or column. size: res, n, margins of source and target along the axis."""
        launcher, (res, n, before, after) = self._launcher, size
        # Neighbouring floats that belong to different lines: those of a texel, or of a row of texels.
        together = n if axis == "row" else res * n
        group = 1 if launcher.lanes == 1 else largest_divisor(together, MOST_GROUP[axis])
        kernel = launcher.kernels.kernel("blur_lines", "prefilter.cl", (), {"TFM_GROUP": group})
        counts, shift = (res + 2 * before, res + 2 * after), before - after
        lines = together // group * (res if axis == "row" else 1)
        at_once, seconds = max(LAUNCH_FLOATS // (max(counts) * group), 1), 0.0
        for first in range(0, lines, at_once):
            end = min(first + at_once, lines)
            seconds += launcher.run(
                kernel,
                (end - first,),
                {
                    "from": source,
                    "to": target,
                    "first": first,
                    "end": end,
                    "per_row": together // group,
                    "pitch": (counts[0] * n, counts[1] * n),
                    "count": counts,
                    "stride": together,
                    "shift": shift,
                    "reach": min(window.reach, sum(counts)),
                    "left": min(max(window.reach - shift, 0), 2 * window.reach + 1),
                    "right": max(shift + window.reach - (counts[0] - 1), 0),
                    "part": window.part,
                    "scale": 1 / window.total,
                },
            )
        return seconds


def margins(boxes: list[Window], res: int) -> list[int]:
    """Return the number of texels beyond each end of a line that every box has to write for the next ones.

    Without them, only the first box would see a constant border. They are limited to the map's width; the
    errors stated in `Prefilter.blur` include the effect of that limit.
    """
    reaches = [window.reach + 1 for window in boxes]
    return [min(sum(reaches[i + 1 :]), res) for i in range(len(boxes))]


def largest_divisor(number: int, limit: int) -> int:
    """Return the largest divisor of a number that does not exceed a limit."""
    return next(divisor for divisor in range(min(number, limit), 0, -1) if number % divisor == 0)
