"""The medium's material: constant colours times the volume's density (TFM eq. 11)."""

import re
import reprlib
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tfm_cl.errors import SceneError
from tfm_cl.model import RGB, Model, section_within
from tfm_cl.scene.phases.base import Phase, parse_phase


class Medium(Model):
    """Scattering and absorption per unit of density, and the phase function."""

    SECTION: ClassVar[str] = "medium"

    sigma_s: RGB = Field((1.0, 1.0, 1.0), description="scattering coefficient at density 1, per world unit")
    sigma_a: RGB = Field((0.0, 0.0, 0.0), description="absorption coefficient at density 1, per world unit")
    phase: Annotated[Phase, section_within(parse_phase)] = Field(
        "isotropic",
        validate_default=True,
        description="phase function: isotropic, hg:G or kajiya-kay:SPECULAR:EXPONENT",
    )

    @property
    def sigma_t(self) -> NDArray[np.float64]:
        """Extinction coefficient σ_s + σ_a at density 1, RGB, per world unit."""
        return np.add(self.sigma_s, self.sigma_a)


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
            raise SceneError(*(_OWN_SECTION.sub("volume.medium", line) for line in error.args)) from None
    raise SceneError(
        f"volume.medium = {reprlib.repr(value)}: should be a table like [medium]: "
        "{ sigma_s = [1, 1, 1], phase = 'isotropic' }"
    )


_OWN_SECTION = re.compile(r"^medium\b|(?<=in \[)medium\b")
"""Where a fault names the section."""
