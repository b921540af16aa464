"""What is written of studies: a page and numbers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from reproduce.claims import Study


def markdown(studies: dict[str, Study], facts: dict[str, Any]) -> str:
    """Write the report."""
    lines = [
        "# The papers' figures and tables, reproduced",
        "",
        f"By `scripts/reproduce_papers.py` on {facts['device']}; sizes: "
        + ", ".join(f"{name} {value}" for name, value in facts["sizes"].items())
        + ". Every verdict is computed from the measurements; speeds are ratios within this run.",
        "",
        "| where | claim | verdict | measured | paper |",
        "|---|---|---|---|---|",
    ]
    for name, study in studies.items():
        for claim in study.claims:
            changed = f"; otherwise than voxels: {claim.changed}" if claim.changed else ""
            cells = (claim.text, f"**{claim.verdict}**{changed}", claim.measured, claim.paper)
            lines.append(f"| [{name}](#{name}) | " + " | ".join(map(_cell, cells)) + " |")
    for name, study in studies.items():
        lines += ["", f'<a id="{name}"></a>', f"## {study.title}", study.how, ""]
        head, *rows = study.rows
        lines += [_row(head), "|" + "---|" * len(head), *map(_row, rows), ""]
        if study.figure is not None:
            lines.append(f"![{study.title}]({name}.png)")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(map(_cell, cells)) + " |"


def numbers(studies: dict[str, Study], facts: dict[str, Any]) -> dict[str, Any]:
    """Return all numbers for JSON."""
    found = {}
    for name, study in studies.items():
        claims = [
            {**asdict(claim), "verdict": claim.verdict, "changed": claim.changed} for claim in study.claims
        ]
        found[name] = {"title": study.title, "how": study.how, "claims": claims, "rows": study.rows}
    return {**facts, "studies": _finite(found)}


def _finite(value: Any) -> Any:
    """Replace values that JSON cannot hold by None, and NumPy's numbers by Python's."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return float(value) if np.isfinite(value) else None
    return bool(value) if isinstance(value, np.bool_) else value
