"""A transmittance function map: what the light pass makes and the scatter pass looks up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.constants import STORAGE_BITS
from tfm_cl.device.structs import GRID, LIGHT
from tfm_cl.errors import SceneError
from tfm_cl.maps import map_file
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.held import OF_GRID, OF_LIGHT, Loaded, OnDevice
from tfm_cl.maps.light_pass import STORED, StoredNumbers
from tfm_cl.maps.planned import Making, Planned
from tfm_cl.maps.resolved import resolve
from tfm_cl.scene.bodies.base import MOST_BODIES, around
from tfm_cl.scene.fields import MOST_FIELDS, Fields
from tfm_cl.scene.lights import LIGHTS, parse_light
from tfm_cl.scene.settings import MapSettings

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pyopencl as cl

    from tfm_cl.device.field import FieldOnDevice
    from tfm_cl.device.structs.base import Struct
    from tfm_cl.maps.bases.base import Functions
    from tfm_cl.maps.light_pass import LightPass, MapBuffers
    from tfm_cl.maps.resolved import ResolvedMap
    from tfm_cl.scene.bodies import MarchedBody
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.solids import Solid

MOST_MODES = 1 << 20
"""Numbers, at most, of what a basis learnt, in a file."""
MOST_OF_FIT = 64
"""Numbers of each array of a light's fit."""


