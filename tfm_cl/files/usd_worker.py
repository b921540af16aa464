"""Takes points or curves out of a USD file, in a process of its own: `tfm_cl.files.usd` runs this file.

usd-core trusts files: one of 2 KB can make it take all memory, or crash. So the system limits this process.

Usage: ``python usd_worker.py FILE SCHEMA FOLDER BYTES``. FOLDER gets ``prims.json`` and ``arrays.npz``, or
``error.txt``, a line; BYTES is the most memory to take.
"""

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

MOST_PRIMS = 10_000
ARCS = frozenset(
    ("references", "payload", "inheritPaths", "specializes", "variantSetNames", "variantSelection", "clips")
)
"""Of a prim, what takes it from elsewhere: a small file can so make any number of prims, or open any file."""


class RefusedError(Exception):
    """The file cannot be used; a line for the user."""


def limit_memory(most: int) -> None:
    """Let the system refuse memory beyond a number of bytes, where it can (Linux, macOS)."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource  # noqa: PLC0415 - not on Windows

        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def open_stage(path: str) -> Any:
    """Open a file that stands for itself."""
    from pxr import Sdf, Tf, Usd  # noqa: PLC0415 - after the limit

    try:
        layer = Sdf.Layer.FindOrOpen(path)
    except Tf.ErrorException as error:
        comments = [str(getattr(one, "commentary", one)) for one in error.args]
        raise RefusedError(f"not readable as USD ({'; '.join(comments)})") from error
    if layer is None:
        raise RefusedError("not readable as USD")
    elsewhere = [f"layer {name}" for name in layer.subLayerPaths]

    def visit(place: Any) -> None:
        if not elsewhere and place.IsPrimPath():
            arcs = ARCS.intersection(layer.GetPrimAtPath(place).ListInfoKeys())
            elsewhere.extend(f"{arc} of {place}" for arc in sorted(arcs))

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    if elsewhere:
        raise RefusedError(
            f"takes something from elsewhere ({elsewhere[0]}): first write one flat file with "
            "'usdcat --flatten FILE -o OUT'"
        )
    return Usd.Stage.Open(layer)


def prims_of(stage: Any, schema: str) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield the facts and the arrays of each visible prim, at the earliest time that there is."""
    from pxr import Usd, UsdGeom  # noqa: PLC0415 - after the limit

    kind, time = getattr(UsdGeom, schema), Usd.TimeCode.EarliestTime()
    places, found = UsdGeom.XformCache(time), 0
    for prim in stage.Traverse():
        if not prim.IsA(kind):
            continue
        shape = kind(prim)
        if shape.ComputeVisibility(time) == "invisible" or shape.ComputePurpose() == "guide":
            continue
        found += 1
        if found > MOST_PRIMS:
            raise RefusedError(f"has more than {MOST_PRIMS:,} prims of {schema}")
        facts: dict[str, Any] = {
            "interpolation": {},
            "path": str(prim.GetPath()),
            "matrix": [list(row) for row in places.GetLocalToWorldTransform(prim)],
        }
        if schema == "BasisCurves":
            for key in ("type", "basis", "wrap"):
                facts[key] = str(prim.GetAttribute(key).Get(time))
        yield facts, arrays_of(shape, facts, time)


def arrays_of(shape: Any, facts: dict[str, Any], time: Any) -> dict[str, Any]:
    """Return a prim's arrays, and note in its facts how those that vary do so."""
    import numpy as np  # noqa: PLC0415 - after the limit
    from pxr import UsdGeom  # noqa: PLC0415

    prim = shape.GetPrim()
    arrays = {"points": shape.GetPointsAttr().Get(time), "velocities": shape.GetVelocitiesAttr().Get(time)}
    if prim.IsA(UsdGeom.BasisCurves):
        arrays["counts"] = shape.GetCurveVertexCountsAttr().Get(time)
    # A primvar of that name wins over the schema's own attribute.
    arrays["widths"] = shape.GetWidthsAttr().Get(time)
    facts["interpolation"]["widths"] = shape.GetWidthsInterpolation()
    for name in ("widths", "displayColor", "displayOpacity"):
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        if primvar.HasValue():
            arrays[name] = primvar.ComputeFlattened(time)
            facts["interpolation"][name] = primvar.GetInterpolation()
    found = {name: np.array(values) for name, values in arrays.items() if values is not None}
    for name in facts["interpolation"].keys() - found.keys():
        del facts["interpolation"][name]
    for name, values in found.items():
        if values.dtype.kind not in "fiu":
            raise RefusedError(f"{name} of {facts['path']} are no numbers")
    return found


def main(path: str, schema: str, folder: str, most: str) -> None:
    """Write what a file holds, or why it cannot be read."""
    limit_memory(int(most))
    try:
        import numpy as np  # noqa: PLC0415 - after the limit

        prims: list[dict[str, Any]] = []
        arrays: dict[str, Any] = {}
        for facts, of_prim in prims_of(open_stage(path), schema):
            arrays |= {f"{len(prims)}.{name}": values for name, values in of_prim.items()}
            prims.append(facts)
        np.savez(Path(folder, "arrays.npz"), **arrays)
        Path(folder, "prims.json").write_text(json.dumps(prims), encoding="utf-8")
    except RefusedError as error:
        Path(folder, "error.txt").write_text(str(error), encoding="utf-8")
    except MemoryError:
        Path(folder, "error.txt").write_text("takes too much memory for its size", encoding="utf-8")
    except Exception as error:  # noqa: BLE001 - usd-core passes on anything
        Path(folder, "error.txt").write_text(f"not readable as USD ({error})", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
