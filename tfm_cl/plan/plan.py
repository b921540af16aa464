"""The plan of a run: every ``"auto"`` decided once, as a number or a name with its reason.

A scene is a request; what a pass finds is a fact. Between them stands the plan: what the passes do, and what
the command line tells.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tfm_cl.errors import SceneError
from tfm_cl.files.image_io.display import WHY_AUTOMATIC
from tfm_cl.maps.bases import BEST
from tfm_cl.maps.resolved import ResolvedMap, resolve
from tfm_cl.plan import emission, lattice, octaves, orders, resolution, surroundings
from tfm_cl.plan.options import grids
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.thin import ThinPrimitives
from tfm_cl.scene.looks import PLAIN
from tfm_cl.scene.optical_depth import why_density
from tfm_cl.scene.solids.ground import GroundSolid

if TYPE_CHECKING:
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.scene_file import SceneFile
    from tfm_cl.scene.settings import MapSettings

OF_BASIS = ("target", "fit", "range", "lookup")
"""Keys of ``[map]`` for which a basis has a way of its own."""
NUMBERS = ("map.res", "map.steps", "map.coeffs", "march.steps")
"""What ``map.max_error`` chooses by measuring, where it is ``"auto"``."""
THIN_WEIGHTING = 2.0
"""α of strands and polygons, as an optical depth."""
OPAQUE_DEPTH = 4.6
"""Optical depth of one crossing from which what is thin is opaque: 99 % of the light."""
PLACED = {
    "from": "above what has density, to the left and in front of it",
    "to": "the middle of what has density",
    "cone": "half a degree more than what has density takes up, at most 60",
    "intensity": "brings a dense, white medium near white, whatever the distance",
}
"""Keys of a light that is placed, and why they are what they are."""

OF_CAMERA = {
    "from": "what has density fills the frame",
    "to": PLACED["to"],
    "haze": "the ground fades before its horizon",
}
"""Keys of a camera that is placed, likewise."""

GROUND = {
    "up": "the world's axis nearest to camera.up; y with camera.matrix",
    "height": "the lowest of what has density and of solids",
}
"""Keys of a ground that is placed, and why they are what they are."""

LOG = logging.getLogger(__name__)

Decisions = Mapping[str, "Decision"]


class Decision(NamedTuple):
    """What is done where the user left it open."""

    value: Any
    """As a scene file writes it; None as long as only rendering can tell."""
    why: str


def told_of(decisions: Decisions) -> dict[str, Any]:
    """Return what was placed, scaled or counted, by dotted key."""
    counts = ("map.res", "map.steps", "march.steps")
    found = ("map", "march", "orders", "emission")
    return {
        key: decision.value
        for key, decision in decisions.items()
        if decision.value is not None and (key in counts or key.split(".")[0] not in found)
        if key.split(".")[-1] not in octaves.KEYS and not surroundings.is_key(key)
    }


@dataclass(frozen=True)
class Plan:
    """What a scene is rendered with."""

    scene: Scene
    """The scene with numbers for resolution and steps; what ``max_error`` asks for is left to measuring."""
    map: ResolvedMap | None
    """Of all maps; None where there are none: for the dual march, without grids or lights, and as long as
    ``max_error`` is to be measured."""
    decisions: Decisions
    """By dotted key of the scene file, all that was left open."""

    @property
    def told(self) -> dict[str, Any]:
        """What was placed, scaled or counted, by dotted key, to be fixed by hand."""
        return told_of(self.decisions)

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return the decisions for JSON."""
        return {key: {"value": value, "why": why} for key, (value, why) in self.decisions.items()}

    def lines(self) -> Iterator[str]:
        """Yield the decisions for people."""
        for key, (value, why) in self.decisions.items():
            yield f"{key} = {'?' if value is None else value}: {why}"

    def log(self) -> None:
        """Tell the logger the decisions, for debugging."""
        for line in self.lines() if LOG.isEnabledFor(logging.DEBUG) else ():
            LOG.debug("%s", line)

    def completed(
        self,
        scene: Scene,
        used: ResolvedMap | None,
        error: float | None = None,
        exposure: float | None = None,
    ) -> Plan:
        """Add what rendering found out.

        Parameters
        ----------
        scene
            With the numbers that it was rendered with.
        used
            Its maps; None without.
        error
            Measured, where ``max_error`` asked for it.
        exposure
            Stops of a PNG; None without one.
        """
        found: dict[str, Any] = {"map.steps": scene.map.steps, "march.steps": scene.march.steps}
        found["image.exposure"] = exposure
        if used is not None:
            found |= {"map.res": used.res, "map.coeffs": used.coeffs, "map.steps": used.steps}
            found["map.density_weighting"] = used.density_weighting
        decisions = dict(self.decisions)
        for key, (value, why) in self.decisions.items():
            if value is None and isinstance(found.get(key), int | float):
                measured = f"; measured: {error:.2g}" if error is not None and key in NUMBERS else ""
                decisions[key] = Decision(found[key], why + measured)
            elif value is None:
                del decisions[key]  # nothing needed it
        return replace(self, scene=scene, map=used, decisions=decisions)


