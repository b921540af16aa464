"""Why a picture is black, or without the medium: looked for only where it is, and told in one line.

What keeps light from a camera is looked for in the order in which it would be mended: density and medium,
what the camera sees of them, the lights, what they reach.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.files.image_io.display import grey_shown_as, shown, straight
from tfm_cl.files.srgb import linear_from_srgb
from tfm_cl.limits import LARGEST_COLOUR, MOST_STOPS
from tfm_cl.render.culling import bounds_of_lights, box_on_screen
from tfm_cl.render.raster import Crop
from tfm_cl.scene.bodies.base import around
from tfm_cl.scene.lights.base import Light, texel_positions

if TYPE_CHECKING:
    from tfm_cl.render.gbuffer import GBuffer
    from tfm_cl.render.result import RenderResult
    from tfm_cl.render.visibility import Visibility
    from tfm_cl.scene.bodies.base import Body
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene

Floats = NDArray[np.float64]

THINNEST = 2e-4
"""Optical depth of which, with the intensity that lights are placed with, no 8 bits show anything."""
EIGHT_BIT_STEP = float(linear_from_srgb(np.array(0.5 / 255)))
"""The least value that a PNG does not round to 0."""
FAINTEST = EIGHT_BIT_STEP / 2.0**MOST_STOPS
"""What is darker counts as black: no exposure shows it."""
MID_GREY = 0.2
"""What the exposure that is proposed shows the brightest value as, about."""
SWALLOWED = 1e-20
"""Transmittance of which nothing is left to be seen."""
ROUNDED_CUTOFF = 1.01
"""Of the march's cutoff: with less transmittance a camera ray ends."""
CHANNELS = ("red", "green", "blue")
NARROWEST = 2.0
"""Pixels: what is wider cannot fall between them."""
RAYS = 32
"""Of a light along a side of its map, that are looked at."""
LATTICE = np.array(list(product(np.linspace(0, 1, 9), repeat=3)))
"""Points of a box that are looked at, in parts of its edges."""
MOST_TOLD = 3
"""Lights, one by one."""


def is_black(image: NDArray[np.float32]) -> bool:
    """Tell whether a picture [H, W, 4] has no light that any exposure shows; fast where it has."""
    return not any((row[:, :3] >= FAINTEST).any() for row in rows_from_the_middle(image))


