"""Prefiltering of maps: blurring coefficients before they are looked up.

Source: Jansen and Bavoil, *Fourier Opacity Mapping* (I3D 2010), section 6. Where coefficients are linear in
the density, their blur is the map of a density that is blurred across the light's rays: what a point receives
is the geometric mean of what passes these rays, never more than their mean. Soft shadows of an area light are
the mean: `tfm_cl.scene.lights.area`.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import pyopencl as cl

from tfm_cl.device.launch import Launcher

Axis = Literal["row", "column"]

GAUSSIAN_BOXES = 3
"""Boxes in a row that make a Gaussian."""

WIDEST = 2.0**40
"""Texels. A wider window gives what this one does, to the last digit of float32."""

MOST_GROUP: dict[Axis, int] = {"row": 32, "column": 64}
"""Floats, at most, that a CPU's work-item carries along a row and down a column: whole cache lines."""

LAUNCH_FLOATS = 1 << 23
"""Floats of a launch, at most: some hundredths of a second on a CPU."""


@dataclass(frozen=True)
class Window:
    """Weights of a discrete box: 1 for `reach` texels on either side of its centre, `part` for the next."""

    reach: int
    part: float

    @classmethod
    def of_width(cls, width: float) -> "Window":
        """Make the mean over a box so many texels wide; up to 1 it lies within its texel."""
        width = max(width, 1.0)
        reach = math.floor((width - 1) / 2)
        return cls(reach, (width - 1) / 2 - reach)

    @classmethod
    def of_variance(cls, variance: float) -> "Window":
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
        """Blur a map along its rows and columns; beyond the border its own texels go on, the nearest rays.

        A box costs the same at every width. A Gaussian costs as its boxes do, and what they write beyond the
        border for one another (`margins`): 1 + 0.6 width / res times as much, at most some 3 times.

        Parameters
        ----------
        coefficients
            float32 [res, res, n]; stays as it is.
        width
            Full width in texels, any number ≥ 0; 0 changes nothing.
        kernel
            ``box``: the mean over a square of this side; of its outermost texels only a part may count.
            ``gaussian``: of standard deviation width / √12, which is that of the box. It is three boxes in a
            row whose variances add up to exactly this. From a width of 5 on, a step blurred along one axis is
            within 1.2 % of its height, and any signal within 3.2 % of its range, of what a Gaussian makes of
            it; for widths of more than four maps both are 6.5 %.

        Returns
        -------
        blurred
            float32 [res, res, n] in device memory; ``coefficients`` itself when nothing changes.
        seconds
            Device time.

        Raises
        ------
        DeviceMemoryError
            When the device has no room for two more maps; for a Gaussian, with a margin (`margins`).
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
        """Apply a box to every row or column; size: res, n, margins of source and target along the axis."""
        launcher, (res, n, before, after) = self._launcher, size
        # Neighbouring floats that belong to different lines: of a texel, or of a row of texels.
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
    """Return the texels beyond each end of a line that every box has to write for the ones after it.

    Without them a border would be blurred to a constant only once. At most a map's width: what the rest costs
    is in the errors that `Prefilter.blur` states.
    """
    reaches = [window.reach + 1 for window in boxes]
    return [min(sum(reaches[i + 1 :]), res) for i in range(len(boxes))]


def largest_divisor(number: int, limit: int) -> int:
    """Return the largest divisor of a number that is not above a limit."""
    return next(divisor for divisor in range(min(number, limit), 0, -1) if number % divisor == 0)
