"""Settings of the two passes and of the image: sections ``[map]``, ``[march]`` and ``[image]``."""

from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from tfm_cl.bases import BASES
from tfm_cl.model import Model, count_or_auto, number_or_auto, unknown_key

AOVS = {
    "depth": "opacity-weighted mean distance from the camera, world units; 0 where there is no medium",
    "transmittance": "RGB transmittance of the medium along the camera ray",
    "light_transmittance": "RGB mean over lights and ray of the light's transmittance, weighted by what the "
    "camera sees; 0 where nothing is lit",
    "samples": "density samples taken for the pixel by the view pass",
}
"""Extra image layers and what they hold."""


MAX_WEIGHTING = 1e6
"""Beyond it float32 cannot tell e^(-τ/α) from 1."""
MAX_RES = 8192
MAX_STEPS = 100_000


def _basis(value: Any) -> Any:
    if not isinstance(value, str) or value not in BASES:
        raise ValueError(unknown_key(str(value), list(BASES)).replace("key", "basis"))
    return value


class MapSettings(Model):
    """How the light pass builds a transmittance function map."""

    SECTION: ClassVar[str] = "map"

    basis: Annotated[str, BeforeValidator(_basis)] = Field("dct", description="basis of the map: dct")
    coeffs: int = Field(8, ge=1, description="coefficients per texel, 1 to 32")
    density_weighting: Annotated[float | Literal["auto"], number_or_auto(1, MAX_WEIGHTING)] = Field(
        10.0,
        description="α ≥ 1 of eq. 19 on the density's own transmittance; auto: half the "
        "largest optical depth seen by the lights, between 1 and 16",
    )
    res: Annotated[int, count_or_auto(MAX_RES)] = Field(
        1024, description="map is res × res texels; auto: as fine as voxels and pixels, 64 to 2048"
    )
    steps: Annotated[int, count_or_auto(MAX_STEPS)] = Field(
        100,
        description="steps along a light ray, of the map and of the dual march; auto: at most 1.5 voxels "
        "long, 16 to 1024",
    )
    storage: Literal["f32", "f16", "u8"] = Field("f32", description="type of the stored coefficients")

    @model_validator(mode="after")
    def _basis_allows(self) -> Self:
        limit = BASES[self.basis].max_coeffs
        if self.coeffs > limit:
            raise ValueError(f"coeffs = {self.coeffs}: should be at most {limit} for basis '{self.basis}'")
        return self


class MarchSettings(Model):
    """How the view pass samples the camera rays."""

    SECTION: ClassVar[str] = "march"

    method: Literal["tfm", "dual"] = Field(
        "tfm", description="tfm: look the light up in its map; dual: march to the light at every sample"
    )
    steps: Annotated[int, count_or_auto(MAX_STEPS)] = Field(
        100, description="steps along the lit part of a camera ray; auto: at most 1.5 voxels long, 16 to 1024"
    )
    sampling: Literal["projective", "world"] = Field(
        "projective", description="uniform in the light's projective space (section 4.2) or in the world"
    )
    max_stretch: float = Field(
        4.0,
        ge=1,
        description="projective sampling: the longest step is at most this times the mean one; large values "
        "are the paper's, which starves the far end of rays that pass near the light",
    )
    cutoff: float = Field(
        1e-4,
        ge=0,
        lt=1,
        description="a camera ray ends where less than this of its transmittance is left: the error is "
        "at most this part of the brightest light behind; 0 marches every ray to its end",
    )
    skip_empty: bool = Field(
        default=True, description="jump over bricks without density; the samples taken stay where they are"
    )
    voxels: Literal["f32", "f16", "u8"] = Field(
        "f32",
        description="type of the voxels on the device: f16 errs by 2^-11 of a density, u8 by 1/510 of the "
        "largest in or beside its block of 8x8x8",
    )


def _crop(value: Any) -> Any:
    if value is None:
        return None
    whole = isinstance(value, list | tuple) and all(type(item) is int for item in value)
    if not whole or len(value) != 4:  # noqa: PLR2004 - two corners
        raise ValueError("should be four whole numbers x0,y0,x1,y1")
    x0, y0, x1, y1 = value
    if not (0 <= x0 < x1 and 0 <= y0 < y1):
        raise ValueError("should be x0,y0,x1,y1 with 0 ≤ x0 < x1, 0 ≤ y0 < y1")
    return x0, y0, x1, y1


def _aovs(value: Any) -> Any:
    if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
        raise ValueError("should be a list of names")
    for name in value:
        if name not in AOVS:
            raise ValueError(unknown_key(name, list(AOVS)).replace("key", "aov"))
    return tuple(dict.fromkeys(value))


class ImageSettings(Model):
    """What is written."""

    SECTION: ClassVar[str] = "image"

    crop: Annotated[tuple[int, int, int, int] | None, BeforeValidator(_crop)] = Field(
        None, description="pixels x0,y0,x1,y1 (end excluded) to render of the whole frame"
    )
    exposure: float = Field(0.0, ge=-100, le=100, description="stops, PNG only")
    aov: Annotated[tuple[str, ...], BeforeValidator(_aovs)] = Field(
        (), description="extra EXR layers: " + ", ".join(AOVS)
    )
    pixel_type: Literal["float", "half"] = Field("float", description="of EXR colour channels")
