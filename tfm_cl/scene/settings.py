"""Settings of the passes and the image: sections ``[map]``, ``[march]``, ``[shadow]`` and ``[image]``."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self, TypedDict

from pydantic import BeforeValidator, Field, PlainValidator, model_validator

from tfm_cl.errors import unknown_key, words
from tfm_cl.files.image_io import Compression, PngOptions
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.limits import MOST_STOPS
from tfm_cl.maps.bases import BASES, BEST, MOST_COEFFS
from tfm_cl.maps.bases.given import FUNCTIONS_EXPECTED, functions_in
from tfm_cl.model import (
    Model,
    as_colour,
    count_or_auto,
    in_words,
    number_or_auto,
    number_or_none,
)
from tfm_cl.model_fields import Accepts, Numbers, accepted_by, accepts, numbers
from tfm_cl.scene.layers import NAMES
from tfm_cl.scene.pixel_filters import FILTERS

MAX_WEIGHTING = 1e6
"""Largest density weighting α: beyond it, float32 cannot distinguish e^(-τ/α) from 1."""
MAX_RES = 8192
Count = int | Literal["auto"]
"""A whole number, or left to `tfm_cl.plan`."""
DEFAULT_COEFFS = 8
"""Coefficients per texel if neither a number, bytes nor an error is requested."""
SHADOW_FILTERS = {"nearest": 1, "pcf": 2}
"""Values of the kernels' ``TFM_SHADOW`` by the filter's name in scene files; 0 is for scenes without
solids."""
MAX_STEPS = 100_000
ENVIRONMENT: Literal["environment"] = "environment"
Background = tuple[float, float, float] | Literal["environment"]
"""RGB radiance, or ``"environment"``: what the camera sees of the scene's environment and sky lights."""


@accepts({"type": "string"})
def _functions(value: Any) -> Any:
    if not isinstance(value, str) or "\n" in value:
        raise ValueError(FUNCTIONS_EXPECTED)
    if value:
        functions_in(value)
    return value


@accepts(lambda: {"enum": ["auto", *BASES]})
def _basis(value: Any) -> Any:
    if value != "auto" and (not isinstance(value, str) or value not in BASES):
        raise ValueError(unknown_key(str(value), ["auto", *BASES]).replace("key", "basis"))
    return value


