"""Flames: what a volume's medium emits where a grid of its file is hot, whatever the density.

As in pbrt-v4, values of the grid become kelvin as (value - offset) · scale, and the radiance is that of a
black body relative to its peak, times Le_scale. Other than there it is emitted per world unit, and not per
unit of absorption: thicker smoke does not thicken the flame.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError, VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.volume_io.grid import shown
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.scene.blackbody import COLDEST, HOTTEST, Table
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.presets import PRESETS

if TYPE_CHECKING:
    from pathlib import Path

    from tfm_cl.files.volume_io.grid import Grid
    from tfm_cl.scene.bodies.base import Body

AT_ONCE = 1 << 20
"""Voxels whose colours are looked up together."""


def flame_of(body: Body, medium: Medium) -> Volume | None:
    """Return what the temperatures of a body's medium emit, as a volume that only emits; None without any.

    Its grid is read once for all copies of the volume.

    Raises
    ------
    SceneError
        The body is no grid of a file; temperatures that are impossible.
    VolumeError
        There is no such grid (the message lists the names), or it cannot be read.
    """
    if medium.temperature is None:
        return None
    asked = f"medium.temperature = {shown(medium.temperature)}"
    if not isinstance(body, Volume) or body.source is None:
        raise SceneError(
            f"{asked}: {body.label} has no file that holds such a grid; give a volume file a medium of its "
            "own, [[volume]] medium = { temperature = … }"
        )
    key = heat_of(medium)
    kept = body.kept.get("flame")
    if kept is None or kept[0] != key:
        kept = body.kept["flame"] = key, _read(body, body.source, medium, medium.temperature)
    if medium.Le_scale == 0:
        return None
    flame: Volume = kept[1]
    glow = Medium(
        sigma_s=(0, 0, 0),
        sigma_a=(0, 0, 0),
        emission=(medium.Le_scale,) * 3,
        emission_lights=medium.emission_lights,
    )
    placed = flame.transformed(body.world_from_index)
    return placed.with_medium(glow)


def heat_of(medium: Medium) -> tuple[str | None, float, float]:
    """Return what a medium says of how hot it is: where it is the same, so is the flame."""
    return medium.temperature, medium.temperature_offset, medium.temperature_scale


def flame_in(body: Volume, medium: Medium) -> Volume | None:
    """Return what `flame_of` has read, which lies in the body's indices; None without one."""
    kept = body.kept.get("flame")
    return None if medium.temperature is None or kept is None or kept[0] != heat_of(medium) else kept[1]


def keep_flame(body: Volume, medium: Medium, flame: Volume) -> None:
    """Let `flame_of` find this flame, which lies in the body's indices, in the place of the file's."""
    body.kept["flame"] = heat_of(medium), flame


def _read(volume: Volume, path: Path, medium: Medium, name: str) -> Volume:
    """Read the flame of a volume of ``path``, placed in the volume's indices."""
    try:
        grid = volume_io.choose_grid(path, name)
    except VolumeError as error:
        of_preset = medium.preset is not None and "temperature" in PRESETS[medium.preset].medium
        advice = "; name the grid that is hot, or take the preset 'smoke'" if of_preset else ""
        raise VolumeError(f"medium.temperature = {shown(name)}: {error}{advice}") from None
    label = f"{path}: grid {shown(grid.name)}"
    if grid.read_colour is not None:
        raise VolumeError(f"{label} has three values per voxel; a temperature is one")
    place = _place(volume, path, grid, label)
    stored = volume_io.read_stored(path, grid)
    values = stored.values if isinstance(stored, Leaves) else stored
    if not np.isfinite(values).all():
        if not volume.sanitize:
            raise VolumeError(
                f"{label} holds temperatures that are infinite or NaN; set them to 0 with "
                "--set volume.sanitize=true"
            )
        values = np.where(np.isfinite(values), values, np.float32(0))
    offset, scale = medium.temperature_offset, medium.temperature_scale
    if -offset * scale > COLDEST:
        raise SceneError(
            f"medium.temperature_offset = {offset:g}: makes 0, the value of empty space, "
            f"{-offset * scale:g} K hot, so that all of it glows; kelvin are (value - offset) * {scale:g}, "
            f"and of 0 should come {COLDEST:g} at most"
        )
    hottest = (float(values.max(initial=0.0)) - offset) * scale
    if hottest > HOTTEST:
        raise SceneError(
            f"medium.temperature_scale = {scale:g}: makes the hottest voxel of {label} {hottest:g} K; "
            f"the limit is {HOTTEST:g} K"
        )
    radiance = _radiance(values, offset, scale, hottest)
    channels: tuple[NDArray[np.float32] | Leaves, ...] = tuple(radiance)
    if isinstance(stored, Leaves):
        channels = tuple(Leaves(stored.shape, stored.first, stored.coordinates, one) for one in radiance)
    flame = Volume.of_channels(channels, world_from_index=place, name=grid.name, source=path)
    flame.notes = grid.notes
    if hottest <= COLDEST:
        cold = f"medium.temperature: {label} is at most {max(hottest, 0.0) + 0.0:.4g} K hot"
        flame.notes += (f"{cold}, and up to {COLDEST:g} K nothing glows: raise medium.temperature_scale",)
    return flame


def _radiance(
    values: NDArray[np.float32], offset: float, scale: float, hottest: float
) -> NDArray[np.float32]:
    """Return [3, …], of values of any shape."""
    table, flat = Table(hottest), values.reshape(-1)
    radiance = np.empty((3, flat.size), np.float32)
    for start in range(0, flat.size, AT_ONCE):
        part = slice(start, start + AT_ONCE)
        radiance[:, part] = table.rgb((flat[part].astype(np.float64) - offset) * scale)
    return radiance.reshape(3, *values.shape)


def _place(volume: Volume, path: Path, grid: Grid, label: str) -> NDArray[np.float64]:
    """4×4: from the indices of a grid to those of the volume, both of ``path``."""
    density = volume_io.choose_grid(path, volume.name or None)
    if grid.has_transform and density.has_transform:
        place: NDArray[np.float64] = np.linalg.inv(density.world_from_index) @ grid.world_from_index
        return place
    if grid.shape != volume.shape:
        raise VolumeError(f"{label} has the shape {list(grid.shape)}; expected {list(volume.shape)}")
    return np.eye(4)
