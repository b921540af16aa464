"""Light on voxels for other programs: what each light of a scene brings to the points of a lattice."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.bake.base import Bake
from tfm_cl.errors import SceneError
from tfm_cl.files.volume_io.writing import check_writable, write_grids
from tfm_cl.files.volume_io.written_grid import WrittenGrid
from tfm_cl.scene.bodies.base import around

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.bake.base import MakeScene
    from tfm_cl.bake.renderer import Renderer
    from tfm_cl.device.launch import Progress
    from tfm_cl.scene.bodies import Volume
    from tfm_cl.scene.scene import Scene

POINTS_AT_ONCE = 1 << 21
"""Looked up together: some hundred MiB."""
MOST_VOXELS = 1 << 28
"""Of the lattice's box."""
UNITS = {
    "transmittance": "1: what media and solids leave of the light, 0 to 1",
    "light": "irradiance facing the light, in the unit of a sun's intensity; sum over directions",
}
"""Quantity -> unit, as files say it."""


class LightGridBake(Bake):
    """What each light of a scene brings to voxels, a grid for each."""

    NAME: ClassVar[str] = "light-grid"
    SUMMARY: ClassVar[str] = "light on voxels as .vdb, .nvdb or .npy, a grid for each light"

    quantity: Literal["transmittance", "light"] = Field(
        "transmittance",
        description="transmittance: the part of the light that media and solids leave; light: the irradiance "
        "that arrives, RGB",
    )
    voxel_size: float | None = Field(
        None, gt=0, description="edge of a voxel, world units, of a lattice around all bodies"
    )
    grid_res: int | None = Field(
        None,
        gt=0,
        description="voxels along the longest side of such a lattice; without both: the volume's own",
    )
    everywhere: bool = Field(
        default=False,
        description="on all voxels of the volume's box, not only where density is, or next to it",
    )

    @model_validator(mode="after")
    def _has_one_lattice(self) -> Self:
        if self.voxel_size is not None and self.grid_res is not None:
            raise ValueError("give --voxel-size or --grid-res, not both")
        return self

    def check(self, out: Path) -> None:
        """As `Bake.check`."""
        check_writable(out)

    def bake_frames(
        self, renderer: Renderer, frames: Sequence[MakeScene], out: Path, progress: Progress
    ) -> list[Path]:
        """As `Bake.bake_frames`."""
        (make,) = frames
        scene = make()
        if not scene.lights:
            raise SceneError("nothing to bake: the scene has no lights")
        scene.read_files()
        lattice = self._lattice(scene)
        places = np.argwhere(lattice.active)[:, ::-1]
        names: tuple[str, ...] = ()
        values: list[NDArray[np.float32]] = []
        for first in range(0, len(places), POINTS_AT_ONCE):
            progress("light on voxels", first / len(places))
            matrix = lattice.world_from_index
            points = places[first : first + POINTS_AT_ONCE] @ matrix[:3, :3].T + matrix[:3, 3]
            found = renderer.light_at(scene, points)
            names = found.names
            values.append(found.transmittance if self.quantity == "transmittance" else found.irradiance)
        grids = [
            self._grid(scene, number, name, lattice, [part[number] for part in values])
            for number, name in enumerate(names)
        ]
        return write_grids(out, grids)

    def _grid(
        self, scene: Scene, number: int, name: str, lattice: _Lattice, parts: list[NDArray[np.float32]]
    ) -> WrittenGrid:
        """Return a light's grid: of one number a voxel where red, green and blue are the same in all."""
        rgb = np.concatenate(parts)
        is_grey = bool((rgb == rgb[:, :1]).all())
        values = np.zeros((*lattice.active.shape, *[3] * (not is_grey)), np.float32)
        values[lattice.active] = rgb[:, 0] if is_grey else rgb
        of_scene = number < len(scene.lights)
        kind = scene.lights[number].type if of_scene else "what media emit"
        named = not of_scene or scene.lights[number].name is not None
        facts = {"tfm:light": kind, "tfm:quantity": self.quantity, "tfm:unit": UNITS[self.quantity]}
        title = name if named else f"light_{name}"
        return WrittenGrid(title, values, lattice.active, lattice.world_from_index, facts)

    def _lattice(self, scene: Scene) -> _Lattice:
        """Return the lattice asked for."""
        if self.voxel_size is None and self.grid_res is None:
            return self._own(scene)
        box = (
            around([body.occupied_bounds for body in scene.bodies])
            if scene.bodies
            else np.full((2, 3), np.inf)
        )
        if not np.isfinite(box).all():
            raise SceneError("no lattice fits around a medium that is everywhere; give it a shape")
        extent = box[1] - box[0]
        edge = (
            float(extent.max()) / self.grid_res if self.grid_res is not None else float(self.voxel_size or 1)
        )
        x, y, z = np.maximum(np.ceil(extent / edge - 1e-6), 1).astype(int).tolist()
        _check_count((z, y, x), "a larger --voxel-size or a smaller --grid-res")
        matrix = np.diag([edge, edge, edge, 1.0])
        matrix[:3, 3] = box.mean(axis=0) - edge * (np.array([x, y, z]) - 1) / 2
        return _Lattice(matrix, np.ones((z, y, x), dtype=bool))

    def _own(self, scene: Scene) -> _Lattice:
        """Return the voxels of the only volume of voxels."""
        if len(scene.grids) != 1:
            count = f"{len(scene.grids)} volumes" if scene.grids else "no volume"
            raise SceneError(
                f"the scene has {count} of voxels, not one whose voxels could be taken: give --voxel-size or "
                "--grid-res"
            )
        volume = scene.grids[0]
        occupied = _occupied(volume)
        active = np.ones(occupied.shape, dtype=bool) if self.everywhere else _next_to(occupied)
        matrix = volume.world_from_index.copy()
        matrix[:3, 3] -= matrix[:3, :3].sum(axis=1)  # the border that `_occupied` adds
        return _Lattice(matrix, active)


class _Lattice(NamedTuple):
    """Voxels whose light is looked up."""

    world_from_index: NDArray[np.float64]
    """4×4, of voxel centres."""
    active: NDArray[np.bool_]
    """[z, y, x]: which of its box."""


def _occupied(volume: Volume) -> NDArray[np.bool_]:
    """Return which voxels have density, [z, y, x], with a border of one around all."""
    if volume.why_empty:
        raise SceneError(f"{volume.label}: nothing to bake: {volume.why_empty}")
    z, y, x = volume.shape
    _check_count((z + 2, y + 2, x + 2), "--grid-res")
    return np.pad(volume.leaves.to_dense() > 0, 1)


def _next_to(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which voxels are occupied or next to such: those that a density may be interpolated from."""
    found = occupied
    for axis in range(3):
        wider = found.copy()
        ahead, behind = ([slice(None)] * 3 for _ in range(2))
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        wider[tuple(ahead)] |= found[tuple(behind)]
        wider[tuple(behind)] |= found[tuple(ahead)]
        found = wider
    return found


def _check_count(shape: tuple[int, int, int], remedy: str) -> None:
    z, y, x = shape
    if math.prod(shape) > MOST_VOXELS:
        raise SceneError(f"a lattice of {x}×{y}×{z} voxels; the limit is {MOST_VOXELS:,}: give {remedy}")
