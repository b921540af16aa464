"""The interface of a solid."""

from abc import abstractmethod
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from tfm_cl.errors import Fault, SceneError, unknown_key, words
from tfm_cl.files import mipmap
from tfm_cl.files.mesh_io.triangles import DEFAULT_ALBEDO
from tfm_cl.files.paths import name_of
from tfm_cl.limits import LARGEST_COORDINATE
from tfm_cl.model import Triple, as_colour
from tfm_cl.model_fields import TEXT, Accepts, Numbers, accepts, numbers
from tfm_cl.scene.frame_numbers import OfFrames
from tfm_cl.scene.frames import Axis
from tfm_cl.scene.movable import Movable
from tfm_cl.scene.transform import IDENTITY, Transform, dots, lengths_of, turned

UPWARDS = 0.999
"""Cosine to the y axis from which a plane is level: -z is then up in its image, as seen from above."""


@accepts({"type": "number", "minimum": 0, "maximum": 1}, numbers(3, minimum=0, maximum=1))
def _reflects_no_more_than_all(rgb: tuple[float, float, float]) -> tuple[float, float, float]:
    if max(rgb) > 1:
        raise ValueError("should be from 0 to 1 in every channel")
    return rgb


Reflectance = Annotated[Triple, BeforeValidator(as_colour), AfterValidator(_reflects_no_more_than_all)]
Albedo = Accepts[float | Numbers, Reflectance]
"""Diffuse reflectance, linear Rec. 709, each channel in 0..1; one number means grey."""


@accepts(TEXT)
def _image_name(value: Any) -> Any:
    if isinstance(value, str | Path):
        name = name_of(value, "an image file")
        if Path(name).suffix.lower() not in mipmap.EXTENSIONS:
            raise ValueError(f"should be an image of a known kind: {' '.join(mipmap.EXTENSIONS)}")
        return name
    return value


ReflectanceOrImage = Annotated[
    Annotated[Reflectance, Tag("a colour")] | Annotated[str, BeforeValidator(_image_name), Tag("an image")],
    Discriminator(lambda value: "an image" if isinstance(value, str | Path) else "a colour"),
]
AlbedoOrImage = Accepts[float | Numbers | str | Path, ReflectanceOrImage]
"""`Albedo`, or the file of an image of it."""


class Mapped(NamedTuple):
    """An image on a flat solid."""

    image: mipmap.Mipmap
    uv_from_world: NDArray[np.float64]
    """2×4: texture coordinates of world points; v points upwards in the image."""


class Solid(Movable):
    """An opaque, diffuse (Lambertian) surface."""

    SECTION: ClassVar[str] = "solid"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "mesh": "file filename path obj model",
            "shape": "type kind primitive",
            "albedo": "color colour reflectance diffuse basecolor diffusecolor kd rgb",
            "translate": "position location translation",
            "rotate": "rotation orientation",
            "scale": "size scaling",
            "transform": "matrix toworld worldfromobject worldmatrix xform",
            "from": "min low minimum",
            "to": "max high maximum",
            "smooth": "smoothshading shadesmooth facenormals",
            "visible": "cameravisible hidden visibility",
            "solids are diffuse: give albedo alone": (
                "material bsdf roughness metallic specular ior materials shader"
            ),
            "leave it out: solids emit nothing; add a [[light]]": "emission emitter emissive radiance",
            "leave it out: solids have no names": "name id",
        }
    )

    visible: bool = Field(
        default=True, description="whether the camera sees it; what it does not see still casts shadows"
    )
    holdout: bool = Field(
        default=False,
        description="whether the camera sees a hole in its place: no light and alpha 0 but for the media in "
        "front; it still casts shadows",
    )

    transform: Transform = Field(
        default=IDENTITY,
        validate_default=True,
        description="world-from-object matrix: 16 numbers, row by row",
    )

    @model_validator(mode="after")
    def _is_seen_as_a_hole(self) -> Self:
        if self.holdout and not self.visible:
            raise ValueError("holdout = true is what the camera sees, visible = false is not seen; keep one")
        return self

    @cached_property
    def world_from_object(self) -> NDArray[np.float64]:
        """4×4, read-only."""
        matrix = np.array(self.transform, dtype=np.float64)
        matrix.flags.writeable = False
        return matrix

    def settled(self, axis: Axis, boxes: Callable[[], list[NDArray[np.float64]]]) -> Self:
        """Return the same with what is left open decided by the scene that it is in.

        Parameters
        ----------
        axis
            That points upwards.
        boxes
            Tells the world boxes, [2, 3], of all that has density and of solids that have one.

        Raises
        ------
        SceneError
            The scene does not tell.
        """
        del axis, boxes
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return the solid as a table for a scene file; `parse_solid` reads it."""
        return {key: value for key, value in super().to_dict().items() if value is not None}

    def like(self, other: "Solid") -> Self:
        """Take over what another solid has read of the same files; returns this one."""
        del other
        return self

    def read_files(self) -> None:
        """Read what the solid names, so that nothing has to be read later.

        Raises
        ------
        SceneError
            A file that cannot be used.
        """

    @abstractmethod
    def bounds(self) -> NDArray[np.float64] | None:
        """Low and high corner, [2, 3], world units; None for an infinite solid."""

    def world_plane(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Return a point and the unit normal, both [3], world, of what is an infinite plane; else None."""
        return None

    def files(self) -> list[str]:
        """Return the names of the files that it reads."""
        return []


