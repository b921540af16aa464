"""The figures of a sweep as files for a paper: quality against bytes, and transmittance along a ray."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import InputError
from tfm_cl.extras import needs
from tfm_cl.files.paths import replacing
from tfm_cl.sweep import curves as sweep_curves
from tfm_cl.sweep.rows import SweepRow, one_line_errors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tfm_cl.sweep.report.groups import Group

FORMATS = ("svg", "pdf")
STYLE: Any = {
    "font.size": 8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "svg.fonttype": "none",  # text stays text
    "pdf.fonttype": 42,
    "svg.hashsalt": "tfm_cl",  # the same file of the same figures
}
SIZE = (3.4, 2.5)
"""Inches: a column's width."""
NAME = 60
"""Letters of a file's name that a volume's may take."""


def write_figures(groups: Sequence[Group], out: Path, formats: Iterable[str]) -> None:
    """Write ``out/figures/NAME-psnr``, ``-rmse`` and ``-ray`` of each group in each format.

    Raises
    ------
    InputError
        matplotlib is missing, or a file cannot be written.
    """
    with needs("figures", "drawing figures", InputError):
        import matplotlib as mpl  # noqa: PLC0415 - slow to import
        import matplotlib.figure  # noqa: PLC0415
    folder, taken = out / "figures", set[str]()
    with one_line_errors(folder, "made"):
        folder.mkdir(exist_ok=True)
    with mpl.rc_context(STYLE):
        for group in groups:
            name = _file_name(group.title, taken)
            drawn = {
                "psnr": _quality(group, "lit_psnr", "PSNR lit / dB"),
                "rmse": _quality(group, "lit_rmse", "RMSE lit"),
                "ray": _ray(group, out),
            }
            for what, figure in drawn.items():
                for form in formats if figure is not None else ():
                    with replacing(folder / f"{name}-{what}.{form}") as temporary:
                        _save(figure, temporary, form)


def _save(figure: Any, path: Path, form: str) -> None:
    dates = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    figure.savefig(path, format=form, metadata=dates[form])


def _file_name(title: str, taken: set[str]) -> str:
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", title).strip("-")[:NAME] or "volume"
    names = (f"{plain}{end}" for end in ("", *(f"-{number}" for number in range(2, len(taken) + 3))))
    name = next(name for name in names if name not in taken)
    taken.add(name)
    return name


def _axes(x: str, y: str) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure  # noqa: PLC0415 - no pyplot: nothing of the process is changed

    figure = Figure(SIZE, layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    return figure, axes


def _quality(group: Group, name: str, label: str) -> Figure:
    """Draw a figure of the rows against bytes per texel: a line for each basis and its settings."""
    figure, axes = _axes("bytes per texel", label)
    lines: dict[str, list[SweepRow]] = {}
    for row in group.rows:
        lines.setdefault(", ".join(filter(None, (row.basis, group.variant(row)))), []).append(row)
    for words, rows in lines.items():
        points = sorted((row.bytes_per_texel, getattr(row, name)) for row in rows)
        axes.plot(*zip(*points, strict=True), marker="o", markersize=3, linewidth=1, label=words)
    axes.set_xscale("log", base=2)
    axes.xaxis.set_major_formatter("{x:g}")
    if name == "lit_rmse":
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
    axes.legend(fontsize=6)
    return figure


def _ray(group: Group, out: Path) -> Figure | None:
    """Draw the transmittance along the ray that was kept, exact and of each map; None without one."""
    kept = sweep_curves.read(out, group.first.reference)
    shown = [row for row in group.rows if kept is not None and row.key in kept[1]]
    if kept is None or not shown:
        return None
    figure, axes = _axes("distance from the light / world units", "transmittance")
    for row in shown:
        curve = kept[1][row.key]
        words = ", ".join(filter(None, (f"{row.basis} n = {row.coeffs}", group.variant(row))))
        axes.plot(curve.distance, curve.values, linewidth=0.8, label=words)
    exact = kept[1][shown[0].key]
    axes.plot(exact.distance, exact.exact, color="black", linewidth=1.2, label="exact")
    axes.legend(fontsize=5)
    return figure
