"""How studies draw curves and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from reproduce.lab import Floats, Image
from reproduce.rays import EDGES
from tfm_cl.metrics import display_rgb, lit_mask

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
EXACT: dict[str, Any] = {"color": "#222222", "linewidth": 2.2, "alpha": 0.5, "label": "exact"}


def plots(count: int, height: float = 3.0) -> tuple[Figure, list[Axes]]:
    """Return a figure with plots side by side."""
    figure = Figure(figsize=(4.2 * count, height), dpi=90, layout="constrained")
    return figure, [figure.add_subplot(1, count, i + 1) for i in range(count)]


def pictures(rows: Sequence[Sequence[tuple[str, Image | Floats, float]]], width: float = 2.4) -> Figure:
    """Return a figure with rows of pictures: caption, linear RGB, and the value shown as white."""
    columns = max(map(len, rows))
    heights = [width * row[0][1].shape[0] / row[0][1].shape[1] + 0.3 for row in rows]
    figure = Figure(figsize=(width * columns, sum(heights)), dpi=100, layout="constrained")
    grid = figure.add_gridspec(len(rows), columns, height_ratios=heights)
    for y, row in enumerate(rows):
        for x, (caption, image, white) in enumerate(row):
            axes = figure.add_subplot(grid[y, x])
            axes.imshow(display_rgb(image, white))
            axes.set_title(caption, fontsize=8)
            axes.set_axis_off()
    return figure


def lit_window(image: Image) -> tuple[slice, slice]:
    """Return the part of a picture that shows the medium."""
    y, x = np.nonzero(lit_mask(image))
    if len(y) == 0:
        return slice(None), slice(None)
    return slice(int(y.min()), int(y.max()) + 1), slice(int(x.min()), int(x.max()) + 1)


def curves(axes: Axes, title: str, exact: Floats, found: dict[str, Floats]) -> None:
    """Plot an exact transmittance and its reconstructions over the range."""
    axes.plot(EDGES, exact, **EXACT)
    for (label, values), colour in zip(found.items(), COLOURS, strict=False):
        axes.plot(EDGES, values, color=colour, linewidth=1.1, label=label)
    axes.set_title(title, fontsize=9)
    axes.set_xlabel("depth")
    axes.set_ylabel("transmittance")
    axes.legend(fontsize=7)
