"""The rows of a sweep as LaTeX tables for a paper, which need the package booktabs."""

from __future__ import annotations

from collections.abc import Iterable

from tfm_cl.sweep.report.groups import SETTINGS, Group
from tfm_cl.sweep.report.tables import FIGURES, HEADINGS
from tfm_cl.sweep.rows import SweepRow

SHOWN = (
    "bytes per texel",
    "error of T / %",
    "SSIM lit",
    "PSNR lit / dB",
    "RMSE lit / %",
    "light pass / ms",
    "view pass / ms",
    "speed-up",
)
"""Of the figures that are measured, those that a page has room for."""

ESCAPES = {
    **{c: f"\\{c}" for c in "{}$&#_%"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "α": r"$\alpha$",
    "×": r"$\times$",
    "²": "$^2$",
    "∞": r"$\infty$",
    "–": "--",
}


def latex(groups: Iterable[Group]) -> str:
    """Write a table for each group."""
    return "% Made by tfm sweep; needs \\usepackage{booktabs}.\n" + "\n".join(map(_table, groups))


def _table(group: Group) -> str:
    figures = [column for column in FIGURES if column[0] in SHOWN]
    settings = [name for name in SETTINGS if name in group.varying]
    headings = [
        "basis",
        *(HEADINGS.get(name, name) for name in settings),
        "n",
        *(name for name, _ in figures),
    ]

    def cells(row: SweepRow) -> list[str]:
        values = [getattr(row, name) for name in settings]
        shown = [value if isinstance(value, str) else f"{value:g}" for value in values]
        return [row.basis, *shown, str(row.coeffs), *(text(row) for _, text in figures)]

    lines = [_line(cells(row)) for row in group.rows]
    about = f"{group.title}: {group.settings}; {group.first.device}; tfm_cl {group.first.version}."
    return "\n".join(
        [
            r"\begin{table}",
            r"  \centering",
            f"  \\caption{{{_escaped(about)}}}",
            f"  \\begin{{tabular}}{{{'l' * (1 + len(settings))}{'r' * (1 + len(figures))}}}",
            r"    \toprule",
            _line(headings),
            r"    \midrule",
            *lines,
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def _line(cells: Iterable[str]) -> str:
    return f"    {' & '.join(map(_escaped, cells))} \\\\"


def _escaped(text: str) -> str:
    """Escape names, which come from files, so that they are not commands."""
    return "".join(ESCAPES.get(c, c if c.isprintable() else " ") for c in text)
