"""What a light is to the rest of the project."""

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.errors import SceneError
from tfm_cl.model import LARGEST_COORDINATE, RGB, Model, number_or_none, unknown_key
from tfm_cl.scene.lights.texels import look_up

Floats = NDArray[np.float64]

SHORTEST_REACH = 1e-9
"""World units: the square of its inverse is far from float32's limit."""

TINY = 1e-100
"""Keeps points at the light from dividing by 0."""


@dataclass(frozen=True)
class LightFrame:
    """Where a light and its map lie in the world, as the kernels need it."""

    world_from_light: NDArray[np.float64]
    """4×4 with orthonormal axes: x right, y up, z where the map looks."""
    shape: tuple[float, ...]
    """Up to four numbers that the light's kernel header finds in ``params->light_shape``."""
    chart: tuple[float, float, float, float] = (1.0, 1.0, 0.0, 0.0)
    """The window of its chart, `tfm_cl.scene.lights.charts.Chart.window`, for lights that have one."""
    cone_from_light: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    """3×3, rotation to where a spot's axis is z."""


class Arrival(NamedTuple):
    """How the light arrives at world points; float64, as ``LightSample`` of the kernels."""

    direction: Floats
    """[points, 3] of travel, world, unit; 0 at the light itself."""
    distance: Floats
    """[points] travelled, world units: from the light, or from where a sun's rays begin."""
    position: Floats
    """[points, 2]: u, v in the map; beyond [0, 1] where the map does not reach."""
    strength: Floats
    """[points]: falloff and edge, what the intensity is multiplied by without medium, solids and texture."""
    texture: Floats
    """[points, 2]: u, v in the light's image, for lights that have one."""


class LitCone(NamedTuple):
    """All that a light with a place of its own can reach."""

    world_from_light: Floats
    """4×4: the apex at the origin, the axis along z."""
    slope: float
    """Tangent of the half angle; infinite for light to all sides."""
    reach: float
    """Distance beyond which there is none, world units; infinite without."""


