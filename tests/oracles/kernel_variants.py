"""Every program that is built from the kernels, in enough variants to meet each choice beside each other.

Headers and macros are those that the passes themselves ask for, of scenes, lights and settings that are
chosen here. A new kernel file is a line of ``PROGRAMS``, a new choice a line above it; bases and lights come
from their registries, phase functions from ``every_phase``, which a test compares with theirs.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from every_phase import ONE_OF_EACH_PHASE

import tfm_cl as tfm
from tfm_cl.constants import STORAGE_BITS
from tfm_cl.device.bricks import ANY_GRID, MOST_POOLS, VOXEL_BITS, BrickGrid, VoxelType, brick_count_of
from tfm_cl.device.media import MediaOnDevice, media_on_device
from tfm_cl.device.primitives import PrimitivesOnDevice
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.base import LOOKUPS
from tfm_cl.maps.light_pass import map_variant
from tfm_cl.maps.resolved import ResolvedMap, resolve
from tfm_cl.render import emission, lattice_points, orders, surroundings
from tfm_cl.render.batches import SINGLE_NUMBER, Batch, LightVariant
from tfm_cl.render.lattice import pass_variant, voxels_variant
from tfm_cl.render.scatter import scatter_variant
from tfm_cl.scene.bodies import MarchedBody
from tfm_cl.scene.lights import LIGHTS
from tfm_cl.scene.lights.charts import Hemisphere, Octahedron, Perspective
from tfm_cl.scene.settings import MapSettings

Choices = Mapping[str, Sequence[Any]]
Case = Mapping[str, Any]
Program = tuple[tuple[str, ...], dict[str, int | str]]
"""Headers and macros."""


# --- what is in space ------------------------------------------------------------------------------------

GREY = tfm.Medium(sigma_s=1.0, sigma_a=0.5)
WARM = tfm.Medium(sigma_s=(1.0, 0.7, 0.4), sigma_a=(0.1, 0.2, 0.5))
OCTAVES = {"attenuation": 0.6, "contribution": 0.5, "eccentricity": 0.7}  # as no plan decides on them
COLD = tfm.Medium(sigma_s=(0.2, 0.5, 1.1), octaves=2, **OCTAVES)
PHASED = [COLD.replace(phase=phase) for phase in ONE_OF_EACH_PHASE]
GLOWING = GREY.replace(emission=(1.0, 0.5, 0.1))
FLAME = tfm.Medium(sigma_s=0, sigma_a=0, emission=1.0)
VOXELS = np.ones((3, 4, 5), np.float32)


def _grid(medium: tfm.Medium | None = None, **changes: Any) -> tfm.Volume:
    return tfm.Volume(VOXELS, medium=medium, **changes)


def _coloured(medium: tfm.Medium | None = None) -> tfm.Volume:
    return _grid(medium, colour=np.ones((*VOXELS.shape, 3)))


def _box(medium: tfm.Medium | None = None) -> tfm.BoxVolume:
    return tfm.BoxVolume(density=0.5, medium=medium)


def _ball(medium: tfm.Medium | None = None) -> tfm.SphereVolume:
    return tfm.SphereVolume(density=0.5, medium=medium)


def _fire() -> tfm.Volume:
    """As of a file, with a grid of temperatures that has been read."""
    medium = GREY.replace(temperature="heat")
    volume = _grid(medium, source=Path("fire.npz"))
    flame = tfm.Volume.of_channels([VOXELS] * 3, world_from_index=np.eye(4))
    volume.kept["flame"] = (("heat", 0.0, 1.0), flame)
    return volume


def _fog(medium: tfm.Medium | None = None) -> tfm.EverywhereVolume:
    return tfm.EverywhereVolume(density=0.1, medium=medium)


def _points(medium: tfm.Medium | None = None, **changes: Any) -> tfm.Points:
    return tfm.Points(np.zeros((1, 3)), 1.0, medium=medium, **changes)


def _strands(medium: tfm.Medium | None = None) -> tfm.Curves:
    return tfm.Curves(np.eye(3), [3], 0.1, medium=medium)


def _leaves(medium: tfm.Medium | None = None) -> tfm.Polygons:
    return tfm.Polygons(np.eye(3), [[0, 1, 2]], 0.5, medium=medium)


BODIES: dict[str, list[Any]] = {
    "grid": [_grid()],
    "tinted grid": [_grid(WARM)],
    "3 grids": [_grid(), _grid(), _grid()],
    "2 tints": [_grid(WARM), _grid(COLD)],
    "coloured grid": [_coloured()],
    "grid in fog": [_grid(), _fog()],
    "coloured grid, box": [_coloured(), _box(WARM)],
    "box": [_box()],
    "ball": [_ball(WARM.replace(octaves=3, **OCTAVES))],
    "fog": [_fog()],
    "box, ball": [_box(), _ball()],
    "grid, box, ball": [_grid(), _box(), _ball()],
    "every phase": [_ball(medium) for medium in PHASED],
    "every kind": [
        _coloured(),
        _grid(WARM),
        *(_grid(medium) for medium in PHASED[:3]),
        *(_ball(medium) for medium in PHASED[3:]),
        _box(COLD),
        _ball(),
        _fog(),
    ],
    "glowing grid": [_grid(GLOWING)],
    "glowing ball": [_ball(GLOWING)],
    "fire": [_fire()],
    "coloured flame in a grid, fog": [_grid(), _coloured(FLAME), _fog(WARM)],
    "points": [_points()],
    "every primitive": [
        _coloured(),
        _points(colour=(1, 0.5, 0.2)),
        _strands(COLD.replace(phase=tfm.KajiyaKay())),
        _leaves(WARM),
        _fog(),
    ],
}
"""Mixtures, those of one body among them, since a scene of one body has kernels of its own."""
FIELDS_IN = {"tinted grid": 1, "fire": 1, "3 grids": 1, "coloured grid": 3, "every primitive": 3}
"""Of these are the light passes': they know of what is marched, and of one field of density."""


