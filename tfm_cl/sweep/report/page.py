"""The report of a sweep: a single, self-contained HTML file."""

from __future__ import annotations

import dataclasses
import html
import json
import math
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tfm_cl.files.image_io.false_colour import COLOURS
from tfm_cl.metrics import compare
from tfm_cl.page import SCRIPTS as SHARED_SCRIPTS
from tfm_cl.page import asset, filled, inside_element, source_hash
from tfm_cl.sweep import curves as sweep_curves
from tfm_cl.sweep.report.pictures import Pictures, pictures
from tfm_cl.sweep.rows import BUDGETS, SweepRow, kept_image

if TYPE_CHECKING:
    from tfm_cl.sweep.report.groups import Group

LIMIT = 40_000_000
"""Largest number of bytes of the file; further pictures are left out, and the page says which."""
SCRIPTS = ("common.js", "plots.js", "viewer.js", "table.js", "page.js")
_ASSETS = files("tfm_cl.sweep.report") / "assets"


def page(groups: list[Group], out: Path, limit: int = LIMIT) -> str:
    """Make the page.

    Parameters
    ----------
    groups
        At least one.
    out
        The sweep's folder: images and curves are read from it.
    limit
        Bytes that the page may take; it is larger only if its figures without pictures are.

    Returns
    -------
    str
        HTML that loads nothing else: it contains scripts, figures and pictures.
    """
    # Slow to import, and untyped.
    from plotly.offline import get_plotlyjs  # type: ignore[import-untyped] # noqa: PLC0415

    plotly = inside_element(get_plotlyjs())
    script = inside_element("\n".join(['"use strict";', *map(asset, SHARED_SCRIPTS), *map(_asset, SCRIPTS)]))
    parts = {
        # Only these two scripts may run, and nothing may be loaded, whatever a name might smuggle in.
        "HASHES": f"{source_hash(plotly)} {source_hash(script)}",
        "TITLE": html.escape("Sweep: " + ", ".join(dict.fromkeys(group.title for group in groups))[:200]),
        "STYLE": asset("theme.css") + _asset("page.css"),
        "PLOTLY": plotly,
        "SCRIPT": script,
    }
    figures = [_group(group, out) for group in groups]
    used = sum(len(part.encode()) for part in parts.values()) + len(_json(figures))
    found = pictures(groups, out, limit - used - _RESERVE)
    for entry in figures:
        _add_pictures(entry, found)
    parts["DATA"] = _json(_data(groups, figures))
    parts["PICTURES"] = _json(found.encoded)
    return filled(_asset("page.html"), parts)


_RESERVE = 100_000
"""Bytes reserved for the template, and for the description of each row's picture."""


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")


def _json(value: Any) -> str:
    """JSON without characters that have a meaning in HTML."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _data(groups: list[Group], figures: list[dict[str, Any]]) -> dict[str, Any]:
    devices = ", ".join(dict.fromkeys(group.first.device for group in groups))
    count = sum(len(group.rows) for group in groups)
    volumes = f"{len(groups)} volume{'s' if len(groups) > 1 else ''}"
    versions = ", ".join(dict.fromkeys(group.first.version for group in groups))
    return {
        "about": f"{count} maps of {volumes}, each measured against the dual march.",
        "footer": f"tfm_cl {versions} on {devices}. Drawn with plotly.js.",
        "budgets": BUDGETS,
        "signed_colours": COLOURS["signed"],
        "limit_megabytes": LIMIT // 10**6,
        "groups": figures,
    }


def _group(group: Group, out: Path) -> dict[str, Any]:
    first = group.first
    return {
        "title": group.title,
        "settings": group.settings,
        "device": first.device,
        "version": first.version,
        "reference": first.reference,
        "converged": group.converged,
        "seconds_reference": first.seconds_reference,
        "dual": _dual(group, out),
        "varying": group.varying,
        "rows": [_row(row, group) for row in group.rows],
        "curves": _curves(group, out),
    }


def _dual(group: Group, out: Path) -> dict[str, Any] | None:
    """Compare the dual march of the rows' steps with the converged one; figures are named as in a row."""
    row = group.first
    if group.converged is None:
        return None
    dual, truth = (kept_image(out, key, (row.width, row.height)) for key in (row.reference, group.converged))
    if dual is None or truth is None:
        return None
    found = compare(dual, truth)
    parts = {"converged": found, **({"converged_lit": found.lit} if found.lit else {})}
    return {
        f"{prefix}_{name}": _number(getattr(part, name))
        for prefix, part in parts.items()
        for name in ("ssim", "psnr", "rmse")
    }


def _row(row: SweepRow, group: Group) -> dict[str, Any]:
    values = {name: _number(value) for name, value in dataclasses.asdict(row).items()}
    return values | {
        "variant": group.variant(row),
        "budgets": group.budgets.get(row.key, []),
        "picture": None,
    }


def _number(value: Any) -> Any:
    """Write values that JSON has no number for as strings."""
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return None if math.isnan(value) else "inf" if value > 0 else "-inf"


def _curves(group: Group, out: Path) -> dict[str, Any] | None:
    """Return the curves that the sweep kept of this group's rows."""
    kept = sweep_curves.read(out, group.first.reference)
    if kept is None:
        return None
    ray, curves = kept
    shown = [row for row in group.rows if row.key in curves]
    if not shown:
        return None
    any_curve = curves[shown[0].key]
    return {
        "u": ray[0],
        "v": ray[1],
        "distance": any_curve.distance,
        "exact": any_curve.exact,
        "values": {row.key: curves[row.key].values for row in shown},
    }


def _add_pictures(entry: dict[str, Any], found: Pictures) -> None:
    reasons = dict.fromkeys(found.missing, "missing") | dict.fromkeys(found.left_out, "left out")
    for row in entry["rows"]:
        row["picture"] = reasons.get(row["key"])