class MapSettings(Model):
    """How the light pass builds a transmittance function map."""

    SECTION: ClassVar[str] = "map"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "coeffs": "coefficients n order terms count numbers",
            "res": "resolution size texels mapres",
            "steps": "samples lightsteps stepcount",
            "storage": "format precision type",
            "max_error": "error tolerance maxerror",
            "blur": "filterwidth prefilter",
        }
    )

    basis: Annotated[str, BeforeValidator(_basis)] = Field(
        default="auto",
        description="basis of the map; auto: klt, the most accurate at equal bytes. "
        + "; ".join(f"{basis.name}: {basis.summary}" for basis in BASES.values()),
    )
    coeffs: Annotated[Count, count_or_auto(MOST_COEFFS)] = Field(
        default="auto",
        description="coefficients per texel: 1 to 32, planes of slices to 512; auto: as required by bytes or "
        "max_error, else 8",
    )
    bytes_: Annotated[float | None, number_or_none(1, 4 * MOST_COEFFS + 16)] = Field(
        default=None,
        validation_alias="bytes",
        description="limit of the bytes per texel, including its range; determines coeffs if that is auto",
    )
    max_error: Annotated[float | None, number_or_none(1e-4, 1)] = Field(
        default=None,
        description="largest relative RMSE of the picture's lit pixels against the converged dual march: "
        "coeffs, res and both steps are chosen by measuring, unless they are given",
    )
    density_weighting: Annotated[float | Literal["auto"], number_or_auto(1, MAX_WEIGHTING)] = Field(
        default="auto",
        description="α ≥ 1 of eq. 19, applied to the transmittance of the density alone; only for the "
        "target transmittance; auto: half the largest optical depth seen by the lights, between 1 and 16",
    )
    target: Literal["auto", "transmittance", "optical-depth", "extinction"] = Field(
        default="auto",
        description="function that is approximated: T^(1/α), τ or σ; auto: the default of the basis",
    )
    fit: Literal["auto", "l2", "visibility"] = Field(
        default="auto",
        description="least-squares fit: plain, or weighted by the light that the density removes (D T²)",
    )
    range: Literal["auto", "box", "trimmed", "visible", "global"] = Field(
        default="auto",
        description="part of a light ray that the coefficients describe: box: within the medium's bounds; "
        "trimmed: where there is density; visible: where there is density and light; global: the same "
        "depths for all rays",
    )
    slicing: Literal["uniform", "density", "gamma"] = Field(
        default="uniform",
        description="planes of the bases slices and slices-cubic: uniform: equidistant; density: closer "
        "where the mean density of the rays is high; gamma: closer near the light",
    )
    lookup: Literal["auto", "interpolate", "reconstruct", "stochastic", "lattice"] = Field(
        default="auto",
        description="between texels: interpolate the coefficients, interpolate the reconstructed optical "
        "depths, or use one texel at random; lattice: look all lights up once a voxel, and interpolate what "
        "they scatter",
    )
    functions: Annotated[str, PlainValidator(_functions)] = Field(
        default="",
        description="what the basis learns, as tfm writes it for the frames of a range: float32 in base64 "
        "after ROWSxCOLUMNS:, of klt values at 65 places along a light ray; empty: learnt from the light's "
        "own rays",
    )
    res: Annotated[Count, count_or_auto(MAX_RES)] = Field(
        default=1024,
        description="the map has res × res texels; auto: as fine as voxels and pixels require, 64 to 2048",
    )
    steps: Annotated[Count, count_or_auto(MAX_STEPS)] = Field(
        default=100,
        description="steps along the range of a light ray, and along the light rays of the dual march; "
        "auto: at most 1.5 voxels long, 16 to 1024",
    )
    deposits: Literal["steps", "depth"] = Field(
        default="steps",
        description="what primitives leave in the map: steps: in each step of a light ray what lies in it, "
        "by exact integrals; depth: all at the primitive's own depth, without steps (FOM eq. 5-6), for the "
        "targets optical-depth and extinction with the fit l2",
    )
    storage: Literal["f32", "f16", "u8"] = Field(default="f32", description="type of the stored coefficients")
    blur: float = Field(
        default=0.0,
        ge=0,
        le=1e9,
        description="width of a filter of the map, in texels; for the targets optical-depth and extinction "
        "with the fit l2 and the range box or global; filters the density across the light's rays (FOM "
        "section 6)",
    )
    blur_kernel: Literal["box", "gaussian"] = Field(
        default="gaussian", description="filter of blur: a box, or a Gaussian with the variance of that box"
    )

    @model_validator(mode="before")
    @classmethod
    def _max_error_chooses(cls, values: Any) -> Any:
        if isinstance(values, dict) and values.get("max_error") is not None:
            return {"res": "auto", "steps": "auto", **values}
        return values

    @model_validator(mode="after")
    def _basis_allows(self) -> Self:
        if self.bytes_ is not None and self.coeffs != "auto":
            raise ValueError(f"bytes chooses coeffs: set coeffs to auto, not {self.coeffs}")
        if self.bytes_ is not None and self.max_error is not None:
            raise ValueError("bytes and max_error both choose coeffs: set one of them")
        basis = BASES[BEST if self.basis == "auto" else self.basis]
        if self.coeffs != "auto" and self.coeffs not in basis.counts:
            raise ValueError(
                f"coeffs = {self.coeffs}: basis '{basis.name}' has {in_words(basis.counts)} coefficients"
            )
        if self.basis == "auto":
            return self
        for name, known in (("target", basis.targets), ("fit", basis.fits)):
            value = getattr(self, name)
            if value != "auto" and value not in known:
                raise ValueError(f"{name} = '{value}': basis '{self.basis}' has {', '.join(known) or 'none'}")
        if not basis.lerps and self.lookup == "interpolate":
            raise ValueError(
                f"lookup = 'interpolate': the coefficients of basis '{self.basis}' cannot be interpolated"
            )
        return self


class MarchSettings(Model):
    """How the view pass samples the camera rays."""

    SECTION: ClassVar[str] = "march"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "steps": "samples stepcount maxsteps viewsteps marchsteps numsteps",
            "here a number of steps, for a whole ray: steps": "stepsize step steprate stepscale",
            "method": "integrator mode type",
            "cutoff": "threshold minimumtransmittance opacitycutoff terminationthreshold",
            "write it in [medium]: orders": "bounces maxdepth volumebounces",
        }
    )

    method: Literal["tfm", "dual"] = Field(
        default="tfm",
        description="tfm: look the light up in its map; dual: march to the light at every sample",
    )
    steps: Annotated[Count, count_or_auto(MAX_STEPS)] = Field(
        default=100,
        description="steps along the lit part of a camera ray; auto: at most 1.5 voxels long, 16 to 1024",
    )
    sampling: Literal["projective", "world"] = Field(
        default="projective",
        description="uniform in the light's projective space (section 4.2) or in the world",
    )
    attenuation: Literal["consistent", "paper"] = Field(
        default="consistent",
        description="consistent: the medium attenuates everything behind it; paper: only within the light's "
        "cone, as printed in TFM's algorithm 1",
    )
    max_stretch: float = Field(
        default=4.0,
        ge=1,
        description="projective sampling: limit of the longest step, as a multiple of the mean step; large "
        "values correspond to the paper, which undersamples the far end of rays that pass near the light",
    )
    cutoff: float = Field(
        default=1e-4,
        ge=0,
        lt=1,
        description="a camera ray ends where its transmittance falls below this value: the error is at most "
        "this fraction of the brightest light behind; 0: march every ray to its end",
    )
    skip_empty: bool = Field(
        default=True, description="skip bricks without density; the other samples stay where they are"
    )
    voxels: Literal["f32", "f16", "u8"] = Field(
        default="f32",
        description="type of the voxels on the device: the error of f16 is 2^-11 of a density, that of u8 "
        "1/510 of the largest density in or next to the block of 8x8x8",
    )


