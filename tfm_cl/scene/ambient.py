"""Ambient light."""

from typing import ClassVar

from pydantic import Field

from tfm_cl.errors import words
from tfm_cl.model import RGB, Model


class Ambient(Model):
    """The same radiance from all directions, without shadows (TFM section 4.3).

    The medium scatters it along the whole camera ray: L_a (σ_s/σ_t)(1 - T), eq. 7. The integral is the same
    for a medium of varying density. A solid reflects it multiplied by the albedo.
    """

    SECTION: ClassVar[str] = "ambient"
    WORDS: ClassVar[dict[str, str]] = words({"radiance": "color colour intensity strength light rgb value"})

    radiance: RGB = Field(
        default=(0.0, 0.0, 0.0),
        validate_default=True,
        description="RGB radiance, the same from all directions",
    )
