"""The perspective camera."""

from collections.abc import Collection, Sequence
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from tfm_cl.errors import SceneError, words
from tfm_cl.model import Model, Point, Triple, Vec3, check_different
from tfm_cl.model_fields import Accepts, Numbers, accepts, numbers
from tfm_cl.scene.frames import Axis, as_direction, look_at
from tfm_cl.scene.transform import Matrix, Rows, lengths_of

MAX_PIXELS = 1 << 28
"""Largest number of pixels of an image: 16384 × 16384."""
AXES_ALIKE = 1e-3
"""By how much axes of a matrix may differ from unit length and a right angle: printed numbers have few
digits."""
SENSOR_WIDTH = 36.0
"""Millimetres, of a full-frame camera."""
RIVALS = (
    (("fov",), ("focal_length", "sensor_width"), "say how wide the view is"),
    (("from", "to", "up"), ("matrix",), "say where the camera is"),
)
"""Keys that say the same in two ways, of which a camera has one, and what they say."""


@accepts(numbers(2, "integer", minimum=1))
def _resolution(value: object) -> tuple[int, int]:
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2  # noqa: PLR2004 - width, height
        or not all(isinstance(item, int) and not isinstance(item, bool) for item in value)
    ):
        raise ValueError("should be two whole numbers [width, height]")
    width, height = value
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise ValueError(f"should be at least 1×1 and at most {MAX_PIXELS:,} pixels")
    return width, height


