"""What a basis is to the rest of the project."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Basis:
    """A way to keep the transmittance along a light ray in a few numbers."""

    name: str
    """Name in scene files and on the command line."""
    header: str
    """Kernel header, below ``kernels/``, with the functions that ``kernels/basis/README.md`` names."""
    summary: str
    """One line for ``--help``."""
    max_coeffs: int = 32
