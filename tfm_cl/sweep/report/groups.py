"""Groups of comparable rows: those of one reference, and the settings in which their maps differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from tfm_cl.sweep.rows import BUDGETS, SweepRow, equal_bytes, in_place_of

SETTINGS = {
    "density_weighting": "α {:g}",
    "target": "{}",
    "range": "{} range",
    "fit": "{} fit",
    "lookup": "{}",
    "storage": "{}",
    "map_res": "map {}²",
}
"""Settings in which two maps with one basis and number of coefficients may differ, with their labels."""


@dataclass(frozen=True)
class Group:
    """The rows of one reference: one volume, light, camera and device."""

    title: str
    """Name of the volume, with the beginning of the reference's key if other groups have the same name."""
    rows: list[SweepRow]
    """The rows, ordered by basis and settings, then bytes."""
    varying: list[str]
    """The `SETTINGS` that differ among the rows."""
    varying_of_basis: dict[str, list[str]]
    """Those that differ among the rows of one basis."""
    budgets: dict[str, list[int]]
    """For the key of a row, the `BUDGETS` at which it is the best of its basis."""

    @property
    def first(self) -> SweepRow:
        """Any of the rows, for values that all have in common."""
        return self.rows[0]

    @property
    def converged(self) -> str | None:
        """Key of the converged dual march, if any row was compared with one."""
        return next((row.converged for row in self.rows if row.converged is not None), None)

    @property
    def settings(self) -> str:
        """The values that all rows have in common, in words."""
        row = self.first
        words = [
            f"{row.width}×{row.height} pixels",
            f"{row.view_steps} view and {row.map_steps} light steps",
            *(_word(name, row) for name in SETTINGS if name not in self.varying),
        ]
        return "; ".join([", ".join(words), *self._stand_ins()])

    def _stand_ins(self) -> list[str]:
        """Say for each basis which requested numbers of coefficients it does not support."""
        taken: dict[str, dict[int, int]] = {}
        for row in self.rows:
            for asked in row.stands_for:
                taken.setdefault(row.basis, {})[asked] = row.coeffs
        return [f"{basis} with {in_place_of(counts)} coefficients" for basis, counts in taken.items()]

    def variant(self, row: SweepRow) -> str:
        """Name the settings that distinguish a row's map from others of its basis, except its size."""
        return ", ".join(_word(name, row) for name in self.varying_of_basis[row.basis])


def grouped(rows: Iterable[SweepRow]) -> list[Group]:
    """Group rows by volume and reference, in the order of the rows."""
    found: dict[tuple[str, str], list[SweepRow]] = {}
    for row in rows:
        found.setdefault((row.volume, row.reference), []).append(row)
    # The same volume with another medium, camera, device or version: the key distinguishes them.
    times = Counter(volume for volume, _ in found)
    return [
        _group(volume if times[volume] == 1 else f"{volume} [{reference[:6]}]", members)
        for (volume, reference), members in found.items()
    ]


def _group(title: str, rows: list[SweepRow]) -> Group:
    varying = _varying(rows)
    of_basis = {
        basis: _varying([row for row in rows if row.basis == basis])
        for basis in dict.fromkeys(row.basis for row in rows)
    }
    best = equal_bytes(rows, BUDGETS)[rows[0].volume]
    budgets: dict[str, list[int]] = {}
    for budget in BUDGETS:
        for row in best[budget].values():
            budgets.setdefault(row.key, []).append(budget)

    def order(row: SweepRow) -> tuple[object, ...]:
        return row.basis, *(_sortable(getattr(row, name)) for name in varying), row.bytes_per_texel, row.key

    return Group(title, sorted(rows, key=order), varying, of_basis, budgets)


def _varying(rows: list[SweepRow]) -> list[str]:
    return [name for name in SETTINGS if len({getattr(row, name) for row in rows}) > 1]


def _sortable(value: float | str) -> tuple[float, str]:
    """Order numbers before words such as "auto"."""
    return (float("inf"), value) if isinstance(value, str) else (value, "")


def _word(name: str, row: SweepRow) -> str:
    value = getattr(row, name)
    return f"α {value}" if name == "density_weighting" and value == "auto" else SETTINGS[name].format(value)
