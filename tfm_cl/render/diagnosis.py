"""Why a picture is black: looked for only in pictures that are, and told in one line.

What keeps light from a camera is looked for in the order in which it would be mended: density and medium,
what the camera sees of them, the lights, what they reach.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tfm_cl.files.image_io.png import linear_from_srgb
from tfm_cl.model import LARGEST_COLOUR
from tfm_cl.render.culling import bounds_of_lights, box_on_screen
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.lights.base import Light, texel_positions

if TYPE_CHECKING:
    from tfm_cl.render.result import RenderResult
    from tfm_cl.render.visibility import GBuffer, Visibility
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Media, Scene

Floats = NDArray[np.float64]

THINNEST = 2e-4
"""Optical depth of which, with the intensity that lights are placed with, no 8 bits show anything."""
EIGHT_BIT_STEP = float(linear_from_srgb(np.array(0.5 / 255)))
"""The least value that a PNG does not round to 0."""
MOST_STOPS = 100
"""Of an exposure."""
FAINTEST = EIGHT_BIT_STEP / 2.0**MOST_STOPS
"""What is darker counts as black: no exposure shows it."""
MID_GREY = 0.2
"""What the exposure that is proposed makes of the brightest value, about."""
SWALLOWED = 1e-20
"""Transmittance of which nothing is left to be seen."""
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
    rows = (image[len(image) // 2], *image)  # first the middle, where most pictures have some
    return not any((row[:, :3] >= FAINTEST).any() for row in rows)


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
    gbuffer = visibility.gbuffer(result.scene, result.crop)
    reasons = [_Finder(result, visibility, gbuffer).reason()]
    if gbuffer is not None and gbuffer.shown.any():
        dark = not gbuffer.albedo[gbuffer.shown].any()
        reasons.append(
            "the solids in view have the albedo 0" if dark else "no light reaches the solids in view"
        )
    return f"{_black(result)}: {'; '.join(reasons)}"


def too_dark(result: RenderResult, exposure: float) -> str:
    """Tell why a picture that has light is black in 8 bits; empty where it is not.

    Parameters
    ----------
    exposure
        Stops, of the PNG.
    """
    brightest = float(result.image[..., :3].max())
    if not FAINTEST <= brightest < EIGHT_BIT_STEP / 2.0**exposure:
        return ""
    stops = min(math.ceil(math.log2(MID_GREY / brightest)), MOST_STOPS)
    reason = f"its brightest value, {brightest:.3g}, is less than an 8-bit step: --exposure {stops} shows it"
    thin = too_thin(result.scene.volume, result.scene.medium)
    return f"{_black(result)}: {reason}" + (f"; {thin}" if thin else "")


def without_density(volume: Volume | Homogeneous) -> str:
    """Tell why a volume has no density at all; empty where it has."""
    if isinstance(volume, Homogeneous):
        return "" if volume.density > 0 else "volume.density is 0"
    if volume.density_scale == 0:
        return "density_scale is 0"
    if volume.largest > 0:
        return ""
    return "all voxels are 0" if volume.colour is None else "all voxels times their colours are 0"


def too_thin(volume: Media, medium: Medium) -> str:
    """Tell why a medium is too thin to be seen, however it is lit; empty where it is not."""
    if isinstance(volume, Homogeneous):
        depths = [volume.density * _diagonal(volume.bounds)]
    else:
        depths = [
            part.density_scale * part.largest * _diagonal(part.occupied_bounds) for part in volume.parts
        ]
    depth = sum(depths) * float(medium.sigma_t.max())
    if not depth < THINNEST:
        return ""
    reason = f"the medium is too thin to be seen, its optical depth at most {depth:.2g}"
    if min((part.density_scale for part in volume.parts), default=0.0) == LARGEST_COLOUR:
        return f"{reason} even with the largest density_scale, {LARGEST_COLOUR:g}"
    return f"{reason}: raise {_density_key(volume)}"


def _density_key(volume: Media) -> str:
    return "volume.density" if isinstance(volume, Homogeneous) else "density_scale"


def _black(result: RenderResult) -> str:
    whole = result.crop == (0, 0, *result.scene.camera.res)
    return "the picture is black" + ("" if whole else f" within the crop {','.join(map(str, result.crop))}")


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
        self._bounds: Floats = self._scene.volume.occupied_bounds
        self._scatters = np.asarray(self._scene.medium.sigma_s)
        volume = self._scene.volume
        if isinstance(volume, Volume) and volume.colour is not None:
            self._scatters = self._scatters * [channel.largest > 0 for channel in volume.channels]

    def reason(self) -> str:
        """Return the first that holds."""
        aovs = self._result.aovs
        reason = self._no_density() or self._no_scattering()
        if not reason and aovs["transmittance"].min() >= 1:
            reason = self._not_seen()
        if not reason and not (self._scatters * self._scene.ambient.radiance).any():
            reason = self._no_light() or self._not_reached() or self._not_lit() or self._swallowed()
        return reason or self._too_faint()

    # ------------------------------------------------------------------------------------------- the medium

    def _no_density(self) -> str:
        volume = self._scene.volume
        if isinstance(volume, Homogeneous):
            return without_density(volume)
        reasons = [(part.label, without_density(part)) for part in volume.parts]
        if not all(reason for _, reason in reasons):
            return ""
        return "; ".join(dict.fromkeys(f"{label}: {reason}" for label, reason in reasons))

    def _no_scattering(self) -> str:
        if self._scatters.any():
            return ""
        if any(self._scene.medium.sigma_s):
            return "medium.sigma_s is 0 in all channels that the volume's colours have"
        if any(self._scene.medium.sigma_a):
            return "medium.sigma_s is 0: the medium absorbs light and scatters none"
        return "medium.sigma_s and sigma_a are 0: there is nothing to be seen"

    # ----------------------------------------------------------------------------------------- the camera

    def _not_seen(self) -> str:
        """Tell why the camera sees nothing of the medium."""
        thin = too_thin(self._scene.volume, self._scene.medium)
        if thin or not np.isfinite(self._bounds).all():
            return thin
        box = box_on_screen(self._bounds, self._scene.camera)
        return self._outside(box) or self._between_pixels(box)

    def _outside(self, box: Floats) -> str:
        """Tell why the picture shows no part of ``box``, which the medium's bounds are on the screen."""
        if not box[0] < box[2]:
            return f"the medium, around {_point(self._bounds.mean(axis=0))}, is behind the camera"
        for what, frame in (("picture", (0, 0, *self._scene.camera.res)), ("crop", self._result.crop)):
            side = _side(box, frame)
            if side:
                return f"the medium lies {side} the {what}"
        if self._gbuffer is not None and self._is_hidden(self._gbuffer, box):
            return "solids hide the medium from the camera"
        return ""

    def _between_pixels(self, box: Floats) -> str:
        if self._result.crop != (0, 0, *self._scene.camera.res):
            return "the camera's rays meet no density there"
        size = min(box[2] - box[0], box[3] - box[1])
        if size < NARROWEST:
            return (
                f"the camera sees the medium only {size:.2g} pixels wide, between the rays through their "
                "centres: bring the camera nearer, or render more pixels"
            )
        return (
            "the camera's rays meet no density within the medium's bounds: what there is lies between the "
            f"pixels or between the {self._scene.march.steps} steps of a ray"
        )

    def _is_hidden(self, gbuffer: GBuffer, box: Floats) -> bool:
        """Tell whether solids lie before the medium's bounds in all pixels that show these."""
        x0, y0, x1, y1 = self._result.crop
        left, top = math.floor(max(box[0], x0)), math.floor(max(box[1], y0))
        right, bottom = math.ceil(min(box[2], x1)), math.ceil(min(box[3], y1))
        for y in range(top, bottom):
            begin, end = _within(self._bounds, *self._scene.camera.rays((left, y, right, y + 1)))
            if (begin < np.minimum(end, gbuffer.solid[y - y0, left - x0 : right - x0, 3])).any():
                return False
        return True

    # ------------------------------------------------------------------------------------------ the lights

    def _lamps(self) -> Iterator[_Lamp]:
        """Yield all single lights that the medium could scatter something of."""
        for number, light in enumerate(self._scene.lights, 1):
            for part in light.parts():
                image = part.texture_image()
                brightest = 1.0 if image is None else image.max(axis=(0, 1))
                if (self._scatters * part.intensity * brightest).any():
                    yield _Lamp(number, part.fitted(self._scene.volume.bounds))

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
        return f"the medium scatters {scattered} only, of which there is no light"

    def _not_reached(self) -> str:
        """Tell why no light's cone or reach holds anything that the camera sees of the medium."""
        lamps = list(self._lamps())
        if self._result.lit and len(lamps) == sum(len(light.parts()) for light in self._scene.lights):
            return ""  # with dark lights among them it may be these that lit speaks of
        places = [(lamp, self._lit_points(lamp.light)) for lamp in lamps]
        reached = [(lamp, points) for lamp, points in places if len(points)]
        if not reached:
            return f"no light reaches the medium: {self._how_missed(lamps)}"
        x0, y0, x1, y1 = self._result.crop
        rectangles = bounds_of_lights([lamp.light for lamp, _ in reached], self._scene.camera, self._bounds)
        inside = np.clip(rectangles.reshape(-1, 2, 2), (x0, y0), (x1, y1))
        shown = [reached[i] for i in np.flatnonzero((inside[:, 0] < inside[:, 1]).all(axis=1))]
        if not shown:
            return "the lights reach the medium only outside of what the picture shows"
        widths = [self._width_in_pixels(lamp.light, points) for lamp, points in shown]
        widest = int(np.argmax(widths))
        if widths[widest] < NARROWEST:
            lamp = shown[widest][0]
            return (
                f"the {'cone' if lamp.light.type == 'spot' else 'reach'} of {lamp.name} is only "
                f"{widths[widest]:.2g} pixels wide where it meets the medium, and falls between them: widen "
                "it, or render more pixels"
            )
        return ""

    def _not_lit(self) -> str:
        """Tell why nothing is seen of what the lights reach."""
        if self._result.lit:
            return ""
        causes = [] if isinstance(self._scene.volume, Homogeneous) else ["has no density"]
        if self._result.aovs["transmittance"].min() <= self._scene.march.cutoff:
            causes.append(f"lies behind more of it (lower {_density_key(self._scene.volume)})")
        if self._scene.solids:
            causes.append("lies behind solids")
        return f"what the lights reach of the medium {' or '.join(causes or ['is too little'])}"

    def _lit_points(self, light: Light) -> Floats:
        """Points [n, 3] of the medium's occupied bounds that a light reaches."""
        origins, directions = light.rays(np.concatenate([texel_positions(RAYS), [[0.5, 0.5]]]))
        if np.isfinite(self._bounds).all():
            low, high = self._bounds
            begin, end = _within(self._bounds, origins, directions)
            hit = begin < end
            origins, directions, begin, end = origins[hit], directions[hit], begin[hit], end[hit]
            points = [low + LATTICE * (high - low)]
            parts = (1e-6, 0.25, 0.5, 0.75, 1 - 1e-6)
        else:
            points, parts = [], (1e-6, 1e-3, 0.1, 0.5, 0.9)
            begin = np.zeros(len(origins))
            end = begin + (
                getattr(light, "reach", None)
                or 10 * max(_distance(origins[0], self._scene.camera.from_), 1.0)
            )
        points += [origins + (begin + part * (end - begin))[:, None] * directions for part in parts]
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
        nearest = _distance(place, np.clip(place, *self._bounds))
        return f"{lamp.name} ends at its reach of {lamp.reach:g}, and the medium begins {nearest:.3g} away"

    def _width_in_pixels(self, light: Light, points: Floats) -> float:
        """Width of what a light reaches, where it is widest in the picture."""
        cone = light.lit_cone()
        if cone is None:
            return math.inf
        camera = self._scene.camera
        depth = (points - cone.world_from_light[:3, 3]) @ cone.world_from_light[:3, 2]
        width = 2 * np.minimum(cone.reach, cone.slope * depth if math.isfinite(cone.slope) else math.inf)
        away = (points - np.asarray(camera.from_)) @ camera.world_from_camera[:3, 2]
        pixel = 2 * math.tan(math.radians(camera.fov) / 2) * away / camera.res[1]
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
                f"{_density_key(self._scene.volume)}"
            )
        for lamp in self._lamps():
            points = self._lit_points(lamp.light)
            directions = -lamp.light.arrival(points).direction
            if not tracer.occluded(points, directions, lamp.light.source_distance(points)).all():
                return "solids or the medium itself keep the light from what the camera sees of the medium"
        return "solids keep the light from the medium"

    def _too_faint(self) -> str:
        textured = [
            number for number, light in enumerate(self._scene.lights, 1) if light.texture_image() is not None
        ]
        if textured:
            return f"the texture of light {textured[0]} is black where the camera sees it fall on the medium"
        return (
            "too little light for float32 numbers arrives at what the camera sees of the medium: raise "
            "light.intensity"
        )


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
