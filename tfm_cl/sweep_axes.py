"""What a sweep varies: the map settings of every combination of its axes."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from tfm_cl.errors import InputError, SceneError
from tfm_cl.settings import MapSettings
from tfm_cl.sweep_rows import Weighting


@dataclass(frozen=True)
class Axes:
    """Values of each map setting; where there are none, the scene's own value stays.

    Raises
    ------
    InputError
        When there is no basis, no number of coefficients or no α.
    SceneError
        For a value that no basis of the sweep takes, whatever the other settings are.
    """

    bases: tuple[str, ...]
    coeffs: tuple[int, ...]
    density_weightings: tuple[Weighting, ...]
    ranges: tuple[str, ...] = ()
    fits: tuple[str, ...] = ()
    storages: tuple[str, ...] = ()
    map_sizes: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for name, values in (
            ("basis", self.bases),
            ("number of coefficients", self.coeffs),
            ("α", self.density_weightings),
        ):
            if not values:
                raise InputError(f"a sweep needs at least one {name}")
        for basis in self.bases:
            MapSettings(basis=basis).resolved()
        for name, values in (*self._settings().items(), ("density_weighting", self.density_weightings)):
            for value in values:
                self._check(name, value)

    def _settings(self) -> dict[str, tuple[Any, ...]]:
        """Return values by setting, outer ones first; without basis and α."""
        settings: dict[str, tuple[Any, ...]] = {
            "range": self.ranges,
            "fit": self.fits,
            "storage": self.storages,
            "res": self.map_sizes,
            "coeffs": self.coeffs,
        }
        return {name: values for name, values in settings.items() if values}

    def _check(self, name: str, value: Any) -> None:
        refusal: SceneError | None = None
        for basis in self.bases:
            try:
                MapSettings(**{"basis": basis, "coeffs": "auto", name: value}).resolved()
            except SceneError as error:
                refusal = refusal or error
            else:
                return
        if refusal:
            raise refusal

    def variants(self, settings: MapSettings) -> tuple[list[MapSettings], list[str]]:
        """Return a scene's map settings in every combination, and a line on each kind that is left out.

        A basis is swept over α only where its target is the transmittance; elsewhere α has no meaning and is
        ``auto``. What comes to the same settings is there once. ``bytes`` and ``max_error`` of the scene,
        which choose the coefficients, play no part.

        Returns
        -------
        settings, left_out
            Resolved, by basis, range, fit, storage, map size, α, coefficients; and one line for each reason
            for which a basis refuses combinations.

        Raises
        ------
        SceneError
            When nothing remains.
        """
        found: dict[MapSettings, None] = {}
        refusals: Counter[str] = Counter()
        axes = self._settings()
        coeffs = axes.pop("coeffs")
        for basis, *values in itertools.product(self.bases, *axes.values()):
            chosen = {
                "basis": basis,
                "bytes_": None,
                "max_error": None,
                **dict(zip(axes, values, strict=True)),
            }
            for alpha, n in itertools.product(_unique(self.density_weightings), coeffs):
                try:
                    variant = settings.replace(**chosen, density_weighting=alpha, coeffs=n).resolved()
                except SceneError as error:
                    refusals[str(error)] += 1
                    continue
                if variant.target != "transmittance":
                    variant = variant.replace(density_weighting="auto")
                found[variant] = None
        if not found:
            raise SceneError(f"no combination of the sweep's settings is possible: {next(iter(refusals))}")
        left_out = [
            f"left out {count} combination{'s' if count > 1 else ''}: {reason}"
            for reason, count in refusals.items()
        ]
        return list(found), left_out


def _unique(values: Iterable[Weighting]) -> list[Weighting]:
    return list(dict.fromkeys(values))