@dataclass(frozen=True, eq=False)
class TransmittanceMap:
    """The transmittance of a field of density along every ray of one light, in a few coefficients per texel.

    Only the density is projected; colours enter as an exponent at look-up (TFM eq. 11-14), so that one
    map serves every ``sigma_s``, ``sigma_a`` and phase function of a scene of one medium. It lives on the
    device of the renderer that built it, or comes from a file (`save`, `load`); any renderer takes it.
    """

    light: Light
    plan: Planned
    """What was decided before it was built."""
    requested: MapSettings
    """The scene's own."""
    bodies: tuple[MarchedBody, ...]
    """Whose density it holds; bodies of constant density need no map. Of a map from a file, none."""
    fields: Fields
    """How their densities make fields."""
    field_index: int
    """Which of these this map is of."""
    solids: tuple[Solid, ...]
    """That stood in the light's way; of a map from a file, none."""
    shadow_res: int
    """Of the shadow map that says how far their shadow leaves the rays open."""
    origin: NDArray[np.float64]
    """[3]: the device's, world."""
    held: OnDevice | Loaded

    @cached_property
    def on_device(self) -> OnDevice:
        """Itself on a device: that of its renderer or, from a file, one of its own."""
        return self.held if isinstance(self.held, OnDevice) else self.held.on_device()

    @property
    def buffers(self) -> MapBuffers:
        """Its numbers on the device."""
        return self.on_device.buffers

    @property
    def of_light(self) -> cl.Buffer:
        """The light's struct on the device."""
        return self.on_device.of_light

    @property
    def medium(self) -> FieldOnDevice:
        """What it was built from."""
        return self.on_device.medium

    @property
    def light_pass(self) -> LightPass:
        """That built it, or could have."""
        return self.on_device.light_pass

    @property
    def numbers(self) -> StoredNumbers:
        """Its numbers on the host, as they are stored."""
        if isinstance(self.held, Loaded):
            return self.held.numbers
        return self.light_pass.stored(self.settings, self.buffers)

    @property
    def margin(self) -> float:
        """World units, by which primitives reached beyond their bounds."""
        return (self.held if isinstance(self.held, Loaded) else self.held.medium).margin

    @property
    def voxels(self) -> str:
        """Type of the voxels that were marched; empty without grids."""
        return (self.held if isinstance(self.held, Loaded) else self.held.medium).voxels

    def __repr__(self) -> str:
        size = f"{self.settings.res}×{self.settings.res} texels"
        kind = f"{self.settings.coeffs} coefficients of {self.settings.basis}"
        return f"TransmittanceMap({self.light.type}, {size}, {kind}, {self.nbytes / 2**20:.1f} MiB)"

    @property
    def settings(self) -> ResolvedMap:
        """Resolved: no ``"auto"``."""
        return self.plan.settings

    @property
    def density_weighting(self) -> float:
        """The α in use."""
        return self.plan.density_weighting

    @property
    def largest_optical_depth(self) -> float:
        """Of the field, along the rays of all the scene's lights, on a coarse map."""
        return self.plan.deepest

    @property
    def extinction(self) -> float:
        """Extinction at density 1 that visibility is meant for: fit, range ``visible``, `residual`."""
        return self.plan.extinction

    @property
    def number_unit(self) -> float:
        """Unit in which numbers are stored (half precision only)."""
        return self.plan.number_unit

    @property
    def functions(self) -> Functions | None:
        """Of the basis."""
        return self.plan.functions

    @property
    def field(self) -> NDArray[np.float32]:
        """Ranges of the light rays, [size, size, 4].

        Begin and end (distances from the light), slope beyond, last density. Without meaning for the range
        ``box``.
        """
        return self.plan.field

    @cached_property
    def coefficients(self) -> NDArray[np.float32]:
        """The coefficients of every texel, float32 [y, x, n] (a copy on the host)."""
        with self.light_pass.turn:
            return self.light_pass.read(self.plan, self.buffers)

    @cached_property
    def occupied(self) -> NDArray[np.float32]:
        """Where along every texel's light ray there is density, float32 [y, x, 2].

        Distances from the light, world units, of the begin of the first step with density and of the end of
        the last, within the map's range; both are 0 for a ray without density.
        """
        with self.light_pass.turn:
            return self.light_pass.read_occupied(self.settings, self.buffers)

    @property
    def nbytes(self) -> int:
        """Size of the texels' numbers on the device; `bytes_per_texel` has the ranges too."""
        return STORAGE_BITS[self.settings.storage] // 8 * self.settings.coeffs * self.settings.res**2

    @property
    def kept_bytes(self) -> int:
        """Size on the device of all that belongs to it, and on the host of what it was planned with."""
        occupied = 8 * self.settings.res**2
        clip = 0 if self.plan.clip is None else self.plan.clip.nbytes
        return self.nbytes + occupied + self.field.nbytes + clip

    @property
    def bytes_per_texel(self) -> float:
        """All numbers of a texel and its share of the ranges."""
        return self.settings.bytes_per_texel

    @cached_property
    def _residuals(self) -> NDArray[np.float32]:
        with self.light_pass.turn:
            return self.light_pass.residual(self.plan, self.light, self.of_light, self.medium, self.buffers)

    @cached_property
    def residual(self) -> NDArray[np.float32]:
        """Where the map cannot be trusted: relative error of T of every texel, float32 [y, x].

        √(∫ D (T_map - T)² / ∫ D T²) along the texel's light ray, with T marched in four times the map's
        steps between the medium's bounds, for the extinction `extinction`; 0 where the ray meets no density.
        """
        error, light = self._residuals[..., 0], self._residuals[..., 1]
        return np.sqrt(np.divide(error, light, out=np.zeros_like(error), where=light > 0))

    @property
    def error(self) -> float:
        """`residual` of all rays together: √(Σ ∫ D (T_map - T)² / Σ ∫ D T²)."""
        error, light = self._residuals.sum(axis=(0, 1), dtype=np.float64)
        return float(np.sqrt(error / light)) if light > 0 else 0.0

    @property
    def grain(self) -> float:
        """World units, what it cannot tell apart: a step along its rays and a texel across, at most."""
        return grain_of(self.light, self.bodies, self.settings, self.field)

    def curve(
        self, u: float, v: float, count: int = 256
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Follow one light ray: what the map says of its transmittance, and what is true.

        Parameters
        ----------
        u, v
            Map position in [0, 1]².
        count
            Points along the ray between the medium's bounds.

        Returns
        -------
        distance, exact, of_map
            float64 [count]: distances from the light, and the transmittance for the extinction `extinction`,
            marched on the host in steps between the points, and looked up.

        Raises
        ------
        SceneError
            When the ray misses the medium.
        """
        if isinstance(self.held, Loaded):
            raise SceneError("a map from a file knows no density to follow its rays through; build it again")
        origins, directions = self.light.rays(np.array([[u, v]]))
        parts = [body.interval(origins[0], directions[0]) for body in self.bodies]
        met = [(low, high) for low, high in parts if low < high]
        if not met:
            raise SceneError(f"the light ray of map position {u:g}, {v:g} misses the medium")
        begin, end = min(low for low, _ in met), max(high for _, high in met)
        edges = np.linspace(begin, end, count + 1)
        distance = (edges[:-1] + edges[1:]) / 2
        points = origins[0] + distance[:, None] * directions[0]
        fields = self.fields.depths_along(self.bodies, origins[0], directions[0], edges)
        depth = self.extinction * fields[:, self.field_index]
        exact = np.exp(-(np.cumsum(depth) - 0.5 * depth))
        return distance, exact, self.evaluate(points, self.extinction).astype(np.float64)

    def evaluate(self, points: ArrayLike, sigma_t: ArrayLike = 1.0) -> NDArray[np.float32]:
        """Transmittance from the light to points, as the view pass sees it.

        Parameters
        ----------
        points
            World positions, shape (..., 3).
        sigma_t
            Extinction coefficient at density 1: one number, or RGB. The default gives the map's own
            colourless transmittance (eq. 13).

        Returns
        -------
        ndarray
            T in [0, 1], shape (...), or (..., 3) for RGB; 0 where the light does not reach.

        Raises
        ------
        SceneError
            When the points are not finite triples.
        """
        world = np.asarray(points, dtype=np.float64)
        if world.shape[-1:] != (3,) or not np.isfinite(world).all():
            raise SceneError(f"points are finite positions of shape (..., 3); got the shape {world.shape}")
        device = (world - self.origin).astype(np.float32).reshape(-1, 3)
        with self.light_pass.turn:
            depths = self.light_pass.evaluate(
                self.plan, self.light, self.of_light, self.medium, self.buffers, device
            )
        depths = depths.reshape(world.shape[:-1])
        sigma = np.asarray(sigma_t, dtype=np.float32)
        reached = depths >= 0
        if sigma.ndim:
            depths, reached = depths[..., None], reached[..., None]
        transmittance: NDArray[np.float32] = np.where(reached, np.exp(-sigma * np.maximum(depths, 0)), 0)
        return transmittance.astype(np.float32)

    def save(self, path: str | Path) -> None:
        """Write it to a file, from which `load` makes the same map again, anywhere.

        Parameters
        ----------
        path
            An ``.npz`` archive; the file appears whole or not at all.

        Raises
        ------
        InputError
            Another extension, or it cannot be written.
        """
        map_file.write(path, *saved(self))

    @classmethod
    def load(cls, path: str | Path, device: str | None = None) -> TransmittanceMap:
        """Read a map that `save` wrote.

        It evaluates points, and a `Renderer` renders with it, bit by bit as with the one that was saved. Of
        the volume it knows only whether a scene's is the same: it follows no `curve` and measures no
        `residual`.

        Parameters
        ----------
        path
            The file.
        device
            The OpenCL device that evaluates points, named as for `Renderer`, which uses its own.

        Raises
        ------
        InputError
            Missing, damaged, no map, or one of a newer version.
        """
        return loaded(map_file.read(path), device)

    def check_serves(self, scene: Scene, light: Light, fields: Fields, field: int) -> None:
        """Raise `SceneError` unless this map is right for a fitted light of a scene and one of its fields."""
        same_bodies = self._is_of(scene.marched)
        changed = self.fields.first_change(fields) if same_bodies else None
        for what, same in (
            ("volume", same_bodies),
            (f"colour of {_name(scene, changed)}: its share of what maps hold has changed", changed is None),
            ("field of density", self.field_index == field),
            # Of solids from a file nothing is left but where they end the rays: the renderer looks there.
            ("set of solids", isinstance(self.held, Loaded) or self.solids == scene.solids),
            ("shadow.res", not scene.solids or self.shadow_res == scene.shadow.res),
            ("light", self.light.map_key() == light.map_key()),
            ("map settings", self.requested == scene.map),
            ("voxel type", not scene.grids or self.voxels == scene.march.voxels),
        ):
            if not same:
                raise SceneError(f"was built for another {what}; build the maps again")

    def _is_of(self, bodies: Sequence[MarchedBody]) -> bool:
        """Tell whether the density of some bodies is the one that it holds."""
        if isinstance(self.held, Loaded):
            return self.held.digests == tuple(body.digest for body in bodies)
        return len(self.bodies) == len(bodies) and all(
            one.same_density(other) for one, other in zip(self.bodies, bodies, strict=False)
        )


def grain_of(
    light: Light, bodies: Sequence[MarchedBody], settings: ResolvedMap, field: NDArray[np.floating]
) -> float:
    """`TransmittanceMap.grain` of a fitted light's map: of bodies, settings and ranges of the rays."""
    if settings.range == "box":
        low, high = around([body.bounds for body in bodies])
        longest = float(np.linalg.norm(high - low))
        corner = np.maximum(*(np.abs(end - light.frame().world_from_light[:3, 3]) for end in (low, high)))
        far = float(np.linalg.norm(corner))
    else:
        longest, far = float((field[..., 1] - field[..., 0]).max()), float(field[..., 1].max())
    return longest / settings.steps + light.footprint(far) / settings.res


def _name(scene: Scene, marched: int | None) -> str:
    """Return what messages call a body that is marched."""
    if marched is None:
        return ""
    body = scene.marched[marched]
    return f"volume.{scene.bodies.index(body)} ({body.label})" if len(scene.bodies) > 1 else body.label


def saved(light_map: TransmittanceMap) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return what `map_file.write` writes of a map."""
    plan, held = light_map.plan, light_map.on_device
    table, light = plan.settings.to_dict(), light_map.light
    del table["density_weighting"]  # what was decided may be beyond what can be asked for
    home = light_map.held
    digests = home.digests if isinstance(home, Loaded) else [body.digest for body in light_map.bodies]
    known = LIGHTS[light.type].keys()
    numbers, fields = light_map.numbers, light_map.fields
    about = {
        "settings": table,
        "requested": light_map.requested.to_dict(),
        "light": {key: value for key, value in light.to_dict().items() if key in known and key != "texture"},
        "bodies": list(digests),
        "voxels": light_map.voxels,
        "samples": numbers.samples,
        "hits": numbers.hits,
        "field_index": light_map.field_index,
        "shadow_res": light_map.shadow_res,
        "number_unit": plan.number_unit,
        "density_weighting": plan.density_weighting,
        "extinction": plan.extinction,
        "largest_optical_depth": plan.deepest,
        "margin": light_map.margin,
    }
    arrays = {
        "numbers": numbers.values,
        "limits": numbers.limits,
        "occupied": numbers.occupied,
        "ranges": plan.field,
        "origin": light_map.origin,
        "rgb_from_field": fields.rgb_from_field,
        "weights": fields.weights,
        "sigma_t": fields.sigma_t,
    }
    if plan.clip is not None:
        arrays["clip"] = plan.clip
    if plan.functions is not None:
        arrays["modes"] = plan.modes
    arrays |= {f"light_{name}": array for name, array in light.fit().items()}
    arrays |= {f"of_light_{name}": held.light_struct()[name] for name in OF_LIGHT}
    arrays |= {f"of_grids_{name}": held.grid_structs()[name] for name in OF_GRID}
    return about, arrays


def loaded(file: map_file.MapFile, device: str | None) -> TransmittanceMap:
    """Make the map of a file; raises `InputError` for what is damaged."""
    fit = {name: file.take(f"light_{name}", file.shape(f"light_{name}"), np.float64) for name in _fit(file)}
    alpha = file.number("density_weighting", 1.0)
    asked, used, of_light = (file.get(key, dict) for key in ("requested", "settings", "light"))
    try:
        requested = MapSettings.from_table(asked)
        settings = resolve(MapSettings.from_table(used)).replace(density_weighting=alpha)
        light = parse_light(of_light)
        light = light.with_fit(fit) if fit else light
        light.frame()
    except SceneError as error:
        raise file.fault("; ".join(map(str, error.args))) from error
    plan, fields = _plan(file, settings), _fields(file)
    res = settings.res
    held = Loaded(
        digests=tuple(map(str, file.get("bodies", list))),
        numbers=StoredNumbers(
            file.take("numbers", (res, res, settings.coeffs), STORED[settings.storage]),
            file.take("limits", (settings.coeffs, 2), np.float32),
            file.take("occupied", (res, res, 2), np.float32),
            file.get("samples", int),
            file.get("hits", int),
        ),
        light=_struct(file, "of_light", LIGHT, OF_LIGHT, ()),
        grids=_struct(file, "of_grids", GRID, OF_GRID, (_count(file, "of_grids_size", MOST_BODIES),)),
        device=device,
        settings=settings,
        extinction=plan.extinction,
        field_index=file.get("field_index", int),
        voxels=file.get("voxels", str),
        margin=file.number("margin"),
    )
    if not 0 <= held.field_index < fields.count:
        raise file.fault(f"field_index = {held.field_index} of {fields.count}")
    return TransmittanceMap(
        light=light,
        plan=plan,
        requested=requested,
        bodies=(),
        fields=fields,
        field_index=held.field_index,
        solids=(),
        shadow_res=file.get("shadow_res", int),
        origin=file.take("origin", (3,), np.float64),
        held=held,
    )


def _fit(file: map_file.MapFile) -> list[str]:
    """Names of the arrays of the light's fit."""
    names = [name.removeprefix("light_") for name in file.arrays if name.startswith("light_")]
    for name in names:
        if np.prod(file.shape(f"light_{name}"), dtype=float) > MOST_OF_FIT:
            raise file.fault(f"the array 'light_{name}' is too large")
    return names


def _count(file: map_file.MapFile, name: str, most: int) -> int:
    """Rows of an array, 1 to ``most``."""
    rows = next(iter(file.shape(name)), 0)
    if not 1 <= rows <= most:
        raise file.fault(f"the array '{name}' has {rows} rows, not 1 to {most}")
    return rows


def _struct(
    file: map_file.MapFile, prefix: str, struct: Struct, names: tuple[str, ...], shape: tuple[int, ...]
) -> NDArray[Any]:
    """Fill structs with those members that a file has."""
    made = np.zeros(shape, struct.dtype)
    for name in names:
        of_member = made.dtype[name]
        made[name] = file.take(f"{prefix}_{name}", (*shape, *of_member.shape), of_member.base)
    return made


def _plan(file: map_file.MapFile, settings: ResolvedMap) -> Planned:
    """Read what was decided before the map was built."""
    rows = _count(file, "ranges", max(2, settings.res))
    if settings.range != "box" and rows == 1:  # looked up between two, at least
        raise file.fault("the array 'ranges' has one row")
    basis, functions = BASES[settings.basis], None
    if basis.learns(settings) and basis.recalled is not None:
        rows_of_modes = file.shape("modes")
        if np.prod(rows_of_modes, dtype=float) > MOST_MODES:
            raise file.fault("the array 'modes' is too large")
        try:
            functions = basis.recalled(settings, file.take("modes", rows_of_modes, np.float32))
        except ValueError as error:
            raise file.fault(f"the array 'modes' {error}") from error
    elif basis.functions is not None:
        functions = basis.functions(settings, None)
    res = settings.res
    clip = file.take("clip", (res, res), np.float32, finite=False) if "clip" in file.arrays else None
    if clip is not None and np.isnan(clip).any():
        raise file.fault("the array 'clip' holds NaN")
    return Planned(
        settings=settings,
        field=file.take("ranges", (rows, rows, 4), np.float32),
        made=Making(lambda: functions),
        number_unit=file.number("number_unit"),
        density_weighting=file.number("density_weighting", 1.0),
        extinction=file.number("extinction"),
        clip=clip,
        deepest=file.number("largest_optical_depth"),
    )


def _fields(file: map_file.MapFile) -> Fields:
    bodies = _count(file, "sigma_t", MOST_BODIES)
    count = file.shape("rgb_from_field")[-1:]
    if not 1 <= sum(count) <= MOST_FIELDS:
        raise file.fault(f"{sum(count)} fields, not 1 to {MOST_FIELDS}")
    return Fields(
        file.take("rgb_from_field", (3, *count), np.float64),
        file.take("weights", (bodies, 3, *count), np.float64),
        file.take("sigma_t", (bodies, 3), np.float64),
    )
