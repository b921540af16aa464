"""The interface of a light."""

import re
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from tfm_cl.errors import Fault, SceneError, unknown_key, words
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import RGB, Model, number_or_none
from tfm_cl.model_fields import accepts
from tfm_cl.scene.frames import Axis
from tfm_cl.scene.lights.texels import look_up
from tfm_cl.scene.transform import corners_of

Floats = NDArray[np.float64]
Directions = NDArray[np.floating]
"""That are seen, and what is seen there: float64, or float32 for pictures."""

SHORTEST_REACH = 1e-9
"""Smallest reach of a light, world units: the square of its inverse is still far below the largest
float32."""

MOST_LETTERS = 23
"""Of a light's name: a channel ``light.NAME.R`` then has the 31 that any reader of EXR knows."""

NAME = rf"^[A-Za-z0-9_-]{{1,{MOST_LETTERS}}}$"
"""Of a light, as a regular expression."""
TINY = 1e-100
"""Lower bound of distances to a light, which avoids a division by 0 at the light itself."""


@dataclass(frozen=True)
class LightFrame:
    """Position and orientation of a light and its map in the world, in the form that the kernels need."""

    world_from_light: NDArray[np.float64]
    """4×4 with orthonormal axes: x to the right, y up, z in the viewing direction of the map."""
    shape: tuple[float, ...]
    """Up to four parameters of the light, which its kernel header finds in ``light->shape``."""
    chart: tuple[float, float, float, float] = (1.0, 1.0, 0.0, 0.0)
    """Window of the chart (`tfm_cl.scene.lights.charts.Chart.window`), for lights that have a chart."""
    cone_from_light: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    """3×3 rotation from light space to a space whose z axis is the axis of the spot's cone."""


class Arrival(NamedTuple):
    """How the light arrives at world points: the kernels' ``LightSample`` in float64."""

    direction: Floats
    """[points, 3], unit direction of travel, world; 0 at the light itself."""
    distance: Floats
    """[points], distance travelled, world units: from the light or, for a sun, from where its rays begin."""
    position: Floats
    """[points, 2], u and v in the map; outside [0, 1] for points that the map does not cover."""
    strength: Floats
    """[points], factor of the intensity due to falloff and cone edge, without medium, solids and texture."""
    texture: Floats
    """[points, 2], u and v in the light's texture, for lights that have one."""


class PartOfSky(NamedTuple):
    """What a light is of the surroundings that it is a part of: properties of `Light`."""

    spread: float = 0.0
    most_texels: int | None = None
    is_at_points: bool = False
    asked_apart: float | None = None


class LitCone(NamedTuple):
    """The region that a light with a position can reach."""

    world_from_light: Floats
    """4×4; in light space the apex is at the origin and the axis points along z."""
    slope: float
    """Tangent of the half angle; infinite for light in all directions."""
    reach: float
    """Distance beyond which there is no light, world units; may be infinite."""


@accepts({"type": "string", "pattern": NAME})
def _name(value: Any) -> Any:
    if value is None:
        return value
    if not isinstance(value, str) or not re.fullmatch(NAME, value):
        raise ValueError(f"should be text of 1 to {MOST_LETTERS} letters, digits, _ and -")
    return value