def rows_from_the_middle(picture: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    """Yield all rows of a picture, first the middle one, where most have something."""
    yield picture[len(picture) // 2]
    yield from picture


def why_black(result: RenderResult, visibility: Visibility) -> str:
    """Find the reason why a picture has no light.

    Parameters
    ----------
    result
        A picture that `is_black`.
    visibility
        Which traced its solids.

    Returns
    -------
    str
        One line.
    """
    scene = result.scene
    if not (scene.lights or any(scene.ambient.radiance) or scene.emits):
        return f"{_black(result)}: the scene has no light and no ambient"
    gbuffer = visibility.gbuffer(scene, Crop(result.crop))
    reasons = [_Finder(result, visibility, gbuffer).reason()]
    if gbuffer is not None and gbuffer.shown.any():
        dark = not gbuffer.albedo[gbuffer.shown].any()
        reasons.append(
            "the solids in view have the albedo 0" if dark else "no light reaches the solids in view"
        )
    return f"{_black(result)}: {'; '.join(reasons)}"


def why_unseen(result: RenderResult, visibility: Visibility) -> str:
    """Tell why a whole frame shows nothing of the medium, though other things; empty where it shows some."""
    scene = result.scene
    whole = result.crop == (0, 0, *scene.camera.res)
    if not whole or result.meets_medium:
        return ""
    reason = _Finder(result, visibility, visibility.gbuffer(scene, Crop(result.crop))).why_unseen()
    return f"the picture shows nothing of the medium: {reason}" if reason else ""


def too_dark(
    result: RenderResult, exposure: float, view: str = "standard", *, transparent: bool = False
) -> str:
    """Tell why a picture that has light is black in 8 bits; empty where it is not.

    Parameters
    ----------
    exposure, view, transparent
        Of the PNG; the exposure in stops.
    """
    brightest = 0.0
    for row in rows_from_the_middle(result.picture(transparent=transparent)):
        colours = straight(row) if transparent else row[:, :3]
        if (shown(colours, exposure, view) >= EIGHT_BIT_STEP).any():
            return ""
        brightest = max(brightest, float(colours.max()))
    if brightest < FAINTEST:
        return ""
    stops = min(math.ceil(math.log2(grey_shown_as(MID_GREY, view) / brightest)), MOST_STOPS)
    reason = f"its brightest value, {brightest:.3g}, is less than an 8-bit step: --exposure {stops} shows it"
    thin = too_thin(result.scene)
    return f"{_black(result)}: {reason}" + (f"; {thin}" if thin else "")


def too_thin(scene: Scene) -> str:
    """Tell why all bodies together are too thin to be seen, however lit; empty where they are not."""
    parts = [part for part in _parts_of(scene) if part.optical_depth > 0]
    depth = sum(part.optical_depth for part in parts)
    if not parts or not depth < THINNEST or scene.emits:
        return ""
    reason = f"the medium is too thin to be seen, its optical depth at most {depth:.2g}"
    raised = [part.density_key for part in parts if part.density_factor < LARGEST_COLOUR]
    if not raised:
        keys = " and ".join(part.density_key for part in parts)
        return f"{reason} even with the largest {keys}, {LARGEST_COLOUR:g}"
    return f"{reason}: raise {' or '.join(raised)}"


def _black(result: RenderResult) -> str:
    whole = result.crop == (0, 0, *result.scene.camera.res)
    return "the picture is black" + ("" if whole else f" within the crop {','.join(map(str, result.crop))}")


@dataclass(frozen=True)
class _Part:
    """A body of a scene, and what messages call it and its keys."""

    number: int | None
    """From 0, as in keys; None where it is the only one."""
    body: Body
    medium: Medium

    @property
    def section(self) -> str:
        return "volume" if self.number is None else f"volume.{self.number}"

    @property
    def name(self) -> str:
        return self.body.label if self.number is None else f"{self.section} ({self.body.label})"

    @property
    def density_key(self) -> str:
        return f"{self.section}.{self.body.DENSITY_KEY}"

    @property
    def density_factor(self) -> float:
        return float(getattr(self.body, self.body.DENSITY_KEY))

    @property
    def optical_depth(self) -> float:
        """What that of no ray is greater than; 0 only where nothing is extinguished at all."""
        extinction = float((self.body.largest_density * self.medium.sigma_t).max())
        return extinction * _diagonal(self.body.occupied_bounds) if extinction > 0 else 0.0

    @cached_property
    def scatters(self) -> Floats:
        """σ_s, [3]: 0 for colours of which it has no density."""
        return np.where(self.body.largest_density > 0, self.medium.sigma_s, 0.0)

    @cached_property
    def emits(self) -> bool:
        """Whether it emits light of a colour that it has a density of."""
        return bool((self.body.largest_density * self.medium.emission).any())

    @property
    def sends_light(self) -> bool:
        """Whether it scatters or emits any."""
        return self.emits or bool(self.scatters.any())

    def why_dark(self) -> str:
        """Tell why it sends no light whatever; empty where it would."""
        if empty := self.body.why_empty:
            return f"{self.name}: {empty}"
        if self.sends_light:
            return ""
        key = "medium" if self.body.own_medium is None else f"{self.section}.medium"
        if any(self.medium.sigma_s):
            return f"{key}.sigma_s is 0 in all channels that the volume's colours have"
        if any(self.medium.sigma_a):
            return f"{key}.sigma_s is 0: the medium absorbs light and scatters none"
        return f"{key}.sigma_s and sigma_a are 0: there is nothing to be seen"


def _parts_of(scene: Scene) -> list[_Part]:
    several = len(scene.bodies) > 1
    parts = [
        _Part(number if several else None, body, scene.medium_of(body))
        for number, body in enumerate(scene.bodies)
    ]
    return parts + [_Part(None, flame, scene.medium_of(flame)) for flame in scene.flames]


@dataclass(frozen=True)
class _Lamp:
    """A single light, with a map of its own."""

    number: int
    """Of the light of the scene that it is part of, from 1."""
    light: Light

    @property
    def name(self) -> str:
        return f"light {self.number}"

    @property
    def reach(self) -> float | None:
        reach: float | None = getattr(self.light, "reach", None)
        return reach


class _Finder:
    """Looks for the reason why the medium sends no light to the camera."""

    def __init__(self, result: RenderResult, visibility: Visibility, gbuffer: GBuffer | None) -> None:
        self._result, self._visibility, self._gbuffer = result, visibility, gbuffer
        self._scene: Scene = result.scene
        self._parts = _parts_of(self._scene)
        self._scattering = [part for part in self._parts if part.sends_light]
        self._scatters = np.max([part.scatters for part in self._parts], axis=0)

    def reason(self) -> str:
        """Return the first that holds."""
        reason = self._nothing_scatters() or self._not_seen()
        if not reason and any(part.emits for part in self._parts):
            reason = self._behind_absorbers()
        elif not reason and not (self._scatters * self._scene.ambient.radiance).any():
            reason = (
                self._no_light()
                or self._not_reached()
                or self._not_lit()
                or self._swallowed()
                or self._behind_absorbers()
            )
        return reason or self._too_faint()

    def why_unseen(self) -> str:
        """Return the first that holds where nothing is extinguished nor emitted on any camera ray."""
        return self._nothing_scatters() or self._not_seen()

    def _called(self, parts: list[_Part]) -> str:
        """Name the one body that is meant, where there are others."""
        return parts[0].name if len(parts) == 1 < len(self._parts) else "the medium"

    def _nothing_scatters(self) -> str:
        reasons = [part.why_dark() for part in self._parts]
        return "; ".join(dict.fromkeys(reasons)) if all(reasons) else ""

    # ----------------------------------------------------------------------------------------- the camera

    def _not_seen(self) -> str:
        """Tell why the camera sees nothing of what scatters."""
        if self._transmittance >= 1 and not (self._scene.emits and self._result.aovs["emission"].any()):
            return too_thin(self._scene) or self._out_of_sight(
                [part for part in self._parts if part.optical_depth > 0 or part.emits], meets_none=True
            )
        only_absorb = len(self._scattering) < len(self._parts)
        return self._out_of_sight(self._scattering, meets_none=False) if only_absorb else ""

    @property
    def _transmittance(self) -> float:
        """The least of all pixels and colours."""
        return float(self._result.aovs["transmittance"].min())

    def _ends_within(self) -> bool:
        """Tell whether camera rays end because nothing is to be seen through what lies before."""
        return self._transmittance <= ROUNDED_CUTOFF * max(self._scene.march.cutoff, SWALLOWED)

    def _out_of_sight(self, parts: list[_Part], *, meets_none: bool) -> str:
        """Tell why the camera sees nothing of some bodies; ``meets_none``: it is known that it does not."""
        boxes = [part.body.occupied_bounds for part in parts]
        if not np.isfinite(boxes).all():
            return ""
        reason = self._outside(self._called(parts), around(boxes))
        if reason:
            return reason
        reasons = [
            self._outside(called, box) or (self._between_pixels(called, box) if meets_none else "")
            for called, box in zip([self._called([part]) for part in parts], boxes, strict=True)
        ]
        return "; ".join(dict.fromkeys(reasons)) if all(reasons) else ""

    def _outside(self, called: str, bounds: Floats) -> str:
        """Tell why the picture shows nothing within a world box."""
        box = box_on_screen(bounds, self._scene.camera)
        if not box[0] < box[2]:
            return f"{called}, around {_point(bounds.mean(axis=0))}, is behind the camera"
        for what, frame in (("picture", (0, 0, *self._scene.camera.res)), ("crop", self._result.crop)):
            side = _side(box, frame)
            if side:
                return f"{called} lies {side} the {what}"
        if self._gbuffer is not None and self._is_hidden(self._gbuffer, bounds, box):
            return f"solids hide {called} from the camera"
        return ""

    def _between_pixels(self, called: str, bounds: Floats) -> str:
        if self._result.crop != (0, 0, *self._scene.camera.res):
            return "the camera's rays meet no density there"
        box = box_on_screen(bounds, self._scene.camera)
        size = min(box[2] - box[0], box[3] - box[1])
        if size < NARROWEST:
            return (
                f"the camera sees {called} only {size:.2g} pixels wide, between the rays through their "
                "centres: bring the camera nearer, or render more pixels"
            )
        return (
            f"the camera's rays meet no density within the bounds of {called}: what there is lies between "
            f"the pixels or between the {self._scene.march.steps} steps of a ray"
        )

    def _is_hidden(self, gbuffer: GBuffer, bounds: Floats, box: Floats) -> bool:
        """Tell whether solids lie before a world box in all pixels of ``box``, which show it."""
        x0, y0, x1, y1 = self._result.crop
        left, top = math.floor(max(box[0], x0)), math.floor(max(box[1], y0))
        right, bottom = math.ceil(min(box[2], x1)), math.ceil(min(box[3], y1))
        for y in range(top, bottom):
            begin, end = _within(bounds, *self._scene.camera.rays((left, y, right, y + 1)))
            if (begin < np.minimum(end, gbuffer.solid[y - y0, left - x0 : right - x0, 3])).any():
                return False
        return True

    # ------------------------------------------------------------------------------------------ the lights

    def _lamps(self) -> Iterator[_Lamp]:
        """Yield all single lights that a body could scatter something of."""
        for number, light in enumerate(self._scene.lights, 1):
            for part in light.parts():
                image = part.texture_image()
                brightest = 1.0 if image is None else image.max(axis=(0, 1))
                if (self._scatters * part.intensity * brightest).any():
                    yield _Lamp(number, part.fitted(self._scene.bounds))

    def _no_light(self) -> str:
        """Tell why all lights are dark, or of a colour that the medium does not scatter."""
        if next(self._lamps(), None) is not None:
            return ""
        lights = self._scene.lights
        lit = [i for i, light in enumerate(lights) if any(light.intensity)]
        if not lit and not any(self._scene.ambient.radiance):
            return (
                "light.intensity is 0" if len(lights) == 1 else f"all {len(lights)} lights have intensity 0"
            )
        black = [i for i in lit if _texture_is_black(lights[i])]
        if black and black == lit:
            return f"the texture of light {black[0] + 1} is black: {getattr(lights[black[0]], 'texture', '')}"
        scattered = " and ".join(name for name, sigma in zip(CHANNELS, self._scatters, strict=True) if sigma)
        return f"{self._called(self._scattering)} scatters {scattered} only, of which there is no light"

    def _not_reached(self) -> str:
        """Tell why no light's cone or reach holds anything that the camera sees of the medium."""
        lamps = list(self._lamps())
        all_scatter = len(self._scattering) == len(self._parts)
        if (
            self._result.lit
            and all_scatter
            and len(lamps) == sum(len(light.parts()) for light in self._scene.lights)
        ):
            return ""  # with dark lights, or bodies, among them it may be these that lit speaks of
        reached = [
            (lamp, part, points)
            for part in self._scattering
            for lamp in lamps
            if len(points := self._points_of(part, lamp.light))
        ]
        called = self._called(self._scattering)
        if not reached:
            return f"no light reaches {called}: {self._how_missed(lamps)}"
        shown = [(lamp, points) for lamp, part, points in reached if self._shows(lamp.light, part)]
        if not shown:
            return f"the lights reach {called} only outside of what the picture shows"
        widths = [self._width_in_pixels(lamp.light, points) for lamp, points in shown]
        widest = int(np.argmax(widths))
        if widths[widest] < NARROWEST:
            lamp = shown[widest][0]
            return (
                f"the {'cone' if lamp.light.type == 'spot' else 'reach'} of {lamp.name} is only "
                f"{widths[widest]:.2g} pixels wide where it meets {called}, and falls between them: widen "
                "it, or render more pixels"
            )
        return ""

    def _not_lit(self) -> str:
        """Tell why nothing is seen of what the lights reach."""
        if self._result.lit:
            return ""
        causes = ["has no density"] if self._scene.marched else []
        if self._ends_within():
            causes.append(f"lies behind more of it (lower {_thickest(self._parts).density_key})")
        if self._scene.solids:
            causes.append("lies behind solids")
        return f"what the lights reach of the medium {' or '.join(causes or ['is too little'])}"

    def _shows(self, light: Light, part: _Part) -> bool:
        """Tell whether the picture shows what a light may reach of a body."""
        rectangles = bounds_of_lights([light], self._scene.camera, part.body.occupied_bounds)
        x0, y0, x1, y1 = self._result.crop
        low, high = np.clip(rectangles.reshape(2, 2), (x0, y0), (x1, y1))
        return bool((low < high).all())

    def _lit_points(self, light: Light) -> Floats:
        """Points [n, 3], of the occupied bounds of all that scatters, that a light reaches."""
        return np.concatenate([self._points_of(part, light) for part in self._scattering])

    def _points_of(self, part: _Part, light: Light) -> Floats:
        """Points [n, 3] of a body's occupied bounds that a light reaches."""
        bounds = part.body.occupied_bounds
        origins, directions = light.rays(np.concatenate([texel_positions(RAYS), [[0.5, 0.5]]]))
        if np.isfinite(bounds).all():
            low, high = bounds
            begin, end = _within(bounds, origins, directions)
            hit = begin < end
            origins, directions, begin, end = origins[hit], directions[hit], begin[hit], end[hit]
            points = [low + LATTICE * (high - low)]
            shares = (1e-6, 0.25, 0.5, 0.75, 1 - 1e-6)
        else:
            points, shares = [], (1e-6, 1e-3, 0.1, 0.5, 0.9)
            begin = np.zeros(len(origins))
            end = begin + (
                getattr(light, "reach", None)
                or 10 * max(_distance(origins[0], self._scene.camera.from_), 1.0)
            )
        points += [origins + (begin + share * (end - begin))[:, None] * directions for share in shares]
        candidates = np.concatenate(points)
        reached: Floats = candidates[light.reaches(candidates) & (light.arrival(candidates).strength > 0)]
        return reached

    def _how_missed(self, lamps: list[_Lamp]) -> str:
        told: dict[int, str] = {}
        for lamp in lamps:
            if lamp.number not in told:
                told[lamp.number] = self._miss(lamp)
        some = list(told.values())[:MOST_TOLD]
        return "; ".join(some + ["…"] * (len(told) > MOST_TOLD))

    def _miss(self, lamp: _Lamp) -> str:
        endless = lamp.light.replace(reach=None) if lamp.reach is not None else None
        if endless is None or not len(self._lit_points(endless)):
            return f"the cone of {lamp.name} misses it"
        place = endless.begins(np.zeros((1, 3)))[0]
        away, nearest = min(
            (_distance(place, np.clip(place, *part.body.occupied_bounds)), i)
            for i, part in enumerate(self._scattering)
        )
        called = self._called([self._scattering[nearest]])
        return f"{lamp.name} ends at its reach of {lamp.reach:g}, and {called} begins {away:.3g} away"

    def _width_in_pixels(self, light: Light, points: Floats) -> float:
        """Width of what a light reaches, where it is widest in the picture."""
        cone = light.lit_cone()
        if cone is None:
            return math.inf
        camera = self._scene.camera
        depth = (points - cone.world_from_light[:3, 3]) @ cone.world_from_light[:3, 2]
        width = 2 * np.minimum(cone.reach, cone.slope * depth if math.isfinite(cone.slope) else math.inf)
        away = (points - np.asarray(camera.from_)) @ camera.world_from_camera[:3, 2]
        pixel = camera.pixel_width * away
        return float(np.max(np.broadcast_to(width, pixel.shape)[away > 0] / pixel[away > 0], initial=0.0))

    # -------------------------------------------------------------------------------------- on their way

    def _swallowed(self) -> str:
        """Tell what keeps the lights from what they would reach."""
        if self._result.aovs["light_transmittance"].max() >= SWALLOWED:
            return ""
        tracer = self._visibility.tracer(self._scene)
        if tracer is None:
            return (
                "the medium swallows the light before it gets to what the camera sees: lower "
                f"{_thickest(self._parts).density_key}"
            )
        for lamp in self._lamps():
            points = self._lit_points(lamp.light)
            directions = -lamp.light.arrival(points).direction
            if not tracer.occluded(points, directions, lamp.light.source_distance(points)).all():
                return "solids or the medium itself keep the light from what the camera sees of the medium"
        return "solids keep the light from the medium"

    def _behind_absorbers(self) -> str:
        """Tell which body hides those that scatter, and scatters nothing itself."""
        absorbing = [part for part in self._parts if part.optical_depth > 0 and not part.sends_light]
        if not absorbing or not self._ends_within():
            return ""
        thickest = _thickest(absorbing)
        return (
            f"what {'emits' if self._scene.emits else 'scatters'} light lies behind {thickest.name}, which "
            "only absorbs it: lower "
            f"{thickest.density_key}"
        )

    def _too_faint(self) -> str:
        textured = [number for number, light in enumerate(self._scene.lights, 1) if light.is_textured]
        if textured:
            return f"the texture of light {textured[0]} is black where the camera sees it fall on the medium"
        key = "light.intensity" if self._scene.lights else "ambient.radiance"
        if self._scene.emits:
            key = f"medium.emission or {key}"
        return (
            "too little light for float32 numbers arrives at what the camera sees of the medium: raise " + key
        )


def _thickest(parts: list[_Part]) -> _Part:
    return max(parts, key=lambda part: part.optical_depth)


def _texture_is_black(light: Light) -> bool:
    return bool(getattr(light, "texture", "")) and all(
        not any(part.intensity) or ((image := part.texture_image()) is not None and not image.any())
        for part in light.parts()
    )


def _within(bounds: Floats, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Part of rays inside a box: begin ≥ 0, end, both [rays]; the end is not greater where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = (bounds[:, None] - origins) / directions
    along = np.isnan(sides).any(axis=0)  # a ray within one of the box's sides
    low = np.where(along, -np.inf, sides.min(axis=0))
    high = np.where(along, np.inf, sides.max(axis=0))
    return np.maximum(low.max(axis=1), 0), high.min(axis=1)


def _side(box: Floats, frame: tuple[int, int, int, int]) -> str:
    """On which side of a frame a rectangle lies; empty where they meet."""
    sides = ("right of", "below", "left of", "above")
    beyond = (box[0] >= frame[2], box[1] >= frame[3], box[2] <= frame[0], box[3] <= frame[1])
    return next((side for side, is_there in zip(sides, beyond, strict=True) if is_there), "")


def _diagonal(bounds: Floats) -> float:
    return float(np.linalg.norm(bounds[1] - bounds[0]))


def _distance(one: Floats, other: Floats | tuple[float, float, float]) -> float:
    return float(np.linalg.norm(np.subtract(one, other)))


def _point(point: Floats) -> str:
    return ",".join(f"{value:.4g}" for value in point)