class ShadowSettings(Model):
    """The shadow maps with which solids shade the medium; shadows on solids are ray traced."""

    SECTION: ClassVar[str] = "shadow"
    WORDS: ClassVar[dict[str, str]] = words({"res": "resolution size texels", "filter": "type kind method"})

    res: int = Field(
        default=1024,
        ge=1,
        le=MAX_RES,
        description="texels along each side of a light's shadow map, which holds distances to solids",
    )
    filter: Literal["nearest", "pcf"] = Field(
        default="pcf",
        description="nearest: test the nearest texel; pcf: fraction of the four surrounding texels that are "
        "lit (percentage-closer filtering)",
    )


@accepts(numbers(4, "integer", minimum=0))
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


@accepts({"type": "array", "items": {"enum": list(NAMES)}})
def _aovs(value: Any) -> Any:
    if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
        raise ValueError("should be a list of names")
    for name in value:
        if name not in NAMES:
            raise ValueError(unknown_key(name, list(NAMES)).replace("key", "aov"))
    return tuple(dict.fromkeys(value))


@accepts(lambda: accepted_by(as_colour), {"const": ENVIRONMENT})
def _background(value: Any) -> Any:
    if isinstance(value, str) and value == ENVIRONMENT:
        return value
    try:
        return as_colour(value)
    except ValueError as error:
        hint = f", or '{ENVIRONMENT}'" if isinstance(value, str) else ""
        raise ValueError(f"{error}{hint}") from None


@accepts({"enum": list(VIEWS)})
def _view(value: Any) -> Any:
    if not isinstance(value, str) or value not in VIEWS:
        raise ValueError(unknown_key(str(value), list(VIEWS)).replace("key", "view"))
    return value


SAMPLES = (1, 4, 16, 64, 256)
"""Of a pixel, at most."""


@accepts({"enum": list(SAMPLES)})
def _samples(value: Any) -> Any:
    if type(value) is not int or value not in SAMPLES:
        raise ValueError("should be 1, 4, 16, 64 or 256")
    return value


@accepts({"enum": list(FILTERS)})
def _filter(value: Any) -> Any:
    if not isinstance(value, str) or value not in FILTERS:
        raise ValueError(unknown_key(str(value), list(FILTERS)).replace("key", "filter"))
    return value


MOTION_SAMPLES = 9
"""Times at which the shutter is open, unless asked otherwise: odd, so that the middle is one of them."""
MOST_MOTION_SAMPLES = 1024
MOST_FRAMES = 100
"""That a shutter may be open before or after its frame."""


@accepts(numbers(2))
def _shutter(value: Any) -> Any:
    if value is None:
        return None
    if (
        not isinstance(value, list | tuple)
        or len(value) != 2  # noqa: PLR2004 - open and close
        or not all(isinstance(end, int | float) and not isinstance(end, bool) for end in value)
        or not -MOST_FRAMES <= value[0] <= value[1] <= MOST_FRAMES
    ):
        raise ValueError(
            "should be two numbers [open, close] of frames from this one, open ≤ close, from "
            f"-{MOST_FRAMES} to {MOST_FRAMES}"
        )
    return float(value[0]), float(value[1])


class FrameOptions(TypedDict):
    """What of a frame is rendered, and how pixels are made of samples."""

    crop: tuple[int, int, int, int] | None
    aovs: tuple[str, ...]
    background: Background
    samples: int
    filter: str


