"""Camera, light and ground for a volume that comes without: a good picture by itself."""

import itertools
import math
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import SceneError
from tfm_cl.limits import LARGEST_COLOUR, LARGEST_COORDINATE
from tfm_cl.model import Triple
from tfm_cl.scene.bodies.base import around
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.frames import AXES, Axis, as_direction, from_y_up
from tfm_cl.scene.lights.base import LIGHTS, Light, parse_light
from tfm_cl.scene.lights.surroundings import Surroundings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfm_cl.scene.bodies.base import Body
    from tfm_cl.scene.solids.base import Solid

TOWARDS_CAMERA = (0.35, 0.18, 1.0)
"""From the volume to the camera: in front, a little to the right and above, where y is up."""
TOWARDS_LIGHT = (-0.75, 0.9, 0.35)
"""From the volume to the light: above, to the left, slightly in front: shape by half shadow."""
LIGHT_DISTANCE = 4.0
"""Radii of the bounding sphere between its centre and the light."""
INTENSITY = 15.0
"""An isotropic, white, dense medium returns about 1/4π of the light: this brings it near white."""
WIDEST_CONE = 60.0
"""Degrees."""
TURNS = 8
"""In which a camera is moved to where the picture is filled: each halves what is left to move, at least."""


class Outlined(Protocol):
    """What something is placed by: a body, or what is known of one."""

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """As `Body.occupied_bounds`."""

    def outline(self) -> NDArray[np.float64]:
        """As `Body.outline`."""


def camera_for(
    bodies: "Sequence[Outlined]",
    /,
    filled: float | None = None,
    height: float = TOWARDS_CAMERA[1],
    hazy: float | None = None,
    **given: Any,
) -> Camera:
    """Make a camera from the keys given; it looks at the occupied bounds, which fill the frame.

    It stands in the frame of ``up``: where z is up, x is still to the right, and it looks along +y.

    Parameters
    ----------
    filled
        Part of the frame's height or width, whichever is first, that what is seen of the bodies fills,
        without wisps, in its middle; None: the corners of the bounds fill all of it.
    height
        Of the camera above them, over its distance in front of them.
    hazy
        What `Camera.haze` is, over the distance to what it looks at, unless it is given; None: there is none.
    """
    if "matrix" in given:
        return Camera(**given)
    if "from" in given and "to" in given:
        return _hazy(Camera(**given), hazy)
    centre, radius = _sphere(bodies)
    asked = set(given)
    given.setdefault("to", _point(centre, radius))
    if "from" not in given:
        towards = _from_y_up(given.get("up", (0, 1, 0))) @ (TOWARDS_CAMERA[0], height, TOWARDS_CAMERA[2])
        # Any place serves to check the other keys and learn the angle of view.
        camera = Camera(**{**given, "from": _vector(given["to"]) + towards})
        width, height = camera.res
        tangent = np.tan(np.radians(camera.fov) / 2)
        # Each corner of the bounds, in camera axes, has to stay within the frame's sides.
        corners = _corners(bodies) - _vector(given["to"])
        right, up, forward = (corners @ camera.world_from_camera[:3, :3]).T
        with np.errstate(over="ignore"):  # an angle of nearly 0: as far away as can be
            distance = np.maximum(np.abs(right) * height / width, np.abs(up)) / tangent - forward
        away = min(float(distance.max()), LARGEST_COORDINATE)
        given["from"] = _along(_vector(given["to"]), towards, away, radius)
        if filled is not None:
            given |= _closer(bodies, Camera(**given), filled, fixed="to" in asked)
    return _hazy(Camera(**given), hazy)


def _hazy(camera: Camera, hazy: float | None) -> Camera:
    if hazy is None or "haze" in camera.model_fields_set:
        return camera
    return camera.replace(haze=float(f"{hazy * np.linalg.norm(np.subtract(camera.to, camera.from_)):.3g}"))


def _closer(bodies: "Sequence[Outlined]", camera: Camera, filled: float, *, fixed: bool) -> dict[str, Triple]:
    """Return from and to with which what is seen of bodies fills part of the frame; ``fixed``: to stays."""
    points = np.concatenate([body.outline() for body in bodies])
    if not len(points):
        return {}
    width, height = camera.res
    half = filled * np.tan(np.radians(camera.fov) / 2) * np.array([width / height, 1.0])
    middle, axes = np.asarray(camera.to, dtype=np.float64), camera.world_from_camera[:3, :3]
    away = float(np.linalg.norm(np.subtract(camera.from_, middle)))
    for _ in range(TURNS):
        seen = (points - middle) @ axes
        depth = np.maximum(away + seen[:, 2], 1e-6 * away)[:, None]
        ends = np.stack([(seen[:, :2] / depth).min(axis=0), (seen[:, :2] / depth).max(axis=0)])
        if not fixed:
            middle = middle + away * (axes[:, :2] @ ends.mean(axis=0))
            seen = (points - middle) @ axes
        away = float((np.abs(seen[:, :2]) / half - seen[:, 2:]).max())
    extent = float(np.ptp(points, axis=0).max()) or away
    return {"from": _point(middle - away * axes[:, 2], extent), "to": _point(middle, extent)}


