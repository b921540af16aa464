"""One field of density on the device: all that light passes know of a scene's bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tfm_cl.device.primitives import Eye

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.device.primitives import Listed, PrimitivesOnDevice
    from tfm_cl.scene.lights import Light


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
    primitives: PrimitivesOnDevice | None
    sets: cl.Buffer | None
    """What those of each body add to this field."""

    @property
    def headers(self) -> tuple[str, ...]:
        """Of the kinds of primitives."""
        return () if self.primitives is None else self.primitives.headers

    def met_by(self, light: Light, of_light: cl.Buffer, res: int) -> Met:
        """Return what kernels are told of the density that the rays of a light's map meet.

        Parameters
        ----------
        light
            Fitted.
        of_light
            Its struct, on the device.
        res
            Texels along a side of the map.
        """
        if self.primitives is None or self.sets is None:
            return Met(self.arguments)
        eye = Eye.of_light(light, of_light, self.primitives.origin, res)
        return Met.listed(self.arguments, self.primitives.listed(self.sets, eye))


@dataclass(frozen=True)
class Met:
    """What kernels are told of the density on their rays' way."""

    arguments: dict[str, Any]
    longest: int = 0
    """Primitives, at most, that a ray looks at beside its steps."""

    @classmethod
    def listed(cls, arguments: dict[str, Any], listed: Listed) -> Met:
        """Add lists of primitives to other arguments."""
        return cls(arguments | listed.arguments(), listed.longest)
