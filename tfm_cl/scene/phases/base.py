"""The interface of a phase function."""

from abc import abstractmethod
from collections.abc import Hashable
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from tfm_cl.errors import unknown_key, words
from tfm_cl.model import Model
from tfm_cl.model_fields import SECTION, accepts

ANGLES = 4096
"""At which a phase function is looked at for its moments, the first of which are then right to 1e-5."""
OVERLAP = 0.6
"""Variance of the directions around a light's, over the square of its spread: equal parts of the sky add up
to an even sky within a tenth (half the width leaves ripples of half of it)."""
LEAST = 1e-6
"""Moments that are less than this part of their own are left out."""
ALIKE = 0.01
"""Relative difference up to which a phase function is wide enough by itself."""
COSINES = 1024
"""Of the table of one that is not."""


class Phase(Model):
    """A phase function p(μ) that integrates to 1 over the sphere.

    μ is the cosine of the angle between the direction in which the light travels and the direction to the
    camera; 1 is forward scattering.
    """

    SECTION: ClassVar[str] = "medium.phase"
    WORDS: ClassVar[dict[str, str]] = words(
        {
            "g": "anisotropy asymmetry meancosine eccentricity",
            "g1": "anisotropy1 forward",
            "g2": "anisotropy2 backward",
            "type": "name kind model",
            "diameter": "size particlesize",
            "file": "filename path",
        }
    )
    HEADER: ClassVar[str]
    """Kernel header, below ``kernels/``, with a function of its name: ``Floats NAME(MEDIUM, Floats mu)``."""
    ARGUMENTS: ClassVar[str] = "(medium, mu)"
    """Of that function; one that knows how strands lie takes ``const FibreAngles *fibres`` instead."""
    KNOWS_TANGENTS: ClassVar[bool] = False
    TAKES: ClassVar[str] = "no parameter"
    """What may follow its name on the command line, in words."""

    type: str = Field(description="name of the phase function")

    def kernel_parameters(self) -> tuple[float, ...]:
        """Up to four parameters, which the kernel finds in ``medium->phase``."""
        return ()

    def kernel_table(self) -> NDArray[np.float32] | None:
        """Numbers of any count, ``medium->phase_table`` floats from the medium; None: it needs none."""
        return None

    @property
    def mean_cosine(self) -> float:
        """Mean of μ over the directions into which light is scattered; 0 where it is even."""
        return float(self.legendre_moments(2)[1])

    def legendre_moments(self, count: int) -> NDArray[np.float64]:
        """Means of P_0(μ), P_1(μ), … over the directions into which light is scattered, ``[count]``."""
        # Midpoints in the cube root of the angle: half of them within 23° of a peak forwards.
        root = (np.arange(ANGLES) + 0.5) / ANGLES
        angle = np.pi * root**3
        mu = np.cos(angle)
        scattered = self.evaluate(mu) * np.sin(angle) * root**2
        scattered /= scattered.sum()
        before, now = np.zeros_like(mu), np.ones_like(mu)
        found = np.empty(count)
        for n in range(count):
            found[n] = (scattered * now).sum()
            before, now = now, ((2 * n + 1) * mu * now - n * before) / (n + 1)
        return found

    @abstractmethod
    def evaluate(self, mu: ArrayLike) -> NDArray[np.float64]:
        """p(μ) per steradian in double precision: the reference for the kernel header."""

    def read_files(self) -> None:
        """Read what it names, so that nothing has to be read later.

        Raises
        ------
        SceneError
            A file that cannot be used.
        """

    def files(self) -> tuple[str, ...]:
        """Return the names of the files that it reads."""
        return ()

    @property
    def content(self) -> Hashable:
        """What it depends on besides what it is told: what is in files."""
        return None

    def beside(self, folder: Path) -> Self:
        """Return the same with names of files that are relative to ``folder`` made absolute."""
        del folder
        return self

    def widened(self, spread: float) -> "Phase":
        """Return the mean of p over directions around the light's.

        These are spread like a Gaussian, so that neighbouring parts of the sky overlap. What depends on how
        strands lie is wide anyway.

        Parameters
        ----------
        spread
            Radius, in radians, of the part of the sky that the light stands for.
        """
        return self if spread == 0 or self.KNOWS_TANGENTS else _widened(self, self.content, spread)

    @staticmethod
    def left_by_spread(order: NDArray[np.integer], spread: float) -> NDArray[np.float64]:
        """Return what is left of Legendre moments of these orders where it is `widened` by a spread."""
        # A Gaussian on the sphere multiplies each moment.
        left: NDArray[np.float64] = np.exp(-order * (order + 1) * OVERLAP * spread**2 / 2)
        return left

    @classmethod
    def parameters(cls) -> list[str]:
        """Keys of the numbers that may follow its name on the command line, in order."""
        return [name for name in cls.model_fields if name != "type"]

    @classmethod
    def usage(cls) -> str:
        """Return how it is written on the command line, as ``hg:G``."""
        name = cls.model_fields["type"].default
        return ":".join([name, *(parameter.upper() for parameter in cls.parameters())])

    @classmethod
    def from_text(cls, text: str) -> Self:
        """Make a phase function from the numbers in ``--phase name:text``; one left out has its default."""
        parts, names = text.split(":") if text else [], cls.parameters()
        parts += [""] * (len(names) - len(parts))
        try:
            values = {name: float(part) for name, part in zip(names, parts, strict=True) if part}
        except ValueError:
            name = cls.model_fields["type"].default
            raise ValueError(f"takes {cls.TAKES}; got '{name}:{text}'") from None
        return cls(**values)  # type: ignore[arg-type]  # every subclass has a default type


PHASES: dict[str, type[Phase]] = {}
"""Name in scene files -> class, of all that `tfm_cl.scene.phases` lists."""


@lru_cache(maxsize=64)
def _widened(phase: Phase, _content: Hashable, spread: float) -> Phase:
    variance = OVERLAP * spread**2  # along each axis
    count = int(np.sqrt(-2 * np.log(LEAST) / variance)) + 2
    order = np.arange(count)
    moments = phase.legendre_moments(count) * phase.left_by_spread(order, spread)
    cosines = np.cos(np.linspace(np.pi, 0, COSINES))
    values = np.maximum(legval(cosines, (2 * order + 1) / (4 * np.pi) * moments), 0)
    if np.allclose(values, phase.evaluate(cosines), rtol=ALIKE, atol=0):
        return phase
    return PHASES["table"].from_table({"cosines": cosines, "values": values})


OTHER_NAMES = words(
    {
        "hg": "henyeygreenstein heneygreenstein henyeygreenstien schlick anisotropic",
        "double-hg": "doublehenyeygreenstein twolobe twotermhg dualhg twohg doublelobe",
        "isotropic": "uniform constant none",
        "draine": "cornetteshanks",
        "mie": "miefog cloud water droplets",
        "fournier-forand": "fournierforand ff",
        "table": "tabulated tabphase measured",
        "mix": "mixture blendphase blend",
        "kajiya-kay": "kajiyakay hair fibre fiber",
    }
)
"""Names in other programs -> the name here."""


@accepts({SECTION: "phase"})
def parse_phase(value: Any) -> Phase:
    """Make a phase function from a `Phase`, ``"name"``, ``"name:text"`` or a table with ``type``.

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
        raise ValueError(unknown_key(name, list(PHASES), words=OTHER_NAMES).replace("key", "phase function"))
    return PHASES[name]