def light_for(bodies: "Sequence[Outlined]", camera: Camera, /, **given: Any) -> Light:
    """Make a light from the keys given: of any type, above and to the left; a spot's cone holds the medium.

    With the intensity chosen here, what reaches the volume's centre through no medium is `INTENSITY`
    whatever the type, falloff and distance.
    """
    kind = given.get("type", "spot")
    known = LIGHTS.get(kind) if isinstance(kind, str) else None
    if known is None:
        return parse_light(given)  # which refuses it
    right, up, forward = camera.world_from_camera[:3, :3].T
    left_up_front = TOWARDS_LIGHT[0] * right + TOWARDS_LIGHT[1] * up - TOWARDS_LIGHT[2] * forward
    if issubclass(known, Surroundings):
        return parse_light(known.placed(INTENSITY, left_up_front, camera.up) | given)
    keys = known.keys()
    centre, radius = _sphere(bodies)
    given.setdefault("from", _along(centre, left_up_front, LIGHT_DISTANCE * radius, radius))
    if "to" in keys:
        given.setdefault("to", _point(centre, radius))
    distance = float(np.linalg.norm(centre - _vector(given["from"])))
    intensity = INTENSITY
    if given.get("falloff") == "inverse-square":
        # Three digits, and from inside as from the surface: the volume begins at no distance.
        intensity = float(f"{min(INTENSITY * max(distance, radius) ** 2, LARGEST_COLOUR):.3g}")
    given.setdefault("intensity", intensity)
    if "cone" in keys:
        # From inside the sphere no cone holds it: take a wide one.
        half_angle = np.degrees(np.arcsin(radius / distance)) + 0.5 if distance > radius else WIDEST_CONE
        given.setdefault("cone", round(min(float(half_angle), WIDEST_CONE), 1))
    return parse_light(given)


def solids_for(solids: "Sequence[Solid]", bodies: "Sequence[Body]", camera: Camera) -> "tuple[Solid, ...]":
    """Return the solids, with a ground where it is not said: under all that has density and all other solids.

    Raises
    ------
    SceneError
        Nothing has a lowest point; or a mesh cannot be used.
    """

    @cache
    def boxes() -> list[np.ndarray]:
        found = [body.occupied_bounds for body in bodies]
        found += [box for box in (solid.bounds() for solid in solids) if box is not None]
        return [box for box in found if np.isfinite(box).all()]

    return tuple(solid.settled(upwards(camera), boxes) for solid in solids)


def upwards(camera: Camera) -> Axis:
    """Return the world's axis nearest to what is up; a matrix tells what is up in the picture only."""
    if camera.matrix is not None:
        return "y"
    return max(AXES, key=lambda name: float(np.dot(AXES[name], camera.up)))


def _looked_at(bodies: "Sequence[Outlined]") -> np.ndarray:
    """World box around what has density, [2, 3]; what is everywhere is looked through."""
    boxes = [box for box in (body.occupied_bounds for body in bodies) if np.isfinite(box).all()]
    return around(boxes) if boxes else np.array([[-np.inf] * 3, [np.inf] * 3])


def _corners(bodies: "Sequence[Outlined]") -> np.ndarray:
    return np.array(list(itertools.product(*_looked_at(bodies).T)))


def _sphere(bodies: "Sequence[Outlined]") -> tuple[np.ndarray, float]:
    low, high = _looked_at(bodies)
    if not np.isfinite([low, high]).all():
        raise SceneError("a medium everywhere has no middle: give the scene a camera and lights")
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def _vector(value: Any) -> np.ndarray:
    """Three numbers, or zeros for what the camera or the light will refuse with its own words."""
    try:
        vector = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.zeros(3)
    return vector if vector.shape == (3,) and (np.abs(vector) <= LARGEST_COORDINATE).all() else np.zeros(3)


def _from_y_up(up: Any) -> np.ndarray:
    """Return the smallest rotation, 3×3, that takes +y to ``up``; none for what the camera will refuse."""
    try:
        return from_y_up(_vector(as_direction(up)))
    except ValueError:
        return np.eye(3)


def _along(centre: np.ndarray, direction: np.ndarray, distance: float, extent: float) -> Triple:
    return _point(centre + distance * direction / np.linalg.norm(direction), extent)


def _point(position: np.ndarray, extent: float) -> Triple:
    # Four digits of the volume's extent, wherever it lies: good enough to type by hand.
    digits = 4 - math.floor(math.log10(extent))
    x, y, z = (round(float(item), digits) + 0.0 for item in position)
    return x, y, z
