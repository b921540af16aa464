"""The interface of a phase function."""

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.errors import unknown_key
from tfm_cl.model import Model


class Phase(Model):
    """A phase function p(μ) that integrates to 1 over the sphere.

    μ is the cosine of the angle between the direction in which the light travels and the direction to the
    camera; 1 is forward scattering.
    """

    SECTION: ClassVar[str] = "medium.phase"
    HEADER: ClassVar[str]
    """Kernel header, below ``kernels/``, with a function of its name: ``Floats NAME(MEDIUM, Floats mu)``."""
    ARGUMENTS: ClassVar[str] = "(medium, mu)"
    """Of that function; one that knows how strands lie takes ``const FibreAngles *fibres`` instead."""
    KNOWS_TANGENTS: ClassVar[bool] = False

    type: str = Field(description="name of the phase function")

    def kernel_parameters(self) -> tuple[float, ...]:
        """Up to four parameters, which the kernel finds in ``medium->phase``."""
        return ()

    @abstractmethod
    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ) per steradian in double precision: the reference for the kernel header."""

    @classmethod
    def from_text(cls, text: str) -> "Phase":
        """Make a phase function from the text after the colon in ``--phase name:text``."""
        if text:
            raise ValueError(f"takes no parameter; got '{text}'")
        return cls()  # type: ignore[call-arg]  # every subclass has a default type


PHASES: dict[str, type[Phase]] = {}
"""Name in scene files -> class, of all that `tfm_cl.scene.phases` lists."""


def parse_phase(value: Any) -> Phase:
    """Make a phase function from a `Phase`, ``"name"``, ``"name:numbers"`` or a table with ``type``.

    Raises
    ------
    ValueError
        Unknown name or wrong form.
    """
    if isinstance(value, Phase):
        return value
    if isinstance(value, str):
        name, _, text = value.partition(":")
        return _phase_class(name).from_text(text)
    if isinstance(value, dict) and isinstance(value.get("type"), str):
        return _phase_class(value["type"])(**value)
    raise ValueError('should be a name, as "isotropic" or "hg:0.3", or a table { type = "hg", g = 0.3 }')


def _phase_class(name: str) -> type[Phase]:
    if name not in PHASES:
        raise ValueError(unknown_key(name, list(PHASES)).replace("key", "phase function"))
    return PHASES[name]