class ImageSettings(Model):
    """Settings of the image that is written."""

    SECTION: ClassVar[str] = "image"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "write it in [camera]: res = [width, height]": "res resolution size width height dimensions",
            "samples": "spp samplesperpixel sampleperpixel aasamples antialiasing",
            "view": "viewtransform tonemap tonemapping tonemapper look gamma film",
            "filter": "rfilter pixelfilter reconstructionfilter",
            "exposure": "ev exposurevalue stops",
            "aov": "aovs layers passes channels outputs",
            "transparent": "alpha filmtransparent",
            "pixel_type": "componentformat exrtype depth colordepth",
            "compression": "exrcompression codec exrcodec",
            "shutter": "motionblur shutterangle exposuretime",
            "motion_samples": "motionsteps timesamples shuttersamples",
            "name the picture on the command line: -o FILE": "file filename output path",
        }
    )

    crop: Accepts[
        Sequence[int] | None, Annotated[tuple[int, int, int, int] | None, BeforeValidator(_crop)]
    ] = Field(
        default=None,
        validate_default=True,
        description="part of the frame to render: pixels x0,y0,x1,y1 (end excluded)",
    )
    samples: Annotated[int, BeforeValidator(_samples)] = Field(
        default=1,
        description="camera rays of a pixel, at most: 1, 4, 16, 64 or 256; more than one where neighbours "
        "differ, more than 4 where these differ",
    )
    filter: Annotated[str, BeforeValidator(_filter)] = Field(
        default="box",
        description="how pixels are made of samples. "
        + "; ".join(f"{name}: {found.summary}" for name, found in FILTERS.items()),
    )
    exposure: Annotated[float | Literal["auto"], number_or_auto(-MOST_STOPS, MOST_STOPS)] = Field(
        default=0.0, description="exposure in stops, PNG only; auto: by how bright what is lit is"
    )
    view: Annotated[str, BeforeValidator(_view)] = Field(
        default="standard",
        description="how light is shown, PNG only. "
        + "; ".join(f"{view.NAME}: {view.SUMMARY}" for view in VIEWS.values()),
    )
    background: Accepts[
        float | Numbers | Literal["environment"], Annotated[Background, PlainValidator(_background)]
    ] = Field(
        default=(0.0, 0.0, 0.0),
        validate_default=True,
        description="behind media and solids: RGB radiance, scene-linear, which lights nothing; or "
        "environment: what the camera sees of environment and sky lights; added as far as the media let it "
        "through; alpha and layers are without it",
    )
    transparent: bool = Field(
        default=False, description="write alpha, PNG only, and no background; otherwise over the background"
    )
    png_bits: Literal[8, 16] = Field(default=8, description="bits a channel, PNG only: 8 or 16")
    dither: bool = Field(
        default=True,
        description="dither 8 bits, so that gradients do not band, PNG only; otherwise round",
    )
    aov: Accepts[Sequence[str], Annotated[tuple[str, ...], BeforeValidator(_aovs)]] = Field(
        default=(),
        validate_default=True,
        description="extra EXR layers: " + ", ".join(NAMES) + " (light.NAME for each of them)",
    )
    deep_tolerance: float = Field(
        default=0.01,
        ge=0,
        le=0.5,
        description="deep images (.deep.exr): by how much the transmittance of their samples may be off, "
        "anywhere along a ray; 0: a sample for each step",
    )
    deep_colour: bool = Field(
        default=False, description="deep images (.deep.exr): write the colours of samples too"
    )
    pixel_type: Literal["float", "half"] = Field(
        default="float", description="type of the colour channels in EXR files"
    )
    compression: Compression = Field(
        default="zip",
        description="compression of EXR files, but for deep images: pxr24 rounds floats to 24 bits, dwaa and "
        "dwab change colours a little, all others keep every bit; htj2k needs OpenEXR 3.4 to be read",
    )
    shutter: Accepts[Numbers | None, Annotated[tuple[float, float] | None, BeforeValidator(_shutter)]] = (
        Field(
            default=None,
            validate_default=True,
            description="motion blur: when it opens and closes, in frames from this one, as -0.25,0.25; what "
            "moves by keyframes or velocities is blurred",
        )
    )
    motion_samples: int = Field(
        default=MOTION_SAMPLES,
        ge=1,
        le=MOST_MOTION_SAMPLES,
        description="motion blur: moments between, evenly spread, whose mean is the picture; of an even "
        "number the one in the middle is rendered too, for layers of what is not blurred, as depth",
    )

    @property
    def shows_environment(self) -> bool:
        """Whether the lights that surround the scene are behind it."""
        return self.background == ENVIRONMENT

    @property
    def has_background(self) -> bool:
        """Whether there is anything behind media and solids."""
        return self.shows_environment or any(self.background)

    @property
    def is_blurred(self) -> bool:
        """Whether it shows other moments than the frame's own."""
        return self.shutter is not None and any(self.shutter)

    @property
    def frame(self) -> FrameOptions:
        """What `Renderer.render` takes of it."""
        return FrameOptions(
            crop=self.crop,
            aovs=self.aov,
            background=self.background,
            samples=self.samples,
            filter=self.filter,
        )

    @property
    def png(self) -> PngOptions:
        """What `tfm_cl.files.image_io.save` takes for a PNG, besides the exposure."""
        return PngOptions(
            view=self.view, transparent=self.transparent, png_bits=self.png_bits, dither=self.dither
        )
