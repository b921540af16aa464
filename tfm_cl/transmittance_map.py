"""A transmittance function map: what the light pass makes and the view pass looks up."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tfm_cl.errors import SceneError
from tfm_cl.lights import Light
from tfm_cl.settings import MapSettings

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.bricks import BrickGrid
    from tfm_cl.passes.light_pass import LightPass, MapBuffers
    from tfm_cl.scene import Scene
    from tfm_cl.volume import Volume


@dataclass(frozen=True, eq=False)
class TransmittanceMap:
    """The transmittance of the density along every ray of one light, in a few numbers a texel.

    Only the density is projected; colours enter as an exponent at look-up (TFM eq. 11–14), so that one
    map serves every ``sigma_s``, ``sigma_a`` and phase function. It lives on the device of the renderer
    that built it.
    """

    light: Light
    settings: MapSettings
    volume: Volume
    density_weighting: float
    """The α in use, also where the settings say ``auto``."""
    largest_optical_depth: float
    """Of the density, along the rays of all the scene's lights, on a coarse map."""
    buffers: MapBuffers
    params: cl.Buffer
    bricks: BrickGrid
    light_pass: LightPass

    @cached_property
    def coefficients(self) -> NDArray[np.float32]:
        """The numbers of every texel, float32 [y, x, n] (a copy on the host)."""
        return self.light_pass.read(self.settings, self.buffers)

    @cached_property
    def occupied(self) -> NDArray[np.float32]:
        """The part of every texel's light ray that holds density, float32 [y, x, 2]: first and last u.

        u is 0 where the ray enters the medium's bounds (or the light itself) and 1 where it leaves them;
        both are 0 for a ray without density. Accurate to a light step.
        """
        return self.light_pass.read_occupied(self.settings, self.buffers)

    @property
    def nbytes(self) -> int:
        """Size on the device, in the storage type."""
        return self.buffers.nbytes

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
        device = (world - self.volume.bounds.mean(axis=0)).astype(np.float32).reshape(-1, 3)
        depths = self.light_pass.evaluate(
            self.settings, self.light, self.params, self.bricks, self.buffers, device
        )
        depths = depths.reshape(world.shape[:-1])
        sigma = np.asarray(sigma_t, dtype=np.float32)
        reached = depths >= 0
        if sigma.ndim:
            depths, reached = depths[..., None], reached[..., None]
        transmittance: NDArray[np.float32] = np.where(reached, np.exp(-sigma * np.maximum(depths, 0)), 0)
        return transmittance.astype(np.float32)

    def check_serves(self, scene: Scene, index: int) -> None:
        """Raise `SceneError` unless this map is right for light ``index`` of a scene."""
        light = scene.lights[index]
        for what, same in (
            ("volume", _same_density(self.volume, scene.volume)),
            ("light", self.light.map_key() == light.map_key()),
            ("map settings", self.settings == scene.map),
            ("voxel type", self.bricks.voxels == scene.march.voxels),
        ):
            if not same:
                raise SceneError(f"map {index + 1} was built for another {what}; build the maps again")


def _same_density(one: Volume, other: Volume) -> bool:
    return (
        one.same_voxels(other)
        and one.density_scale == other.density_scale
        and one.world_from_index is other.world_from_index
    )
