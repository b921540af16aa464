"""Scattering by strands (Kajiya and Kay 1989)."""

import math
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.scene.phases.base import Phase


class KajiyaKay(Phase):
    """Diffuse and specular reflection of a thin cylinder, which depends on how strands lie.

    sin θ_l [(1 - s)/π² + s cos₊ᵖ(θ_v - θ_m) / (2π B)], with B = ∫ cosᵖ over [-π/2, π/2]: θ_l is the angle
    between the light's travel and the strand, θ_v that of the direction to the camera, θ_m that of the cone
    into which a mirror would reflect. It is the radiance of an opaque strand of albedo 1 in a light of
    irradiance 1. Of the light that a strand takes, diffuse reflection gives back all, and specular reflection
    all or less: no more leaves it than arrives. Where several strands lie in one step of the march, their
    tangents' second moments stand for them. Bodies without strands scatter evenly.

    Source: J. T. Kajiya, T. L. Kay, "Rendering Fur with Three Dimensional Textures", SIGGRAPH 1989; the
    factors are those that bound its energy.
    """

    HEADER: ClassVar[str] = "phase/kajiya_kay.h"
    ARGUMENTS: ClassVar[str] = "(medium, fibres)"
    KNOWS_TANGENTS: ClassVar[bool] = True
    TAKES: ClassVar[str] = "the share and the exponent of specular reflection, as in kajiya-kay:0.3:40"

    type: Literal["kajiya-kay"] = "kajiya-kay"
    specular: float = Field(default=0.3, ge=0, le=1, description="s: share of specular reflection")
    exponent: float = Field(
        default=40.0, ge=1, le=1e4, description="p: of the cosine: the larger, the narrower the highlight"
    )

    def kernel_parameters(self) -> tuple[float, ...]:
        """(s, p, 1 / (2π B))."""
        return (self.specular, self.exponent, 1 / (2 * math.pi * _cosine_integral(self.exponent)))

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """1/4π: without strands."""
        return np.full(np.shape(mu), 1.0 / (4.0 * np.pi))

    def evaluate_strand(
        self, tangent: NDArray[np.floating], travel: NDArray[np.floating], to_camera: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Evaluate it for unit vectors [..., 3]: of strands, of the light's travel, and to the camera."""
        along_light = (np.asarray(tangent, dtype=np.float64) * travel).sum(axis=-1)
        along_view = (np.asarray(tangent, dtype=np.float64) * to_camera).sum(axis=-1)
        light, view = (np.sqrt(np.maximum(1 - cosine**2, 0)) for cosine in (along_light, along_view))
        mirrored = np.maximum(along_light * along_view + light * view, 0) ** self.exponent
        s, _, scale = self.kernel_parameters()
        found: NDArray[np.float64] = light * ((1 - s) / np.pi**2 + s * scale * mirrored)
        return found


def _cosine_integral(exponent: float) -> float:
    """∫ cosᵖ from -π/2 to π/2 = √π Γ((p + 1)/2) / Γ(p/2 + 1)."""
    return math.sqrt(math.pi) * math.exp(math.lgamma((exponent + 1) / 2) - math.lgamma(exponent / 2 + 1))
