"""A map as it is built: every choice of `MapSettings` made, in plain numbers and names."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from tfm_cl.constants import STORAGE_BITS
from tfm_cl.errors import SceneError
from tfm_cl.maps.bases import BASES, BEST, Basis
from tfm_cl.maps.bases.base import Fit, Lookup, Range, Target
from tfm_cl.maps.bases.given import functions_in
from tfm_cl.model import Model, decided
from tfm_cl.scene.settings import DEFAULT_COEFFS, MapSettings

if TYPE_CHECKING:
    from tfm_cl.scene.lights.base import Light

MOST_WEIGHTED = 32
"""Most numbers that the fit ``visibility`` finds: a ray sums n (n + 1) / 2 products for it."""
FIELD_BYTES = 16
"""Bytes of an entry of the field of ranges: begin, end, slope beyond the end, and last density."""


class ResolvedMap(Model):
    """What the passes read of a map; its names are those of `MapSettings`, and nothing is ``"auto"``."""

    SECTION: ClassVar[str] = "map"

    basis: str
    coeffs: int
    density_weighting: float | None = None
    """α of eq. 19; None until the light's rays have been looked at, where it is left to them."""
    target: Target
    fit: Fit
    range: Range
    slicing: Literal["uniform", "density", "gamma"]
    lookup: Lookup | Literal["lattice"]
    functions: str = ""
    """Data of functions that the basis is given; empty: it learns them, if it learns any."""
    res: int
    steps: int
    deposits: Literal["steps", "depth"]
    storage: Literal["f32", "f16", "u8"]
    blur: float
    blur_kernel: Literal["box", "gaussian"] = Field(default="gaussian")

    @property
    def between_texels(self) -> Lookup:
        """How kernels look a point up: at the points of a lattice as the basis does best."""
        return BASES[self.basis].defaults.lookup if self.lookup == "lattice" else self.lookup

    @property
    def bytes_per_texel(self) -> float:
        """Bytes of a texel: its coefficients, and its share of the field of ranges."""
        return _bytes_per_texel(self.coeffs, self.storage, self.range, self.res)

    @property
    def is_weighted(self) -> bool:
        """Whether functions and numbers depend on α."""
        return self.target == "transmittance"

    @cached_property
    def without_alpha(self) -> ResolvedMap:
        """The same, without α where nothing depends on it: that follows the rays of all lights."""
        return self if self.is_weighted else self.replace(density_weighting=None)

    @property
    def learns(self) -> bool:
        """Whether the functions of a map follow from its own light rays."""
        return not self.functions and BASES[self.basis].learns(self)

    @property
    def lasts(self) -> bool:
        """Whether functions that were learnt once can be given to maps of other frames."""
        return BASES[self.basis].lasts(self)

    @property
    def is_linear(self) -> bool:
        """Whether the coefficients are linear in the density."""
        return self.target != "transmittance" and self.fit == "l2" and BASES[self.basis].lerps

    def of_light(self, light: Light) -> ResolvedMap:
        """Return the settings of a light's own map, which may be smaller than others."""
        most = light.most_texels
        if most is None or most >= self.res:
            return self
        if most not in self._smaller:
            self._smaller[most] = self.replace(res=most)
        return self._smaller[most]

    @cached_property
    def _smaller(self) -> dict[int, ResolvedMap]:
        """By texels along a side: dozens of lights have the same."""
        return {}

    def request(self) -> MapSettings:
        """Return the settings that ask for exactly this."""
        return MapSettings.from_table(self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Return the section of a scene file that asks for exactly this."""
        table = {key: getattr(self, name, None) for key, name in MapSettings.keys().items()}  # its order
        alpha = "auto" if self.density_weighting is None else self.density_weighting
        return table | {"density_weighting": alpha}


@lru_cache(maxsize=64)
def resolve(settings: MapSettings, *, res: int | None = None, steps: int | None = None) -> ResolvedMap:
    """Make every choice that no light ray is needed for: all but α.

    Parameters
    ----------
    settings
        Without ``max_error``, which is kept by measuring.
    res, steps
        Numbers for ``"auto"`` of the settings.

    Raises
    ------
    SceneError
        Functions that are none of the basis, ``bytes`` that are too few, more than `MOST_WEIGHTED` numbers
        with the fit ``visibility``, or a blur of numbers, or deposits in them, that are not linear in the
        density.
    """
    basis = BASES[BEST if settings.basis == "auto" else settings.basis]
    range_: Range = basis.defaults.range if settings.range == "auto" else settings.range
    res = decided(settings.res) if res is None else res
    coeffs = settings.coeffs
    resolved = ResolvedMap(
        basis=basis.name,
        coeffs=_affordable(settings, basis, range_, res) if coeffs == "auto" else coeffs,
        density_weighting=None if settings.density_weighting == "auto" else settings.density_weighting,
        target=basis.defaults.target if settings.target == "auto" else settings.target,
        fit=basis.defaults.fit if settings.fit == "auto" else settings.fit,
        range=range_,
        slicing=settings.slicing,
        lookup=basis.defaults.lookup if settings.lookup == "auto" else settings.lookup,
        functions=settings.functions,
        res=res,
        steps=decided(settings.steps) if steps is None else steps,
        deposits=settings.deposits,
        storage=settings.storage,
        blur=settings.blur,
        blur_kernel=settings.blur_kernel,
    )
    if resolved.fit == "visibility" and resolved.coeffs > MOST_WEIGHTED:
        raise SceneError(
            f"map.coeffs = {resolved.coeffs}: fit = 'visibility' finds up to {MOST_WEIGHTED}; set fewer, or "
            "fit = 'l2'"
        )
    if resolved.functions:
        _check_functions(resolved)
    if resolved.blur > 0 and (not resolved.is_linear or resolved.range not in ("box", "global")):
        raise SceneError(
            f"map.blur = {settings.blur:g}: needs numbers linear in the density, as basis = 'hcos' with "
            f"range = 'global'; not basis '{basis.name}' with target '{resolved.target}', fit "
            f"'{resolved.fit}', range '{resolved.range}'"
        )
    if resolved.deposits == "depth" and not resolved.is_linear:
        raise SceneError(
            "map.deposits = 'depth': needs numbers linear in the density, as basis = 'fourier' or 'slices'; "
            f"not basis '{basis.name}' with target '{resolved.target}', fit '{resolved.fit}'"
        )
    return resolved


def _check_functions(settings: ResolvedMap) -> None:
    """Refuse functions that are none of the basis."""
    basis = BASES[settings.basis]
    if not settings.lasts or basis.recalled is None:
        raise SceneError(
            f"map.functions: basis '{basis.name}' takes none with fit '{settings.fit}' and slicing "
            f"'{settings.slicing}'; set it to \"\", or leave it out"
        )
    try:
        basis.recalled(settings, functions_in(settings.functions))
    except ValueError as error:
        raise SceneError(
            f"map.functions: {error} for basis '{basis.name}' with coeffs = {settings.coeffs}; set it to "
            '"", and they are learnt'
        ) from None


def field_res(map_res: int) -> int:
    """Entries along each side of a map's field of ranges."""
    return max(2, min(map_res, max(64, map_res // 4)))


def _affordable(settings: MapSettings, basis: Basis, range_: Range, res: int) -> int:
    """Return the most numbers that ``bytes`` leaves room for, or the default."""
    if settings.bytes_ is None:
        return max([n for n in basis.counts if n <= DEFAULT_COEFFS] or [min(basis.counts)])
    counts = [n for n in basis.counts if settings.fit != "visibility" or n <= MOST_WEIGHTED]
    needs = {n: _bytes_per_texel(n, settings.storage, range_, res) for n in counts}
    affordable = [n for n, size in needs.items() if size <= settings.bytes_]
    if not affordable:
        raise SceneError(
            f"map.bytes = {settings.bytes_:g}: basis '{basis.name}' needs at least {min(needs.values()):g}"
        )
    return max(affordable)


def _bytes_per_texel(coeffs: int, storage: str, range_: Range, res: int) -> float:
    numbers = coeffs * STORAGE_BITS[storage] / 8
    return numbers if range_ == "box" else numbers + FIELD_BYTES * (field_res(res) / res) ** 2
