"""``tfm info``: what a file of volumes, points or curves holds."""

import json
import math
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from tfm_cl.cli.paths import SOURCE
from tfm_cl.device.structs import declared
from tfm_cl.errors import InputError, TfmError
from tfm_cl.files import curves_io, points_io, volume_io
from tfm_cl.files.curves_io.stored import StoredCurves
from tfm_cl.files.points_io.stored import StoredPoints
from tfm_cl.files.volume_io.grid import Grid
from tfm_cl.files.volume_io.grid import shown as shown_name
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.plan import resolution
from tfm_cl.scene.bodies.primitive_settings import spacing
from tfm_cl.scene.bodies.volume import Volume, bounds_of
from tfm_cl.scene.optical_depth import density_scale_for
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import bare_body

DEVICE_BYTES = declared.SOURCE.dtype.itemsize + declared.PRIMITIVE.dtype.itemsize
"""Of a primitive, as it is and as it is seen; lists of them come to these."""
LANES = 16
"""Rays a work-item carries on CPUs, whose memory is told; with one, on a GPU, records are smaller."""


@click.command("info")
@click.argument("path", metavar="FILE", type=SOURCE)
@click.option("--json", "as_json", is_flag=True, help="print JSON")
def command(path: Path, *, as_json: bool) -> None:
    """List the grids, points or curves of a file: size, place, values, memory on the device."""
    if path.suffix.lower() == ".toml":
        raise InputError(
            f"{path}: a scene, of which `tfm render {path} --print-config` tells all; `tfm info` tells of "
            "files of volumes, points and curves"
        )
    table = bare_body(path) or {}
    kind = next((key for key in ("points", "curves") if key in table), "")
    if kind:
        told: dict[str, Any] = {kind: describe_points(path) if kind == "points" else describe_curves(path)}
        shown = [(kind, told[kind])]
    else:
        told = {"grids": [describe(path, grid) for grid in volume_io.open_grids(path)]}
        shown = [(f"grid {grid['name']!r}", grid) for grid in told["grids"]]
    if as_json:
        print(json.dumps({"file": str(path), **told}, indent=2))
        return
    print(path)
    for name, facts in shown:
        print(f"  {name}")
        for key, value in facts.items():
            if value is not None and key != "name":
                print(f"    {key.replace('_', ' '):15} {_shown(value)}")


def describe_points(path: Path) -> dict[str, Any]:
    """Return all that is known of the points of a file, in its units."""
    stored = points_io.read_points(path)
    return {
        "count": len(stored.positions),
        **_extent(stored.positions),
        **_ranges(stored, ("radii", "densities", "opacities", "colours", "velocities")),
        "spacing": spacing(stored.positions),
        "device_bytes": DEVICE_BYTES * len(stored.positions),
    }


def describe_curves(path: Path) -> dict[str, Any]:
    """Return all that is known of the curves of a file, in its units."""
    stored = curves_io.read_curves(path)
    segments = len(stored.positions) - len(stored.counts)
    return {
        "count": len(stored.counts),
        "segments": segments,
        **_extent(stored.positions),
        **_ranges(stored, ("widths", "opacities", "colours")),
        "device_bytes": DEVICE_BYTES * segments,
    }


def _extent(positions: NDArray[np.float32]) -> dict[str, Any]:
    return {"bounds": [positions.min(axis=0).tolist(), positions.max(axis=0).tolist()]}


def _ranges(stored: StoredPoints | StoredCurves, names: tuple[str, ...]) -> dict[str, Any]:
    """Least and largest number of each attribute; None for those that the file does not have."""
    found = {name: getattr(stored, name) for name in names}
    return {
        name: None if values is None else [float(values.min()), float(values.max())]
        for name, values in found.items()
    }


