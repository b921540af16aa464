"""A clear sky with its sun."""

import math
from functools import cached_property, lru_cache
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from tfm_cl.limits import LARGEST_COLOUR
from tfm_cl.model import RGB, Point
from tfm_cl.model_fields import Accepts, Numbers, accepts, numbers
from tfm_cl.scene.frames import AXES, Axis, as_direction, from_y_up
from tfm_cl.scene.lights.area import MOST_SAMPLES
from tfm_cl.scene.lights.base import Directions, Floats, Light
from tfm_cl.scene.lights.clear_sky import COLUMNS, DIRECTIONS, ROWS, ClearSky, direction_of
from tfm_cl.scene.lights.sun import SunLight
from tfm_cl.scene.lights.surroundings import Surroundings
from tfm_cl.scene.transform import turned

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of linear Rec. 709."""

Up = Axis | Literal["auto"]


@accepts(numbers(3), {"enum": ["auto", *AXES]})
def _up(value: Any) -> Any:
    return value if isinstance(value, str) and value == "auto" else as_direction(value)


class SkyLight(Surroundings):
    """Clear sky, ground and sun, by the time of day: the model of `tfm_cl.scene.lights.clear_sky`.

    ``azimuth`` is measured where +y is up, from +z towards +x, as in an `EnvironmentLight`'s image; another
    ``up`` turns all of that by the smallest rotation that takes +y there. With ``intensity`` 1 radiances are
    in W / (m² sr nm), weighted over wavelengths as luminance is: a sun at 45° has an irradiance of about 1.2,
    and the sky adds 0.25 on level ground.
    """

    HEADER: ClassVar[str] = SunLight.HEADER
    WHOLE: ClassVar[float] = 2.3

    type: Literal["sky"] = "sky"
    intensity: RGB = Field(
        default=(1.0, 1.0, 1.0),
        validate_default=True,
        description="RGB factor; with 1 a high sun has an irradiance of about 1.3",
    )
    elevation: float = Field(
        default=45.0,
        ge=0,
        le=90,
        description="of the sun above the horizon, degrees, 0 to 90: its colour follows",
    )
    azimuth: float = Field(
        default=0.0, ge=-360, le=360, description="of the sun, degrees: 0 is +z, 90 is +x, where +y is up"
    )
    up: Accepts[Numbers | Up, Annotated[Point | Literal["auto"], BeforeValidator(_up)]] = Field(
        default="auto",
        validate_default=True,
        description="direction of the zenith, x,y,z or an axis, as z; auto: the world's axis nearest to "
        "camera.up, y with camera.matrix",
    )
    turbidity: float = Field(
        default=3.0, ge=1, le=10, description="haze: 2 is very clear, 3 clear, 6 warm, 10 hazy"
    )
    ground_albedo: RGB = Field(
        default=(0.2, 0.2, 0.2),
        validate_default=True,
        description="RGB albedo of the ground all around, 0 to 1",
    )
    sun: bool = Field(default=True, description="the sun itself: a light, and a disk that the camera sees")
    samples: int = Field(
        default=32,
        ge=1,
        le=MOST_SAMPLES,
        description=f"directions of sky and ground, 1 to {MOST_SAMPLES}, each with a map of its own",
    )

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        if max(self.ground_albedo) > 1:
            albedo = list(self.ground_albedo)
            raise ValueError(f"ground_albedo = {albedo}: should be at most 1 in every channel")
        if not any(self.up):
            raise ValueError(f"up = {list(self.up)}: no direction")
        if max(self.intensity) > LARGEST_COLOUR / BRIGHTEST:
            raise ValueError(
                f"intensity = {list(self.intensity)}: should be at most {LARGEST_COLOUR / BRIGHTEST:g}"
            )
        return self

    @classmethod
    def placed(cls, irradiance: float, direction: Floats, up: tuple[float, float, float]) -> dict[str, Any]:
        """As `Surroundings.placed`: with the sun towards the direction, at its usual height."""
        x, _, z = from_y_up(np.asarray(up)).T @ direction
        azimuth = round(math.degrees(math.atan2(x, z)), 1)
        return {**super().placed(irradiance, direction, up), "azimuth": azimuth, "up": up}

    def upright(self, axis: Axis) -> Self:
        """As `Light.upright`."""
        return self.replace(up=AXES[axis]) if self.up == "auto" else self

    @property
    def _sky(self) -> ClearSky:
        return _clear_sky(self.elevation, self.azimuth, self.turbidity, self.ground_albedo)

    @property
    def _world_from_sky(self) -> Floats:
        return from_y_up(np.asarray(AXES["y"] if self.up == "auto" else self.up))

    def parts(self) -> tuple[Light, ...]:
        """Return suns for equal shares of the light of sky and ground, then the sun itself.

        Each has all the light from around its direction.
        """
        return self._parts

    @cached_property
    def _parts(self) -> tuple[Light, ...]:
        """Kept: they are asked for some times in a frame."""
        directions, light = _shares(self._sky, self.samples)
        parts = [self.part(self.spread_of(self.samples))] * len(directions)
        if self.sun and self._sky.sun_irradiance.any():
            directions = np.concatenate([directions, [self._sky.sun]])
            light = np.concatenate([light, [self._sky.sun_irradiance]])
            parts.append(self.part(0.0))
        directions = turned(directions, self._world_from_sky.T)
        irradiances = np.multiply(self.intensity, light)
        return SunLight.of_parts(directions, irradiances, parts)

    def radiance(self, directions: Directions, width: Directions) -> Directions:
        """As `Surroundings.radiance`: sky, ground and, with ``sun``, the sun's disk."""
        local = turned(self._world_from_sky.T.astype(directions.dtype), directions.T).T
        seen = self._sky.around(local)
        if self.sun:
            seen += self._sky.disk(local, width)
        seen *= np.asarray(self.intensity, seen.dtype)
        return seen


