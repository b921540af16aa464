"""One field of density on the device: all that light passes know of a scene's bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class FieldOnDevice:
    """One scalar field of density, which light passes march."""

    index: int
    extinction: float
    """At density 1, of the colour that sees deepest into it: what visibility is meant for."""
    strongest: float
    """At density 1, of the colour that sees least far."""
    voxels: str
    """Type of the voxels in memory."""
    defines: dict[str, int | str]
    arguments: dict[str, Any]