class NoDevice:
    """Takes what would be uploaded."""

    def upload(self, what: str, array: Any) -> None:
        """Forget it."""


@cache
def media_of(mixture: str, voxels: VoxelType, pools: int) -> MediaOnDevice:
    """What kernels are told of a mixture of `BODIES`."""
    camera = tfm.Camera(from_=(0, 0, 9), to=(0, 0, 0))
    scene = tfm.Scene(BODIES[mixture], GREY, camera, [])
    grids, bricks = (*scene.grids, *scene.flames), None
    if grids:
        bricks = BrickGrid(
            blocks=None,  # type: ignore[arg-type]
            table=None,  # type: ignore[arg-type]
            pools=(None,) * pools,  # type: ignore[arg-type]
            brick_counts=tuple(brick_count_of(grid.shape) for grid in grids),
            occupied=1,
            records=2,
            pool_size=2,
            voxels=voxels,
            exponents=tuple((0,) * len(grid.channel_leaves) for grid in grids),
        )
    primitives = PrimitivesOnDevice(NoDevice(), scene) if scene.primitives else None  # type: ignore[arg-type]
    return media_on_device(NoDevice(), scene, bricks, primitives)  # type: ignore[arg-type]


GRIDS: Choices = {"voxels": list(VOXEL_BITS), "pools": (1, MOST_POOLS)}

# --- lights, and their maps -------------------------------------------------------------------------------

LIGHT: Choices = {
    # A sun has none of its own, and takes no notice of one.
    "chart": [chart.HEADER for chart in (Perspective, Hemisphere, Octahedron)],
    "light": list(dict.fromkeys(light.HEADER for light in LIGHTS.values())),
    "inverse_square": (0, 1, 2),
}
EVERY_BASIS = {name: MapSettings(basis=name) for name in BASES} | {
    "dct 1": MapSettings(basis="dct", coeffs=1, target="optical-depth", fit="visibility"),
    "hcos 16": MapSettings(basis="hcos", coeffs=16, fit="visibility"),
    "klt 15": MapSettings(basis="klt", coeffs=15, target="transmittance", fit="l2"),
}
"""Every basis by itself, and the kinds of target and fit."""
EVALUATED = ("dct", "klt", "slices", "moments", "trig-moments", "nodes")
"""The kinds of evaluation; the light pass's program evaluates every basis."""
STORED: Choices = {"storage": list(STORAGE_BITS), "range": ("box", "visible"), "lookup": list(LOOKUPS)}


