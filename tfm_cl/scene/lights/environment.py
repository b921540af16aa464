"""Light from all directions: a uniform sky, or an image of one."""

from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.files.texture import ImagePath, check_brightness, panorama_for, read, stamp
from tfm_cl.model import RGB
from tfm_cl.scene.frame_numbers import OfFrames
from tfm_cl.scene.lights.area import MOST_SAMPLES, sphere_directions
from tfm_cl.scene.lights.base import Directions, Floats, Light
from tfm_cl.scene.lights.panorama import means
from tfm_cl.scene.lights.sun import SunLight
from tfm_cl.scene.lights.surroundings import Surroundings

BLOCKS = (512, 1024)
"""Largest size of an environment image, rows and columns, after downsampling; then each pixel is assigned to
the nearest direction."""


class EnvironmentLight(OfFrames, Surroundings):
    """Radiance from all directions, as the sum of suns in fixed directions, each with a map of its own.

    ``texture`` is a latitude-longitude image with +y up, as OpenEXR defines it: the top row is +y, the
    centre of the image +z, a quarter to the left of it +x, and both sides are -z. A viewer inside sees it
    upright and not mirrored. Its pixels are multiplied by ``intensity``; transparent pixels are dark.
    """

    HEADER: ClassVar[str] = SunLight.HEADER
    WHOLE: ClassVar[float] = 4 * np.pi

    type: Literal["environment"] = "environment"
    intensity: RGB = Field(
        default=(1.0, 1.0, 1.0), validate_default=True, description="RGB radiance, or factor of the image"
    )
    texture: ImagePath = Field(
        default="",
        validate_default=True,
        description="latitude-longitude image of the radiance, +y up, +z in the centre: .png .exr .npy; "
        "empty: the same in all directions",
    )
    samples: int = Field(
        default=32,
        ge=1,
        le=MOST_SAMPLES,
        description=f"directions, 1 to {MOST_SAMPLES}, each with a map of its own",
    )

    def parts(self) -> tuple[Light, ...]:
        """Return ``samples`` suns in evenly spread directions.

        The irradiance of each is the radiance integrated over its cell, the directions to which it is the
        nearest; without an image that is 4π / samples times the radiance.

        Raises
        ------
        SceneError
            When the image cannot be used.
        """
        directions = sphere_directions(self.samples)
        if self.texture:
            flux = _image_flux(self.texture, stamp(self.texture), self.samples)
            check_brightness(self.texture, float(flux.max()), self.intensity)
        else:
            flux = np.full((self.samples, 3), 4 * np.pi / self.samples)
        irradiances = np.multiply(self.intensity, flux)
        parts = [self.part(self.spread_of(self.samples))] * self.samples
        return SunLight.of_parts(directions, irradiances, parts)

    def read_files(self) -> None:
        """Sum the texture up for its parts, which is kept."""
        self.parts()

    def radiance(self, directions: Directions, width: Directions) -> Directions:
        """As `Surroundings.radiance`: the image between its pixels, or the mean of those in the width."""
        if not self.texture:
            return np.broadcast_to(np.asarray(self.intensity), directions.shape)
        # Means are differences of sums over many pixels.
        seen = means(panorama_for(self.texture), directions.astype(np.float64), width.astype(np.float64))
        return np.multiply(self.intensity, seen)


def directions_of(rows: Floats, columns: Floats) -> Floats:
    """Return the unit directions [rows, columns, 3] of the pixels of a latitude-longitude image.

    ``rows`` from 0 (top) to 1, ``columns`` from 0 (left) to 1.
    """
    latitude, longitude = np.pi * (0.5 - rows)[:, None], 2 * np.pi * (0.5 - columns)
    x, z = np.cos(latitude) * np.sin(longitude), np.cos(latitude) * np.cos(longitude)
    return np.stack([x, np.broadcast_to(np.sin(latitude), x.shape), z], axis=-1)


@lru_cache(maxsize=64)
def _image_flux(path: str, _stamp: tuple[int, int], count: int) -> NDArray[np.float64]:
    """Integrate an image's radiance over the cells of `sphere_directions`: [count, RGB]."""
    return flux_of(read(path), count)


def flux_of(image: NDArray[np.float32], count: int) -> NDArray[np.float64]:
    """Integrate radiance [height, width, RGB] over the cells of ``count`` directions: [count, RGB].

    Each pixel is weighted by its exact solid angle, so that the cells sum to the integral over the sphere.
    """
    height, width = image.shape[:2]
    row_edges, column_edges = (
        np.arange(n + 1) * size // n
        for size, n in zip((height, width), np.minimum((height, width), BLOCKS), strict=True)
    )
    solid_angle = -np.diff(np.cos(np.pi * np.arange(height + 1) / height)) * 2 * np.pi / width
    middles = [(edges[1:] + edges[:-1]) / 2 for edges in (row_edges, column_edges)]
    pixels = directions_of(middles[0] / height, middles[1] / width)
    directions = sphere_directions(count)
    flux = np.zeros((count, 3))
    for row, (begin, end) in enumerate(pairwise(row_edges)):
        summed = np.tensordot(solid_angle[begin:end], image[begin:end].astype(np.float64), axes=1)
        blocks = np.add.reduceat(summed, column_edges[:-1], axis=0)
        np.add.at(flux, (pixels[row] @ directions.T).argmax(axis=1), blocks)
    flux.flags.writeable = False
    return flux
