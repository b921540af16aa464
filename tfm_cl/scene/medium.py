"""The medium's material: constant colours times the volume's density (TFM eq. 11)."""

import re
import reprlib
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from tfm_cl.constants import MOST_OCTAVES
from tfm_cl.errors import Fault, SceneError, unknown_key, words
from tfm_cl.files.paths import name_of
from tfm_cl.limits import LARGEST_COLOUR
from tfm_cl.model import RGB, Model, decided, number_or_auto, section_within
from tfm_cl.model_fields import SECTION, TEXT, Accepts, accepts
from tfm_cl.scene.optical_depth import OPTICAL_DEPTH
from tfm_cl.scene.phases.base import PHASES, Phase, parse_phase
from tfm_cl.scene.presets import PRESETS, expanded


@accepts(TEXT)
def _grid_name(value: Any) -> str | None:
    return None if value is None or value == "" else name_of(value, "a grid of temperatures")


@accepts({"enum": [*PRESETS, ""]})
def _preset(value: Any) -> str | None:
    if isinstance(value, str) and not value:
        return None
    if value is not None and (not isinstance(value, str) or value not in PRESETS):
        raise ValueError(unknown_key(str(value), list(PRESETS)).replace("key", "preset"))
    return value


MOST_EMISSION_LIGHTS = 1024
"""Of a body; each has a map of its own."""
MOST_COSINE = 0.999
"""Mean cosine of a lobe that octaves take for a narrower one."""
MOST_ORDERS = 1000
"""Of scattering, of which a deep cloud of albedo 1 still shows the last."""


