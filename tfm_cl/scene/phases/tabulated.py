"""Phase functions that are known by their values."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field

from tfm_cl.constants import PHASE_CELLS
from tfm_cl.errors import InputError, SceneError
from tfm_cl.files.paths import real_path, source_of
from tfm_cl.files.phase_table import Curve, TablePath, checked, read
from tfm_cl.model_fields import Accepts, Numbers
from tfm_cl.scene.frame_numbers import KEYS, OfFrames
from tfm_cl.scene.phases.base import Phase

MOST_LOST = 0.01
"""Of the light, by peaks that are too narrow for the device."""


def listed(value: Any) -> tuple[Any, ...]:
    """Return the items of a list, a tuple or an array; raises `ValueError` of anything else."""
    if not isinstance(value, list | tuple | np.ndarray):
        raise ValueError("should be a list")  # noqa: TRY004 - what pydantic takes
    return tuple(value.tolist() if isinstance(value, np.ndarray) else value)


@dataclass(frozen=True, eq=False)
class Samples:
    """What ``kernels/phase/tabulated_phase.h`` reads."""

    values: NDArray[np.float32]
    """[PHASE_CELLS + 2], at squares of even steps from a pole: from μ = 1 to 0, then from -1 to 0."""


Listed = Accepts[Numbers, Annotated[tuple[float, ...], BeforeValidator(listed)]]


class TabulatedPhase(OfFrames, Phase):
    """Measured or computed: linear in μ between the values, which are scaled so as to integrate to 1.

    The values come from a file with a cosine and a value in every line, or from arrays. Cosines that are left
    out are evenly spaced from -1 to 1, as in Mitsuba's `tabphase`; 1 is forward scattering. The device has
    the function at places 0.02° apart around both poles and 0.03° between them: what is narrower is not seen.
    """

    HEADER: ClassVar[str] = "phase/tabulated_phase.h"
    TAKES: ClassVar[str] = "a file with a cosine and a value in every line, as in table:measured.txt"

    type: Literal["table"] = "table"
    file: TablePath = Field(
        default="",
        validate_default=True,
        description="text with a cosine and a value in every line, relative to the scene file",
    )
    cosines: Listed = Field(
        default=(), validate_default=True, description="instead of a file: cosines from -1 to 1, in order"
    )
    values: Listed = Field(
        default=(),
        validate_default=True,
        description="instead of a file: values at the cosines, or evenly spaced",
    )

    def model_post_init(self, context: Any, /) -> None:
        """Check what was given, and read what is there."""
        super().model_post_init(context)
        if bool(self.file) == bool(self.values) or (self.file and self.cosines):
            raise SceneError(f"{self.SECTION}: a table has either a file or values (and cosines)")
        if self.values:
            self.read_files()

    @cached_property
    def _curve(self) -> Curve:
        if self.file:
            try:
                return read(self.file)
            except SceneError as error:
                raise error.within(f"{self.SECTION}.file") from None
        try:
            even = np.linspace(-1, 1, len(self.values))
            return checked(np.array(self.cosines or even), np.array(self.values))
        except ValueError as error:
            raise SceneError(f"{self.SECTION}: {error}") from None

    @cached_property
    def _samples(self) -> Samples:
        return sampled(self.evaluate)

    def read_files(self) -> None:
        """Read the file, once."""
        _ = self._samples

    def files(self) -> tuple[str, ...]:
        """As `Phase.files`."""
        return (self.file,) if self.file else ()

    @property
    def content(self) -> Hashable:
        """As `Phase.content`."""
        return (self._curve.cosines.tobytes(), self._curve.values.tobytes()) if self.file else None

    def beside(self, folder: Path) -> Self:
        """As `Phase.beside`."""
        try:
            return self.replace(file=str(real_path(source_of(self.file, folder)))) if self.file else self
        except InputError:
            return self  # reading it says what is wrong with the name

    def kernel_table(self) -> NDArray[np.float32]:
        """As `Samples.values`."""
        return self._samples.values

    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ), in double precision."""
        return np.interp(np.asarray(mu, dtype=np.float64), self._curve.cosines, self._curve.values)

    def to_dict(self) -> dict[str, Any]:
        """Return what was given: the file, or the numbers."""
        return {key: value for key, value in super().to_dict().items() if value and key not in KEYS}

    @classmethod
    def usage(cls) -> str:
        """``table:FILE``."""
        return "table:FILE"

    @classmethod
    def from_text(cls, text: str) -> Self:
        """``table:FILE``."""
        if not text:
            raise ValueError(f"takes {cls.TAKES}")
        return cls(file=text)


def sampled(evaluate: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Samples:
    """Return a phase function's values as the device has them.

    Raises
    ------
    SceneError
        It has peaks between them.
    """
    off_pole = np.linspace(0, 1, PHASE_CELLS // 2 + 1) ** 2
    values = evaluate(np.concatenate([1 - off_pole, off_pole - 1]))
    ahead, back = values.reshape(2, -1)
    whole = 2 * np.pi * float(np.trapezoid(ahead + back, off_pole))
    if abs(whole - 1) > MOST_LOST:
        raise SceneError(
            f"{Phase.SECTION}: has peaks narrower than tables on the device, 0.02° to 0.03°, which would "
            f"integrate to {whole:.3g} instead of 1; widen them"
        )
    return Samples(values.astype(np.float32))
