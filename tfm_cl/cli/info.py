"""``tfm info``: what a volume file holds."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from tfm_cl import volume_io
from tfm_cl.volume import bounds_of
from tfm_cl.volume_io.grid import Grid


@click.command("info")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="print JSON")
def command(path: Path, *, as_json: bool) -> None:
    """List the grids of a volume file: size, place, values, memory on the device."""
    grids = [describe(path, grid) for grid in volume_io.open_grids(path)]
    if as_json:
        print(json.dumps({"file": str(path), "grids": grids}, indent=2))
        return
    print(path)
    for grid in grids:
        print(f"  grid {grid.pop('name')!r}")
        for key, value in grid.items():
            if value is not None:
                print(f"    {key.replace('_', ' '):15} {_shown(value)}")


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
        "device_bytes": 4 * (x + 2) * (y + 2) * (z + 2),
        "renders": volume_io.refusal(grid) or "yes",
    }
    if min(grid.shape) < 1:
        return shown
    shown["bounds"] = bounds_of(grid.shape, grid.world_from_index).tolist()
    if grid.unsupported or x * y * z > volume_io.MAX_VOXELS:
        return shown
    data = volume_io.read_grid(path, grid)
    finite = data[np.isfinite(data)]
    active = grid.active_voxels if grid.active_voxels is not None else int(np.count_nonzero(data))
    shown |= {
        "min": float(finite.min()) if finite.size else None,
        "max": float(finite.max()) if finite.size else None,
        "mean": float(finite.mean(dtype=np.float64)) if finite.size else None,
        "active_voxels": active,
        "active_share": active / data.size,
    }
    if finite.size < data.size:
        shown["not_finite"] = data.size - finite.size
    return shown


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