def settings_of(case: Case) -> ResolvedMap:
    """The map of a case."""
    settings = resolve(EVERY_BASIS[case["basis"]])
    return settings.replace(storage=case["storage"], range=case["range"], lookup=case["lookup"])


def light_headers(case: Case) -> tuple[str, ...]:
    """Chart and kind."""
    return case["chart"], case["light"]


# --- programs ---------------------------------------------------------------------------------------------


def _of_bricks(case: Case) -> Program:
    return (), {"TFM_VOXEL_BITS": VOXEL_BITS[case["voxels"]], **ANY_GRID}


def _of_probe(case: Case) -> Program:
    (field, *_) = media_of(case["grids"], case["voxels"], case["pools"]).of_fields
    macros = {"TFM_INVERSE_SQUARE": case["inverse_square"], "TFM_SHADOW": case["shadow"]}
    return (*field.headers, *light_headers(case)), field.defines | macros


def _of_light_pass(case: Case) -> Program:
    settings = settings_of(case)
    basis, of_map = map_variant(settings)
    (field, *_) = media_of(case["grids"], case["voxels"], case["pools"]).of_fields
    _, defines = _of_probe(case)
    if settings.is_linear and field.defines.get("TFM_PRIMITIVES"):
        defines["TFM_OWN_DEPTH"] = int(case["deposits"] == "depth")
    return (*field.headers, basis, *light_headers(case)), defines | of_map


def _of_primitives(case: Case) -> Program:
    primitives = media_of(case["bodies"], "f32", 1).primitives
    assert primitives is not None
    macros = {"TFM_INVERSE_SQUARE": case["inverse_square"], "TFM_FROM_LIGHT": case["from_light"]}
    of_light = light_headers(case) if case["from_light"] else ()
    return (*primitives.headers, *of_light), primitives.defines | macros


def _of_camera(case: Case) -> Program:
    media = media_of(case["bodies"], case["voxels"], case["pools"])
    macros = {"TFM_SHADOW": case["shadow"], "TFM_LIGHT_LAYERS": case["layers"]}
    macros["TFM_DEEP_COLOURS"] = case["colours of samples"]
    return media.headers, media.defines | media.channels(textured=False) | macros


def _of_deep(case: Case) -> Program:
    headers, defines = _of_camera({**case, "layers": 0})
    return headers, defines | {"TFM_DEEP": 1}


def _of_deep_own(case: Case) -> Program:
    headers, defines = _of_camera({**case, "layers": 0, "colours of samples": 1})
    return headers, defines | {"TFM_DEEP": 2}


def _of_scatter(case: Case) -> Program:
    headers, defines = scatter_variant(*_batch(case))
    macros = {"TFM_LIGHT_LAYERS": case["layers"], "TFM_DEEP_COLOURS": case["colours of samples"]}
    if case.get("around"):
        macros |= {"TFM_AROUND": 1, "TFM_ORDER_MEDIA": _scattering(case)}
    return headers, defines | macros


def _of_light_at(case: Case) -> Program:
    of_lights, media = _batch(case)
    return of_lights.variant(media)


def _of_surface(case: Case) -> Program:
    of_lights, media = _batch(case)
    headers, defines = of_lights.variant(media)
    return headers, defines | {"TFM_LIGHT_LAYERS": case["layers"]}


def _batch(case: Case) -> tuple[Batch, MediaOnDevice]:
    media = media_of(case["bodies"], case["voxels"], case["pools"])
    shows_residual, is_dual = case["basis"] == "residual", case["basis"] == "dual"
    settings = None
    if media.fields.count and not is_dual:
        settings = settings_of({**case, "basis": "dct"} if shows_residual else case)
        if shows_residual:
            settings = settings.replace(**SINGLE_NUMBER)
    falloff = (("TFM_INVERSE_SQUARE", case["inverse_square"]),)
    of_lights = Batch(
        of=LightVariant(light_headers(case), falloff, bool(case["texture"]), bool(case["shared"])),
        indices=[0],
        settings=settings,
        shadow_filter=case["shadow"],
        is_dual=is_dual,
        arguments={},
        blocks={},
        most_in_a_block=1,
        window=(0, 0, 1, 1),
        lit=None,  # type: ignore[arg-type]
        shows_residual=shows_residual and settings is not None,
    )
    return of_lights, media


