"""A transmittance function map: what the light pass makes and the scatter pass looks up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.constants import STORAGE_BITS
from tfm_cl.errors import SceneError
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pyopencl as cl

    from tfm_cl.device.field import FieldOnDevice
    from tfm_cl.maps.bases.base import Functions
    from tfm_cl.maps.light_pass import LightPass, MapBuffers
    from tfm_cl.maps.planned import Planned
    from tfm_cl.maps.resolved import ResolvedMap
    from tfm_cl.scene.bodies import MarchedBody
    from tfm_cl.scene.fields import Fields
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings
    from tfm_cl.scene.solids import Solid


@dataclass(frozen=True, eq=False)
class TransmittanceMap:
    """The transmittance of a field of density along every ray of one light, in a few coefficients per texel.

    Only the density is projected; colours enter as an exponent at look-up (TFM eq. 11-14), so that one
    map serves every ``sigma_s``, ``sigma_a`` and phase function of a scene of one medium. It lives on the
    device of the renderer that built it.
    """

    light: Light
    plan: Planned
    """What was decided before it was built."""
    requested: MapSettings
    """The scene's own."""
    bodies: tuple[MarchedBody, ...]
    """Whose density it holds; bodies of constant density need no map."""
    fields: Fields
    """How their densities make fields."""
    field_index: int
    """Which of these this map is of."""
    solids: tuple[Solid, ...]
    """That stood in the light's way."""
    shadow_res: int
    """Of the shadow map that says how far their shadow leaves the rays open."""
    origin: NDArray[np.float64]
    """[3]: the device's, world."""
    buffers: MapBuffers
    of_light: cl.Buffer
    medium: FieldOnDevice
    light_pass: LightPass

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
        origins, directions = self.light.rays(np.array([[u, v]]))
        parts = [body.interval(origins[0], directions[0]) for body in self.bodies]
        met = [(low, high) for low, high in parts if low < high]
        if not met:
            raise SceneError(f"the light ray of map position {u:g}, {v:g} misses the medium")
        begin, end = min(low for low, _ in met), max(high for _, high in met)
        edges = np.linspace(begin, end, count + 1)
        distance = (edges[:-1] + edges[1:]) / 2
        points = origins[0] + distance[:, None] * directions[0]
        depth = np.zeros(count)
        for body, weights in zip(self.bodies, self.fields.weights[:, :, self.field_index], strict=True):
            channels = body.depths_along(origins[0], directions[0], edges)
            depth += self.extinction * (channels @ weights[: channels.shape[1]])
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

    def check_serves(self, scene: Scene, light: Light, fields: Fields, field: int) -> None:
        """Raise `SceneError` unless this map is right for a fitted light of a scene and one of its fields."""
        same_bodies = len(self.bodies) == len(scene.marched) and all(
            one.same_density(other) for one, other in zip(self.bodies, scene.marched, strict=False)
        )
        changed = self.fields.first_change(fields) if same_bodies else None
        for what, same in (
            ("volume", same_bodies),
            (f"colour of {_name(scene, changed)}: its share of what maps hold has changed", changed is None),
            ("field of density", self.field_index == field),
            ("set of solids", self.solids == scene.solids),
            ("shadow.res", not self.solids or self.shadow_res == scene.shadow.res),
            ("light", self.light.map_key() == light.map_key()),
            ("map settings", self.requested == scene.map),
            ("voxel type", not scene.grids or self.medium.voxels == scene.march.voxels),
        ):
            if not same:
                raise SceneError(f"was built for another {what}; build the maps again")


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