class Medium(Model):
    """Scattering, absorption and emission per unit of density, and the phase function."""

    SECTION: ClassVar[str] = "medium"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "here sigma_s and sigma_a: albedo 0.9 at extinction 1 is sigma_s = 0.9, sigma_a = 0.1": (
                "albedo singlescatteringalbedo ssa"
            ),
            "here sigma_s + sigma_a: extinction 2 at albedo 0.9 is sigma_s = 1.8, sigma_a = 0.2": (
                "extinction sigmat extinctioncoefficient mut meanfreepath"
            ),
            "sigma_s": "scattering scatteringcoefficient scatteringcolor scattercolor scatter mus",
            "sigma_a": "absorption absorptioncoefficient absorptioncolor absorb mua",
            "write phase = { type = 'hg', g = 0.3 }": "anisotropy g asymmetry meancosine gvalue eccentric",
            "phase": "phasefunction",
            "write it in [volume]: density_scale of a file, density of a shape": (
                "density densityscale scale densitymultiplier densityattribute"
            ),
            "emission": "emissioncolor emissioncolour emissive le radiance emitted",
            "multiply emission by it": "emissionstrength emissionintensity emissionscale emissionpower",
            "temperature": "temperatureattribute temperaturegrid heat flame",
            "Le_scale": "blackbodyintensity blackbodyscale lescale temperaturestrength",
            "here sigma_s, what is scattered, and sigma_a, what is absorbed, in red, green and blue": (
                "color colour tint"
            ),
            "orders": "bounces maxdepth maxbounces scatterings volumebounces",
            "preset": "type kind name",
        }
    )

    preset: Annotated[str | None, BeforeValidator(_preset)] = Field(
        default=None,
        description="a medium by name, whose numbers those given here change; empty: none. "
        + "; ".join(f"{name}: {preset.summary}" for name, preset in PRESETS.items()),
    )
    sigma_s: RGB = Field(
        default=(1.0, 1.0, 1.0),
        validate_default=True,
        description="scattering coefficient at density 1, per world unit",
    )
    sigma_a: RGB = Field(
        default=(0.0, 0.0, 0.0),
        validate_default=True,
        description="absorption coefficient at density 1, per world unit",
    )
    phase: Accepts[Phase | str | dict[str, Any], Annotated[Phase, section_within(parse_phase)]] = Field(
        default="isotropic",
        validate_default=True,
        description=f"phase function: {', '.join(phase.usage() for phase in PHASES.values())}",
    )
    emission: RGB = Field(
        default=(0.0, 0.0, 0.0),
        validate_default=True,
        description="radiance emitted at density 1, per world unit, also without lights",
    )
    temperature: Annotated[str | None, BeforeValidator(_grid_name)] = Field(
        default=None,
        description="name of a grid of the volume's file: where that is hot a black body glows, whatever "
        "the density; empty: none",
    )
    temperature_offset: float = Field(
        default=0.0,
        ge=-LARGEST_COLOUR,
        le=LARGEST_COLOUR,
        description="kelvin = (value - temperature_offset) * temperature_scale, of the values of that grid",
    )
    temperature_scale: float = Field(
        default=1.0,
        ge=0,
        le=LARGEST_COLOUR,
        description="of the same; for instance 1000 where 1 means 1000 K",
    )
    Le_scale: float = Field(
        default=1.0,
        ge=0,
        le=LARGEST_COLOUR,
        description="radiance per world unit where that grid is hot: Le_scale times a black body's, relative "
        "to its peak",
    )
    emission_lights: int = Field(
        default=0,
        ge=0,
        le=MOST_EMISSION_LIGHTS,
        description="what the medium emits lights its surroundings, too: as so many point lights, at most, "
        "for each volume, box or sphere; 0: only the camera sees it, or, with orders, media scatter it, too",
    )

    orders: int = Field(
        default=1,
        ge=1,
        le=MOST_ORDERS,
        description="how often light is scattered, at most, on its way to the camera; 1: single scattering; "
        "more: the first order as before, the others from a lattice, without noise, of any phase function",
    )
    octaves: int = Field(
        default=1,
        ge=1,
        le=MOST_OCTAVES,
        description="multiple scattering, roughly, from one look-up of a light; 1: single scattering",
    )
    attenuation: Annotated[float | Literal["auto"], number_or_auto(0, 1)] = Field(
        default="auto",
        description="of octaves: the extinction that light meets in each, over the one before; 1 - g of it: "
        "by similarity, as if the medium scattered evenly; auto: by how deep it is",
    )
    contribution: Annotated[float | Literal["auto"], number_or_auto(0, 1)] = Field(
        default="auto",
        description="of octaves: how much light each adds, over the one before; auto: by how deep it is",
    )
    eccentricity: Annotated[float | Literal["auto"], number_or_auto(0, 1)] = Field(
        default="auto",
        description="of octaves: mean cosine of what each scatters, over that of the one before and over g, "
        "that of the phase function; auto: by how deep the medium is",
    )

    @property
    def octave_terms(self) -> NDArray[np.float64]:
        """[3, octaves]: what multiplies optical depths, how much light there is, and its mean cosine.

        Of light with the transmittance T, share_i C^`OCTAVE_GROWTH` HG(cosine_i) T^(depth_i) is scattered per
        albedo in octave i > 0, where C is the optical depth of the camera's ray and HG the phase function of
        Henyey and Greenstein. The first octave is single scattering, T times the phase function.

        Source: M. Wrenninge, C. Kulla, V. Lundqvist, "Oz: The Great and Volumetric", SIGGRAPH 2013 Talks. New
        is C: how often light was scattered depends on how deep the medium is there. By similarity, what was
        scattered often meets the medium as if it were isotropic, and 1 - g times as dense (g: mean cosine of
        the phase function); light scattered n times has the mean cosine gⁿ. The numbers are the best for
        pictures of several volumes, see `tfm_cl.plan.octaves`, which decides on those that are left open.
        """
        if self.octaves == 1:
            return np.array([[1.0], [1.0], [0.0]])
        i, g = np.arange(self.octaves), self.phase.mean_cosine
        depth = np.where(i > 0, (1 - g) * decided(self.attenuation) ** i, 1.0)
        cosine = np.clip(g * (g * decided(self.eccentricity)) ** i, -MOST_COSINE, MOST_COSINE)
        return np.stack([depth, decided(self.contribution) ** i, cosine])

    @property
    def albedo(self) -> NDArray[np.float64]:
        """The part of what is extinguished that is scattered, RGB; 0 where nothing is."""
        return np.divide(self.sigma_s, self.sigma_t, out=np.zeros(3), where=self.sigma_t > 0)

    @property
    def sigma_t(self) -> NDArray[np.float64]:
        """Extinction coefficient σ_s + σ_a at density 1, RGB, per world unit."""
        return np.add(self.sigma_s, self.sigma_a)

    @property
    def typical_depth(self) -> float:
        """Optical depth along typical lines of sight, where the density may be scaled to it."""
        return OPTICAL_DEPTH if self.preset is None else PRESETS[self.preset].optical_depth

    def replace(self, **changes: Any) -> Self:
        """As `Model.replace`; a preset replaces all that it has a number for."""
        return super().replace(**expanded(changes))

    def beside(self, folder: Path) -> Self:
        """Return the same with names of files that are relative to ``folder`` made absolute."""
        phase = self.phase.beside(folder)
        return self if phase is self.phase else self.replace(phase=phase)

    @property
    def emits(self) -> bool:
        """Whether its density emits any light."""
        return any(self.emission)

    @model_validator(mode="before")
    @classmethod
    def _preset_fills(cls, values: Any) -> Any:
        return expanded(values) if isinstance(values, dict) else values

    @model_validator(mode="after")
    def _check_used(self) -> Self:
        if self.octaves > 1 and self.orders > 1:
            raise ValueError(
                f"octaves = {self.octaves} and orders = {self.orders}: both are multiple scattering; set one"
            )
        given = {"temperature_offset": 0, "temperature_scale": 1, "Le_scale": 1}
        unused = [name for name, neutral in given.items() if getattr(self, name) != neutral]
        if self.temperature is None and unused:
            value = getattr(self, unused[0])
            raise ValueError(f"{unused[0]} = {value:g} does nothing without temperature, the name of a grid")
        if self.emission_lights and self.temperature is None and not self.emits:
            raise ValueError(
                f"emission_lights = {self.emission_lights} does nothing where nothing is emitted; set "
                "emission, or temperature, the name of a grid"
            )
        return self

    @property
    def dark(self) -> Self:
        """The same, but it emits nothing."""
        neutral = {"temperature": None, "temperature_offset": 0.0, "temperature_scale": 1.0, "Le_scale": 1.0}
        return self.replace(emission=0.0, emission_lights=0, **neutral)


@accepts({SECTION: "medium"})
def parse_medium(value: Any) -> Medium | None:
    """Make the medium of one body from a `Medium`, a table, or None for the scene's.

    Raises
    ------
    SceneError
        Unknown key or impossible value.
    """
    if value is None or isinstance(value, Medium):
        return value
    if isinstance(value, dict):
        try:
            return Medium.from_table(value)
        except SceneError as error:
            found = (Fault(_OWN_SECTION.sub("volume.medium", fault), fault.key) for fault in error.faults)
            raise SceneError(*found) from None
    raise SceneError(
        f"volume.medium = {reprlib.repr(value)}: should be a table like [medium]: "
        "{ sigma_s = [1, 1, 1], phase = 'isotropic' }"
    )


OwnMedium = Accepts[Medium | dict[str, Any] | None, Annotated[Medium | None, section_within(parse_medium)]]
"""The medium of one body alone: as `parse_medium` takes it."""

_OWN_SECTION = re.compile(r"^medium\b|(?<=in \[)medium\b")
"""Where a fault names the section."""