def _of_lattice_voxels(case: Case) -> Program:
    of_lights, media = _batch({**case, "shadow": 0, "texture": 0})
    return voxels_variant(of_lights, media, _lattice_colours(case, media), case["apart"])


def _of_lattice_pass(case: Case) -> Program:
    media = media_of(case["bodies"], case["voxels"], case["pools"])
    headers, defines = pass_variant(media, _lattice_colours(case, media), case["apart"])
    macros = {"TFM_LIGHT_LAYERS": int(case["apart"] > 1), "TFM_DEEP_COLOURS": case["colours of samples"]}
    return headers, defines | macros


def _lattice_colours(case: Case, media: MediaOnDevice) -> int:
    return max(case["colours"], media.channels(textured=False)["TFM_CHANNELS"])


def _of_emission_lights(case: Case) -> Program:
    of_lights, media = _batch(case)
    return emission.lights_variant(of_lights.of, media, _scattering(case))


def _scattering(case: Case) -> int:
    return len({body.own_medium for body in BODIES[case["bodies"]]})


RGB = 3


def _of_points_lit(case: Case) -> Program:
    of_lights, media = _batch(case)
    return lattice_points.depths_variant(of_lights, media)


def _of_surroundings_view(case: Case) -> Program:
    of_lights, media = _batch(case)
    return lattice_points.view_variant(of_lights.of, media, _scattering(case))


def _of_surroundings_pass(case: Case) -> Program:
    media = media_of(case["bodies"], case["voxels"], case["pools"])
    headers, defines = surroundings.pass_variant(media, _scattering(case), has_solids=bool(case["shadow"]))
    macros = {"TFM_LIGHT_LAYERS": case["layers"], "TFM_DEEP_COLOURS": case["colours of samples"]}
    return headers, defines | macros


def _of_order_media(case: Case) -> Program:
    media = media_of(case["bodies"], case["voxels"], case["pools"])
    return orders.media_variant(media, *_of_points(case, media), emits=bool(case["emits"]))


def _of_points(case: Case, media: MediaOnDevice) -> tuple[int, int, int]:
    """Colours, degree, and media that are told apart."""
    mixed = _scattering(case)
    return _lattice_colours(case, media), case["degree"], mixed if mixed > 1 else 0


def _of_order_lights(case: Case) -> Program:
    of_lights, media = _batch(case)
    colours, degree, mixed = _of_points(case, media)
    has_walls = bool(case["shadow"])
    return orders.lights_variant(
        of_lights, media, RGB if has_walls else colours, degree, mixed, walls=has_walls
    )


def _of_order_sweep(case: Case) -> Program:
    colours = max(case["channels"], case["colours"])
    mixed = case["media"] if case["channels"] == RGB else 0
    if case["walls"]:
        colours = RGB
    return orders.sweep_variant(case["channels"], colours, case["degree"], mixed, walls=bool(case["walls"]))


def _of_order_moments(case: Case) -> Program:
    mixed = case["media"] if case["colours"] == RGB else 0
    return orders.moments_variant(case["colours"], case["degree"], mixed)


def _of_order_points(case: Case) -> Program:
    del case
    return orders.points_variant()


def _of_order_pass(case: Case) -> Program:
    media = media_of(case["bodies"], case["voxels"], case["pools"])
    has_solids = bool(case["shadow"])
    if "colours" not in case:
        headers, defines = emission.pass_variant(media, _scattering(case), has_solids=has_solids)
    else:
        colours, _, mixed = _of_points({"degree": 0} | case, media)
        headers, defines = orders.pass_variant(media, colours, mixed, has_solids=has_solids)
    return headers, defines | {"TFM_DEEP_COLOURS": case["colours of samples"]}