def _rigid(matrix: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    axes = np.array(matrix)[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    if np.abs(lengths - 1).max() > AXES_ALIKE:
        shown = ", ".join(f"{length:.4g}" for length in lengths)
        raise ValueError(f"a camera has no scale: divide the first three columns by their lengths {shown}")
    if np.abs(axes.T @ axes - np.eye(3)).max() > 2 * AXES_ALIKE:
        raise ValueError("its first three columns should be at right angles to each other")
    if np.linalg.det(axes) < 0:
        raise ValueError("it mirrors the picture: x to the right, y up and z to the back are right-handed")
    return matrix


_world_from_camera = lru_cache(maxsize=16)(look_at)
"""Every frame asks for it several times."""


def _placed_by(matrix: tuple[tuple[float, ...], ...]) -> tuple[Triple, Triple, Triple]:
    """Return the position, the view's direction and up that a matrix says."""
    _, up, backwards, position = ((x, y, z) for x, y, z in zip(*matrix[:3], strict=True))
    return position, (-backwards[0], -backwards[1], -backwards[2]), up


def _fault(line: str) -> PydanticCustomError:
    return PydanticCustomError("faults", "{lines}", {"lines": [line]})


def outdone(keys: Collection[str]) -> set[str]:
    """Return the keys that say in another way what these keys, which were given later, say.

    ``up`` and ``sensor_width`` alone do not say enough to stand in for others.
    """
    enough = set(keys) - {"up", "sensor_width"}
    sides = [(one, other) for *rivals, _ in RIVALS for one, other in (rivals, rivals[::-1])]
    return {key for one, other in sides if enough & set(one) for key in other}


class Camera(Model):
    """A pinhole camera anywhere: outside or inside the medium or a light's cone.

    Camera space: x to the right, y up, z into the scene; only the key ``matrix`` has z to the back, as other
    programs do. Pixel (0, 0) is at the top left; one ray passes through the centre of each pixel.

    It stands where ``from`` and ``to`` or a ``matrix`` say, and its view is as wide as ``fov`` or
    ``focal_length`` says. All but ``matrix`` and ``focal_length`` can be read of every camera: with a matrix
    ``to`` is 1 in front of it.
    """

    SECTION: ClassVar[str] = "camera"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "from": "position location origin eye lookfrom pos translation",
            "to": "lookat target at interest center centre aim poi",
            "up": "upvector vup roll",
            "res": "resolution size filmsize imagesize dimensions width height xres yres",
            "fov": "fovy vfov yfov fieldofview angle vertical angleofview",
            "fov is vertical: 2 atan(tan(horizontal / 2) height / width); or write focal_length": (
                "fovx hfov xfov horizontalfov fovhorizontal"
            ),
            "focal_length": "focal lens focallengthmm",
            "haze": "aerialperspective fogdistance mist visibility",
            "sensor_width": "sensor sensorsize filmwidth horizontalaperture filmback gate",
            "matrix": "transform toworld worldfromcamera cameratoworld worldmatrix rotation",
            "leave it out: the camera is a pinhole, and all is in focus": (
                "fstop fstops aperture dof focusdistance focaldistance lensradius aperturesize"
            ),
            "leave it out: nothing is clipped": (
                "near far nearclip farclip clipstart clipend clipping znear zfar"
            ),
            "leave it out: cameras are perspective": "type projection",
            "write it in [image]": "exposure samples spp filter crop",
        }
    )

    from_: Vec3 = Field(validation_alias="from", description="position, world units")
    to: Vec3 = Field(description="point that the camera looks at, world units")
    up: Accepts[Numbers | Axis, Annotated[Point, BeforeValidator(as_direction)]] = Field(
        default=(0.0, 1.0, 0.0),
        validate_default=True,
        description="direction that is up in the image, and for what is placed automatically: camera, light, "
        "sky and ground; x,y,z or an axis, as z for data of programs whose z is up",
    )
    matrix: Accepts[Rows | None, Annotated[Matrix, AfterValidator(_rigid)] | None] = Field(
        default=None,
        validate_default=True,
        description="instead of from, to and up: world from camera, 4x4, 16 numbers row by row, the position "
        "in the last column; x is to the right, y up, and the camera looks along -z, as in Blender, Maya, "
        "Houdini, USD and glTF; without scale",
    )
    fov: float = Field(
        default=40.0, gt=0, lt=180, description="vertical field of view, the full angle, degrees"
    )
    focal_length: float | None = Field(
        default=None, gt=0, description="instead of fov: focal length of the lens, millimetres"
    )
    sensor_width: float = Field(
        default=SENSOR_WIDTH,
        gt=0,
        description="with focal_length: width of what the picture's width shows of the sensor, millimetres",
    )
    haze: float | None = Field(
        default=None,
        gt=0,
        description="distance, world units, over which solids fade into the background, as in hazy air: "
        "exp(-distance / haze) is seen of them; none: they do not",
    )
    res: Accepts[Sequence[int], Annotated[tuple[int, int], BeforeValidator(_resolution)]] = Field(
        default=(1280, 720), validate_default=True, description="width and height in pixels"
    )

    @model_validator(mode="before")
    @classmethod
    def _says_nothing_twice(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        attributes = cls.keys()
        given = [key for key, name in attributes.items() if values.get(key, values.get(name)) is not None]
        for *rivals, what in RIVALS:
            one, other = ([key for key in keys if key in given] for keys in rivals)
            if one and other:
                both = " and ".join(f"camera.{keys[0]}" for keys in (one, other))
                raise _fault(f"{both} both {what}; keep one")
        if "sensor_width" in given and "focal_length" not in given:
            raise _fault("camera.sensor_width needs camera.focal_length: give both, or fov")
        # `to_dict` writes None for keys that have no say.
        silent = {name for key in outdone(given) for name in (key, attributes[key])}
        values = {key: value for key, value in values.items() if key not in silent}
        # What follows from a matrix is filled in when that has been checked.
        return {"from": (0, 0, 0), "to": (0, 0, -1)} | values if "matrix" in given else values

    @model_validator(mode="after")
    def _follows_lens_and_matrix(self) -> Self:
        found: dict[str, Any] = {}
        if self.focal_length is not None:
            width, height = self.res
            half_height = self.sensor_width / 2 * height / width
            found["fov"] = float(np.degrees(2 * np.arctan2(half_height, self.focal_length)))
            if not 0 < found["fov"] < 180:  # noqa: PLR2004 - degrees
                raise _fault(
                    f"camera.focal_length = {self.focal_length:g}: with a sensor {self.sensor_width:g} wide "
                    f"the field of view is {found['fov']:g} degrees; it should be between 0 and 180"
                )
        if self.matrix is not None:
            position, forward, up = _placed_by(self.matrix)
            x, y, z = np.add(position, forward).tolist()
            found |= {"from_": position, "to": (x, y, z), "up": up}
        self.__dict__.update(found)
        self.model_fields_set.difference_update(found)  # they are not said, but follow
        return self

    @model_validator(mode="after")
    def _has_a_frame(self) -> Self:
        if self.matrix is not None:
            return self
        check_different(self.from_, self.to, "from and to")
        forward = np.subtract(self.to, self.from_)
        sine = np.linalg.norm(np.cross(forward, self.up)) / (
            np.linalg.norm(forward) * max(float(np.linalg.norm(self.up)), 1e-30)
        )
        if sine < 1e-6:  # noqa: PLR2004 - parallel within float32
            raise ValueError(f"up {list(self.up)} is zero or along the view direction; choose another")
        return self

    def replace(self, **changes: Any) -> Self:
        """Return a copy with other values; what says the same in another way is given up for them."""
        attributes = self.keys()
        kept = {name: getattr(self, name) for name in self.model_fields_set}
        said = {key for key, value in changes.items() if value is not None}
        for key in outdone({key for key, name in attributes.items() if key in said or name in said}):
            kept.pop(attributes[key], None)
        return type(self)(**kept | {attributes.get(key, key): value for key, value in changes.items()})

    def turned(self, degrees: float) -> Self:
        """Return a camera that is turned about ``up`` through ``to``; seen from above, counter-clockwise."""
        if degrees == 0:
            return self
        if self.matrix is not None:
            raise SceneError("camera.matrix: is not turned; a turntable needs camera.from and camera.to")
        axis, away = np.array(self.up) / np.linalg.norm(self.up), np.subtract(self.from_, self.to)
        angle = np.radians(degrees)
        along = axis * (axis @ away)
        across = away - along
        moved = along + np.cos(angle) * across + np.sin(angle) * np.cross(axis, across)
        return self.replace(from_=tuple((self.to + moved).tolist()))

    def to_dict(self) -> dict[str, Any]:
        """Return the section as a scene file writes it; None for what follows from other keys."""
        unsaid = {"fov"} if self.focal_length is not None else {"focal_length", "sensor_width"}
        unsaid |= {"from", "to", "up"} if self.matrix is not None else {"matrix"}
        return super().to_dict() | dict.fromkeys(unsaid)

    @property
    def world_from_camera(self) -> NDArray[np.float64]:
        """4×4; the columns are right, up, forward and the position."""
        if self.matrix is None:
            return _world_from_camera(self.from_, self.to, self.up).copy()
        position, forward, up = _placed_by(self.matrix)
        matrix = _world_from_camera(
            (0.0, 0.0, 0.0), forward, up
        ).copy()  # far away 1 in front would be rounded
        matrix[:3, 3] = position
        return matrix

    def seen_of(self, distance: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Return which part `haze` leaves of what is at finite distances, world units."""
        if self.haze is None:
            return np.ones_like(distance)
        with np.errstate(over="ignore", divide="ignore"):  # float32 may not have it
            seen: NDArray[np.floating[Any]] = np.exp(-distance / self.haze)
        return seen

    @property
    def pixel_width(self) -> float:
        """Width of a pixel at distance 1, in the middle of the picture."""
        return float(2 * np.tan(np.radians(self.fov) / 2) / self.res[1])

    @property
    def ndc_from_camera(self) -> NDArray[np.float64]:
        """4×4 perspective: after division by w, x and y in [-1, 1] span the image (y up); depth is 1/z."""
        width, height = self.res
        scale = 1.0 / np.tan(np.radians(self.fov) / 2)
        rows = [[scale * height / width, 0, 0, 0], [0, scale, 0, 0], [0, 0, 0, 1], [0, 0, 1, 0]]
        return np.array(rows, dtype=np.float64)

    def rays(
        self, crop: tuple[int, int, int, int] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Origins and unit directions, both [pixels, 3], world, of the rays through the pixels' centres.

        Row by row from the top, for the pixels x0, y0, x1, y1 (end excluded) or for all pixels.

        Raises
        ------
        SceneError
            When the crop is not inside the frame.
        """
        columns, rows = self._centres(crop)
        x, y = np.meshgrid(columns, rows)
        return self.rays_through(x.ravel(), y.ravel())

    def directions(
        self, crop: tuple[int, int, int, int] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Directions of `rays`, [pixels, 3], in float32, and their cosines with the camera's, [pixels].

        In memory all x come first, then all y: for what works on many at once.

        Raises
        ------
        SceneError
            As of `rays`.
        """
        (width, height), pixel, (x, y) = self.res, self.pixel_width, self._centres(crop)
        right, up, forward = self.world_from_camera[:3, :3].T[:, :, None]
        across, down = (x - width / 2) * pixel * right, (height / 2 - y) * pixel * up + forward
        directions = down.astype(np.float32)[:, :, None] + across.astype(np.float32)[:, None]
        cosines = 1 / np.sqrt((directions * directions).sum(axis=0))
        directions *= cosines
        return directions.reshape(3, -1).T, cosines.ravel()

    def _centres(
        self, crop: tuple[int, int, int, int] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y of the centres of columns and rows."""
        width, height = self.res
        x0, y0, x1, y1 = crop or (0, 0, width, height)
        if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
            raise SceneError(f"crop = {[x0, y0, x1, y1]}: should be inside the {width}×{height} frame")
        return np.arange(x0, x1, dtype=np.float64) + 0.5, np.arange(y0, y1, dtype=np.float64) + 0.5

    def rays_through(
        self, x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Origins and unit directions, both [n, 3], world, of rays through places, pixels from top left."""
        width, height = self.res
        pixel = self.pixel_width
        x, y = ((x - width / 2) * pixel)[:, None], ((height / 2 - y) * pixel)[:, None]
        right, up, forward, position = self.world_from_camera[:3].T
        directions = x * right + y * up + forward
        directions /= lengths_of(directions)[:, None]
        return np.broadcast_to(position, directions.shape), directions
