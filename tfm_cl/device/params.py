"""The one parameter struct that host and kernels share, declared once.

The C text is generated from ``FIELDS`` and put in front of every kernel. All members are 4 bytes wide,
so there is no padding on any device; a test compares the offsets all the same.

On the device, "world" means the world moved so that the centre of the volume's bounds is the origin:
scenes far from the origin keep float32's full precision.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.maps.bases.base import UNIFORM_SHARE
from tfm_cl.model import LARGEST_COORDINATE
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.bodies.volumes import MOST_VOLUMES
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.lights import Light
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.scene import Scene

if TYPE_CHECKING:
    from tfm_cl.device.bricks import BrickGrid


@dataclass(frozen=True)
class Field:
    """One member of the struct."""

    kind: Literal["float", "int"]
    name: str
    count: int
    meaning: str


FIELDS = (
    Field(
        "float",
        "index_from_world",
        12 * MOST_VOLUMES,
        "3x4 row major, to each padded grid: 0 is the zero border",
    ),
    Field("int", "grid_size", 3 * MOST_VOLUMES, "padded grid x, y, z: one zero voxel on each side"),
    Field("int", "brick_count", 3 * MOST_VOLUMES, "bricks x, y, z that cover it"),
    Field("int", "first_brick", MOST_VOLUMES, "where each volume's bricks begin in the table"),
    Field("int", "pool_size", 1, "records in a pool"),
    Field("int", "skip_empty", 1, "1: jump over bricks without density"),
    Field("float", "density_scale", MOST_VOLUMES, "density = density_scale * voxel as stored"),
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
    Field("int", "paper_attenuation", 1, "1: algorithm 1 as printed, dimmed within the light's cone only"),
    Field("float", "cutoff", 1, "a camera ray ends where no colour has more transmittance left"),
    Field("float", "world_from_light", 12, "3x4 row major, rigid; the light's map looks along +z"),
    Field("float", "light_from_world", 12, "its inverse"),
    Field("float", "light_shape", 4, "parameters of the light's kind"),
    Field("float", "chart", 4, "scale and offset from the plane of the light's chart to u and v"),
    Field("float", "cone_from_light", 12, "3x4 row major, rotation to where a spot's axis is z"),
    Field("float", "light_intensity", 3, "RGB"),
    Field("float", "light_nearest_inverse", 1, "inverse-square falloff stops growing at this 1 / distance"),
    Field("float", "medium_half", 3, "homogeneous: half sizes of the box, or the radius first; middle at 0"),
    Field("float", "medium_density", 1, "density of a homogeneous medium"),
    Field("float", "medium_visible", 1, "distance in it beyond which the cutoff ends a camera ray"),
    Field("int", "light_in_medium", 1, "1: the light lies in it"),
    Field("int", "lit_pixels", 4, "x0, y0, x1, y1 of the pixels that the light may change"),
    Field("int", "first_lit", 1, "where what is known of their solids begins in its buffer"),
    Field("int", "shadow_res", 1, "texels along each side of the shadow map"),
    Field("int", "first_shadow", 1, "where it begins in its buffer"),
    Field("int", "texture_size", 2, "columns and rows of the light's texture"),
    Field("int", "first_texel", 1, "where it begins in its buffer"),
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

FARTHEST = 3e4
"""Sizes of the medium between it and the camera or a light, at which float32 errs by about a hundredth of the
picture; ten times as far, the picture is another one."""
LEAST_CUTOFF = 1e-7
"""Of a camera ray in a homogeneous medium: it may be infinite."""
SMALLEST_SIZE = 1e-6
"""World units, of what a millionth is the distance at which inverse-square falloff stops growing."""

DTYPE = np.dtype(
    [
        (f.name, np.float32 if f.kind == "float" else np.int32, (f.count,) if f.count > 1 else ())
        for f in FIELDS
    ]
)


def c_declaration() -> str:
    """Return the struct as OpenCL C, one commented member a line, and ``PARAMS``, how kernels take it."""
    members = (
        f"  {f.kind} {f.name}{f'[{f.count}]' if f.count > 1 else ''};  /* {f.meaning} */" for f in FIELDS
    )
    return "\n".join(["typedef struct {", *members, "} Params;", "#define PARAMS __global const Params *"])


def fill(
    scene: Scene,
    light: Light,
    *,
    crop: tuple[int, int, int, int],
    density_weighting: float,
    bricks: BrickGrid | None = None,
    field: NDArray[np.float32] | None = None,
    number_unit: float = 1.0,
    texture_size: tuple[int, int] = (1, 1),
) -> NDArray[Any]:
    """Return the struct, as a 0-d array of `DTYPE`, for one light of a scene.

    Without ``bricks`` no density can be read.
    """
    params = np.zeros((), dtype=DTYPE)
    world_from_device = _world_from_device(scene)
    device_from_world = np.linalg.inv(world_from_device)
    for i, volume in enumerate(scene.volume.parts):
        _fill_volume(params, i, volume, world_from_device)
    if bricks is not None:
        _fill_bricks(params, scene.volume.parts, bricks)
    params["skip_empty"] = scene.march.skip_empty
    params["shadow_res"] = scene.shadow.res
    params["texture_size"] = texture_size
    _fill_view(params, scene, crop, device_from_world)
    frame = light.frame()
    device_from_light = device_from_world @ frame.world_from_light
    params["world_from_light"] = device_from_light[:3].ravel()
    params["light_from_world"] = np.linalg.inv(device_from_light)[:3].ravel()
    params["light_shape"][: len(frame.shape)] = frame.shape
    params["chart"] = frame.chart
    params["cone_from_light"] = _rotation(frame.cone_from_light)
    params["light_intensity"] = light.intensity
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


def fill_homogeneous(scene: Scene, volume: Homogeneous, crop: tuple[int, int, int, int]) -> NDArray[Any]:
    """Return the structs, [lights] of `DTYPE`, for the lights of a scene with a homogeneous volume.

    What says where a light's shadow map, texture and lit pixels are is left at 0.

    Parameters
    ----------
    scene
        Of single lights, fitted to the volume.
    volume
        Its volume.
    crop
        Pixels x0, y0, x1, y1 that are rendered.
    """
    world_from_device = _world_from_device(scene)
    device_from_world = np.linalg.inv(world_from_device)
    common = np.zeros((), dtype=DTYPE)
    _fill_view(common, scene, crop, device_from_world)
    half_sizes = volume.half_sizes
    if np.isfinite(half_sizes).all():
        common["medium_half"] = half_sizes
    common["medium_density"] = volume.density
    extinction = scene.medium.sigma_t * volume.density
    seen = extinction[extinction > 0]
    if seen.size:
        common["medium_visible"] = min(visible_depth(scene.march.cutoff) / seen.min(), LARGEST_COORDINATE)
    lights = scene.lights
    params = np.broadcast_to(common, len(lights)).copy()
    frames = [light.frame() for light in lights]
    device_from_light = device_from_world @ np.stack([frame.world_from_light for frame in frames])
    params["world_from_light"] = device_from_light[:, :3].reshape(-1, 12)
    params["light_from_world"] = np.linalg.inv(device_from_light)[:, :3].reshape(-1, 12)
    for shape, frame in zip(params["light_shape"], frames, strict=True):
        shape[: len(frame.shape)] = frame.shape
    params["chart"] = [frame.chart for frame in frames]
    params["cone_from_light"] = [_rotation(frame.cone_from_light) for frame in frames]
    params["light_intensity"] = [light.intensity for light in lights]
    # A sun is in no medium, wherever its map begins.
    placed = np.array([light.lit_cone() is not None for light in lights])
    params["light_in_medium"] = placed & volume.contains(device_from_light[:, :3, 3])
    sizes = np.full(len(lights), np.linalg.norm(half_sizes) * 2)
    if not np.isfinite(sizes).all():
        # Nothing else has a size where the medium has none.
        sizes = np.linalg.norm(device_from_light[:, :3, 3], axis=1)
    params["light_nearest_inverse"] = 1e6 / np.maximum(sizes, SMALLEST_SIZE)
    return params


def _rotation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """3×3 to 3×4 row by row, without a translation."""
    return np.column_stack([matrix, np.zeros(3)]).ravel()


def check_distances(scene: Scene) -> None:
    """Refuse what float32 could not place exactly enough; a sun may be anywhere.

    Raises
    ------
    SceneError
        The camera, or a light that arrives, is more than `FARTHEST` sizes of the medium away from it.
    """
    bounds, lights = scene.volume.bounds, scene.lights
    if not np.isfinite(bounds).all():
        return
    middle, size = bounds.mean(axis=0), float(np.linalg.norm(bounds[1] - bounds[0]))
    places = np.array([scene.camera.from_, *(getattr(light, "from_", middle) for light in lights)])
    distances = np.linalg.norm(places - middle, axis=1)
    for i in np.flatnonzero(distances > FARTHEST * size).tolist():
        name, instead = "camera.from", "come nearer, with a larger fov"
        if i > 0:
            cone = lights[i - 1].lit_cone()
            if cone is None or cone.reach < distances[i] - size:
                continue  # its place does not matter, or nothing of it arrives
            name, instead = f"light {i - 1}: light.from", "come nearer, or use a light of the type sun"
        raise SceneError(
            f"{name} = {places[i].tolist()}: is {distances[i]:g} world units from the medium, whose size is "
            f"{size:.3g}; float32 on the device places things up to {FARTHEST:g} sizes away: {instead}"
        )


def visible_depth(cutoff: float) -> float:
    """Optical depth at which a camera ray in a homogeneous medium ends."""
    return -math.log(max(cutoff, LEAST_CUTOFF))


def reference_extinction(medium: Medium) -> float:
    """Choose the extinction at density 1 that visibility is meant for: of the colour that sees deepest."""
    seen = medium.sigma_t[medium.sigma_t > 0]
    return float(seen.min()) if seen.size else 1.0


def padded_from_index() -> NDArray[np.float64]:
    """4×4: from voxel indices to the grid with its border of one voxel."""
    matrix = np.eye(4)
    matrix[:3, 3] = 1.0
    return matrix


def _world_from_device(scene: Scene) -> NDArray[np.float64]:
    """4×4: the device's origin is the middle of the volume, or the camera where it has none."""
    matrix = np.eye(4)
    bounds = scene.volume.bounds
    matrix[:3, 3] = bounds.mean(axis=0) if np.isfinite(bounds).all() else scene.camera.from_
    return matrix