class Light(Model):
    """A light with a projective space: every point it reaches lies on one ray of its map.

    `rays`, `arrival`, `reaches`, `interval` and `projective_depth` repeat the geometry of the kernels in
    float64. All points, origins and directions are in world space.
    """

    SECTION: ClassVar[str] = "light"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "from": "position location origin pos translation",
            "to": "target lookat at aim",
            "write to = from + direction": "direction dir rotation orientation",
            "intensity": "strength power energy radiance irradiance brightness emission scale lumens watts",
            "multiply intensity = [r, g, b] by it": "color colour tint rgb exposure temperature",
            "write cone: the half angle, degrees": (
                "angle coneangle spotsize cutoffangle cutoff outerangle spotangle innerangle beamangle"
            ),
            "blend": "spotblend penumbra beamwidth softness coneblend",
            "radius": "size softsize shadowsoftsize lightsize sourceradius",
            "texture": "file filename image map hdri gobo path cookie environmentmap",
            "reach": "range distance maxdistance attenuationradius",
            "falloff": "decay attenuation decayrate falloffexponent",
            "type": "kind shape",
            "write from and to, or up of a sky": "transform toworld matrix translate rotate",
            "leave it out: media and solids shade every light": "shadow shadows castshadow castshadows",
        }
    )
    HEADER: ClassVar[str]
    """Kernel header, relative to ``kernels/``; ``kernels/light/README.md`` lists the functions it
    provides."""

    @classmethod
    def unknown(cls, key: str) -> Fault:
        """As `Model.unknown`; of keys that other lights have, which."""
        others = [name for name, light in LIGHTS.items() if key in light.keys()]  # noqa: SIM118 - no dict
        kind = cls.model_fields["type"].default
        if not others:
            return super().unknown(key)
        return Fault(f"unknown key {key!r} in [light]: '{kind}' has none, only {', '.join(others)}", (key,))

    @property
    def headers(self) -> tuple[str, ...]:
        """Kernel headers in the order of inclusion: that of the chart, if any, then that of the light."""
        return (self.HEADER,)

    type: str = Field(description="kind of light")
    intensity: RGB = Field(
        default=(1.0, 1.0, 1.0), validate_default=True, description="RGB; the unit depends on falloff"
    )
    falloff: Literal["none", "inverse-square"] = Field(
        default="none",
        description="none, as in the papers: intensity is the irradiance everywhere; "
        "inverse-square: intensity is per steradian, distance in world units",
    )
    name: Annotated[str | None, BeforeValidator(_name)] = Field(
        default=None, description="what its layer is called, light.NAME; default: its number, from 1"
    )

    @abstractmethod
    def frame(self) -> LightFrame:
        """Place the light's map in the world.

        Raises
        ------
        SceneError
            When the map has to be `fitted` first, or only the `parts` of the light have maps.
        """

    @abstractmethod
    def footprint(self, distance: float) -> float:
        """Width of the map at a distance from the light's origin, if all texels were as wide as the widest.

        In world units.
        """

    @abstractmethod
    def rays(self, positions: Floats) -> tuple[Floats, Floats]:
        """Origins and unit directions, both [rays, 3], for map positions u, v [rays, 2] in [0, 1]²."""

    @abstractmethod
    def arrival(self, points: Floats, nearest: float = 0.0) -> Arrival:
        """How the light arrives at points [points, 3].

        Parameters
        ----------
        points
            Any points; strength and position are meaningful only where the light `reaches`.
        nearest
            Distance below which inverse-square falloff stops growing.
        """

    @abstractmethod
    def begins(self, points: Floats) -> Floats:
        """Points [points, 3] where the light's rays through points [points, 3] begin."""

    def reaches(self, points: Floats) -> NDArray[np.bool_]:
        """Whether the light could reach points [points, 3] if nothing were in its way."""
        return np.ones(len(points), dtype=bool)

    def reaches_all_of(self, box: Floats) -> bool:
        """Whether it reaches every point of a world box [2, 3], as far as `reaches` tells.

        What a light reaches is convex: a cone, a ball, or everything.
        """
        return bool(self.reaches(corners_of(box)).all())

    def interval(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Part of rays (origins, directions [rays, 3]) that the light can reach: begin ≥ 0 and end, [rays].

        The end may be infinite; both are 0 for rays that the light does not reach.
        """
        del directions
        return np.zeros(len(origins)), np.full(len(origins), np.inf)

    def projective_depth(self, points: Floats) -> Floats:
        """Depth w ≥ 0 in the light's projective space, [points]; constant for parallel light."""
        return np.ones(len(points))

    def source_distance(self, points: Floats) -> Floats:
        """Distance from points [points, 3] to the light, along a ray towards it."""
        return self.arrival(points).distance

    def lit_cone(self) -> LitCone | None:
        """Return a cone or sphere that contains all points the light can reach; None if it is unbounded."""
        return None

    @property
    def is_unbounded(self) -> bool:
        """Whether it reaches every point, were there nothing in its way."""
        cone = self.lit_cone()
        return cone is None or (np.isinf(cone.slope) and np.isinf(cone.reach))

    @property
    def place(self) -> tuple[float, float, float] | None:
        """World position that it shines from; None: from none, as a sun."""
        return None

    def nearest(self, bounds: Floats) -> float:
        """Distance from the light to the nearest point of a box, [2, 3]; infinite for parallel light."""
        del bounds
        return np.inf

    def is_smooth_in(self, bounds: Floats) -> bool:
        """Whether there is no edge, source or texture of the light in a box, [2, 3], or near it."""
        del bounds
        return self.is_unbounded and not self.is_textured

    @property
    def is_textured(self) -> bool:
        """Whether it is multiplied by a `texture_image`."""
        return False

    @property
    def spread(self) -> float:
        """Radius, in radians, of the part of the sky that it stands for; 0: it comes from one direction."""
        return 0.0

    @property
    def surrounds(self) -> bool:
        """Whether it comes from all around, as the sum of many parts: `Surroundings`."""
        return False

    @property
    def is_at_points(self) -> bool:
        """Whether media look it up at the points of a lattice, as so soft a light allows."""
        return False

    @property
    def asked_apart(self) -> float | None:
        """World units between these points that are asked for; None where that is left open."""
        return None

    @property
    def core(self) -> float:
        """Radius, world units, of a ball that shines evenly, whose falloff it has; 0: that of a point."""
        return 0.0

    @property
    def most_texels(self) -> int | None:
        """Texels along a side of its map, at most; None: as many as the scene's maps have."""
        return None

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

    def fit(self) -> dict[str, Floats]:
        """Return what `fitted` found, as arrays by their names; empty before."""
        return {}

    def with_fit(self, fit: Mapping[str, Floats]) -> Self:
        """Return the light as it was `fitted` when `fit` was called.

        Raises
        ------
        SceneError
            No arrays that this kind of light has.
        """
        del fit
        return self

    @property
    def needs_fitting(self) -> bool:
        """Whether the light must be `fitted` before `frame` can be called."""
        return False

    def upright(self, axis: Axis) -> Self:
        """Return the same with its zenith along a world's axis, where it has one that is left open."""
        del axis
        return self

    def parts(self) -> tuple["Light", ...]:
        """Return the lights whose sum this one is, each with a map of its own; for most lights, itself."""
        return (self,)

    def texture_image(self) -> NDArray[np.float32] | None:
        """Texture that the light is multiplied by, [height, width, RGB], or None.

        Row 0 is at v = 1, column 0 at u = 0; bilinear between texel centres (``kernels/core/texture.h``).

        Raises
        ------
        SceneError
            When the file cannot be used; names the key and the file.
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
        """Intensity times texture [points, RGB] at positions u, v [points, 2] in the image."""
        intensity = np.broadcast_to(np.asarray(self.intensity), (len(positions), 3))
        image = self.texture_image()
        return intensity if image is None else intensity * look_up(image, positions)

    def falloff_at(self, distance: Floats, nearest: float) -> Floats:
        """1, or 1 / distance², which does not grow further below the distance ``nearest``.

        Of a ball of the radius R, see `core`, the mean of that over its points, where x = distance / R:
        ``3/2 (1 + (1 - x²) / 2x ln |(1 + x) / (1 - x)|) / R²``. Within 4 %, at the surface, that is
        (3 - x² - x⁴/5 - 3x⁸/10) / R² inside, and (1 + x⁻²/5 + 3x⁻⁶/10) / distance² outside.
        """
        gain = np.ones(len(distance))
        if self.falloff == "inverse-square":
            squares = np.maximum(distance, max(nearest, TINY)) ** 2
            gain /= squares
            if self.core > 0:
                part = np.minimum(self.core**2 / squares, 1)
                inside = np.minimum(squares / self.core**2, 1)
                ball = (3 - inside * (1 + inside / 5 + 0.3 * inside**3)) / self.core**2
                gain = np.where(inside < 1, ball, gain * (1 + part / 5 + 0.3 * part**3))
        return gain

    def window_at(self, distance: Floats) -> Floats:
        """1, or (1 - (d / reach)⁴)² for a light with a `reach`, and 0 beyond it: ``light_window``.

        Karis, "Real Shading in Unreal Engine 4", SIGGRAPH 2013 course notes.
        """
        reach: float | None = getattr(self, "reach", None)
        if reach is None:
            return np.ones(len(distance))
        window: Floats = np.maximum(1 - (distance / reach) ** 4, 0) ** 2
        return window

    def map_key(self) -> tuple[object, ...]:
        """Everything that the light's transmittance map depends on; that excludes its colour."""
        frame = self.frame()
        cone = frame.cone_from_light.tobytes()
        return (self.headers, frame.world_from_light.tobytes(), frame.shape, frame.chart, cone)


LIGHTS: dict[str, type[Light]] = {}
"""Name in scene files -> class, of all that `tfm_cl.scene.lights` lists."""


OTHER_TYPES = words(
    {
        "sun": "directional distant parallel directionallight distantlight sunlight",
        "spot": "spotlight projector",
        "point": "pointlight omni omnidirectional",
        "environment": "envmap hdri dome domelight infinite constant environmentmap ibl",
        "sky": "sunsky physicalsky nishita hosek skylight",
        "write 'spot' with radius": "area arealight disk rect rectangle quad",
    }
)
"""Types in other programs -> the name here, or what to do."""


def parse_light(values: dict[str, Any]) -> Light:
    """Make a light from a scene file's table; ``type`` is ``spot`` when left out.

    Raises
    ------
    SceneError
        Unknown type, unknown key or impossible value.
    """
    name = values.get("type", "spot")
    if not isinstance(name, str) or name not in LIGHTS:
        line = unknown_key(str(name), list(LIGHTS), words=OTHER_TYPES).replace("key", "light", 1)
        raise SceneError(Fault(f"light.type: {line}", ("type",)))
    return LIGHTS[name].from_table(values)


def fit_array(fit: Mapping[str, Floats], name: str, shape: tuple[int, ...]) -> Floats:
    """Return one of the arrays of `Light.fit`.

    Raises
    ------
    SceneError
        It is missing, of another shape, or not finite.
    """
    array = fit.get(name)
    if array is None or array.shape != shape or not np.isfinite(array).all():
        raise SceneError(f"light.{name}: should be {'×'.join(map(str, shape))} finite numbers")
    return array


def names_of(lights: Iterable[Light]) -> list[str]:
    """Return the names of a scene's lights: without one, their number from 1.

    Raises
    ------
    SceneError
        Two have the same.
    """
    found: dict[str, int] = {}
    for number, light in enumerate(lights):
        name = str(number + 1) if light.name is None else light.name
        first = found.setdefault(name, number)
        if first != number:
            raise SceneError(
                f'light {number}: light.name = "{name}": light {first} is called so, too (without a name a '
                "light is called by its number, from 1); give it another"
            )
    return list(found)


Reach = Annotated[float | None, number_or_none(SHORTEST_REACH, LARGEST_COORDINATE)]
"""Distance beyond which a light is dark, world units; None: unlimited."""


def ball_interval(offsets: Floats, directions: Floats, radius: float) -> tuple[Floats, Floats]:
    """Part of rays inside a sphere: begin and end ≥ 0, both [rays]; both 0 for rays that miss it.

    ``offsets`` [rays, 3]: from the sphere's centre to the rays' origins; ``directions`` [rays, 3]: unit.
    """
    nearest = -(offsets * directions).sum(axis=-1)
    passing = offsets + nearest[:, None] * directions
    half = np.sqrt(np.maximum(radius**2 - (passing * passing).sum(axis=-1), 0))
    begin, end = np.maximum(nearest - half, 0), nearest + half
    hit = (half > 0) & (end > begin)
    return np.where(hit, begin, 0), np.where(hit, end, 0)


def texel_positions(res: int, part: slice | None = None) -> Floats:
    """Texel centres of a map, ``[res², 2]``; x varies fastest, and the first row has the lowest y.

    Of a ``part`` of the texels only these.
    """
    first, end, _ = (part or slice(None)).indices(res * res)
    y, x = np.divmod(np.arange(first, end), res)
    return np.stack([(x + 0.5) / res, (y + 0.5) / res], axis=-1)
