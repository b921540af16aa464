"""Looks: what a scene leaves out, chosen so that it is a picture by itself; one row each.

A look names a medium (`tfm_cl.scene.presets`) and sets a stage for it: a clear sky with its sun, a ground
where it helps, a camera that what is seen fills, and how the picture is shown. What is given stays as it is.
"""

from __future__ import annotations

import math
import re
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError, VolumeError, unknown_key
from tfm_cl.files import volume_io
from tfm_cl.files.volume_io.grid import Grid
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.limits import LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.scene.frames import as_direction
from tfm_cl.scene.lights.base import LIGHTS
from tfm_cl.scene.movable import said_by
from tfm_cl.scene.solids.base import UPWARDS

PLAIN, AUTO = "plain", "auto"
Values = dict[str, Any]


@dataclass(frozen=True)
class Look:
    """The stage of a medium."""

    words: str
    """Of file names that speak of it, as a regular expression."""
    elevation: float
    """Of the sun, degrees."""
    has_ground: bool = False
    azimuth: float = -70.0
    """Of the sun, degrees, where the camera stands at 19: to its left, as 0 is +z and 90 is +x."""
    turbidity: float = 3.0
    height: float = 0.1
    """Of the camera above what it looks at, over its distance in front of it."""
    daylight: float = 1.0
    """Intensity of sky and sun."""
    samples: int = 16
    """Of a pixel, where it shows edges."""
    view: str = "filmic"
    """How a PNG shows it."""
    medium: Values | None = None
    """In the place of the preset's."""


LOOKS = {
    "fire": Look("fire|flame|explo|burn|torch", elevation=1.0, has_ground=True, daylight=0.25, view="aces"),
    "cloud": Look("cloud|cumul|strat|nimb|cirr", elevation=20.0, azimuth=-110.0, turbidity=2.2, height=-0.2),
    "smoke": Look("smoke|plume|fume|soot", elevation=40.0, has_ground=True),
    "steam": Look("steam|vapou?r|breath", elevation=40.0, has_ground=True),
    "dust": Look("dust|sand|powder", elevation=25.0, has_ground=True, turbidity=6.0),
    "fog": Look("fog|mist|haze", elevation=12.0, has_ground=True, turbidity=5.0),
    "hair": Look(
        "hair|fur|curl|tuft",
        elevation=35.0,
        samples=4,
        medium={
            "phase": {"type": "kajiya-kay"},
            "sigma_s": [0.55, 0.4, 0.25],
            "sigma_a": [0.45, 0.6, 0.75],
        },
    ),
}
"""Name -> look: that of a preset, but for hair."""
HOT = ("temperature", "flame", "flames", "heat")
"""Names of grids that glow, the first that a file has."""
FILLED = 0.8
"""Part of the frame's height or width that what is seen fills."""
GROUND = 0.1
"""Albedo, of dark earth or asphalt: what stands on it is brighter."""
HAZE = 10.0
"""Distance over which the ground fades, over that to what the camera looks at: its horizon is no edge."""
PARTS = 16
"""Of the sky, each with a map of its own."""
PARTS_OVER_GROUND = 32
"""The same where there is a ground, on which the shadow of each of 16 is seen by itself."""
OCTAVES = 4
"""Of multiple scattering, which costs next to nothing."""
KELVIN = 400.0
"""Values of a hot grid beyond it are kelvin; others are relative to the hottest."""
FLAME = 1900.0
"""Kelvin of the hottest of those: flames of wood and oil glow at 1500 to 2000 K."""
BESIDE_PRESETS = frozenset({"preset", "octaves", "orders", "emission_lights"})
"""Keys of a medium that do not say what it is made of."""
FIRE_LIGHTS = 48
"""Of a fire."""
FLAME_DEPTH = 60.0
"""Radiance of a black body's peak that a flame as deep as the volume would have."""


class Chosen(NamedTuple):
    """A look, and why it is this one."""

    name: str
    why: str


def chosen(asked: str, path: Path, holds: str | None) -> Chosen:
    """Return the look of a file.

    Parameters
    ----------
    asked
        Its name, ``plain``, or ``auto``: plain for a scene, and what fits a bare file.
    holds
        The key of the body that a bare file is; None for a scene.

    Raises
    ------
    SceneError
        There is no such look.
    """
    if asked == AUTO:
        return _fitting(path, holds) if holds else Chosen(PLAIN, "scenes say what they want")
    if asked not in {PLAIN, *LOOKS}:
        raise SceneError(unknown_key(asked, [AUTO, PLAIN, *LOOKS]).replace("key", "look"))
    return Chosen(asked, "asked for")


def _fitting(path: Path, holds: str) -> Chosen:
    hot = hot_grid(path)
    if hot is not None:
        return Chosen("fire", f"the file has a grid '{hot}'")
    if holds == "curves":
        return Chosen("hair", "the file holds strands")
    name = path.stem.lower()
    for look, stage in LOOKS.items():
        if look != "fire" and (found := re.search(stage.words, name)):
            return Chosen(look, f"the file's name has '{found.group()}' in it")
    return Chosen("cloud", "the file says nothing of what it is")


def hot_grid(path: Path) -> str | None:
    """Return the name of a volume file's grid of temperatures; None without one, or of another file."""
    if path.suffix.lower() not in volume_io.FORMATS:
        return None
    try:
        names = {grid.name.lower(): grid.name for grid in volume_io.open_grids(path)}
    except VolumeError:
        return None  # its reader says what is wrong
    return next((names[hot] for hot in HOT if hot in names), None)


