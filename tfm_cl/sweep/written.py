"""Writes the report on a sweep's folder: ``report.html`` to look at, ``sweep.md`` to read."""

from __future__ import annotations

from pathlib import Path

from tfm_cl.errors import InputError
from tfm_cl.files.paths import write_text
from tfm_cl.sweep.report.groups import grouped
from tfm_cl.sweep.report.page import page
from tfm_cl.sweep.report.tables import markdown
from tfm_cl.sweep.rows import read_rows


def write(out: Path) -> None:
    """Write ``report.html`` and ``sweep.md`` from the rows, images and curves of ``out``.

    Raises
    ------
    InputError
        If there are no rows, or a file cannot be written.
    """
    groups = grouped(read_rows(out))
    if not groups:
        raise InputError(f"{out / 'sweep.jsonl'}: holds no rows to report on")
    write_text(out / "sweep.md", markdown(groups))
    write_text(out / "report.html", page(groups, out))
