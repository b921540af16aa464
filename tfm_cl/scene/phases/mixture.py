"""Phase functions that are sums of others."""

from collections.abc import Hashable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field

from tfm_cl.errors import SceneError
from tfm_cl.model import section_within
from tfm_cl.model_fields import SECTION, Accepts, accepts
from tfm_cl.scene.phases.base import Phase, parse_phase
from tfm_cl.scene.phases.tabulated import Listed, Samples, listed, sampled

MOST_PARTS = 8


@accepts({SECTION: "phase"})
def _part(value: Any) -> Phase:
    # Before its own parts are looked at: they may be nested however deep.
    is_mixture = isinstance(value, PhaseMixture) or (isinstance(value, dict) and value.get("type") == "mix")
    if is_mixture:
        raise ValueError("a mixture cannot be part of another; list its parts")
    phase = parse_phase(value)
    if phase.KNOWS_TANGENTS:
        raise ValueError("depends on how strands lie, and cannot be part of a mixture")
    return phase


class PhaseMixture(Phase):
    """p(μ) = Σ wᵢ pᵢ(μ) / Σ wᵢ: particles of several kinds in one medium.

    Of phase functions that know nothing of strands. The device has the sum by its values, as
    `TabulatedPhase`, and parts that are too narrow for it are refused when files are read.
    """

    HEADER: ClassVar[str] = "phase/tabulated_phase.h"

    type: Literal["mix"] = "mix"
    phases: Accepts[
        Sequence[Phase | str | dict[str, Any]],
        Annotated[tuple[Annotated[Phase, section_within(_part)], ...], BeforeValidator(listed)],
    ] = Field(min_length=1, max_length=MOST_PARTS, description="phase functions, as many as weights")
    weights: Listed = Field(
        description="of each ≥ 0: the part of what is scattered that it scatters, over their sum"
    )

    def model_post_init(self, context: Any, /) -> None:
        """Check that there is a weight for each part."""
        super().model_post_init(context)
        if len(self.weights) != len(self.phases):
            given = f"{len(self.phases)} and {len(self.weights)}"
            raise SceneError(f"{self.SECTION}: a mixture needs as many weights as phases; got {given}")
        if not (min(self.weights) >= 0 and 0 < sum(self.weights) < np.inf):
            raise SceneError(f"{self.SECTION}.weights = {list(self.weights)}: should be ≥ 0, and not all 0")

    @cached_property
    def _samples(self) -> Samples:
        return sampled(self.evaluate)

    def read_files(self) -> None:
        """As `Phase.read_files`, of all."""
        for phase in self.phases:
            phase.read_files()
        _ = self._samples

    def files(self) -> tuple[str, ...]:
        """As `Phase.files`, of all."""
        return tuple(name for phase in self.phases for name in phase.files())

    @property
    def content(self) -> Hashable:
        """As `Phase.content`, of all."""
        return tuple(phase.content for phase in self.phases)

    def beside(self, folder: Path) -> Self:
        """As `Phase.beside`, of all."""
        return self.replace(phases=tuple(phase.beside(folder) for phase in self.phases))

    def kernel_table(self) -> NDArray[np.float32]:
        """As `Samples.values`."""
        return self._samples.values

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        total = sum(self.weights)
        density = np.zeros(np.shape(mu))
        for weight, phase in zip(self.weights, self.phases, strict=True):
            density = density + weight / total * phase.evaluate(mu)
        return density

    @classmethod
    def usage(cls) -> str:
        """Return its name: no line of text holds a mixture."""
        return "mix"

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Raise `ValueError`, which says how a mixture is written."""
        raise ValueError(
            'is a table, as { type = "mix", phases = ["mie:8", "rayleigh"], weights = [0.9, 0.1] }; '
            f"got 'mix{':' * bool(text)}{text}'"
        )
