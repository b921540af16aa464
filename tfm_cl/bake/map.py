"""Transmittance function maps for other programs: numbers, ranges and functions as textures, and decoders.

A point's optical depth at density 1 is a series, Σ_j c_j B_j(v), over the range of its light ray. The texture
``coefficients`` holds the c_j of every texel, four a layer; ``functions`` the B_j at equal steps of v, in the
same layers; ``ranges`` where the range begins and ends, the slope beyond it, and the last density.
``maps.json`` says where a point is in them. With linear filtering that is all that a look-up needs, so one
decoder serves every basis that is a series: only the tables differ.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from tfm_cl.bake.base import Bake, check_folder, filling
from tfm_cl.constants import TABULATED_CELLS
from tfm_cl.errors import InputError, SceneError, unknown_key
from tfm_cl.files import texture_io
from tfm_cl.maps.bases import BASES, BEST
from tfm_cl.scene.lights.base import names_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.bake.base import MakeScene
    from tfm_cl.bake.renderer import Renderer
    from tfm_cl.device.launch import Progress
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.scene.scene import Scene

VERSION = 1
"""Of ``maps.json``, raised when older decoders would misread the files."""
DECODERS = ("decode.glsl", "decode.hlsl", "decode.osl", "decode.py")
FILE_ENDINGS = frozenset({".exr", ".ktx2", ".npy", ".nvdb", ".png", ".tga", ".vdb"})
"""Of files that are baked; a folder with such a name would be a surprise."""
PROJECTIONS = ("orthographic", "perspective", "hemisphere", "octahedron")
"""By their numbers in the decoders: a sun's, and the charts of lights with a position."""
FINE = 1024
"""Steps of the functions that are not tabulated themselves: between them lines differ from cosines of 32
half-waves by 0.1 %, from those of 8 by 0.008 %."""
LARGEST_DEPTH = 1e30
"""Optical depth of density 1, at most: kernels stop there too."""
UNLIMITED = 1e30
"""Reach of lights without one, world units."""
MEANINGS = {
    "coefficients": "c_j of each texel, j = 4 i to 4 i + 3 in layer i; row 0 at v = 0, column 0 at u = 0",
    "ranges": "of each texel's ray: begin and end of the series, slope of the depth beyond, last density",
    "functions": "B_j from begin to end of the range in equal steps along u, in the coefficients' layers",
    "distance": "along the light's ray: from the light; orthographic: from the plane z = 0; world units",
    "projection": "0 orthographic, x y; 1 perspective, x/z y/z; 2 hemisphere, 3 octahedron: see the decoders",
    "chart": "u = chart[0] x + chart[2], v = chart[1] y + chart[3] of that",
    "light_from_world": "4x4, row by row, for column vectors; the light at the origin, its map along +z",
    "unit_from_light": "the same, where box is true: to the unit cube between whose sides the ranges are",
    "cone": "axis in light space, cosine of the half angle; dark beyond; cosine -1: all directions",
    "reach": "world units; dark beyond",
    "series": "f = series[0] + series[1] sum(c B); depth = -series[2] ln f; where that is 0, f from 0 to [3]",
    "rgb_from_field": "extinction per world unit at density 1: T_rgb = exp(-sum(rgb_from_field depth)), "
    "the sum over the fields of a light",
    "intensity": "RGB of this part of the light: irradiance, or per steradian with falloff inverse-square",
}


def _formats(value: Any) -> Any:
    if not isinstance(value, list | tuple) or not value:
        raise ValueError(f"should be some of {', '.join(texture_io.FORMATS)}")
    for name in value:
        if name not in texture_io.FORMATS:
            raise ValueError(unknown_key(str(name), list(texture_io.FORMATS)).replace("key", "format"))
    return tuple(dict.fromkeys(value))


