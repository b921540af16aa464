"""The one parameter struct that host and kernels share, declared once.

The C text is generated from ``FIELDS`` and put in front of every kernel. All members are 4 bytes wide,
so there is no padding on any device; a test compares the offsets all the same.

On the device, "world" means the world moved so that the centre of the volume's bounds is the origin:
scenes far from the origin keep float32's full precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.bases.base import UNIFORM_SHARE
from tfm_cl.camera import Camera
from tfm_cl.lights import Light
from tfm_cl.medium import Medium
from tfm_cl.scene import Scene
from tfm_cl.volume import Volume

if TYPE_CHECKING:
    from tfm_cl.bricks import BrickGrid


@dataclass(frozen=True)
class Field:
    """One member of the struct."""

    kind: Literal["float", "int"]
    name: str
    count: int
    meaning: str


FIELDS = (
    Field("float", "index_from_world", 12, "3x4 row major, to the padded grid: 0 is the zero border"),
    Field("int", "grid_size", 3, "padded grid x, y, z: one zero voxel on each side"),
    Field("int", "brick_count", 3, "bricks x, y, z that cover it"),
    Field("int", "pool_size", 1, "records in a pool"),
    Field("int", "skip_empty", 1, "1: jump over bricks without density"),
    Field("float", "density_scale", 1, "density = density_scale * voxel as stored"),
    Field("float", "sigma_t", 3, "extinction at density 1, RGB, per world unit"),
    Field("float", "albedo", 3, "sigma_s / sigma_t, RGB; 0 where sigma_t is 0"),
    Field("float", "phase", 4, "parameters of the phase function"),
    Field("float", "camera_position", 3, "world"),
    Field("float", "camera_right", 3, "world, times tan(fov/2) * width / height"),
    Field("float", "camera_up", 3, "world, times tan(fov/2)"),
    Field("float", "camera_forward", 3, "world, unit"),
    Field("int", "image_size", 2, "full frame, pixels"),
    Field("int", "crop", 4, "x0, y0, x1, y1 of the pixels that are rendered"),
    Field("int", "view_steps", 1, "samples along the lit part of a camera ray"),
    Field("int", "projective", 1, "1: uniform in projective space (section 4.2), 0: in the world"),
    Field("float", "max_stretch", 1, "longest projective step over the mean one"),
    Field("float", "cutoff", 1, "a camera ray ends where no colour has more transmittance left"),
    Field("float", "world_from_light", 12, "3x4 row major, rigid; the light looks along +z"),
    Field("float", "light_from_world", 12, "its inverse"),
    Field("float", "light_shape", 4, "parameters of the light's kind"),
    Field("float", "light_intensity", 3, "RGB"),
    Field("float", "light_in_grid", 3, "its position in the padded grid"),
    Field("float", "light_nearest_inverse", 1, "inverse-square falloff stops growing at this 1 / distance"),
    Field("int", "map_res", 1, "texels along each side of the map"),
    Field("int", "light_steps", 1, "steps along a light ray"),
    Field("float", "density_weighting", 1, "alpha of eq. 19"),
    Field("float", "inverse_weighting", 1, "1 / alpha"),
    Field("int", "field_res", 1, "entries along each side of the field of ranges"),
    Field("float", "longest_range_inverse", 1, "1 / longest range in the field, world"),
    Field("float", "reference_extinction", 1, "extinction at density 1 that visibility is meant for"),
    Field("float", "number_unit", 1, "optical depth or extinction that a stored 1 stands for"),
    Field("float", "uniform_share", 1, "of the uniform weight in the visibility-weighted fit"),
)

DTYPE = np.dtype(
    [
        (f.name, np.float32 if f.kind == "float" else np.int32, (f.count,) if f.count > 1 else ())
        for f in FIELDS
    ]
)


def c_declaration() -> str:
    """Return the struct as OpenCL C, one commented member a line."""
    members = (
        f"  {f.kind} {f.name}{f'[{f.count}]' if f.count > 1 else ''};  /* {f.meaning} */" for f in FIELDS
    )
    return "\n".join(["typedef struct {", *members, "} Params;"])


def fill(
    scene: Scene,
    light: Light,
    *,
    crop: tuple[int, int, int, int],
    density_weighting: float,
    bricks: BrickGrid | None = None,
    field: NDArray[np.float32] | None = None,
    number_unit: float = 1.0,
) -> NDArray[Any]:
    """Return the struct, as a 0-d array of `DTYPE`, for one light of a scene.

    Without ``bricks`` no density can be read.
    """
    params = np.zeros((), dtype=DTYPE)
    world_from_device = np.eye(4)
    world_from_device[:3, 3] = scene.volume.bounds.mean(axis=0)
    device_from_world = np.linalg.inv(world_from_device)
    _fill_volume(params, scene.volume, world_from_device)
    if bricks is not None:
        params["brick_count"] = bricks.brick_count
        params["pool_size"] = bricks.pool_size
        params["density_scale"] = scene.volume.density_scale * 2.0**bricks.exponent
    params["skip_empty"] = scene.march.skip_empty
    params["cutoff"] = scene.march.cutoff
    sigma_t = scene.medium.sigma_t
    params["sigma_t"] = sigma_t
    params["albedo"] = np.divide(scene.medium.sigma_s, sigma_t, out=np.zeros(3), where=sigma_t > 0)
    phase = scene.medium.phase.kernel_parameters()
    params["phase"][: len(phase)] = phase
    _fill_camera(params, scene.camera, device_from_world)
    params["crop"] = crop
    params["view_steps"] = scene.march.steps
    params["projective"] = scene.march.sampling == "projective"
    params["max_stretch"] = min(scene.march.max_stretch, 1e30)
    frame = light.frame()
    device_from_light = device_from_world @ frame.world_from_light
    params["world_from_light"] = device_from_light[:3].ravel()
    params["light_from_world"] = np.linalg.inv(device_from_light)[:3].ravel()
    params["light_shape"][: len(frame.shape)] = frame.shape
    params["light_intensity"] = light.intensity
    padded_from_world = padded_from_index() @ np.linalg.inv(scene.volume.world_from_index)
    params["light_in_grid"] = (padded_from_world @ frame.world_from_light)[:3, 3]
    params["light_nearest_inverse"] = 1e6 / np.linalg.norm(np.diff(scene.volume.bounds, axis=0))
    if field is not None:
        params["field_res"] = len(field)
        longest = float((field[..., 1] - field[..., 0]).max())
        params["longest_range_inverse"] = 1 / longest if longest > 0 else 0.0
    params["reference_extinction"] = reference_extinction(scene.medium)
    params["number_unit"] = number_unit
    params["uniform_share"] = UNIFORM_SHARE
    params["map_res"] = scene.map.res
    params["light_steps"] = scene.map.steps
    params["density_weighting"] = density_weighting
    params["inverse_weighting"] = 1.0 / density_weighting
    return params


def reference_extinction(medium: Medium) -> float:
    """Choose the extinction at density 1 that visibility is meant for: of the colour that sees deepest."""
    seen = medium.sigma_t[medium.sigma_t > 0]
    return float(seen.min()) if seen.size else 1.0


def padded_from_index() -> NDArray[np.float64]:
    """4×4: from voxel indices to the grid with its border of one voxel."""
    matrix = np.eye(4)
    matrix[:3, 3] = 1.0
    return matrix


def _fill_volume(params: NDArray[Any], volume: Volume, world_from_device: NDArray[np.float64]) -> None:
    z, y, x = volume.shape
    padded_from_device = padded_from_index() @ np.linalg.inv(volume.world_from_index) @ world_from_device
    params["index_from_world"] = padded_from_device[:3].ravel()
    params["grid_size"] = (x + 2, y + 2, z + 2)


def _fill_camera(params: NDArray[Any], camera: Camera, device_from_world: NDArray[np.floating]) -> None:
    width, height = camera.res
    right, up, forward, position = (device_from_world @ camera.world_from_camera)[:3].T
    tangent = np.tan(np.radians(camera.fov) / 2)
    params["camera_position"] = position
    params["camera_right"] = right * tangent * width / height
    params["camera_up"] = up * tangent
    params["camera_forward"] = forward
    params["image_size"] = (width, height)
