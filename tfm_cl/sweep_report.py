"""What a sweep's rows look like: a plot, a contact sheet and tables, from the folder alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray
from PIL import Image

from tfm_cl.errors import InputError
from tfm_cl.files import replacing, write_text
from tfm_cl.metrics import display_luma, display_rgb, lit_mask, white_of
from tfm_cl.sweep import SweepRow, Weighting, kept_image, read_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

DPI = 120
MAX_SIDE = 60_000
"""Pixels: matplotlib draws no image beyond 2¹⁶."""
INK, FAINT = "#222222", "#666666"
SERIES = (("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#CC79A7", "D"), ("#E69F00", "v"))
"""Colour (Okabe and Ito's, safe for the colour-blind) and marker of each α."""

AMPLIFICATION = 10
"""Of the difference images: full colour at a tenth of the display range."""
TILE = (2.5, 2.8)
"""Inches: box that an image of the contact sheet is fitted into."""


@dataclass(frozen=True)
class _Group:
    """The rows that belong in one diagram: same reference, same map but for n and α."""

    title: str
    rows: dict[tuple[Weighting, int], SweepRow]

    @property
    def first(self) -> SweepRow:
        return next(iter(self.rows.values()))

    @property
    def alphas(self) -> list[Weighting]:
        # "auto" comes after the numbers.
        return sorted({alpha for alpha, _ in self.rows}, key=lambda alpha: (alpha == "auto", alpha))

    @property
    def coeffs(self) -> list[int]:
        return sorted({n for _, n in self.rows})

    @property
    def settings(self) -> str:
        row = self.first
        return (
            f"{row.width}×{row.height} pixels, {row.view_steps} view and {row.map_steps} light steps, "
            f"map {row.map_res}² {row.basis} {row.storage}"
        )


def write(out: Path) -> None:
    """Write ``sweep.png``, ``contact_sheet.png`` and ``sweep.md`` from the rows and images of ``out``.

    Raises
    ------
    InputError
        When there are no rows, or a file cannot be written.
    """
    groups = _grouped(read_rows(out))
    if not groups:
        raise InputError(f"{out / 'sweep.jsonl'}: holds no rows to report on")
    write_text(out / "sweep.md", _markdown(groups))
    for name, figure in (("sweep.png", _plot(groups)), ("contact_sheet.png", _contact_sheet(groups, out))):
        dpi = min(DPI, MAX_SIDE / max(figure.get_size_inches()))
        with replacing(out / name) as temporary:
            figure.savefig(temporary, format="png", dpi=dpi, facecolor="white")


def _grouped(rows: list[SweepRow]) -> list[_Group]:
    found: dict[tuple[object, ...], dict[tuple[Weighting, int], SweepRow]] = {}
    for row in rows:
        key = (row.reference, row.volume, row.basis, row.storage, row.map_res)
        found.setdefault(key, {})[row.density_weighting, row.coeffs] = row
    groups = [_Group(next(iter(members.values())).volume, members) for members in found.values()]
    # The same volume under another medium, camera, device or version: the key tells them apart.
    times = Counter((group.title, group.settings) for group in groups)
    return [
        group
        if times[group.title, group.settings] == 1
        else _Group(f"{group.title} [{group.first.reference[:6]}]", group.rows)
        for group in groups
    ]


def _alpha(alpha: Weighting) -> str:
    return f"α = {alpha}" if isinstance(alpha, str) else f"α = {alpha:g}"


# ---------------------------------------------------------------------------------------------- table


def _decibel(psnr: float) -> str:
    return f"{psnr:.1f}" if np.isfinite(psnr) else "∞"


def _speed_up(row: SweepRow) -> str:
    seconds = row.seconds_light_pass + row.seconds_view_pass
    return f"{row.seconds_reference / seconds:.1f}×" if seconds > 0 else "–"


COLUMNS: tuple[tuple[str, Callable[[SweepRow], str]], ...] = (
    ("α", lambda row: _alpha(row.density_weighting).removeprefix("α = ")),
    ("n", lambda row: str(row.coeffs)),
    ("SSIM lit", lambda row: f"{row.lit_ssim:.4f}"),
    ("PSNR lit / dB", lambda row: _decibel(row.lit_psnr)),
    ("RMSE lit / %", lambda row: f"{100 * row.lit_rmse:.2f}"),
    ("SSIM", lambda row: f"{row.ssim:.4f}"),
    ("PSNR / dB", lambda row: _decibel(row.psnr)),
    ("RMSE / %", lambda row: f"{100 * row.rmse:.2f}"),
    ("light pass / ms", lambda row: f"{1e3 * row.seconds_light_pass:.1f}"),
    ("view pass / ms", lambda row: f"{1e3 * row.seconds_view_pass:.1f}"),
    ("dual march / ms", lambda row: f"{1e3 * row.seconds_reference:.1f}"),
    ("speed-up", _speed_up),
    ("map / MiB", lambda row: f"{row.map_bytes / 2**20:.1f}"),
)


def _markdown(groups: list[_Group]) -> str:
    """One table for each group; times are those of the device."""
    lines = [
        "# Quality against coefficients",
        "",
        (
            "n coefficients a texel, density weighting α; reference: the dual march of the same steps. "
            "*Lit* is over the pixels where the reference's alpha exceeds 0.001. RMSE is of linear values, "
            "relative to the reference's mean; times are the device's, compilation excluded; the speed-up "
            "is of light and view pass together."
        ),
    ]
    for group in groups:
        row = group.first
        # Names come from files: keep them from being markup.
        title = "".join(f"\\{c}" if c in "\\`*_[]<>|#" else " " if c in "\r\n" else c for c in group.title)
        lines += [
            "",
            f"## {title}",
            "",
            f"{group.settings}; {row.device}; tfm_cl {row.version}.",
            "",
            "| " + " | ".join(name for name, _ in COLUMNS) + " |",
            "|" + " --: |" * len(COLUMNS),
        ]
        lines += [
            "| " + " | ".join(text(group.rows[alpha, n]) for _, text in COLUMNS) + " |"
            for alpha in group.alphas
            for n in group.coeffs
            if (alpha, n) in group.rows
        ]
    return "\n".join(lines) + "\n"


# ----------------------------------------------------------------------------------------------- plot


def _plot(groups: list[_Group]) -> Figure:
    """SSIM and PSNR against n, a row of axes for each group."""
    figure = Figure(figsize=(9.0, 0.6 + 3.2 * len(groups)), layout=ConstrainedLayoutEngine(h_pad=0.1))
    axes = figure.subplots(len(groups), 2, squeeze=False)
    alphas = list(dict.fromkeys(alpha for group in groups for alpha in group.alphas))
    styles = {alpha: SERIES[index % len(SERIES)] for index, alpha in enumerate(alphas)}
    for group, (ssim, psnr) in zip(groups, axes, strict=True):
        ssim.set_title(
            group.title, loc="left", fontsize=11, color=INK, weight="bold", parse_math=False, pad=18
        )
        ssim.text(
            0, 1.03, group.settings, transform=ssim.transAxes, fontsize=8, color=FAINT, parse_math=False
        )
        _curves(ssim, group, styles, "ssim")
        _curves(psnr, group, styles, "psnr")
        ssim.set_ylabel("SSIM", fontsize=9)
        psnr.set_ylabel("PSNR / dB", fontsize=9)
    handles = [
        Line2D([], [], color=color, marker=marker, markersize=5, label=_alpha(alpha))
        for alpha, (color, marker) in styles.items()
    ]
    handles += [
        Line2D([], [], color=INK, linestyle="-", label="lit pixels"),
        Line2D([], [], color=INK, linestyle=":", label="whole frame"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False, fontsize=9)
    return figure


def _curves(axes: Axes, group: _Group, styles: dict[Weighting, tuple[str, str]], metric: str) -> None:
    endless = False
    for alpha in group.alphas:
        color, marker = styles[alpha]
        rows = [group.rows[alpha, n] for n in group.coeffs if (alpha, n) in group.rows]
        for prefix, line, fill in (("lit_", "-", color), ("", ":", "white")):
            values = np.array([getattr(row, prefix + metric) for row in rows])
            endless |= bool(np.isinf(values).any())
            axes.plot(
                [row.coeffs for row in rows],
                np.where(np.isfinite(values), values, np.nan),
                color=color,
                linestyle=line,
                linewidth=1.6,
                marker=marker,
                markersize=5,
                markerfacecolor=fill,
            )
    axes.set_xscale("log", base=2)
    axes.set_xlim(group.coeffs[0] / 1.2, group.coeffs[-1] * 1.2)
    axes.set_xticks(group.coeffs, [str(n) for n in group.coeffs])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("coefficients n", fontsize=9)
    axes.tick_params(labelsize=8, color=FAINT)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    if endless:
        axes.text(0.98, 0.04, "∞ (identical) not drawn", transform=axes.transAxes, ha="right", fontsize=8)


# ------------------------------------------------------------------------------------- contact sheet

MARGIN, GAP = 0.3, 0.12
HEADER, LABEL = 0.75, 0.42
"""Inches: above a group, and above an image for its numbers."""


@dataclass(frozen=True)
class _View:
    """What the contact sheet shows of a group: the part of the frame where the reference is lit."""

    reference: NDArray[np.float32] | None
    """[H, W, 4], cut; None if the file is missing or damaged."""
    white: float
    window: tuple[slice, slice]
    """Rows and columns of the frame."""

    @classmethod
    def of(cls, group: _Group, out: Path) -> _View:
        row = group.first
        image = kept_image(out, row.reference, (row.width, row.height))
        if image is None:
            return cls(None, 1.0, (slice(0, row.height), slice(0, row.width)))
        lit = lit_mask(image)
        window = (_occupied(lit.sum(axis=1)), _occupied(lit.sum(axis=0)))
        return cls(image[window].copy(), white_of(image), window)

    @property
    def tile(self) -> tuple[float, float]:
        """Width and height in inches, within `TILE`."""
        height, width = (side.stop - side.start for side in self.window)
        scale = min(TILE[0] / width, TILE[1] / height)
        return max(scale * width, 0.02), max(scale * height, 0.02)

    def colours(self, image: NDArray[np.float32]) -> NDArray[Any]:
        """Display image [h, w, 3], 8 bit."""
        return _thumbnail(display_rgb(image, self.white))

    def error(self, image: NDArray[np.float32]) -> NDArray[Any] | None:
        """Signed difference of display luma [h, w] from the reference."""
        if self.reference is None:
            return None
        return _thumbnail(display_luma(image, self.white) - display_luma(self.reference, self.white))


def _occupied(counts: NDArray[np.int_]) -> slice:
    """Range of the counts above 0 and a margin; all of them if none is."""
    occupied = np.flatnonzero(counts)
    if occupied.size == 0:
        return slice(0, counts.size)
    margin = 2 + (occupied[-1] - occupied[0]) // 12
    return slice(max(0, int(occupied[0] - margin)), min(counts.size, int(occupied[-1] + margin + 1)))


def _thumbnail(pixels: NDArray[np.float64]) -> NDArray[Any]:
    """Average whole blocks of pixels, so that what is drawn is at most about twice what is seen."""
    factor = max(1, int(max(pixels.shape[1] / TILE[0], pixels.shape[0] / TILE[1]) / (2 * DPI)))
    if pixels.ndim == 2:  # noqa: PLR2004 - one channel
        return np.asarray(Image.fromarray(pixels.astype(np.float32)).reduce(factor))
    return np.asarray(Image.fromarray(np.round(255 * pixels).astype(np.uint8)).reduce(factor))


def _contact_sheet(groups: list[_Group], out: Path) -> Figure:
    """Show the reference, then for each α a row of images and below them a row of differences."""
    views = [_View.of(group, out) for group in groups]
    heights = [
        HEADER + len(group.alphas) * (LABEL + 2 * (view.tile[1] + GAP)) + 0.5 * MARGIN
        for group, view in zip(groups, views, strict=True)
    ]
    columns = max(3, *(1 + len(group.coeffs) for group in groups))  # 3: room for the header
    figure = Figure(figsize=(2 * MARGIN + columns * (TILE[0] + GAP), 0.5 * MARGIN + sum(heights)))
    top = 0.5 * MARGIN
    for group, view, height in zip(groups, views, heights, strict=True):
        _sheet_of_group(_Sheet(figure, view.tile, top), group, view, out)
        top += height
    return figure


@dataclass(frozen=True)
class _Sheet:
    """Places tiles on a figure, in inches from its top left corner."""

    figure: Figure
    tile: tuple[float, float]
    top: float

    def text(self, x: float, y: float, text: str, **style: Any) -> None:
        """Write below the point (x, y)."""
        width, height = self.figure.get_size_inches()
        self.figure.text(
            x / width, 1 - (self.top + y) / height, text, va="top", parse_math=False, **{"color": INK} | style
        )

    def caption(self, column: int, y: float, title: str, numbers: str) -> None:
        """Write two lines above a tile."""
        self.text(self.left(column), y + 0.03, title, fontsize=9, weight="bold")
        self.text(self.left(column), y + 0.21, numbers, fontsize=7.5)

    def image(self, column: int, y: float, pixels: NDArray[Any] | None, **style: Any) -> AxesImage | None:
        """Show pixels in a column with their upper edge at y; None becomes a note."""
        width, height = self.figure.get_size_inches()
        tile_width, tile_height = self.tile
        axes = self.figure.add_axes(
            (
                self.left(column) / width,
                1 - (self.top + y + tile_height) / height,
                tile_width / width,
                tile_height / height,
            )
        )
        axes.set(xticks=[], yticks=[])
        axes.spines[:].set(color="#bbbbbb", linewidth=0.5)
        if pixels is None:
            axes.set_facecolor("#eeeeee")
            axes.text(0.5, 0.5, "image missing", ha="center", va="center", fontsize=8, color=FAINT)
            return None
        return axes.imshow(pixels, aspect="auto", **style)

    @staticmethod
    def left(column: int) -> float:
        """Left edge of a column, inches."""
        return MARGIN + column * (TILE[0] + GAP)


def _sheet_of_group(sheet: _Sheet, group: _Group, view: _View, out: Path) -> None:
    sheet.text(MARGIN, 0.0, group.title, fontsize=12, weight="bold")
    about = f"{group.settings}. Shown and measured: where the reference is lit; below each image its error."
    sheet.text(MARGIN, 0.24, about, fontsize=8, color=FAINT)
    tile_height = sheet.tile[1]
    y = HEADER - 0.2
    scale: AxesImage | None = None
    for alpha in group.alphas:
        image_y, error_y = y + LABEL, y + LABEL + tile_height + GAP / 2
        for column, n in enumerate(group.coeffs, start=1):
            row = group.rows.get((alpha, n))
            if row is None:
                continue
            title = f"n = {n},  {_alpha(alpha)}"
            decibel, percent = _decibel(row.lit_psnr), f"{100 * row.lit_rmse:.1f} %"
            sheet.caption(column, y, title, f"SSIM {row.lit_ssim:.4f}   PSNR {decibel} dB   RMSE {percent}")
            image = kept_image(out, row.key, (group.first.width, group.first.height))
            image = None if image is None else image[view.window]
            sheet.image(column, image_y, None if image is None else view.colours(image))
            error = sheet.image(
                column,
                error_y,
                None if image is None else view.error(image),
                cmap="RdBu_r",
                vmin=-1 / AMPLIFICATION,
                vmax=1 / AMPLIFICATION,
            )
            scale = scale or error
        y += LABEL + 2 * (tile_height + GAP)
    reference_ms = f"{1e3 * group.first.seconds_reference:,.0f} ms on the device"
    sheet.caption(0, HEADER - 0.2, "reference: dual march", reference_ms)
    image_y = HEADER - 0.2 + LABEL
    sheet.image(0, image_y, None if view.reference is None else view.colours(view.reference))
    if scale is not None:
        _error_scale(sheet, image_y + 1.5 * tile_height, scale)


def _error_scale(sheet: _Sheet, y: float, image: AxesImage) -> None:
    width, height = sheet.figure.get_size_inches()
    axes = sheet.figure.add_axes(
        (
            (sheet.left(0) + 0.35) / width,
            1 - (sheet.top + y) / height,
            (TILE[0] - 0.7) / width,
            0.12 / height,
        )
    )
    bar = sheet.figure.colorbar(image, cax=axes, orientation="horizontal", ticks=[-0.1, 0, 0.1])
    bar.ax.set_xticklabels(["≤ –0.1\ntoo dark", "0", "≥ +0.1\ntoo bright"])
    bar.ax.tick_params(labelsize=7.5, length=2, color=FAINT)
    bar.outline.set_linewidth(0.4)
    bar.ax.set_title(f"error of display luma (0…1), ×{AMPLIFICATION}", fontsize=7.5, color=INK, pad=4)