class AnalyticSolid(Solid):
    """A shape whose intersection with rays has a closed form, evaluated in object space in float64.

    Directions are transformed without normalisation, so distances along a ray remain world distances.
    """

    shape: str = Field(description="kind of solid")
    albedo: AlbedoOrImage = Field(
        default=DEFAULT_ALBEDO, validate_default=True, description="diffuse reflectance, linear RGB, 0 to 1"
    )

    def mapped(self) -> Mapped | None:
        """Return the image that its albedo is, if it is one."""
        return None

    @cached_property
    def _object_axes(self) -> NDArray[np.float64]:
        """3×3, the linear part of object-from-world."""
        return np.linalg.inv(self.world_from_object[:3, :3]).astype(np.float64)

    def object_rays(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Transform world rays (origins and directions [N, 3]) to object space."""
        # Subtract the offset first: far from the world's origin this loses the least precision.
        origins = origins - self.world_from_object[:3, 3]
        if np.array_equal(self._object_axes, np.eye(3)):
            return origins, directions
        axes = self._object_axes.T
        return turned(origins, axes), turned(directions, axes)

    def world_normals(self, normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform object normals [N, 3] of any length to unit world normals (inverse transpose)."""
        world = turned(normals, self._object_axes)
        unit: NDArray[np.float64] = world / lengths_of(world)[:, None]
        return unit

    @abstractmethod
    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """First distance > 0 along object rays [N, 3]: [N]; inf for rays that miss."""

    @abstractmethod
    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Object normals [N, 3] at surface points [N, 3], on either side and of any length."""


class FlatSolid(OfFrames, AnalyticSolid):
    """An infinite plane, visible from both sides; an image as its albedo is repeated without end."""

    albedo: AlbedoOrImage = Field(
        default=DEFAULT_ALBEDO,
        validate_default=True,
        description="diffuse reflectance, linear RGB, 0 to 1, or an image file",
    )
    texture_scale: float | None = Field(
        default=None,
        ge=1 / LARGEST_COORDINATE,
        le=LARGEST_COORDINATE,
        description="with an image as albedo: width of one repetition on the plane, object units; default: 1",
    )

    @model_validator(mode="after")
    def _scales_an_image(self) -> Self:
        if self.texture_scale is not None and not isinstance(self.albedo, str):
            raise ValueError("texture_scale is for an image as albedo; give albedo = FILE, or leave it out")
        return self

    @abstractmethod
    def object_plane(self) -> tuple[Triple, Triple]:
        """Return a point on the plane and a normal of any length, object space."""

    @staticmethod
    @abstractmethod
    def read(name: str) -> mipmap.Mipmap:
        """Read an image: `tfm_cl.files.albedo.read_albedo`."""

    @cached_property
    def _unit_normal(self) -> NDArray[np.float64]:
        """[3], object space."""
        normal = self.object_plane()[1]
        unit: NDArray[np.float64] = np.divide(normal, np.linalg.norm(normal))
        return unit

    def distances(self, origins: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `AnalyticSolid.distances`; rays within the plane do not meet it."""
        normal = self._unit_normal
        height, slope = dots(self.object_plane()[0] - origins, normal), dots(directions, normal)
        found = height * slope > 0
        result: NDArray[np.float64] = np.divide(height, slope, out=np.full(len(origins), np.inf), where=found)
        return result

    def normals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `AnalyticSolid.normals`: the same everywhere."""
        return np.broadcast_to(self._unit_normal, points.shape)

    def bounds(self) -> None:
        """Return None: a plane is infinite."""
        return

    def world_plane(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """As `Solid.world_plane`."""
        matrix = self.world_from_object
        point, normal = self.object_plane()
        return matrix[:3, :3] @ point + matrix[:3, 3], self.world_normals(np.array([normal]))[0]

    @cached_property
    def _image(self) -> mipmap.Mipmap | None:
        return self.read(self.albedo) if isinstance(self.albedo, str) else None

    def read_files(self) -> None:
        """Read the image.

        Raises
        ------
        SceneError
            It cannot be used.
        """
        self.mapped()

    def files(self) -> list[str]:
        """As `Solid.files`."""
        return [self.albedo] if isinstance(self.albedo, str) else []

    def mapped(self) -> Mapped | None:
        """As `AnalyticSolid.mapped`; the image's lower left corner lies on the plane's point."""
        if self._image is None:
            return None
        point, normal = np.array(self.object_plane()[0]), self._unit_normal
        up = np.array([0.0, 0.0, -1.0]) if abs(normal[1]) > UPWARDS else np.array([0.0, 1.0, 0.0])
        right = np.cross(up, normal)
        right /= np.linalg.norm(right)
        height, width = self._image.levels[0].shape[1:]
        axes = np.stack([right, np.cross(normal, right) * width / height]) / (self.texture_scale or 1.0)
        uv_from_object = np.column_stack([axes, -axes @ point])
        return Mapped(self._image, uv_from_object @ np.linalg.inv(self.world_from_object))


SOLIDS: dict[str, type[AnalyticSolid]] = {}
"""The analytic shapes by their names in scene files, of all that `tfm_cl.scene.solids` lists."""
MESHES: dict[str, type[Solid]] = {}
"""Key that names the file of a solid without a shape -> class, likewise."""


OTHER_SHAPES = words(
    {
        "box": "cube cuboid",
        "sphere": "ball",
        "plane": "quad rectangle rect disk square grid",
        "ground": "floor groundplane terrain",
        "write mesh = FILE": "mesh obj ply stl gltf glb model trianglemesh",
    }
)
"""Shapes in other programs -> the name here, or what to do."""


def parse_solid(values: dict[str, Any]) -> Solid:
    """Make a solid from a scene file's table, which has either ``mesh`` or ``shape``.

    Raises
    ------
    SceneError
        Neither or both of the two, an unknown shape or key, or an impossible value.
    """
    of_files = [key for key in MESHES if key in values]
    if of_files and "shape" in values:
        raise SceneError(f"solid: has both {of_files[0]} and shape; remove one of them")
    if of_files:
        return MESHES[of_files[0]].from_table(values)
    if "shape" not in values:
        classes = (*MESHES.values(), *SOLIDS.values())
        known = list(dict.fromkeys([*MESHES, "shape", *(key for cls in classes for key in cls.keys())]))  # noqa: SIM118 - no dict
        strange = [
            Fault(unknown_key(key, known, "solid", Solid.WORDS), (key,)) for key in values if key not in known
        ]
        if strange:
            raise SceneError(*strange)
        raise SceneError(f"solid: should have {', '.join(MESHES)} (a file) or shape ({', '.join(SOLIDS)})")
    shape = values["shape"]
    if not isinstance(shape, str) or shape not in SOLIDS:
        line = unknown_key(str(shape), list(SOLIDS), words=OTHER_SHAPES).replace("key", "shape", 1)
        raise SceneError(Fault(f"solid.shape: {line}", ("shape",)))
    return SOLIDS[shape].from_table(values)
