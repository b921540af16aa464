"""A scene's media on the device: what kernels that meet them are told, and how they are compiled for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tfm_cl.device.bricks import ONE_FIELD
from tfm_cl.device.field import FieldOnDevice, Met
from tfm_cl.device.primitives import Eye, choice
from tfm_cl.device.structs.bodies import body_structs, grid_structs
from tfm_cl.device.structs.medium import medium_structs
from tfm_cl.scene.bodies.homogeneous import SHAPES
from tfm_cl.scene.bodies.thin import ThinPrimitives
from tfm_cl.scene.fields import fields_of
from tfm_cl.scene.phases.base import PHASES

if TYPE_CHECKING:
    import pyopencl as cl

    from tfm_cl.device.bricks import BrickGrid
    from tfm_cl.device.launch import Launcher
    from tfm_cl.device.primitives import PrimitivesOnDevice
    from tfm_cl.scene.fields import Fields
    from tfm_cl.scene.lights import Light
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.scene import Scene


BODY_FUNCTIONS = {
    "clip": "(body, ray, interval)",
    "entry": "(body, ray)",
    "is_smooth": "(body, first, last, ratio)",
}
"""What the header of each kind of body of constant density has."""


@dataclass(frozen=True)
class MediaOnDevice:
    """All bodies of a scene, as camera rays meet them."""

    fields: Fields
    bricks: BrickGrid | None
    """None without grids."""
    primitives: PrimitivesOnDevice | None
    sets: cl.Buffer | None
    """What primitives of each body add to the amounts."""
    headers: tuple[str, ...]
    """Of the kinds of phase functions and of bodies."""
    defines: dict[str, int | str]
    """Macros, but for ``TFM_CHANNELS``."""
    arguments: dict[str, Any]
    of_fields: tuple[FieldOnDevice, ...]
    is_grey: bool
    """Whether all three colours are extinguished alike, and scattered in one proportion everywhere."""

    def met_by_camera(self, scene: Scene, view: cl.Buffer, per_pixel: int = 1) -> Met:
        """Return what kernels are told of what camera rays meet: so many along a side of a pixel."""
        if self.primitives is None or self.sets is None:
            return Met(self.arguments)
        eye = Eye.of_camera(scene, view, per_pixel)
        return self.primitives.listed(self.primitives.seen(self.sets, eye), eye).met(self.arguments)

    def channels(self, *, textured: bool) -> dict[str, int]:
        """Return the macro that says how many colours are marched."""
        return {"TFM_CHANNELS": 1 if self.is_grey and not textured else 3}


def media_on_device(
    launcher: Launcher,
    scene: Scene,
    bricks: BrickGrid | None,
    primitives: PrimitivesOnDevice | None = None,
    margin: float = 0.0,
) -> MediaOnDevice:
    """Put media and bodies on the device.

    Parameters
    ----------
    scene
        What to render; only its bodies, their media, ``march.skip_empty`` and `Scene.spreads` matter.
    bricks
        The voxels of its grids, then of its flames; None where it has none.
    primitives
        Its primitives, likewise.
    margin
        World units, by which these reach beyond their bounds.
    """
    flames, bodies = scene.flames, scene.homogeneous
    fields = fields_of(scene)
    media = list(scene.media)
    # All media once more for lights from a part of the sky, with the phase functions that these see.
    for_lights = [
        medium.replace(phase=medium.phase.widened(spread)) for spread in scene.spreads for medium in media
    ]
    is_coloured = any(body.colour is not None for body in scene.marched)
    channels = 3 if flames or is_coloured else 1
    of_grids = {} if bricks is None else bricks.arguments
    # Only the camera sees flames: to light passes they are not there.
    of_bricks = _of_boxes(bricks, primitives, len(scene.grids), 3 if is_coloured else 1)
    met_by_camera = _of_boxes(bricks, primitives, len(scene.grids) + len(flames), channels)
    numbers_of_media = [media.index(scene.medium_of(body)) for body in scene.primitives]
    of_amounts = np.eye(3) if channels == 3 else np.outer([1, 0, 0], [1, 0, 0])  # noqa: PLR2004 - RGB
    phases = list(dict.fromkeys(type(medium.phase) for medium in for_lights))
    kinds = [kind for kind in SHAPES.values() if any(isinstance(body, kind) for body in bodies)]
    numbers = list(PHASES.values())
    of_grid_fields = [
        {
            "grids": launcher.upload(
                "the grids", grid_structs(scene, bricks, fields.weights[:, :, k], margin)
            ),
            **of_grids,
        }
        for k in range(fields.count)
    ]
    met_by = [_met_by(scene, fields, k, primitives, told) for k, told in enumerate(of_grid_fields)]
    of_fields = tuple(
        FieldOnDevice(
            index=k,
            extinction=float(fields.extinctions[k]),
            strongest=float(fields.rgb_from_field[:, k].max()),
            voxels="" if bricks is None else bricks.voxels,
            defines=of_bricks | ONE_FIELD,
            arguments=of_grid_fields[k],
            headers=() if primitives is None else primitives.headers,
            met_by=met_by[k],
            margin=margin,
        )
        for k in range(fields.count)
    )
    return MediaOnDevice(
        fields=fields,
        bricks=bricks,
        primitives=primitives,
        sets=None
        if primitives is None
        else primitives.sets(
            numbers_of_media,
            np.broadcast_to(of_amounts, (len(numbers_of_media), 3, 3)),
            [float(scene.medium_of(body).sigma_t.mean()) or 1.0 for body in scene.primitives],
        ),
        headers=(
            *(() if primitives is None else primitives.headers),
            *(phase.HEADER for phase in phases),
            *(kind.HEADER for kind in kinds),
        ),
        defines=met_by_camera
        | {
            "TFM_MEDIA": len(media),
            "TFM_AMOUNTS": channels,
            "TFM_BODIES": len(bodies),
            "TFM_FIELDS": fields.count,
            "TFM_MEDIUM_OF_GRID(i)": _number_of((*scene.grids, *flames), scene, media),
            "TFM_MEDIUM_OF_BODY(i)": _number_of(bodies, scene, media),
            "TFM_PHASE(medium, mu, fibres)": choice(
                "(medium)->phase_kind",
                ((numbers.index(phase), PurePath(phase.HEADER).stem + phase.ARGUMENTS) for phase in phases),
            ),
            "TFM_THIN": int(any(isinstance(body, ThinPrimitives) for body in scene.primitives)),
            "TFM_OCTAVES": max(medium.octaves for medium in media),
            "TFM_TANGENTS": int(any(phase.KNOWS_TANGENTS for phase in phases)),
            "TFM_EMISSION": int(scene.emits),
            **{
                f"TFM_BODY_{function.upper()}{arguments}": choice(
                    "(body)->kind",
                    (
                        (kind.KIND, f"{PurePath(kind.HEADER).stem}_body_{function}{arguments}")
                        for kind in kinds
                    ),
                )
                for function, arguments in BODY_FUNCTIONS.items()
            },
        },
        arguments={
            "media": launcher.upload("the media", medium_structs(for_lights)),
            "bodies": launcher.upload("the bodies", body_structs(scene)),
            "grids": launcher.upload("the grids", grid_structs(scene, bricks, margin=margin, flames=True)),
            **of_grids,
        },
        of_fields=of_fields,
        is_grey=len(media) == 1 and channels == 1 and len(set(np.asarray(media[0].sigma_t).tolist())) == 1,
    )


def _of_boxes(
    bricks: BrickGrid | None, primitives: PrimitivesOnDevice | None, grids: int, channels: int
) -> dict[str, int | str]:
    """Macros that say what is marched: boxes of the first ``grids``, and the one around all primitives."""
    defines: dict[str, int | str] = {"TFM_GRIDS": 0, "TFM_VOXEL_CHANNELS": 1}
    if bricks is not None:
        defines |= bricks.defines | {"TFM_GRIDS": grids, "TFM_VOXEL_CHANNELS": channels}
    if primitives is None:
        return defines
    return defines | primitives.defines | {"TFM_GRIDS": int(defines["TFM_GRIDS"]) + 1, "TFM_PRIMITIVES": 1}


def _met_by(
    scene: Scene, fields: Fields, k: int, primitives: PrimitivesOnDevice | None, arguments: dict[str, Any]
) -> Callable[[Light, cl.Buffer, int], Met]:
    """Return what tells of a field's density on the way of a light's rays: grids, and lists of primitives."""
    if primitives is None:
        return lambda *_: Met(arguments)
    count = len(scene.primitives)
    weights = _in_field(fields.weights[len(scene.grids) :, :, k])
    sets = primitives.sets([0] * count, weights, [float(fields.extinctions[k])] * count)
    return lambda light, of_light, res: primitives.listed_by_light(sets, light, of_light, res).met(arguments)


def _in_field(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """From weights [bodies, 3] of colours to those of one amount, [bodies, 3, 3]."""
    matrices = np.zeros((len(weights), 3, 3))
    matrices[:, 0] = weights
    return matrices


def _number_of(bodies: Sequence[Any], scene: Scene, media: list[Medium]) -> str:
    """Return a C expression: the number of body i's medium."""
    numbers = [media.index(scene.medium_of(body)) for body in bodies]
    return choice("(i)", ((i, str(number)) for i, number in enumerate(numbers)))
