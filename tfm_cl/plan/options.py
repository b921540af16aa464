"""What a run came to, as a scene file says it, and what a scene file leaves out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.optical_depth import density_scale_for
from tfm_cl.scene.scene_file import SceneFile, Values, VolumeSettings

if TYPE_CHECKING:
    from tfm_cl.scene.scene import Scene

ABSURD = 1e9
"""Factor of a density scale above what is sensible with which there is no picture of it."""
FAR = 2.0
"""Factor between two density scales that makes another picture."""


def warnings(file: SceneFile, scene: Scene) -> tuple[str, ...]:
    """Tell, one line each, what the file leaves out and most likely should not, and what is beyond sense."""
    return (*_without_scale(file, scene), *_too_dense(file, scene))


def _too_dense(file: SceneFile, scene: Scene) -> Iterator[str]:
    for number, settings, volume in grids(file, scene):
        sigma_t = float(scene.medium_of(volume).sigma_t.max())
        deepest = sigma_t * volume.density_scale * volume.largest * volume.longest_ray
        if "density_scale" not in settings.model_fields_set or deepest < ABSURD:
            continue  # at once: the following takes time
        sensible = density_scale_for(volume, scene.medium_of(volume).typical_depth)
        if sigma_t * volume.density_scale > ABSURD * sensible:
            yield (
                f"{file.path}: volume.{number}density_scale = {volume.density_scale:g} makes densities up to "
                f"{volume.density_scale * volume.largest:.2g}: light ends where the first begins; "
                f'"auto" would take {sensible:.2g}'
            )


def _without_scale(file: SceneFile, scene: Scene) -> Iterator[str]:
    return (
        f'{file.path}: volume.{number}density_scale is not given: 1 is used; "auto" would take '
        f"{sensible:g}: give one of them"
        for number, settings, volume in grids(file, scene)
        if "density_scale" not in settings.model_fields_set
        and _is_far_from_one(
            sensible := density_scale_for(volume, scene.medium_of(volume).typical_depth),
            float(scene.medium_of(volume).sigma_t.max()),
        )
    )


def grids(file: SceneFile, scene: Scene) -> Iterator[tuple[str, VolumeSettings, Volume]]:
    """Yield each volume that is a grid, with its settings and what its keys' section is numbered with."""
    for i, (settings, volume) in enumerate(zip(file.volumes, scene.bodies, strict=True)):
        if isinstance(settings, VolumeSettings) and isinstance(volume, Volume):
            yield f"{i}." if len(file.volumes) > 1 else "", settings, volume


def table(file: SceneFile, scene: Scene) -> Values:
    """Return every option in the shape of a scene file that reproduces this run.

    Parameters
    ----------
    file
        What was asked for.
    scene
        Of it, with the numbers decided: `tfm_cl.plan.plan.Plan.scene`.
    """
    return scene.to_table() | {"image": file.image.to_dict()}


def _is_far_from_one(sensible: float, sigma_t: float) -> bool:
    """Tell whether a density scale of 1 gives a much worse optical depth than ``sensible`` would.

    ``sensible`` is for σ_t = 1. A medium of another σ_t may say by it what the density scale does not: then
    both together would be worse.
    """
    if sigma_t <= 0:
        return False
    # Of logarithms, since a quotient may be beyond float64.
    as_it_is, with_sensible = abs(math.log(sigma_t) - math.log(sensible)), abs(math.log(sigma_t))
    return as_it_is >= math.log(FAR) and as_it_is > with_sensible
