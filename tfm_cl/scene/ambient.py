"""Light from everywhere."""

from typing import ClassVar

from pydantic import Field

from tfm_cl.model import RGB, Model


class Ambient(Model):
    """The same radiance from all directions, not shadowed (TFM section 4.3).

    The medium scatters it along the whole camera ray: L_a (σ_s/σ_t)(1 - T), eq. 7, which for a medium whose
    density varies is the same integral. A solid reflects its albedo's part of it.
    """

    SECTION: ClassVar[str] = "ambient"

    radiance: RGB = Field((0.0, 0.0, 0.0), description="RGB, the same from all directions")