def _fill_view(
    params: NDArray[Any],
    scene: Scene,
    crop: tuple[int, int, int, int],
    device_from_world: NDArray[np.floating],
) -> None:
    """Fill in medium, camera and march: what is the same for all lights and volumes."""
    params["cutoff"] = scene.march.cutoff
    params["paper_attenuation"] = scene.march.attenuation == "paper"
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


def _fill_volume(
    params: NDArray[Any], i: int, volume: Volume, world_from_device: NDArray[np.float64]
) -> None:
    z, y, x = volume.shape
    padded_from_device = padded_from_index() @ np.linalg.inv(volume.world_from_index) @ world_from_device
    params["index_from_world"][12 * i : 12 * i + 12] = padded_from_device[:3].ravel()
    params["grid_size"][3 * i : 3 * i + 3] = (x + 2, y + 2, z + 2)


def _fill_bricks(params: NDArray[Any], volumes: Sequence[Volume], bricks: BrickGrid) -> None:
    params["pool_size"] = bricks.pool_size
    first = 0
    for i, (volume, count) in enumerate(zip(volumes, bricks.brick_counts, strict=True)):
        params["brick_count"][3 * i : 3 * i + 3] = count
        params["first_brick"][i] = first
        params["density_scale"][i] = volume.density_scale * 2.0 ** bricks.exponents[i]
        first += math.prod(count)


def _fill_camera(params: NDArray[Any], camera: Camera, device_from_world: NDArray[np.floating]) -> None:
    width, height = camera.res
    right, up, forward, position = (device_from_world @ camera.world_from_camera)[:3].T
    tangent = np.tan(np.radians(camera.fov) / 2)
    params["camera_position"] = position
    params["camera_right"] = right * tangent * width / height
    params["camera_up"] = up * tangent
    params["camera_forward"] = forward
    params["image_size"] = (width, height)