def plan(
    scene: Scene, *, method: str | None = None, maps: MapSettings | None = None, file: SceneFile | None = None
) -> Plan:
    """Decide what a scene leaves open.

    Parameters
    ----------
    scene
        The request.
    method
        ``tfm`` or ``dual`` instead of the scene's.
    maps
        Settings of maps that are there already: their numbers stand where the scene's are ``"auto"``.
    file
        That the scene was read from: tells what was placed and scaled.

    Raises
    ------
    SceneError
        ``map.bytes`` that are too few, a blur or deposits that its basis does not take, deposits of
        nothing, or several orders of scattering of what scatters once only.
    """
    orders.check(scene)
    decisions = {} if file is None else dict(_placed(scene, file))
    decisions |= dict(_of_orders(scene)) | dict(_of_emission(scene))
    of_octaves = octaves.numbers(scene)
    decisions |= {f"{found.section}.{found.key}": Decision(found.number, found.why) for found in of_octaves}
    scene = octaves.resolved(scene, of_octaves)
    reads_maps = (method or scene.march.method) == "tfm"
    of_surroundings = surroundings.decided(scene, reads_maps=reads_maps)
    decisions |= {
        f"light.{f'{one.light}.' if len(scene.lights) > 1 else ''}{one.key}": Decision(one.value, one.why)
        for one in of_surroundings
    }
    scene = surroundings.resolved(scene, of_surroundings)
    has_maps = reads_maps and bool(scene.marched and scene.is_lit)
    if has_maps and scene.map.deposits == "depth" and not scene.primitives:
        raise SceneError(
            "map.deposits = 'depth': says what points, curves and polygons leave in the map, of which "
            "the scene has none; leave it out"
        )
    if has_maps and (of_thin := dict(_for_thin(scene))):
        decisions |= {f"map.{key}": decision for key, decision in of_thin.items()}
        scene = scene.replace(map=scene.map.replace(**{key: found.value for key, found in of_thin.items()}))
    if scene.map.max_error is not None:
        if has_maps:
            chosen, why = _looked_up(scene)
            plain = resolution.resolved(chosen.replace(map=chosen.map.replace(max_error=None)))
            decisions |= _of_map(scene.map, resolve(plain.map))
            if scene.map.lookup == "auto" and chosen.map.lookup == "lattice":
                decisions["map.lookup"] = Decision("lattice", why)
        return Plan(scene, None, decisions | dict(_to_measure(scene, has_maps=has_maps)))
    on_lattice = scene.map.lookup == "lattice"
    if has_maps and scene.map.lookup == "auto":
        on_lattice, why = lattice.choice(scene) if maps is None else lattice.as_of(maps)
        if on_lattice:
            scene = scene.replace(map=scene.map.replace(lookup="lattice"))
            decisions["map.lookup"] = Decision("lattice", why)
    wanted = resolution.wanted(scene, maps, on_lattice=on_lattice)
    decided = resolution.with_numbers(scene, {key: found.number for key, found in wanted.items()})
    resolved = resolve(decided.map) if has_maps else None
    if resolved is not None:
        decisions |= _of_map(scene.map, resolved)
    decisions |= {key: Decision(number, why) for key, (number, _, why) in wanted.items()}
    return Plan(decided, resolved, decisions)


