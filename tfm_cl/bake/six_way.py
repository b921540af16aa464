"""Six-way light maps of smoke, for sprites that are lit in a game: the layout of Unity's VFX Graph.

A frame is seen from the front, in parallel, and lit from one side after the other by a sun of irradiance 1.
Two sheets of all frames have these in their channels, as Unity's manual lists them ("Realistic smoke lighting
with six-way lighting", Visual Effect Graph 17)::

    positive    red: from the right    green: from the top       blue: from the back     alpha: opacity
    negative    red: from the left     green: from the bottom    blue: from the front    alpha: emission

Unity's shader multiplies a direction's numbers by the irradiance of a light there (HDRP; URP's lights are
1/π of theirs): they are radiance for an irradiance, 1/sr, times ``gain``.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tfm_cl.bake.base import Bake
from tfm_cl.errors import InputError, SceneError
from tfm_cl.files.image_io.channels import Bits, extension_of, write_channels
from tfm_cl.files.paths import check_writable, replacing
from tfm_cl.model import Vec3
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.bodies.base import around
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.frames import from_y_up
from tfm_cl.scene.lights import SunLight

if TYPE_CHECKING:
    from tfm_cl.bake.base import MakeScene
    from tfm_cl.bake.renderer import Renderer
    from tfm_cl.device.launch import Progress
    from tfm_cl.scene.scene import Scene

Floats = NDArray[np.float32]

SIDES = {
    "right": (1, 0, 0),
    "top": (0, 1, 0),
    "back": (0, 0, -1),
    "left": (-1, 0, 0),
    "bottom": (0, -1, 0),
    "front": (0, 0, 1),
}
"""Where the light comes from -> towards it, along right, up and the way to the camera; in the order of the
channels."""
AWAY = 256.0
"""Of the camera, in halves of the frame's width: sizes in front and behind the middle differ by that part."""
MARGIN = 0.02
"""Of a frame, at each side, around all that has density."""
LARGEST_SHEET = 16384
"""Pixels along a side, of a texture in Unity."""
FAINT = 1e-4
"""Opacity up to which nothing is divided by it."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of Rec. 709 primaries."""


