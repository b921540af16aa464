"""One field of density on the device: all that light passes know of a scene's bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    import pyopencl as cl

    from tfm_cl.scene.lights import Light


@dataclass(frozen=True)
class Met:
    """What kernels are told of the density on their rays' way."""

    arguments: dict[str, Any]
    longest: int = 0
    """Primitives, at most, that a ray looks at beside its steps."""


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
    headers: tuple[str, ...]
    """Of what it is made of, before all others."""
    met_by: Callable[[Light, cl.Buffer, int], Met]
    """Tells what the rays of a light's map meet, of a fitted light, its struct, and texels along a side."""
    margin: float
    """World units, by which primitives reach beyond their bounds."""