def _of_orders(scene: Scene) -> Iterator[tuple[str, Decision]]:
    """Yield what later orders of scattering are found with."""
    if orders.scatters_again(scene):
        points = orders.lattice_of(scene)
        yield "orders.points", Decision("{}x{}x{}".format(*points.size), points.why)
        lobes = orders.lobes(scene)
        if lobes[0].degree:
            yield "orders.directions", Decision(orders.DIRECTIONS, "of each order")
            straight = ", ".join(dict.fromkeys(f"{lobe.straight:.2g}" for lobe in lobes))
            yield (
                "orders.degree",
                Decision(lobes[0].degree, f"of the moments; {straight} of the light goes straight on"),
            )
        else:
            yield (
                "orders.directions",
                Decision(orders.DIRECTIONS, "of each order, turned from one to the next"),
            )


def _of_emission(scene: Scene) -> Iterator[tuple[str, Decision]]:
    """Yield how what media emit lights their surroundings."""
    if lights := scene.emission_lights:
        yield "emission.lights", Decision(len(lights), "clusters of what media emit, all of its energy")
        lattice, why = emission.lattice_of(scene)
        yield "emission.res", Decision(*emission.texels_of(scene))
        points = "every sample" if lattice is None else "{}x{}x{}".format(*lattice.size)
        yield "emission.points", Decision(points, why)


def _for_thin(scene: Scene) -> Iterator[tuple[str, Decision]]:
    """Yield what the best basis holds strands and polygons with, where it is left open.

    Between texels the optical depth is as good as the transmittance in smooth media only: halfway between
    clear and opaque, half of an optical depth of 16 is dark. α, and the fit of what is opaque, are the best
    of a few on three kinds of hair of opacity .8 to 1: at 1, the relative RMSE of pictures is .44, and .58
    with α and the fit of grids.
    """
    asked = scene.map
    thin = [body for body in scene.primitives if isinstance(body, ThinPrimitives)]
    if not thin or asked.basis not in ("auto", BEST) or asked.target != "auto":
        return
    sigma_t = [float(scene.medium_of(body).sigma_t.max()) for body in thin]
    yield (
        "target",
        Decision(
            "transmittance", "strands and polygons cover texels or do not: light is in between, not depth"
        ),
    )
    if asked.density_weighting == "auto":
        alpha = max(1.0, THIN_WEIGHTING / max(*sigma_t, 1e-30))
        why = f"{THIN_WEIGHTING:g} of an optical depth: one crossing takes much or all of the light"
        yield "density_weighting", Decision(alpha, why)
    depths = [float(np.median(body.densities)) * sigma for body, sigma in zip(thin, sigma_t, strict=True)]
    if asked.fit == "auto" and max(depths) >= OPAQUE_DEPTH:
        yield (
            "fit",
            Decision("l2", "one crossing takes all of the light: no ray has more to lose than another"),
        )


def with_lookup(scene: Scene) -> Scene:
    """Return the scene with what ``map.lookup = "auto"`` comes to, for the error that it asks for."""
    return _looked_up(scene)[0]


def _looked_up(scene: Scene) -> tuple[Scene, str]:
    """`with_lookup`, and why."""
    if scene.map.lookup != "auto":
        return scene, ""
    is_lattice, why = lattice.choice(scene)
    lookup = "lattice" if is_lattice else resolve(scene.map, res=1, steps=1).lookup
    return scene.replace(map=scene.map.replace(lookup=lookup)), why