def describe(path: Path, grid: Grid) -> dict[str, Any]:
    """Return all that is known of a grid, in the units of the file."""
    z, y, x = grid.shape
    shown: dict[str, Any] = {
        "name": grid.name,
        "class": grid.grid_class,
        "values": grid.value_type,
        "dims": [x, y, z],
        "voxel_size": np.linalg.norm(grid.world_from_index[:3, :3], axis=0).tolist(),
        "bounds": None,
        "min": None,
        "max": None,
        "mean": None,
        "active_voxels": grid.active_voxels,
        "active_share": None,
        "device_bytes": None,
        "renders": volume_io.refusal(grid) or "yes",
    }
    if grid.background != 0.0:
        shown["background"] = grid.background
    if min(grid.shape) < 1:
        return shown
    shown["bounds"] = bounds_of(grid.shape, grid.world_from_index).tolist()
    if grid.unsupported or volume_io.beyond_limits(grid):
        return shown
    voxels = volume_io.read_stored(path, grid)
    measured, active, finite = _measured(voxels)
    if grid.read_colour is not None:
        measured, *_ = _measured(volume_io.read_vectors(path, grid))
    shown |= measured
    shown["device_bytes"], refused = _on_device(voxels)
    if shown["renders"] == "yes":
        shown["renders"] = refused or _fault(path, grid, voxels) or "yes"
    shown["active_voxels"] = active if grid.active_voxels is None else grid.active_voxels
    shown["active_share"] = shown["active_voxels"] / (x * y * z)
    if finite < x * y * z:
        shown["not_finite"] = x * y * z - finite
    return shown


def _fault(path: Path, grid: Grid, voxels: NDArray[np.float32] | Leaves) -> str:
    """Why `tfm render` without options refuses a grid, or makes a black picture of it; empty for neither.

    It does what `tfm render` does before it needs a device. The voxels become a volume's own.
    """
    try:
        volume = Volume.of_grid(path, grid, voxels)
        scene = resolution.resolved(Scene(volume.with_density_scale(density_scale_for(volume))))
    except TfmError as error:
        return str(error).removeprefix(f"{path}: ").removeprefix(f"grid {shown_name(grid.name)}: ")
    from tfm_cl.render.diagnosis import too_thin  # noqa: PLC0415 - the help needs no picture formats

    reason = volume.why_empty or too_thin(scene)
    return reason and f"the picture is black: {reason}"


def _measured(voxels: NDArray[np.float32] | Leaves) -> tuple[dict[str, float | None], int, int]:
    """Range and mean of the finite voxels; how many voxels are not 0, and how many are finite."""
    if isinstance(voxels, Leaves):
        count = math.prod(voxels.shape) - voxels.not_finite()
        values = (voxels.min(), voxels.max(), voxels.mean())
        nonzero = voxels.active()
    else:
        finite = voxels[np.isfinite(voxels)]
        count, nonzero = finite.size, int(np.count_nonzero(voxels))
        values = (math.nan,) * 3
        if count:
            values = float(finite.min()), float(finite.max()), float(finite.mean(dtype=np.float64))
    named = zip(("min", "max", "mean"), values, strict=True)
    return {name: value if count else None for name, value in named}, nonzero, count


def _on_device(voxels: NDArray[np.float32] | Leaves) -> tuple[int | None, str]:
    """Size of the bricks of float32 voxels on a device of `LANES`, or None and why no device takes them."""
    from tfm_cl.device.bricks import check_count, device_bytes  # noqa: PLC0415 - the help of `tfm info` needs no OpenCL

    try:
        leaves = voxels if isinstance(voxels, Leaves) else Leaves.from_dense(voxels)
        check_count([(leaves,)], "the volume")
    except TfmError as error:
        return None, str(error)
    return device_bytes((leaves,), LANES, "f32"), ""


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, list):
        return ("  to  " if isinstance(value[0], list) else " × ").join(
            "(" + ", ".join(f"{item:.6g}" for item in part) + ")" if isinstance(part, list) else f"{part:.6g}"
            for part in value
        )
    return str(value)
