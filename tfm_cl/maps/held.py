"""Where a map is: on the device it was built on, or in arrays from a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from tfm_cl.device.bricks import ONE_FIELD
from tfm_cl.device.device import choose_device
from tfm_cl.device.field import FieldOnDevice, Met
from tfm_cl.device.launch import Launcher
from tfm_cl.device.structs import GRID, LIGHT
from tfm_cl.errors import SceneError
from tfm_cl.maps.light_pass import LightPass, MapBuffers, StoredNumbers

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.maps.resolved import ResolvedMap

NO_VOXELS: dict[str, int | str] = {"TFM_VOXEL_BITS": 32, "TFM_POOLS": 1, "TFM_VOXEL_CHANNELS": 1}
"""Macros of kernels that know where grids are, and read none."""
OF_LIGHT = ("world_from_light", "light_from_world", "cone_from_light", "shape", "chart")
"""Members of a light's struct that say where its rays are."""
OF_GRID = ("index_from_world", "world_from_index", "size")
"""Members of a grid's struct that say where it is."""


@dataclass(frozen=True)
class OnDevice:
    """A map on a device, and what was built to march its rays."""

    buffers: MapBuffers
    of_light: cl.Buffer
    medium: FieldOnDevice
    light_pass: LightPass

    def light_struct(self) -> NDArray[Any]:
        """Return what kernels were told of the light."""
        return self.light_pass.struct(self.of_light, 1, LIGHT).reshape(())

    def grid_structs(self) -> NDArray[Any]:
        """Return what kernels were told of the grids, [grids]."""
        count = int(self.medium.defines["TFM_GRIDS"])
        return self.light_pass.struct(self.medium.arguments["grids"], count, GRID)


@dataclass(frozen=True)
class Loaded:
    """A map from a file, of which no density is known."""

    digests: tuple[str, ...]
    """Of the bodies that it holds the density of."""
    numbers: StoredNumbers
    light: NDArray[Any]
    """The light's struct."""
    grids: NDArray[Any]
    """[grids], their structs."""
    device: str | None
    """Part of the name of the device that evaluates it."""
    settings: ResolvedMap
    extinction: float
    field_index: int
    voxels: str
    margin: float

    def on_device(self) -> OnDevice:
        """Put it on a device of its own."""
        launcher = Launcher(choose_device(self.device))
        light_pass = LightPass(launcher)
        medium = FieldOnDevice(
            index=self.field_index,
            extinction=self.extinction,
            strongest=self.extinction,
            voxels=self.voxels,
            defines=NO_VOXELS | ONE_FIELD | {"TFM_GRIDS": len(self.grids)},
            arguments={"grids": launcher.upload("the grids", self.grids)},
            headers=(),
            met_by=_unknown,
            margin=self.margin,
        )
        of_light = launcher.upload("the light", self.light)
        return OnDevice(light_pass.held(self.settings, self.numbers), of_light, medium, light_pass)


def _unknown(*_: object) -> Met:
    raise SceneError("the map comes from a file and knows no density; build it again, or render with it")
