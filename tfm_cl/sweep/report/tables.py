"""The rows of a sweep as Markdown, to read in a terminal, to paste, or to compare two sweeps."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from tfm_cl.sweep.report.groups import SETTINGS, Group
from tfm_cl.sweep.rows import BUDGETS, SweepRow


def _decibel(psnr: float | None) -> str:
    return "–" if psnr is None else f"{psnr:.1f}" if np.isfinite(psnr) else "∞"


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f}" if np.isfinite(value) else "∞"


def _similarity(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}" if np.isfinite(value) else "∞"


def _speed_up(row: SweepRow) -> str:
    seconds = row.seconds_light_pass + row.seconds_view_pass
    return f"{row.seconds_reference / seconds:.1f}×" if seconds > 0 else "–"


Column = tuple[str, Callable[[SweepRow], str]]

HEADINGS = {"density_weighting": "α", "map_res": "map"}
FIGURES: tuple[Column, ...] = (
    ("bytes per texel", lambda row: f"{row.bytes_per_texel:g}"),
    ("error of T / %", lambda row: _percent(row.t_error)),
    ("SSIM lit", lambda row: _similarity(row.lit_ssim)),
    ("PSNR lit / dB", lambda row: _decibel(row.lit_psnr)),
    ("RMSE lit / %", lambda row: _percent(row.lit_rmse)),
    ("SSIM", lambda row: _similarity(row.ssim)),
    ("PSNR / dB", lambda row: _decibel(row.psnr)),
    ("RMSE / %", lambda row: _percent(row.rmse)),
    ("SSIM lit converged", lambda row: _similarity(row.converged_lit_ssim)),
    ("PSNR lit converged / dB", lambda row: _decibel(row.converged_lit_psnr)),
    ("RMSE lit converged / %", lambda row: _percent(row.converged_lit_rmse)),
    ("FLIP", lambda row: _similarity(row.flip)),
    ("light pass / ms", lambda row: f"{1e3 * row.seconds_light_pass:.1f}"),
    ("view pass / ms", lambda row: f"{1e3 * row.seconds_view_pass:.1f}"),
    ("dual march / ms", lambda row: f"{1e3 * row.seconds_reference:.1f}"),
    ("speed-up", _speed_up),
    ("maps / MiB", lambda row: f"{row.map_bytes / 2**20:.1f}"),
)

_LEGEND = (
    "n coefficients per texel, density weighting α; reference: the dual march of the same steps, or "
    "(*converged*) of more. *Lit* is over the pixels where the reference's alpha exceeds 0.001. The error of "
    "T is relative, RMS, weighted by density, over the map's own light rays. RMSE is of linear values, "
    "relative to the reference's mean; times are the device's, compilation excluded; the speed-up is of "
    "light and view pass together."
)


def markdown(groups: Iterable[Group]) -> str:
    """Write two tables for each group: the best of each basis at equal bytes, and all rows."""
    lines = ["# Transmittance function maps, compared", "", _LEGEND]
    for group in groups:
        row = group.first
        lines += [
            "",
            f"## {_escaped(group.title)}",
            "",
            f"{_escaped(group.settings)}; {_escaped(row.device)}; tfm_cl {_escaped(row.version)}.",
            "",
            "### At equal bytes",
            "",
            "The best map of each basis (PSNR lit) within a budget of bytes per texel: PSNR, error of T.",
            "",
            *_equal_bytes(group),
            "",
            "### All maps",
            "",
            *_table(_columns(group), group.rows),
        ]
    return "\n".join(lines) + "\n"


def _columns(group: Group) -> list[Column]:
    """List the settings that differ, then what was measured."""
    settings: list[Column] = [("basis", lambda row: _escaped(row.basis))]
    settings += [(HEADINGS.get(name, name), _setting(name)) for name in SETTINGS if name in group.varying]
    return [*settings, ("n", lambda row: str(row.coeffs)), *FIGURES]


def _setting(name: str) -> Callable[[SweepRow], str]:
    def text(row: SweepRow) -> str:
        value = getattr(row, name)
        return _escaped(value) if isinstance(value, str) else f"{value:g}"

    return text


def _table(columns: list[Column], rows: Iterable[SweepRow]) -> list[str]:
    return [
        _line(name for name, _ in columns),
        "|" + " --: |" * len(columns),
        *(_line(text(row) for _, text in columns) for row in rows),
    ]


def _equal_bytes(group: Group) -> list[str]:
    """Make a line for each basis and a column for each budget."""
    cells = {
        (row.basis, budget): f"**{_decibel(row.lit_psnr)}** {_percent(row.t_error)} % (n = {row.coeffs})"
        for row in group.rows
        for budget in group.budgets.get(row.key, [])
    }
    bases = dict.fromkeys(row.basis for row in group.rows)
    return [
        _line(["basis", *(f"{budget} bytes" for budget in BUDGETS)]),
        "|" + " --: |" * (1 + len(BUDGETS)),
        *(_line([_escaped(basis), *(cells.get((basis, b), "–") for b in BUDGETS)]) for basis in bases),
    ]


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _escaped(text: str) -> str:
    """Escape names, which come from files, so that they are not markup."""
    return "".join(f"\\{c}" if c in "\\`*_[]<>|#" else c if c.isprintable() else " " for c in text)