def dress(values: Values, look: str, path: Path, given: Values) -> None:
    """Fill in what a scene leaves out.

    Who says what a medium is made of, or how it is lit, gets that and nothing besides.

    Parameters
    ----------
    values
        Of the scene file, changed here.
    given
        By dotted key, what will be set besides.
    """
    stage = LOOKS[look]
    if "medium" not in values and _keys("medium", given) <= BESIDE_PRESETS:
        values["medium"] = {"preset": look} if stage.medium is None else deepcopy(stage.medium)
        if stage.medium is None and "medium.orders" not in given:  # which octaves do not go with
            values["medium"]["octaves"] = OCTAVES
        if look == "fire":
            values["medium"] |= _flame(values, path, given)
    if "light" in values or not _keys("light", given) <= set(LIGHTS["sky"].keys()) - {"type"}:
        return
    sky: Values = {"elevation": stage.elevation, "azimuth": stage.azimuth, "turbidity": stage.turbidity}
    # What is no table is refused with the rest of the file.
    camera = values["camera"] if isinstance(values.get("camera"), dict) else {}
    up = _up(given.get("camera.up", camera.get("up")))
    sky |= {"intensity": stage.daylight, "ground_albedo": GROUND, "up": up}
    sky["samples"] = PARTS_OVER_GROUND if stage.has_ground else PARTS
    values["light"] = [{"type": "sky", **sky}]
    if "solid" not in values and stage.has_ground and _is_level(up):
        values["solid"] = [{"shape": "ground", "albedo": GROUND}]
    shown = {"background": "environment", "samples": stage.samples, "view": stage.view, "exposure": "auto"}
    if isinstance(values.setdefault("image", {}), dict):
        values["image"] = shown | values["image"]


def _up(value: Any) -> list[float]:
    """Return what a camera says is up; +y where it says nothing, or what it will refuse."""
    try:
        vector = _numbers(as_direction(value), (3,))
    except ValueError:
        vector = None
    return [0.0, 1.0, 0.0] if value is None or vector is None or not vector.any() else vector.tolist()


def _is_level(up: list[float]) -> bool:
    """Tell whether a ground is level where that is up: it is one of the world's axes."""
    return float(np.abs(up).max()) >= UPWARDS * float(np.linalg.norm(up))


def _numbers(value: Any, shape: tuple[int, ...]) -> NDArray[np.float64] | None:
    """Return an array of that shape; None for what the scene will refuse."""
    try:
        numbers = np.asarray(value, np.float64)
        numbers = (
            numbers.reshape(shape) if numbers.size == math.prod(shape) else np.broadcast_to(numbers, shape)
        )
    except (TypeError, ValueError, OverflowError):
        return None
    return numbers if bool((np.abs(numbers) <= LARGEST_COORDINATE).all()) else None


def _keys(section: str, given: Values) -> set[str]:
    """Return the keys of a section that are given, those of the first of several."""
    inside = (key.removeprefix(f"{section}.") for key in given if key.startswith(f"{section}."))
    return {key.removeprefix("0.") for key in inside}


def framing(look: str) -> Values:
    """Return how `tfm_cl.scene.placement.camera_for` places a camera that is left out."""
    if look == PLAIN:
        return {}
    stage = LOOKS[look]
    return {"filled": FILLED, "height": stage.height, "hazy": HAZE if stage.has_ground else None}


def _flame(values: Values, path: Path, given: Values) -> Values:
    """Return what glows, and how brightly, of the file of the only volume."""
    body = values["volume"] if isinstance(values.get("volume"), dict) else {}
    body = body | {key: given[f"volume.{key}"] for key in _keys("volume", given) if f"volume.{key}" in given}
    name = body.get("file")
    source = path.parent / name if isinstance(name, str) else path
    hot = hot_grid(source)
    if hot is None:
        return {}
    grid = volume_io.choose_grid(source, hot)
    hottest = _hottest(volume_io.read_stored(source, grid))
    scale = 1.0 if hottest > KELVIN else FLAME / hottest
    deep = max(float(np.linalg.norm(_axes(grid, body) @ np.array(grid.shape[::-1]))), 1 / LARGEST_COORDINATE)
    return {
        "temperature": hot,
        "temperature_scale": float(f"{min(scale, LARGEST_COLOUR):.3g}"),
        "emission_lights": FIRE_LIGHTS,
        "Le_scale": float(f"{min(FLAME_DEPTH / deep, LARGEST_COLOUR):.3g}"),
    }


def _hottest(stored: NDArray[np.float32] | Leaves) -> float:
    """Return the largest finite value, if it is more than none: its reader says what is not."""
    values = stored.values if isinstance(stored, Leaves) else stored
    hottest = float(values.max(initial=0.0, where=np.isfinite(values)))
    return hottest if hottest > 0 else FLAME


def _axes(grid: Grid, body: Values) -> NDArray[np.float64]:
    """3×3: edges of a voxel in the world, where the scene puts it."""
    axes = grid.world_from_index[:3, :3]
    if not grid.has_transform and (edges := _numbers(body.get("voxel_size", 1.0), (3,))) is not None:
        axes = np.diag(edges)
    moved = said_by(body)
    return axes if moved is None else moved[:3, :3] @ axes
