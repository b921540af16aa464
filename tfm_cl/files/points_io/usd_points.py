"""Points of USD files: prims of type ``Points``, in world space, with all that is said of them.

https://openusd.org/release/api/class_usd_geom_points.html
"""

from pathlib import Path

import numpy as np

from tfm_cl.files.points_io.attributes import check_count, points_of
from tfm_cl.files.points_io.stored import StoredPoints
from tfm_cl.files.usd import at_points, joined, read_prims


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is refused
def read(path: Path) -> StoredPoints:
    """Read the points of all visible prims.

    Raises
    ------
    VolumeError
        As of `read_prims`, too many points, or attributes of other numbers of them.
    """
    prims = read_prims(path, "Points")
    check_count(path, sum(len(prim.arrays["points"]) for prim in prims))
    parts = []
    for prim in prims:
        positions, velocities = prim.positions, prim.velocities
        count = len(positions)
        part = {name: at_points(path, prim, name, prim.arrays[name], count) for name in prim.interpolation}
        if "widths" in part:
            part["widths"] = part["widths"] * prim.scale
        if velocities is not None:
            part["velocities"] = at_points(path, prim, "velocities", velocities, count)
        parts.append(part | {"positions": positions})
    attributes = joined(path, parts)
    return points_of(path, attributes.pop("positions"), attributes)
