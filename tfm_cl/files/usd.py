"""Points and curves of USD files (``.usd``, ``.usda``, ``.usdc``, ``.usdz``), by usd-core (``tfm_cl[usd]``).

A file has to stand for itself, without references, variants or other layers. It is read at its earliest
time, by a process of its own (`tfm_cl.files.usd_worker`) with limited memory and time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import VolumeError
from tfm_cl.extras import missing

LEAST_MEMORY, MEMORY_OF_BYTE = 2 << 30, 32
"""Bytes that the process may take, and how many more for each of the file; its libraries alone map 1 GiB."""
LEAST_TIME, BYTES_A_SECOND = 60.0, 1 << 21
"""Seconds that the process may take, and how many bytes of the file make it another."""
VECTORS = ("points", "velocities", "displayColor")
ARRAYS = (*VECTORS, "counts", "widths", "displayOpacity")
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "PXR_WORK_THREAD_LIMIT": "1"}
"""Threads map memory each, however many processors there are."""
LONGEST_REASON = 300
"""Characters of what the process says."""


@dataclass(frozen=True)
class Prim:
    """One set of points or curves, as the file has it."""

    path: str
    """Its place in the file."""
    matrix: NDArray[np.float64]
    """[4, 4] from its own space to the world; rows are multiplied from the left."""
    arrays: dict[str, NDArray[Any]]
    """What there is of points, counts, widths, displayColor, displayOpacity, velocities."""
    interpolation: dict[str, str]
    """Of widths, colours and opacities: constant, uniform, varying, vertex or faceVarying."""
    tokens: dict[str, str]
    """``type``, ``basis`` and ``wrap`` of curves."""

    @property
    def positions(self) -> NDArray[np.float64]:
        """[n, 3]: in the world."""
        return self.arrays["points"] @ self.matrix[:3, :3] + self.matrix[3, :3]

    @property
    def velocities(self) -> NDArray[np.float64] | None:
        """[n, 3]: in the world, if there are any."""
        return self.arrays["velocities"] @ self.matrix[:3, :3] if "velocities" in self.arrays else None

    @property
    def scale(self) -> float:
        """How much longer lengths are in the world: the cube root of how much larger volumes are."""
        return float(np.cbrt(abs(np.linalg.det(self.matrix[:3, :3]))))


def read_prims(path: Path, schema: Literal["Points", "BasisCurves"]) -> list[Prim]:
    """Read all visible prims of a schema that have points.

    Raises
    ------
    VolumeError
        usd-core is not installed, the file is damaged, takes too much memory or time, refers to others, or
        has none of them.
    """
    lack = missing("usd")
    if lack:
        raise VolumeError(f"{path}: a USD file {lack}")
    with tempfile.TemporaryDirectory(prefix="tfm-usd-") as folder:
        _work(path, schema, Path(folder))
        facts = json.loads((Path(folder) / "prims.json").read_text(encoding="utf-8"))
        with np.load(Path(folder) / "arrays.npz", allow_pickle=False) as archive:
            prims = [_prim(path, number, of_prim, archive) for number, of_prim in enumerate(facts)]
    found = [prim for prim in prims if len(prim.arrays.get("points", ()))]
    if not found:
        raise VolumeError(f"{path}: holds no visible prim of type {schema} with points")
    return found


def _work(path: Path, schema: str, folder: Path) -> None:
    """Let the worker write what it finds."""
    size = path.stat().st_size
    command = _command(path, schema, folder, LEAST_MEMORY + MEMORY_OF_BYTE * size)
    seconds = LEAST_TIME + size / BYTES_A_SECOND
    try:
        done = subprocess.run(  # noqa: S603 - our own
            command, check=False, capture_output=True, timeout=seconds, env=os.environ | ONE_THREAD
        )
    except subprocess.TimeoutExpired:
        raise VolumeError(f"{path}: not read within {seconds:.0f} s; it may be damaged") from None
    refused = folder / "error.txt"
    if refused.exists():
        reason = "".join(letter if letter.isprintable() else " " for letter in refused.read_text("utf-8"))
        raise VolumeError(f"{path}: {' '.join(reason.split())[:LONGEST_REASON]}")
    if done.returncode != 0 or not (folder / "prims.json").exists():
        raise VolumeError(f"{path}: damaged: usd-core failed on it (exit code {done.returncode})")


def _command(path: Path, schema: str, folder: Path, memory: int) -> list[str]:
    worker = Path(__file__).with_name("usd_worker.py")
    return [sys.executable, str(worker), str(path.absolute()), schema, str(folder), str(memory)]


def _prim(path: Path, number: int, facts: dict[str, Any], archive: Any) -> Prim:
    """Check what the worker found in a prim."""
    arrays = {name: archive[f"{number}.{name}"] for name in ARRAYS if f"{number}.{name}" in archive}
    for name, values in arrays.items():
        if values.shape[1:] != ((3,) if name in VECTORS else ()):
            raise VolumeError(f"{path}: {name} of {facts['path'][:80]} are not of the type they should be")
        if not np.isfinite(values).all():
            at = int(np.isfinite(values).reshape(len(values), -1).all(axis=1).argmin())
            raise VolumeError(f"{path}: {name} {at} of {facts['path'][:80]} is {values[at]}, not finite")
    return Prim(
        path=facts["path"],
        matrix=np.array(facts["matrix"]),
        arrays=arrays,
        interpolation=facts["interpolation"],
        tokens={key: facts[key] for key in ("type", "basis", "wrap") if key in facts},
    )


def joined(path: Path, parts: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Join the attributes of several prims.

    Raises
    ------
    VolumeError
        Only some of them have one.
    """
    names = {name for part in parts for name in part}
    for name in sorted(names):
        if any(name not in part for part in parts):
            raise VolumeError(f"{path}: only some of its prims have {name}; give it to all, or to none")
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def at_points(path: Path, prim: Prim, name: str, values: NDArray[Any], count: int) -> NDArray[Any]:
    """Give values of points, or one for all, a row each.

    Raises
    ------
    VolumeError
        There are more or fewer.
    """
    if len(values) == 1:
        return np.broadcast_to(values, (count, *values.shape[1:]))
    if len(values) != count:
        raise VolumeError(f"{path}: {prim.path[:80]} has {len(values):,} {name} for {count:,} points")
    return values