class Light(Model):
    """A light with a projective space: every point it reaches lies on one ray of its map.

    The kernels' geometry is here once more in float64: `rays`, `arrival`, `reaches`, `interval` and
    `projective_depth`. All points, origins and directions are in the world.
    """

    SECTION: ClassVar[str] = "light"
    HEADER: ClassVar[str]
    """Kernel header, below ``kernels/``, with the functions that ``kernels/light/README.md`` names."""

    @property
    def headers(self) -> tuple[str, ...]:
        """Kernel headers, in order: its chart's, if any, and its own."""
        return (self.HEADER,)

    type: str = Field(description="kind of light")
    intensity: RGB = Field((1.0, 1.0, 1.0), description="RGB; its unit depends on falloff")
    falloff: Literal["none", "inverse-square"] = Field(
        "none",
        description="none: the papers' (intensity is irradiance everywhere); "
        "inverse-square: intensity is per steradian, distance in world units",
    )

    @abstractmethod
    def frame(self) -> LightFrame:
        """Place the light's map in the world.

        Raises
        ------
        SceneError
            When the map has to be `fitted` first, or the light is the sum of its `parts` only.
        """

    @abstractmethod
    def footprint(self, distance: float) -> float:
        """Width of the map at a distance from the light's origin if all texels were as wide as the widest.

        World units.
        """

    @abstractmethod
    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """Origins and unit directions, both [rays, 3], of map positions u, v [rays, 2] in [0, 1]²."""

    @abstractmethod
    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """How the light arrives at points [points, 3].

        Parameters
        ----------
        points
            Anywhere; strength and position mean something where the light `reaches`.
        nearest
            Distance below which inverse-square falloff stops growing.
        """

    @abstractmethod
    def begins(self, points: Floats) -> Floats:
        """Where the light's rays through points begin, both [points, 3]."""

    def reaches(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points [points, 3] lie in what the light can reach, were there nothing in its way."""
        return np.ones(len(points), dtype=bool)

    def interval(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Part of rays (both [rays, 3]) that the light can reach: begin ≥ 0, end, both [rays].

        The end may be infinite; both are 0 where the light reaches nothing.
        """
        del directions
        return np.zeros(len(origins)), np.full(len(origins), np.inf)

    def projective_depth(self, points: Floats) -> Floats:
        """Depth w ≥ 0 of the light's projective space, [points]; constant where world steps are even."""
        return np.ones(len(points))

    def source_distance(self, points: Floats) -> Floats:
        """How far a ray from points [points, 3] against the light travels until it is at the light."""
        return self.arrival(points).distance

    def lit_cone(self) -> LitCone | None:
        """Return a cone, or a ball, that all the light lies in; None where it may go anywhere."""
        return None

    @property
    def is_unbounded(self) -> bool:
        """Whether it reaches every point, were there nothing in its way."""
        cone = self.lit_cone()
        return cone is None or (np.isinf(cone.slope) and np.isinf(cone.reach))

    @property
    def has_even_depth(self) -> bool:
        """Whether even steps of its projective space are even in the world: constant `projective_depth`."""
        return True

    @abstractmethod
    def fitted(self, bounds: Floats, everything: Floats | None = None) -> Self:
        """Return the light with its map fitted to what it lights of a box, [2, 3].

        Parameters
        ----------
        everything
            The box around all media, by default the same: rays begin before it.
        """

    @property
    def needs_fitting(self) -> bool:
        """Whether `frame` raises until the light is `fitted`."""
        return False

    def parts(self) -> tuple["Light", ...]:
        """Return the lights, each with a map of its own, whose sum this one is: mostly itself."""
        return (self,)

    def texture_image(self) -> NDArray[np.float32] | None:
        """Colours that the light is multiplied by, [height, width, RGB], or None.

        Row 0 is at v = 1, column 0 at u = 0; between the texels' centres bilinear (``kernels/texture.h``).

        Raises
        ------
        SceneError
            Naming the key and the file that cannot be used.
        """
        return None

    def read_files(self) -> None:
        """Read what the light names, so that nothing has to be read later.

        Raises
        ------
        SceneError
            As `texture_image`.
        """

    def intensity_at(self, positions: Floats) -> Floats:
        """Intensity times texture at the image's positions u, v: [points, 2] to [points, RGB]."""
        intensity = np.broadcast_to(np.asarray(self.intensity), (len(positions), 3))
        image = self.texture_image()
        return intensity if image is None else intensity * look_up(image, positions)

    def falloff_at(self, distance: Floats, nearest: float) -> Floats:
        """1, or 1 / distance², which stops growing at ``nearest``."""
        gain = np.ones(len(distance))
        if self.falloff == "inverse-square":
            gain /= np.maximum(distance, max(nearest, TINY)) ** 2
        return gain

    def window_at(self, distance: Floats) -> Floats:
        """1, or for a light with a `reach` (1 - (d / reach)⁴)², 0 beyond it: ``light_window``.

        Karis, "Real Shading in Unreal Engine 4", SIGGRAPH 2013 course notes.
        """
        reach: float | None = getattr(self, "reach", None)
        if reach is None:
            return np.ones(len(distance))
        window: Floats = np.maximum(1 - (distance / reach) ** 4, 0) ** 2
        return window

    def map_key(self) -> tuple[object, ...]:
        """All of the light that its transmittance map depends on: not its colour."""
        frame = self.frame()
        cone = frame.cone_from_light.tobytes()
        return (self.headers, frame.world_from_light.tobytes(), frame.shape, frame.chart, cone)


LIGHTS: dict[str, type[Light]] = {}
"""Name in scene files -> class, of all that `tfm_cl.scene.lights` lists."""


def parse_light(values: dict[str, Any]) -> Light:
    """Make a light from a scene file's table; ``type`` is ``spot`` when left out.

    Raises
    ------
    SceneError
        Unknown type, unknown key or impossible value.
    """
    name = values.get("type", "spot")
    if not isinstance(name, str) or name not in LIGHTS:
        raise SceneError(f"light.type: {unknown_key(str(name), list(LIGHTS)).replace('key', 'light')}")
    return LIGHTS[name].from_table(values)


Reach = Annotated[float | None, number_or_none(SHORTEST_REACH, LARGEST_COORDINATE)]
"""Distance beyond which a light is dark, world units; None: it has no end."""


def ball_interval(offsets: Floats, directions: Floats, radius: float) -> tuple[Floats, Floats]:
    """Part of rays inside a ball: begin, end ≥ 0, both [rays]; both 0 where there is none.

    ``offsets`` [rays, 3] of the rays' origins from its middle, unit ``directions`` [rays, 3].
    """
    nearest = -(offsets * directions).sum(axis=-1)
    passing = offsets + nearest[:, None] * directions
    half = np.sqrt(np.maximum(radius**2 - (passing * passing).sum(axis=-1), 0))
    begin, end = np.maximum(nearest - half, 0), nearest + half
    hit = (half > 0) & (end > begin)
    return np.where(hit, begin, 0), np.where(hit, end, 0)


def texel_positions(res: int) -> Floats:
    """Texel centres of a map ``[res², 2]``; x runs fastest, and the first row is the lowest y."""
    at = (np.arange(res) + 0.5) / res
    return np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
