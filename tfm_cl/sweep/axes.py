"""The axes of a sweep: map settings in every combination."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import InputError, SceneError
from tfm_cl.maps.bases import BASES, BEST
from tfm_cl.maps.bases.base import USUAL_COUNTS
from tfm_cl.maps.resolved import resolve
from tfm_cl.model import decided, in_words
from tfm_cl.scene.settings import MapSettings
from tfm_cl.sweep.rows import in_place_of

if TYPE_CHECKING:
    from tfm_cl.sweep.rows import Weighting


@dataclass(frozen=True)
class Axes:
    """Values of each map setting; without any, the scene's own value is used.

    Raises
    ------
    InputError
        If there is no basis, no number of coefficients or no α.
    SceneError
        If no basis of the sweep accepts a value, whatever the other settings are.
    """

    bases: tuple[str, ...]
    coeffs: tuple[int, ...]
    density_weightings: tuple[Weighting, ...]
    ranges: tuple[str, ...] = ()
    fits: tuple[str, ...] = ()
    lookups: tuple[str, ...] = ()
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
            resolve(MapSettings(basis=basis))
        for name, values in (*self._settings().items(), ("density_weighting", self.density_weightings)):
            for value in values:
                self._check(name, value)

    def _settings(self) -> dict[str, tuple[Any, ...]]:
        """Return values by setting, outermost first, without basis and α."""
        settings: dict[str, tuple[Any, ...]] = {
            "range": self.ranges,
            "fit": self.fits,
            "lookup": self.lookups,
            "storage": self.storages,
            "res": self.map_sizes,
            "coeffs": self.coeffs,
        }
        return {name: values for name, values in settings.items() if values}

    def _check(self, name: str, value: Any) -> None:
        refusal: SceneError | None = None
        for basis in self.bases:
            try:
                own = nearest_count(basis, value) if name == "coeffs" else value
                resolve(MapSettings(**{"basis": basis, "coeffs": "auto", name: own}))
            except SceneError as error:
                refusal = refusal or error
            else:
                return
        if refusal:
            raise refusal

    def variants(self, settings: MapSettings) -> tuple[dict[MapSettings, tuple[int, ...]], list[str]]:
        """Return a scene's map settings in every combination, and a line on each deviation from the request.

        A basis is swept over α only if its target is the transmittance; otherwise α has no meaning and is
        ``auto``. A number of coefficients that a basis does not support is replaced by the nearest one that
        it supports. Identical settings appear once. ``bytes`` and ``max_error`` of the scene, which would
        choose the coefficients, are ignored.

        Returns
        -------
        settings, notices
            Resolved settings ordered by basis, range, fit, lookup, storage, map size, α and coefficients,
            each with the requested numbers of coefficients that it replaces; and one line for each basis
            with such replacements and for each reason for which a basis refuses combinations.

        Raises
        ------
        SceneError
            If no combination remains.
        """
        found: dict[MapSettings, tuple[int, ...]] = {}
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
                count = nearest_count(basis, n)
                try:
                    request = settings.replace(**chosen, density_weighting=alpha, coeffs=count)
                    variant = resolve(request).request()
                except SceneError as error:
                    refusals[str(error)] += 1
                    continue
                if variant.target != "transmittance":
                    variant = variant.replace(density_weighting="auto")
                stands_for = found.get(variant, ())
                found[variant] = stands_for if n in {count, *stands_for} else (*stands_for, n)
        if not found:
            raise SceneError(f"no combination of the sweep's settings is possible: {next(iter(refusals))}")
        stand_ins: dict[str, dict[int, int]] = {}
        for variant, asked in found.items():
            for n in asked:
                stand_ins.setdefault(variant.basis, {})[n] = decided(variant.coeffs)
        notices = [
            f"basis '{basis}' has {in_words(BASES[basis].counts)} coefficients: {in_place_of(counts)}"
            for basis, counts in stand_ins.items()
        ]
        notices += [
            f"left out {count} combination{'s' if count > 1 else ''}: {reason}"
            for reason, count in refusals.items()
        ]
        return found, notices


def nearest_count(basis: str, count: Any) -> Any:
    """Return the number of coefficients of a basis nearest to a given one, the larger of two."""
    counts = BASES[BEST if basis == "auto" else basis].counts
    # A number far from all of these is refused by the settings.
    possible = type(count) is int and 1 <= count <= max(*counts, *USUAL_COUNTS)
    return min(counts, key=lambda own: (abs(own - count), -own)) if possible else count


def _unique(values: Iterable[Weighting]) -> list[Weighting]:
    return list(dict.fromkeys(values))
