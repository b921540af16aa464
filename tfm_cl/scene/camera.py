"""The perspective camera."""

from functools import lru_cache
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from tfm_cl.errors import SceneError
from tfm_cl.model import Model, Vec3, check_different
from tfm_cl.scene.frames import look_at

MAX_PIXELS = 1 << 28
"""Largest number of pixels of an image: 16384 × 16384."""


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


_world_from_camera = lru_cache(maxsize=16)(look_at)
"""Every frame asks for it several times."""


class Camera(Model):
    """A pinhole camera anywhere: outside or inside the medium or a light's cone.

    Camera space: x to the right, y up, z into the scene. Pixel (0, 0) is at the top left; one ray passes
    through the centre of each pixel.
    """

    SECTION: ClassVar[str] = "camera"

    from_: Vec3 = Field(alias="from", description="position, world units")
    to: Vec3 = Field(description="point that the camera looks at, world units")
    up: Vec3 = Field(
        (0.0, 1.0, 0.0),
        description="direction that is up in the image and for a camera and light that are placed "
        "automatically",
    )
    fov: float = Field(40.0, gt=0, lt=180, description="vertical field of view, the full angle, degrees")
    res: Annotated[tuple[int, int], BeforeValidator(_resolution)] = Field(
        (1280, 720), description="width and height in pixels"
    )

    @model_validator(mode="after")
    def _has_a_frame(self) -> Self:
        check_different(self.from_, self.to, "from and to")
        forward = np.subtract(self.to, self.from_)
        sine = np.linalg.norm(np.cross(forward, self.up)) / (
            np.linalg.norm(forward) * max(float(np.linalg.norm(self.up)), 1e-30)
        )
        if sine < 1e-6:  # noqa: PLR2004 - parallel within float32
            raise ValueError(f"up {list(self.up)} is zero or along the view direction; choose another")
        return self

    @property
    def world_from_camera(self) -> NDArray[np.float64]:
        """4×4; the columns are right, up, forward and the position."""
        return _world_from_camera(self.from_, self.to, self.up).copy()

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
        width, height = self.res
        x0, y0, x1, y1 = crop or (0, 0, width, height)
        if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
            raise SceneError(f"crop = {[x0, y0, x1, y1]}: should be inside the {width}×{height} frame")
        pixel = self.pixel_width
        at = (np.arange(x0, x1) + 0.5 - width / 2) * pixel, (height / 2 - np.arange(y0, y1) - 0.5) * pixel
        x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(*at))
        right, up, forward, position = self.world_from_camera[:3].T
        directions = x * right + y * up + forward
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(position, directions.shape), directions
