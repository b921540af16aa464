"""Writes the report on a sweep's folder: ``report.html`` to look at, ``sweep.md`` to read, and for papers."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from tfm_cl.errors import InputError
from tfm_cl.files.paths import write_text
from tfm_cl.sweep.report import latex as tables
from tfm_cl.sweep.report.figures import write_figures
from tfm_cl.sweep.report.groups import grouped
from tfm_cl.sweep.report.page import page
from tfm_cl.sweep.report.tables import markdown
from tfm_cl.sweep.rows import read_rows


def write(out: Path, *, latex: bool = False, figures: Collection[str] = ()) -> None:
    """Write ``report.html`` and ``sweep.md`` from the rows, images and curves of ``out``.

    Parameters
    ----------
    out
        The sweep's folder.
    latex
        Also ``sweep.tex``, tables for a paper.
    figures
        Also files in ``figures``, of these formats: ``svg``, ``pdf``.

    Raises
    ------
    InputError
        If there are no rows, a file cannot be written, or matplotlib is missing for figures.
    """
    groups = grouped(read_rows(out))
    if not groups:
        raise InputError(f"{out / 'sweep.jsonl'}: holds no rows to report on")
    write_text(out / "sweep.md", markdown(groups))
    write_text(out / "report.html", page(groups, out))
    if latex:
        write_text(out / "sweep.tex", tables.latex(groups))
    if figures:
        write_figures(groups, out, figures)