class SixWayBake(Bake):
    """The two six-way light maps of a smoke flipbook."""

    NAME: ClassVar[str] = "six-way"
    SUMMARY: ClassVar[str] = (
        "six-way light maps of one INPUT or a sequence, as two sheets .png .tga .exr (Unity's VFX Graph)"
    )
    TAKES_SEVERAL: ClassVar[bool] = True
    NOT_USED: ClassVar[tuple[str, ...]] = (
        *("image.", "march.method", "light.", "solid.", "ambient."),
        *("camera.res", "camera.from", "camera.to", "camera.fov", "camera.focal_length", "camera.matrix"),
    )

    tile: int = Field(256, ge=1, le=LARGEST_SHEET, description="pixels along a side of a frame")
    columns: int | None = Field(None, ge=1, description="frames in a row of the sheet; none: about a square")
    power_of_two: bool = Field(
        default=False, description="columns and rows are powers of two, and so is the sheet with such a tile"
    )
    pixel_samples: Literal[1, 4, 16, 64, 256] = Field(4, description="rays of a pixel, at most")
    front: Vec3 | None = Field(
        None, description="x,y,z from the smoke to the camera; none: +z where y is up, -y where z is"
    )
    gain: float | Literal["auto"] = Field(
        "auto", description="factor of all six maps; auto: their largest value becomes 1"
    )
    alpha: Literal["straight", "premultiplied"] = Field(
        "straight",
        description="straight: maps are divided by the opacity, for the blend mode Alpha; premultiplied: "
        "they are not, for Alpha Premultiplied",
    )
    bits: Bits = Field(8, description="8 or 16 a channel of a PNG")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.gain != "auto" and not 0 < self.gain < math.inf:
            raise ValueError(f"gain = {self.gain:g}: should be a number > 0, or auto")
        if self.power_of_two and self.tile & (self.tile - 1):
            raise ValueError(f"tile = {self.tile}: should be a power of two for --power-of-two")
        return self

    def check(self, out: Path) -> None:
        """As `Bake.check`."""
        for path in _written(out):
            check_writable(path)

    def bake_frames(
        self, renderer: Renderer, frames: Sequence[MakeScene], out: Path, progress: Progress
    ) -> list[Path]:
        """As `Bake.bake_frames`."""
        sheet = self._sheet(len(frames))
        stage = _stage((make() for make in frames), self)
        maps = np.zeros((sheet.rows * self.tile, sheet.columns * self.tile, len(SIDES)), np.float32)
        opacity, emission = np.zeros((2, *maps.shape[:2]), np.float32)
        for number, make in enumerate(frames):
            progress("six-way light maps", number / len(frames))
            place = sheet.place(number, self.tile)
            seen = self._frame(renderer, stage.of(make()))
            maps[place], opacity[place], emission[place] = seen
        if self.alpha == "straight":
            divisor = np.where(opacity > FAINT, opacity, np.float32(np.inf))
            maps /= divisor[..., None]
        gain = self._gain(maps)
        emission_gain = 1.0 / float(emission.max()) if emission.any() else 1.0
        if not opacity.any() and not emission.any():
            raise SceneError("nothing to bake: the camera sees neither density nor emission")
        positive, negative, description = _written(out)
        channels = maps * np.float32(gain)
        facts = {
            "columns": sheet.columns,
            "rows": sheet.rows,
            "frames": len(frames),
            "tile": self.tile,
            "alpha": self.alpha,
            "gain": gain,
            "emission_gain": emission_gain,
            "unit": "maps: radiance for an irradiance of 1 (1/sr) times gain; emission: times emission_gain",
            **stage.facts(),
            "positive": {"file": positive.name, "channels": ["right", "top", "back", "opacity"]},
            "negative": {"file": negative.name, "channels": ["left", "bottom", "front", "emission"]},
        }
        with ExitStack() as files:
            # Whole or not at all, all three.
            first, second, third = (files.enter_context(replacing(path)) for path in _written(out))
            for path, of, last in (
                (first, channels[..., :3], opacity),
                (second, channels[..., 3:], emission * np.float32(emission_gain)),
            ):
                rgba = np.concatenate([of, last[..., None]], axis=-1)
                write_channels(path, rgba, self.bits, extension=extension_of(out))
            third.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        return [positive, negative, description]

    def _sheet(self, frames: int) -> _Sheet:
        """Return how frames lie in the sheet."""
        columns = self.columns or math.ceil(math.sqrt(frames))
        rows = -(-frames // columns)
        if self.power_of_two:
            columns, rows = (1 << (count - 1).bit_length() for count in (columns, rows))
            rows = 1 << (-(-frames // columns) - 1).bit_length()
        width, height = columns * self.tile, rows * self.tile
        if max(width, height) > LARGEST_SHEET:
            raise SceneError(
                f"{frames} frames of {self.tile}×{self.tile} pixels make a sheet of {width}×{height}; the "
                f"limit is {LARGEST_SHEET} along a side: give a smaller --tile, or other --columns"
            )
        return _Sheet(columns, rows)

    def _gain(self, maps: Floats) -> float:
        if self.gain != "auto":
            return self.gain
        largest = float(maps.max())
        return 1.0 / largest if largest > 0 else 1.0

    def _frame(self, renderer: Renderer, scene: Scene) -> tuple[Floats, Floats, Floats]:
        """Return the six maps [tile, tile, 6], opacity and emission of a frame."""
        # Later orders of scattering have one layer for all lights.
        alone = max(scene.medium_of(body).orders for body in scene.bodies) > 1
        groups = [[light] for light in scene.lights] if alone else [list(scene.lights)]
        maps: list[Floats] = []
        for lights in groups:
            result = renderer.render(
                scene.replace(lights=lights), aovs=("lights",), samples=self.pixel_samples
            )
            layers = result.aovs
            maps += [layers[f"light.{light.name}"] + layers.get("orders", 0) for light in lights]
        glow = layers.get("emission", 0) + layers.get("emission_light", 0)
        opacity = 1 - layers["transmittance"].mean(axis=-1)
        return (
            np.stack([_grey(one) for one in maps], axis=-1),
            np.clip(opacity, 0, 1).astype(np.float32),
            _grey(np.broadcast_to(np.asarray(glow, np.float32), maps[0].shape)),
        )


class _Sheet(NamedTuple):
    """How frames lie in a sheet: row by row from the top left."""

    columns: int
    rows: int

    def place(self, number: int, tile: int) -> tuple[slice, slice]:
        """Return where a frame's pixels are."""
        row, column = divmod(number, self.columns)
        return slice(row * tile, (row + 1) * tile), slice(column * tile, (column + 1) * tile)


class _Stage(NamedTuple):
    """Camera and lights, the same for all frames."""

    camera: Camera
    axes: NDArray[np.float64]
    """[3, 3]: right, up and the way to the camera, a row each."""
    middle: NDArray[np.float64]
    width: float
    """World units that a frame's width shows."""

    def of(self, scene: Scene) -> Scene:
        """Return a frame's scene: its bodies with this camera, and six suns."""
        lights = []
        for name, side in SIDES.items():
            x, y, z = (np.array(side) @ self.axes).tolist()
            lights.append(SunLight(from_=(x, y, z), to=(0, 0, 0), name=name))
        return scene.replace(camera=self.camera, lights=lights, solids=(), ambient=Ambient())

    def facts(self) -> dict[str, Any]:
        """Return what the description says of it."""
        right, up, front = self.axes.tolist()
        return {
            "right": right,
            "up": up,
            "front": front,
            "middle": self.middle.tolist(),
            "width": self.width,
        }


def _stage(scenes: Iterable[Scene], bake: SixWayBake) -> _Stage:
    """Return a camera that sees all that has density in any frame."""
    boxes, up = [], None
    for scene in scenes:
        scene.read_files()
        boxes += [body.occupied_bounds for body in scene.bodies]
        up = scene.camera.up if up is None else up
    box = around(boxes)
    if up is None or not np.isfinite(box).all():
        raise SceneError("nothing to bake: a medium that is everywhere has no outline; give it a shape")
    front = np.asarray(
        from_y_up(np.asarray(up, float)) @ (0, 0, 1) if bake.front is None else bake.front, float
    )
    length = float(np.linalg.norm(front))
    right = np.cross(up, front)
    if length == 0 or np.linalg.norm(right) < 1e-6 * length * np.linalg.norm(up):
        raise SceneError(f"front = {front.tolist()}: should be a direction that is not along up {list(up)}")
    front, right = front / length, right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(front, right), front])
    corners = np.array(list(itertools.product(*box.T))) @ axes.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = (low + high) / 2 @ axes
    half = float((high - low)[:2].max()) / 2 / (1 - 2 * MARGIN)
    x, y, z = (middle + AWAY * half * front).tolist()
    camera = Camera(
        from_=(x, y, z),
        to=tuple(middle.tolist()),
        up=tuple(axes[1].tolist()),
        fov=float(np.degrees(2 * np.arctan(1 / AWAY))),
        res=(bake.tile, bake.tile),
    )
    return _Stage(camera, axes, middle, 2 * half)


def _grey(rgb: Floats) -> Floats:
    """Return the luminance [H, W]."""
    grey: Floats = (rgb @ LUMINANCE).astype(np.float32)
    return grey


def _written(out: Path) -> tuple[Path, Path, Path]:
    """Return the names of the sheets and of their description.

    Raises
    ------
    InputError
        No format that sheets have.
    """
    extension_of(out)
    if not out.stem:
        raise InputError(f"{out}: should be a name, as smoke.png")
    positive, negative = (
        out.with_name(f"{out.stem}_{side}{out.suffix}") for side in ("positive", "negative")
    )
    return positive, negative, out.with_suffix(".json")
