"""Curves of a sweep: the transmittance along one light ray, exact and from every map (TFM fig. 8).

``DIR/curves/KEY.json``, one file for each reference (its key)::

    {"volume": name, "light": 0, "u": …, "v": …, "distance": […], "exact": […],
     "curves": [{"label": "klt n=8", "key": key of the row, "values": […]}, …]}

``u`` and ``v`` in [0, 1] are the ray's position on the map of the light with that index. Distances are in
world units from the light; the other values are transmittances of the density.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from tfm_cl.errors import SceneError
from tfm_cl.files.paths import write_text
from tfm_cl.sweep.rows import Key, SweepRow, one_line_errors

if TYPE_CHECKING:
    from tfm_cl.maps.transmittance_map import TransmittanceMap

Ray = tuple[float, float]
"""Position (u, v) on a light's map, 0 to 1."""

COUNT = 256
"""Number of points of a curve."""
CANDIDATES = 256
"""Number of rays from which `choose_ray` chooses."""
CANDIDATE_POINTS = 64
"""Number of points of each of those rays."""
PERCENTILE = 90
"""Largest percentile of the optical depths of those rays: rays beyond it are as dark as the volume gets, and
show little."""
MAX_BYTES = 1 << 26
"""Largest size in bytes of a file of curves; a larger one was not written by a sweep."""

Place = Annotated[float, Field(ge=0, le=1)]
Values = Annotated[
    list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=COUNT, max_length=COUNT)
]


@dataclass(frozen=True)
class Curve:
    """One map along one ray: `COUNT` values each."""

    distance: Values
    exact: Values
    values: Values


@dataclass(frozen=True)
class _Labelled:
    label: str
    key: Key
    values: Values


@dataclass(frozen=True)
class _File:
    volume: str
    light: int
    u: Place
    v: Place
    distance: Values
    exact: Values
    curves: list[_Labelled]


_FILE = TypeAdapter(_File)


def choose_ray(light_map: TransmittanceMap) -> Ray | None:
    """Choose a ray that distinguishes maps: dark, but not the darkest.

    Of 256 texels spread evenly over those whose light rays meet density, it is the one with the largest
    optical depth up to the 90th percentile. None if no ray meets density.
    """
    begin, end = np.moveaxis(light_map.occupied, -1, 0)
    places = np.argwhere(end > begin)
    if len(places) == 0:
        return None
    places = places[np.linspace(0, len(places) - 1, min(len(places), CANDIDATES)).round().astype(int)]
    depths: dict[Ray, float] = {}
    for v, u in (places + 0.5) / begin.shape:
        with contextlib.suppress(SceneError):  # it only grazes the medium, and misses it here
            last = light_map.curve(float(u), float(v), CANDIDATE_POINTS)[1][-1]
            depths[float(u), float(v)] = -float(np.log(np.clip(last, np.finfo(np.float32).tiny, 1)))
    if not depths:
        return None
    # "lower" returns one of the depths, so there always is a ray.
    most = float(np.percentile(list(depths.values()), PERCENTILE, method="lower"))
    return max((ray for ray, depth in depths.items() if depth <= most), key=depths.__getitem__)


def curve_of(light_map: TransmittanceMap, ray: Ray) -> Curve:
    """Evaluate a map along a ray."""
    distance, exact, values = (_numbers(part) for part in light_map.curve(*ray, COUNT))
    return Curve(distance, exact, values)


def _numbers(values: NDArray[np.floating]) -> list[float]:
    # float32 has no more than seven digits.
    return [float(f"{value:.7g}") for value in values]


def read(out: Path, reference: str) -> tuple[Ray, dict[str, Curve]] | None:
    """Read the ray and the curves (by key of the row) of a reference; None if missing or damaged."""
    path = _path(out, reference)
    try:
        if path.stat().st_size > MAX_BYTES:
            return None
        found = _FILE.validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return None
    curves = {curve.key: Curve(found.distance, found.exact, curve.values) for curve in found.curves}
    return (found.u, found.v), curves


def write(
    out: Path, reference: str, ray: Ray, curves: Mapping[str, Curve], rows: Mapping[str, SweepRow]
) -> None:
    """Write the curves of a reference, for those of its rows that have one.

    Maps may place their points differently; all are resampled at the points of the first.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    shown = [row for row in rows.values() if row.reference == reference and row.key in curves]
    if not shown:
        return
    # In the same order, whichever process was first.
    shown.sort(key=lambda row: (row.basis, row.coeffs, row.key))
    first = curves[shown[0].key]
    labels = _labels(shown)
    content = {
        "volume": shown[0].volume,
        "light": 0,
        "u": ray[0],
        "v": ray[1],
        "distance": first.distance,
        "exact": first.exact,
        "curves": [
            {"label": label, "key": row.key, "values": _at(first.distance, curves[row.key])}
            for row, label in zip(shown, labels, strict=True)
        ],
    }
    path = _path(out, reference)
    with one_line_errors(path.parent, "made"):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(content, allow_nan=False))


def _at(distance: list[float], curve: Curve) -> list[float]:
    if curve.distance == distance:
        return curve.values
    return _numbers(np.interp(distance, curve.distance, curve.values))


_PARTS = {
    "density_weighting": "α={:g}",
    "target": "{}",
    "range": "{}",
    "fit": "{}",
    "lookup": "{}",
    "storage": "{}",
    "map_res": "{}²",
}
"""How a label shows a setting that differs among the rows of a basis."""


def _labels(rows: Iterable[SweepRow]) -> list[str]:
    """``klt n=8``, and the settings that distinguish it from other rows of its basis."""
    rows = list(rows)
    labels = []
    for row in rows:
        others = [other for other in rows if other.basis == row.basis]
        parts = [f"{row.basis} n={row.coeffs}"]
        for name, text in _PARTS.items():
            value = getattr(row, name)
            if len({getattr(other, name) for other in others}) > 1:
                parts.append(f"α={value}" if value == "auto" else text.format(value))
        labels.append(" ".join(parts))
    return labels


def _path(out: Path, reference: str) -> Path:
    return out / "curves" / f"{reference}.json"