LIT: Choices = {**LIGHT, "shadow": (0, 1, 2), "texture": (0, 1), "shared": (0, 1)}
GRIDS_LIT: Choices = {
    "bodies": [
        name for name, bodies in BODIES.items() if any(isinstance(body, MarchedBody) for body in bodies)
    ],
    "basis": [*EVALUATED, "dual", "residual"],
    **GRIDS,
    **STORED,
    **LIT,
}
OTHERS_LIT: Choices = {
    "bodies": [name for name in BODIES if name not in GRIDS_LIT["bodies"]],
    "basis": ("dct", "dual", "residual"),  # there are no maps, whatever is asked for
    "voxels": ("f32",),
    "pools": (1,),
    **LIT,
}
DEPOSITS: Choices = {"deposits": ("steps", "depth")}
LATTICE: Choices = {
    "bodies": ("grid", "tinted grid", "3 grids", "coloured grid", "glowing grid"),
    **GRIDS,
    "colours": (1, 3),
}
APART: Choices = {"apart": (1, 3)}
ON_LATTICE: Choices = {**LATTICE, **APART, "basis": EVALUATED, **STORED, **LIGHT, "shared": (0,)}
ORDERS: Choices = {
    **LATTICE,
    "bodies": (
        *LATTICE["bodies"],
        *("box", "box, ball", "grid, box, ball", "2 tints", "grid in fog", "points", "every primitive"),
    ),
}
LAYERS: Choices = {"layers": (0, 1)}
DEEP: Choices = {"colours of samples": (0, 1)}
DEGREE: Choices = {"degree": (0, 2, 3, 4)}
ORDERS_LIT: Choices = {**ORDERS, **DEGREE, "basis": (*EVALUATED, "dual"), **STORED, **LIT, "shared": (0,)}
EMISSION: Choices = {
    "bodies": ("glowing grid", "glowing ball", "fire", "2 tints", "coloured grid, box", "every phase"),
    **GRIDS,
}
EMISSION_LIT: Choices = {
    **EMISSION,
    "basis": (*EVALUATED, "dual"),
    **STORED,
    **LIGHT,
    "shadow": (0, 1, 2),
    "texture": (0,),
    "shared": (0,),
}
SURROUNDED: Choices = {
    "bodies": ("grid", "tinted grid", "3 grids", "coloured grid", "grid, box, ball"),
    **GRIDS,
}
SURROUNDED_LIT: Choices = EMISSION_LIT | SURROUNDED | {"basis": EVALUATED}
WITH_SURROUNDINGS: Choices = SURROUNDED_LIT | {
    "bodies": [name for name in SURROUNDED["bodies"] if "box" not in name],
    "shared": (1,),
    "layers": (0, 1),
    **DEEP,
    "around": (1,),
}
AT_POINTS: Choices = {"shared": (0,), "basis": EVALUATED}
ON_SOLIDS: Choices = {"shared": (0,), "shadow": (1, 2)}
FIELD: Choices = {"grids": list(FIELDS_IN), **GRIDS, **LIGHT, "shadow": (0, 1)}

PRIMITIVES: Choices = {"bodies": ("points", "every primitive"), "from_light": (0, 1), **LIGHT}