class MapBake(Bake):
    """The transmittance function maps of a scene's lights, as textures with decoders."""

    NAME: ClassVar[str] = "map"
    SUMMARY: ClassVar[str] = "a folder with the transmittance function map of each light, and decoders"

    formats: Annotated[tuple[texture_io.Format, ...], BeforeValidator(_formats)] = Field(
        texture_io.FORMATS, description="of the textures, with commas between"
    )
    pixel_type: texture_io.PixelType = Field(
        "float", description="type of the coefficients; what they are functions of stays float"
    )

    def check(self, out: Path) -> None:
        """As `Bake.check`; a name that ends as a file's was meant for another kind."""
        if out.suffix.lower() in FILE_ENDINGS and not out.is_dir():
            raise InputError(
                f"{out}: is to be a folder of maps, but is called as a file; name a folder, or choose --what"
            )
        check_folder(out)

    def check_scene(self, scene: Scene) -> None:
        """As `Bake.check_scene`: the basis is a series, and lights have names of their own."""
        basis = BEST if scene.map.basis == "auto" else scene.map.basis
        if BASES[basis].functions is None:
            series = ", ".join(name for name, known in BASES.items() if known.functions is not None)
            raise SceneError(
                f"map.basis = '{basis}': is no series, which the decoders sum up; bake one of {series}"
            )
        names_of(scene.lights)

    def bake_frames(
        self, renderer: Renderer, frames: Sequence[MakeScene], out: Path, progress: Progress
    ) -> list[Path]:
        """As `Bake.bake_frames`."""
        (make,) = frames
        scene = make()
        self.check_scene(scene)
        names = names_of(scene.lights)
        maps = renderer.build_maps(scene, progress)
        if not maps:
            raise SceneError("nothing to bake: without lights, or grids or primitives, there are no maps")
        entries = []
        with filling(out) as path:
            for name, light_map in zip(_stems(scene, names, maps), maps, strict=True):
                baked = Baked.of(light_map)
                textures = {
                    "coefficients": baked.coefficients,
                    "ranges": baked.ranges,
                    "functions": baked.functions,
                }
                held = {
                    what: [f"{name.stem}.{what}.{ending}" for ending in self.formats] for what in textures
                }
                for what, layers in textures.items():
                    for file in held[what]:
                        kind = self.pixel_type if what == "coefficients" else "float"
                        texture_io.write(path(file), layers, kind)
                entries.append(name.entry | baked.entry | {"files": held})
            about = {"format": "tfm_cl baked maps", "version": VERSION, "meanings": MEANINGS, "maps": entries}
            path("maps.json").write_text(
                json.dumps(about, indent=2, allow_nan=False) + "\n", encoding="utf-8"
            )
            for decoder in DECODERS:
                text = files("tfm_cl.bake.decoders").joinpath(decoder).read_text(encoding="utf-8")
                path(decoder).write_text(text, encoding="utf-8")
        of_maps = [file for entry in entries for held in entry["files"].values() for file in held]
        return [out / file for file in ("maps.json", *DECODERS, *of_maps)]


@dataclass(frozen=True)
class Named:
    """A map's place among those of a scene."""

    stem: str
    """What its files' names begin with."""
    entry: dict[str, Any]
    """The same in ``maps.json``."""


def _stems(scene: Scene, names: list[str], maps: list[TransmittanceMap]) -> list[Named]:
    """Name maps, which are in the order of lights, of their parts, and of fields."""
    places = [
        (name, part, len(light.parts()))
        for name, light in zip(names, scene.lights, strict=True)
        for part in range(len(light.parts()))
    ]
    count = maps[0].fields.count
    emitted = len(maps) // count - len(places)
    places += [("emission.lights", part, emitted) for part in range(emitted)]
    found = []
    for name, part, parts in places:
        for field in range(count):
            stem = (
                name + (f".{part + 1:04d}" if parts > 1 else "") + (f".field{field + 1}" if count > 1 else "")
            )
            found.append(Named(stem, {"light": name, "part": part + 1, "parts": parts, "field": field + 1}))
    return found