BRIGHTEST = 1e6
"""More than any radiance of the model: the sun's disk has some 25,000."""


@lru_cache(maxsize=16)
def _clear_sky(
    elevation: float, azimuth: float, turbidity: float, albedo: tuple[float, float, float]
) -> ClearSky:
    """Return the sky, which is kept."""
    x, y, z = direction_of(math.radians(elevation), math.radians(azimuth)).tolist()
    return ClearSky((x, y, z), turbidity, albedo)


class _Cell(NamedTuple):
    """A rectangle of `DIRECTIONS`, and the luminance of its light."""

    light: float
    rows: slice
    columns: slice


@lru_cache(maxsize=16)
def _shares(sky: ClearSky, count: int) -> tuple[Floats, Floats]:
    """Cut the sphere into ``count`` cells of much the same light: directions and light, both [count, 3].

    The brightest cell is cut in two of equal light, across its longer side, as often as needed; the first cut
    is the horizon. A cell's direction is the mean over its light. Debevec, "A Median Cut Algorithm for Light
    Probe Sampling", SIGGRAPH 2005 posters.
    """
    luminance = sky.light @ LUMINANCE
    all_columns = slice(0, COLUMNS)
    halves = [slice(0, ROWS), slice(ROWS, 2 * ROWS)] if count > 1 else [slice(0, 2 * ROWS)]
    cells = [_Cell(float(luminance[rows].sum()), rows, all_columns) for rows in halves]
    cells = [cell for cell in cells if cell.light > 0]
    while len(cells) < count:
        brightest = max(cells, key=lambda cell: cell.light)
        cells.remove(brightest)
        cells += _halves(luminance, brightest)
    directions, light = np.zeros((2, len(cells), 3))
    for i, (_, rows, columns) in enumerate(cells):
        weights = luminance[rows, columns]
        directions[i] = np.einsum("yx,yxc->c", weights, DIRECTIONS[rows, columns])
        light[i] = sky.light[rows, columns].sum(axis=(0, 1))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions, light


def _halves(luminance: Floats, cell: _Cell) -> list[_Cell]:
    """Cut a cell in two."""
    _, rows, columns = cell
    across = np.linalg.norm(DIRECTIONS[(rows.start + rows.stop) // 2, 0, ::2])
    tall = (rows.stop - rows.start) * math.pi / (2 * ROWS)
    wide = (columns.stop - columns.start) * 2 * math.pi / COLUMNS * across
    by_rows = tall >= wide or columns.stop - columns.start == 1
    cut = rows if by_rows else columns
    sums = np.cumsum(luminance[rows, columns].sum(axis=int(by_rows)))
    half = int(np.searchsorted(sums, sums[-1] / 2))
    # Of the two edges beside the middle the nearer one, and something on both sides.
    half += int(half == 0 or sums[half] - sums[-1] / 2 < sums[-1] / 2 - sums[half - 1])
    middle = min(cut.start + max(half, 1), cut.stop - 1)
    parts = [slice(cut.start, middle), slice(middle, cut.stop)]
    pairs = [(part, columns) if by_rows else (rows, part) for part in parts]
    return [_Cell(float(luminance[pair].sum()), *pair) for pair in pairs]