PROGRAMS: dict[str, tuple[Callable[[Case], Program], list[Choices]]] = {
    "advect.cl": (lambda _: ((), {}), [{"grids": ("leaves",)}]),
    "bricks.cl": (_of_bricks, [{"voxels": GRIDS["voxels"]}]),
    "camera_pass.cl": (_of_camera, [{"bodies": list(BODIES), **GRIDS, "shadow": (0, 1), **LAYERS, **DEEP}]),
    "deep_own.cl": (_of_deep_own, [{**EMISSION, "shadow": (0, 1)}]),
    "deep_pass.cl": (_of_deep, [{"bodies": list(BODIES), **GRIDS, "shadow": (0, 1), **DEEP}]),
    "lattice_pass.cl": (_of_lattice_pass, [{**LATTICE, **APART, **DEEP}]),
    "emission_lights.cl": (_of_emission_lights, [EMISSION_LIT]),
    "light_at.cl": (_of_light_at, [GRIDS_LIT | AT_POINTS, OTHERS_LIT | AT_POINTS]),
    "light_lattice.cl": (_of_lattice_voxels, [ON_LATTICE]),
    "light_pass.cl": (_of_light_pass, [{"basis": list(EVERY_BASIS), **FIELD, **STORED, **DEPOSITS}]),
    "order_lights.cl": (_of_order_lights, [ORDERS_LIT]),
    "order_media.cl": (_of_order_media, [ORDERS | DEGREE | {"emits": (0, 1)}]),
    "order_moments.cl": (_of_order_moments, [{"colours": (1, 3), "degree": (2, 3, 4), "media": (0, 2)}]),
    "order_pass.cl": (
        _of_order_pass,
        [{**ORDERS, "shadow": (0, 1), **DEEP}, {**EMISSION, "shadow": (0, 1), **DEEP}],
    ),
    "order_points.cl": (_of_order_points, [{"colours": (1,)}]),
    "order_sweep.cl": (
        _of_order_sweep,
        [{"channels": (1, 3), "colours": (1, 3), "degree": (0, 4), "media": (0, 2), "walls": (0, 1)}],
    ),
    "prefilter.cl": (lambda case: ((), {"TFM_GROUP": case["group"]}), [{"group": (1, 8, 64)}]),
    "primitives.cl": (_of_primitives, [PRIMITIVES]),
    "probe.cl": (_of_probe, [FIELD]),
    "scatter_pass.cl": (
        _of_scatter,
        [GRIDS_LIT | LAYERS | DEEP, OTHERS_LIT | LAYERS | DEEP, WITH_SURROUNDINGS],
    ),
    "points.cl": (_of_points_lit, [SURROUNDED_LIT, EMISSION_LIT]),
    "surroundings_pass.cl": (_of_surroundings_pass, [{**SURROUNDED, "shadow": (0, 1), **LAYERS, **DEEP}]),
    "surroundings_view.cl": (_of_surroundings_view, [SURROUNDED_LIT]),
    "surface_pass.cl": (_of_surface, [GRIDS_LIT | ON_SOLIDS | LAYERS, OTHERS_LIT | ON_SOLIDS | LAYERS]),
}
"""Entry -> how it is compiled, and with what."""

Variant = tuple[str, str, tuple[str, ...], dict[str, int | str]]
"""A label, and the arguments of `tfm_cl.device.program.source`: entry, headers and defines."""


def kernel_variants(lanes: int, *, few: bool = False) -> Iterator[Variant]:
    """Yield the programs for devices that march so many rays a work-item (1 on GPUs).

    With ``few`` each choice is met, but not any two.
    """
    cases = singly if few else pairwise
    for entry, (program, tables) in PROGRAMS.items():
        for case in (case for choices in tables for case in cases(choices)):
            label = " ".join([entry, *(f"{name}={value}" for name, value in case.items())])
            headers, defines = program(case)
            yield label, entry, headers, {"TFM_LANES": lanes, **defines}


def singly(choices: Choices) -> list[dict[str, Any]]:
    """Choose one of each so that any choice is in some case."""
    most = max(len(values) for values in choices.values())
    return [{name: values[n % len(values)] for name, values in choices.items()} for n in range(most)]


def pairwise(choices: Choices) -> list[dict[str, Any]]:
    """Choose one of each so that any two choices meet in some case: far fewer cases than the product."""
    sizes = [len(values) for values in choices.values()]
    missing = {
        ((one, i), (other, j))
        for one, other in combinations(range(len(sizes)), 2)
        for i, j in product(range(sizes[one]), range(sizes[other]))
    }
    if len(sizes) == 1:
        return [{name: value} for name, values in choices.items() for value in values]
    cases = []
    while missing:
        case = dict(min(missing))  # a pair that is not met yet, then of each the choice that meets most
        for place in range(len(sizes)):
            if place not in case:
                met = [
                    sum(tuple(sorted([(place, i), chosen])) in missing for chosen in case.items())
                    for i in range(sizes[place])
                ]
                case[place] = met.index(max(met))
        missing -= set(combinations(sorted(case.items()), 2))
        cases.append({name: values[case[place]] for place, (name, values) in enumerate(choices.items())})
    return cases