def _placed(scene: Scene, file: SceneFile) -> Iterator[tuple[str, Decision]]:
    """Yield what the file leaves to its look, to `tfm_cl.scene.placement`, and to the picture."""
    if file.look.name != PLAIN:
        yield "look", Decision(*file.look)
    for number, settings, volume in grids(file, scene):
        if settings.density_scale == "auto":
            yield (
                f"volume.{number}density_scale",
                Decision(volume.density_scale, why_density(scene.medium_of(volume).typical_depth)),
            )
    yield from _chosen(scene)
    yield from of_camera(scene.camera, file)
    yield from _grounded(scene, file)
    if file.image.exposure == "auto":
        yield "image.exposure", Decision(None, WHY_AUTOMATIC)
    if file.light is None:
        light = scene.lights[0].to_dict()
        for key, why in PLACED.items():
            if key in light and key not in file.placed_light:
                yield f"light.{key}", Decision(light[key], why)


def of_camera(camera: Camera, file: SceneFile, note: str = "") -> Iterator[tuple[str, Decision]]:
    """Yield what a file leaves open of a camera; ``note``: what is to be said of each reason."""
    table = camera.to_dict()
    for key, why in OF_CAMERA.items():
        if key not in file.camera and "matrix" not in file.camera and table[key] is not None:
            yield f"camera.{key}", Decision(table[key], f"{why}{note}")


def _grounded(scene: Scene, file: SceneFile) -> Iterator[tuple[str, Decision]]:
    """Yield where a ground was placed."""
    for i, (asked, found) in enumerate(zip(file.solids, scene.solids, strict=True)):
        for key, why in GROUND.items() if isinstance(asked, GroundSolid) else ():
            if getattr(asked, key) == "auto":
                yield f"solid.{i}.{key}", Decision(getattr(found, key), why)


def _chosen(scene: Scene) -> Iterator[tuple[str, Decision]]:
    """Yield what was chosen for primitives whose file says too little."""
    for i, body in enumerate(scene.bodies):
        if isinstance(body, Primitives):
            for key, (value, why) in body.chosen.items():
                yield f"volume.{f'{i}.' if len(scene.bodies) > 1 else ''}{key}", Decision(value, why)


def _of_map(asked: MapSettings, resolved: ResolvedMap) -> dict[str, Decision]:
    """Return what a map's settings leave to its basis, and to the light's rays."""
    found = {}
    if asked.basis == "auto":
        found["map.basis"] = Decision(resolved.basis, "the most accurate at equal bytes")
    for key in OF_BASIS:
        if getattr(asked, key) == "auto":
            found[f"map.{key}"] = Decision(
                getattr(resolved, key), f"what basis {resolved.basis} is best with"
            )
    if asked.coeffs == "auto" and asked.max_error is None:
        room = f"the most that map.bytes = {asked.bytes_ or 0:g} has room for"
        found["map.coeffs"] = Decision(resolved.coeffs, room if asked.bytes_ else "the default")
    if asked.density_weighting == "auto" and resolved.target == "transmittance":
        why = "half the largest optical depth along the lights' rays, between 1 and 16"
        found["map.density_weighting"] = Decision(None, why)
    return found


def _to_measure(scene: Scene, *, has_maps: bool) -> Iterator[tuple[str, Decision]]:
    """Yield what ``max_error`` chooses."""
    why = f"the cheapest found that keeps map.max_error = {scene.map.max_error:g}"
    of_map = {"map.res": scene.map.res, "map.coeffs": scene.map.coeffs} if has_maps else {}
    of_light = {"map.steps": scene.map.steps} if scene.marched and scene.is_lit else {}
    for key, asked in (of_map | of_light | {"march.steps": scene.march.steps}).items():
        if asked == "auto":
            yield key, Decision(None, why)