@dataclass(frozen=True)
class Baked:
    """What decoders need of one map."""

    coefficients: NDArray[np.float32]
    """[layers, res, res, 4]"""
    ranges: NDArray[np.float32]
    """[1, size, size, 4]"""
    functions: NDArray[np.float32]
    """[layers, 1, steps + 1, 4]"""
    entry: dict[str, Any]
    """Of ``maps.json``."""

    @classmethod
    def of(cls, light_map: TransmittanceMap) -> Baked:
        """Bake a map.

        Raises
        ------
        SceneError
            Its ranges are where rays cross several boxes.
        """
        light, settings, functions = light_map.light, light_map.settings, light_map.functions
        assert functions is not None  # noqa: S101 - `MapBake.bake` looks
        frame, cone = light.frame(), light.lit_cone()
        projection = {"sun": 0, "perspective": 1, "hemisphere": 2, "octahedron": 3}[
            PurePath(light.headers[0]).stem
        ]
        chart = frame.chart if projection else (0.5 / frame.shape[0], 0.5 / frame.shape[1], 0.5, 0.5)
        is_wide = cone is None or math.isinf(cone.slope)
        cosine = -1.0 if cone is None or is_wide else math.cos(math.atan(cone.slope))
        axis = [0.0, 0.0, 0.0] if is_wide else frame.cone_from_light[2].tolist()
        reach = UNLIMITED if cone is None or math.isinf(cone.reach) else cone.reach
        is_box = settings.range == "box"
        unit_from_light = _unit_from_light(light_map, frame.world_from_light) if is_box else np.eye(4)
        table = _table(functions.values, functions.modes, settings.coeffs)
        has_one = settings.target == "transmittance" and functions.values(np.zeros(1))[0, 0] == 1
        weighting = light_map.density_weighting if settings.target == "transmittance" else 0.0
        offset, scale = (1.0, -1.0) if weighting and not has_one else (0.0, 1.0)
        return cls(
            _in_fours(light_map.coefficients),
            np.ascontiguousarray(light_map.field[None]),
            _in_fours(table[None]),
            {
                "type": light.type,
                "intensity": list(light.intensity),
                "falloff": light.falloff,
                "rgb_from_field": light_map.fields.rgb_from_field[:, light_map.field_index].tolist(),
                "basis": settings.basis,
                "coeffs": settings.coeffs,
                "target": settings.target,
                "range": settings.range,
                "res": settings.res,
                "layers": -(-settings.coeffs // 4),
                "rows": len(table),
                "projection": projection,
                "projection_name": PROJECTIONS[projection],
                "light_from_world": np.linalg.inv(frame.world_from_light).tolist(),
                "unit_from_light": unit_from_light.tolist(),
                "chart": list(chart),
                "cone": [*axis, cosine],
                "series": [offset, scale, weighting, LARGEST_DEPTH],
                "reach": reach,
                "box": is_box,
            },
        )


def _in_fours(numbers: NDArray[np.float32]) -> NDArray[np.float32]:
    """From [y, x, n] to layers of four, [layers, y, x, 4]; 0 where there are no more."""
    height, width, n = numbers.shape
    padded = np.zeros((height, width, -(-n // 4), 4), np.float32)
    padded.reshape(height, width, -1)[..., :n] = numbers
    return np.ascontiguousarray(np.moveaxis(padded, 2, 0))


def _table(values: Any, modes: NDArray[np.float32], n: int) -> NDArray[np.float32]:
    """Functions at equal steps of [0, 1], [steps + 1, n]; as the map has them where it has a table."""
    if modes.shape == (TABULATED_CELLS + 1, n):
        return modes
    found: NDArray[np.float32] = values(np.linspace(0, 1, FINE + 1)).astype(np.float32)
    return found


def _unit_from_light(
    light_map: TransmittanceMap, world_from_light: NDArray[np.float64]
) -> NDArray[np.float64]:
    """4x4, from light space to the unit cube of the one box that the ranges are of."""
    grids = light_map.on_device.grid_structs()
    if len(grids) > 1:
        raise SceneError(
            f"map.range = 'box': the decoders know one box, and not what holds {len(grids)}; "
            "use map.range = 'visible'"
        )
    device_from_light = world_from_light.copy()
    device_from_light[:3, 3] -= light_map.origin
    index_from_device = np.vstack([grids[0]["index_from_world"].reshape(3, 4), [0, 0, 0, 1]]).astype(
        np.float64
    )
    unit: NDArray[np.float64] = (
        np.diag([*(1 / (grids[0]["size"] - 1.0)), 1.0]) @ index_from_device @ device_from_light
    )
    return unit
