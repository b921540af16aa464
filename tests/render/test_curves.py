"""Strands in maps and pictures, against closed forms, the float64 reference and each other."""

from itertools import pairwise

import numpy as np
import pytest
from primitive_scenes import (
    BALLS,
    BLUE,
    BORDER,
    CAMERA,
    CORNERS,
    DEPTH_OF_ONE,
    FIBRES,
    FOG,
    GRID,
    HARDLY,
    LIGHT,
    LIGHT_KINDS,
    LIGHTS,
    SAMPLED,
    SIZES,
    SOLIDS,
    WHITE,
    assert_agrees_with_reference,
    assert_lanes_agree,
    assert_makes_numbers,
    assert_same,
    both_methods,
    colours,
    depth_in_picture,
    every_light,
    map_of,
    opaque_at_last,
    scene_of,
    solid_angles,
)
from tolerances import FAST_MATH, PASS

import tfm_cl as tfm

LEAST = 3.0
"""Width, in texels or pixels, below which a strand is widened."""

# --- one strand, in closed form ----------------------------------------------------------------------------

ENDS = np.array([[-0.411, -0.273, 0.1], [0.487, 0.231, -0.3]])
"""Of the strand."""
OPACITY = 0.6
ENDS_IN_PIXELS = 0.4
"""Pixels of its length by which the sum over pixels errs, since it ends at once."""


def alone(width, opacity=OPACITY):
    """One segment; with the corners."""
    corners = [CORNERS[0], CORNERS[0] + 0.1, CORNERS[1] - 0.1, CORNERS[1]]
    return tfm.Curves([*ENDS, *corners], [2, 2, 2], [width, 0.01, 0.01], opacity=[opacity, HARDLY, HARDLY])


def strand_along(rays, width, least):
    """Optical depth that the strand leaves along rays; how far it may be rounded, infinite at its edges."""
    origins, directions = rays
    along = ENDS[1] - ENDS[0]
    normal = np.cross(directions, along)
    square = (normal**2).sum(axis=1)
    away = origins - ENDS[0]
    u = -(np.cross(directions, normal) * away).sum(axis=1) / square
    apart = np.abs((away * normal).sum(axis=1)) / np.sqrt(square)
    reach = max(least, 15 / 8 * width) / 2 if width < least else width / 2

    def depth(b):
        covered = width / (2 * reach) * 15 / 8 * np.maximum(1 - b**2, 0) ** 2 if width < least else 1.0
        return np.where((b < 1) & (u >= 0) & (u < 1), opaque_at_last(OPACITY, covered), 0)

    b, moved = apart / reach, BORDER / reach
    rounded = DEPTH_OF_ONE + np.abs(depth(b - moved) - depth(b + moved))
    length = np.sqrt((along**2).sum())
    at_end = np.minimum(np.abs(u), np.abs(1 - u)) * length < BORDER / np.sqrt(square).min() * length
    return depth(b), np.where(at_end & (b < 1 + moved), np.inf, rounded)


@pytest.mark.lanes
def test_one_strand_in_the_picture(renderer):
    camera = tfm.Camera(from_=(0.3, 0.2, 9), to=(0, 0, 0), fov=20, res=(64, 48))
    least = LEAST * camera.pixel_width * np.linalg.norm(ENDS.mean(axis=0) - camera.from_)
    for size in SIZES:
        width = size * least / (10 if size > 10 else 1)
        depth, opacity = depth_in_picture(renderer, alone(width), camera)
        expected, rounded = strand_along(camera.rays(), width, least)
        assert expected.max() > 0.01
        assert (np.isinf(rounded)).mean() < 0.01
        assert (np.abs(depth - expected) <= rounded).all(), size
        assert (np.abs(opacity + np.expm1(-expected)) <= rounded).all(), size


@pytest.mark.lanes
@pytest.mark.quick("spot")
@every_light
def test_one_strand_in_a_map(renderer, light):
    fitted = LIGHTS[light].fitted(alone(0.01).bounds)
    wide = fitted.footprint(np.linalg.norm(fitted.frame().world_from_light[:3, 3] - ENDS.mean(axis=0)))
    for size in SIZES:
        res = 400 if size > 10 else 48  # so that the strand is within the corners
        least = LEAST * wide / res
        found = map_of(renderer, alone(size * least), LIGHTS[light], res)
        expected, rounded = strand_along(found.rays, size * least, LEAST * found.texel_at(ENDS.mean(axis=0)))
        expected = np.where(found.lit, expected, 0)
        assert expected.max() > 0.01
        assert (np.abs(found.depth - expected) <= rounded).all(), size


def seen_area(width, middle):
    """Solid angle of the strand as seen from a place."""
    ends = ENDS[0] + (np.arange(1000)[:, None] + 0.5) / 1000 * (ENDS[1] - ENDS[0])
    along = ENDS[1] - ENDS[0]
    away = ends - middle
    distance = np.linalg.norm(away, axis=1)
    return (width * np.linalg.norm(np.cross(away, along), axis=1) / distance**3).mean()


@pytest.mark.parametrize("opacity", [0.2, 1.0])
def test_what_a_thin_strand_hides_does_not_depend_on_the_resolution(renderer, opacity):
    """Its area times its opacity, though it is 1/50 to 2 pixels wide."""
    width = 0.005
    for res in (12, 48, 160, 1200):
        camera = tfm.Camera(from_=(0.3, 0.2, 9), to=(0, 0, 0), fov=20, res=(res, res))
        _, found = depth_in_picture(renderer, alone(width, opacity), camera)
        hidden = (found * solid_angles(camera)).sum()
        expected = opacity * seen_area(width, camera.from_)
        assert hidden == pytest.approx(expected, rel=SAMPLED + ENDS_IN_PIXELS / (res / 3)), res


@pytest.mark.slow
@every_light
def test_what_a_thin_strand_hides_of_a_light_does_not_depend_on_the_resolution(renderer, light):
    width = 0.01
    for res in (32, 64, 256):
        found = map_of(renderer, alone(width), LIGHTS[light], res)
        if light == "sun":
            travel = found.rays.directions[0]
            expected = width * np.linalg.norm(np.cross(travel, ENDS[1] - ENDS[0]))
        else:
            expected = seen_area(width, LIGHTS[light].from_)
        assert found.covered == pytest.approx(OPACITY * expected, rel=SAMPLED + ENDS_IN_PIXELS / (res / 3)), (
            res
        )


@pytest.mark.parametrize(("count", "opacity"), [(300, 1.0), (3000, 0.3), (6000, 1.0)])
def test_many_thin_strands_hide_what_they_do_at_random(renderer, rng, count, opacity):
    """1 - exp(-their area): at most all, whatever the resolution."""
    width, half = 0.002, 1.0
    middles, angles = rng.uniform(-2, 2, (count, 2)), rng.uniform(0, np.pi, count)
    along = 0.4 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = np.stack([middles - along, middles + along], axis=1)
    points = np.concatenate([ends, rng.uniform(-0.1, 0.1, (count, 1, 1)).repeat(2, axis=1)], axis=2)
    strands = tfm.Curves(points.reshape(-1, 3), [2] * count, width, opacity=opacity)
    expected = -np.expm1(-count * width * 0.8 * opacity / 16)
    found = []
    for res in (16, 60, 200):
        camera = tfm.Camera(
            from_=(0, 0, 100), to=(0, 0, 0), fov=2 * np.degrees(np.arctan(half / 100)), res=(res, res)
        )
        found.append(depth_in_picture(renderer, strands, camera)[1].mean())
    # The sample of strands in view, of all alike; and all resolutions of the same ones.
    assert found[-1] == pytest.approx(expected, rel=4 / np.sqrt(count))
    np.testing.assert_allclose(found, found[-1], rtol=0.02)


# --- polylines ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("width", [0.002, 0.15], ids=["thin", "wide"])
def test_a_straight_strand_of_many_segments_is_as_one(renderer, width):
    camera = tfm.Camera(from_=(0.3, 0.2, 9), to=(0, 0, 0), fov=8, res=(121, 97))
    part = np.linspace(0, 1, 14)[:, None]
    many = tfm.Curves((1 - part) * ENDS[0] + part * ENDS[1], [14], width, opacity=OPACITY)
    one = tfm.Curves(ENDS, [2], width, opacity=OPACITY)
    (depth, _), (expected, _) = (depth_in_picture(renderer, body, camera) for body in (many, one))
    assert (expected > 0).sum() > 100
    # What is widened is so by the distance of each segment's middle.
    np.testing.assert_allclose(depth, expected, atol=0.05 * expected.max() if width < 0.1 else DEPTH_OF_ONE)
    assert depth.sum() == pytest.approx(expected.sum(), rel=1e-3)


def test_a_bent_strand_has_neither_gaps_nor_double_cover_beyond_its_wedges(renderer):
    camera = tfm.Camera(from_=(0, 0, 9), to=(0, 0, 0), fov=10, res=(200, 200))
    corners = np.array([[-0.6, -0.3, 0], [-0.2, 0.1, 0], [0.3, 0.0, 0], [0.7, 0.4, 0]])
    width = 0.1
    depth, _ = depth_in_picture(renderer, tfm.Curves(corners, [4], width, opacity=OPACITY), camera)
    origins, directions = camera.rays()
    places = origins - origins[:, 2:] / directions[:, 2:] * directions
    nearest = np.full(len(places), np.inf)
    for a, b in pairwise(corners):
        u = np.clip((places - a) @ (b - a) / ((b - a) ** 2).sum(), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(places - a - u[:, None] * (b - a), axis=1))
    to_corner = np.linalg.norm(places[:, None] - corners, axis=2).min(axis=1)
    away = to_corner > width / 2 * 1.2  # a wedge of half the bend, 28 degrees, ends at 1 / cos of it
    crossings = np.round(depth / -np.log1p(-OPACITY))
    np.testing.assert_allclose(depth, crossings * -np.log1p(-OPACITY), atol=DEPTH_OF_ONE)
    # By its perspective a ribbon that faces the ray is a little narrower than the plane's.
    inside, outside = nearest < 0.49 * width, nearest > 0.51 * width
    assert (crossings[away & inside] == 1).all()
    assert (crossings[away & outside] == 0).all()
    assert (away & inside).sum() > 1000
    assert set(crossings[~away].tolist()) == {0, 1, 2}


# --- highlights --------------------------------------------------------------------------------------------

SHINY = tfm.KajiyaKay(specular=0.7, exponent=40)
RADIUS, BEGIN, END = 0.6, -20.0, 200.0
"""Of an arc around the origin, degrees from x to y."""
STEEPEST = np.exp(-0.5) * np.sqrt(SHINY.exponent)
"""Of a highlight's height, per radian: cosᵖ(x) is about exp(-p x²/2), whose flank is steepest at p x² = 1."""


def arc(count, width):
    angles = np.radians(np.linspace(BEGIN, END, count + 1))
    points = RADIUS * np.stack([np.cos(angles), np.sin(angles), np.zeros(count + 1)], axis=1)
    medium = tfm.Medium(sigma_s=1.0, phase=SHINY)
    return tfm.Curves(points, [count + 1], width, opacity=0.9, medium=medium)


@pytest.mark.slow
@pytest.mark.lanes
@pytest.mark.parametrize("count", [8, 16, 64])
def test_an_arc_of_few_segments_shines_as_a_circle_does(renderer, count):
    """But for its first and last segment, whose ends have no neighbours.

    Where the axis is crossed the tangent is that of the circle. Beside it, at b of the circle's radius, its
    angle errs by b times that from the segment's middle. Were it the segment's, it would err by all of that:
    some 45 times as much.
    """
    camera = tfm.Camera(from_=(0, 0, 9), to=(0, 0, 0), fov=9, res=(160, 160))
    travel = np.array([0.8, 0.3, -0.5]) / np.linalg.norm([0.8, 0.3, -0.5])
    sun = tfm.SunLight(from_=tuple(-travel), to=(0, 0, 0))
    march = tfm.MarchSettings(steps=40)
    scene = tfm.Scene(arc(count, 0.004), WHITE, camera, [sun], march=march)
    image = renderer.render(scene, method="dual").image.reshape(-1, 4).astype(float)
    origins, directions = camera.rays()
    places = origins - origins[:, 2:] / directions[:, 2:] * directions
    angles = np.degrees(np.arctan2(places[:, 1], places[:, 0]))
    angles = np.where(angles < BEGIN - 5, angles + 360, angles)
    step = (END - BEGIN) / count
    shown = (image[:, 3] > 0.02) & (angles > BEGIN + step) & (angles < END - step)
    assert shown.sum() > 400
    tangents = np.stack([-places[:, 1], places[:, 0], np.zeros(len(places))], axis=1)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    expected = SHINY.evaluate_strand(tangents, travel, -directions)[shown]
    found = image[shown, 0] / image[shown, 3]
    highest = expected.max()
    assert highest > 3 * expected.min()
    beside = LEAST / 2 * camera.pixel_width * 9 / RADIUS
    assert np.abs(found - expected).max() < STEEPEST * beside * np.radians(step / 2) * highest


@pytest.mark.slow
def test_a_straight_strand_of_many_segments_shines_as_one(renderer):
    part = np.sort(np.random.default_rng(3).uniform(0, 1, 14))[:, None]
    points = np.concatenate([ENDS[:1], (1 - part) * ENDS[0] + part * ENDS[1], ENDS[1:]])
    many, one = (tfm.Curves(ends, [len(ends)], 0.15, opacity=OPACITY) for ends in (points, ENDS))
    found, expected = (
        renderer.render(scene_of(body, medium=FIBRES), method="dual").image for body in (many, one)
    )
    assert expected[..., :3].max() > 0.3
    np.testing.assert_allclose(found, expected, atol=PASS * expected.max())


@pytest.mark.slow
def test_a_bent_strand_shines_as_the_reference_says(renderer):
    points = [[-0.6, -0.3, 0.1], [-0.3, 0.4, 0.2], [0.2, 0.3, -0.1], [0.3, -0.4, 0.0], [0.8, -0.2, 0.3]]
    strand = tfm.Curves(points, [5], 0.3, opacity=0.7, medium=FIBRES)
    assert_agrees_with_reference(renderer, scene_of(strand), "dual")


# --- against the float64 reference -------------------------------------------------------------------------


def tuft(seed=1, strands=7, opacity=0.6, width=(0.2, 0.28), **changes):
    """Wider than what is widened in the scenes below: as the reference has them."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, 0.05, (strands, 9, 3)) + rng.normal(0, 0.09, (strands, 1, 3))
    points = rng.uniform(-0.6, 0.6, (strands, 1, 3)) + np.cumsum(steps, axis=1)
    widths = rng.uniform(*width, strands)
    return tfm.Curves(points.reshape(-1, 3), [9] * strands, widths, opacity=opacity, **changes)


TUFT = tuft()
MIXTURES = {
    "alone": (TUFT,),
    "fibres": (TUFT.with_medium(FIBRES),),
    "opaque": (tuft(opacity=1.0),),
    "coloured": (tuft(colour=colours(7)),),
    "two bodies of their own media": (tuft(medium=FIBRES), tuft(4, medium=BLUE)),
    "with a grid": (GRID, TUFT.with_medium(FIBRES)),
    "with points": (BALLS, TUFT.with_medium(FIBRES)),
    "all kinds": (GRID, BALLS.with_medium(BLUE), tuft(medium=FIBRES, colour=colours(7)), FOG),
}


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("mixture", MIXTURES)
def test_mixtures(renderer, mixture, method):
    assert_agrees_with_reference(renderer, scene_of(*MIXTURES[mixture]), method)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("light", LIGHT_KINDS)
def test_every_kind_of_light(renderer, light, method):
    scene = scene_of(TUFT.with_medium(FIBRES), lights=[LIGHT_KINDS[light]])
    assert_agrees_with_reference(renderer, scene, method)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("bodies", [(TUFT,), (TUFT, GRID, BALLS)], ids=["strands", "with a grid and points"])
def test_strands_around_an_opaque_ball(renderer, bodies, method):
    assert_agrees_with_reference(renderer, scene_of(*bodies, **SOLIDS), method)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize(
    "march", [{"sampling": "world"}, {"attenuation": "paper"}, {"steps": 300}, {"skip_empty": False}], ids=str
)
def test_settings_of_the_march(renderer, march, method):
    settings = tfm.MarchSettings(**{"steps": 30, "cutoff": 0.0, **march})
    assert_agrees_with_reference(renderer, scene_of(TUFT, march=settings), method)


# --- against each other ------------------------------------------------------------------------------------

ROUNDED = 50 * FAST_MATH
"""Of the brightest: sums of hundreds of strands in another order."""


def many(count=200, **changes):
    """Most of them widened."""
    return tuft(3, count, opacity=0.4, width=(0.001, 0.05), **changes)


def some(curves, numbers):
    """Strands by their numbers."""
    points = np.concatenate([curves.corners[:, 0].reshape(-1, 8, 3), curves.corners[7::8, 1:]], axis=1)
    widths = curves.widths[::8, 0]
    colour = None if curves.colour is None else curves.colour[::8][numbers]
    count = len(numbers)
    return tfm.Curves(
        points[numbers].reshape(-1, 3), [9] * count, widths[numbers], opacity=0.4, colour=colour
    )


@pytest.mark.slow
@both_methods
def test_order_and_splitting_change_nothing(renderer, method):
    strands = many(medium=None, colour=colours(200))
    mixed = np.random.default_rng(8).permutation(200)
    expected = renderer.render(scene_of(strands, medium=FIBRES), method=method)
    for bodies in ((some(strands, mixed),), (some(strands, mixed[:70]), some(strands, mixed[70:]))):
        found = renderer.render(scene_of(*bodies, medium=FIBRES), method=method)
        assert_same(found, expected, ROUNDED)


@pytest.mark.slow
@pytest.mark.parametrize("steps", [127, 129, 257])
def test_what_a_ray_gathers_does_not_depend_on_its_steps(renderer, steps):
    expected = renderer.render(scene_of(many(), lights=[])).aovs["transmittance"]
    march = tfm.MarchSettings(steps=steps, cutoff=0.0)
    found = renderer.render(scene_of(many(), lights=[], march=march)).aovs["transmittance"]
    np.testing.assert_allclose(found, expected, atol=steps * FAST_MATH)


EXTREMES = {
    "of no width": {"width": 0.0},
    "tiny": {"width": 1e-30},
    "huge": {"width": 1e6},
    "of the largest density": {"density": 1e25},
    "of no density": {"density": 0.0},
}


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("extreme", EXTREMES)
def test_extreme_strands_make_numbers(renderer, extreme, method):
    points = [[-0.5, 0, 0], [0.5, 0.2, 0.1], [0.1, 0.1, 0.1], [0.1, 0.1, 0.1]]
    strands = tfm.Curves(points, [2, 2], **{"width": 0.2, **EXTREMES[extreme]}, medium=FIBRES)
    result = renderer.render(scene_of(strands), method=method)
    assert_makes_numbers(result)


def test_all_strands_behind_the_camera(renderer):
    result = renderer.render(scene_of(TUFT, camera=CAMERA.replace(to=(0.6, 0.8, 9)), lights=[]))
    assert (result.image == 0).all()
    assert (result.aovs["transmittance"] == 1).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bodies", "method"),
    [((many(medium=FIBRES),), "dual"), ((many(), GRID, FOG), "tfm")],
    ids=["fibres", "mixed"],
)
def test_lanes_agree(new_renderer, device_name, bodies, method):
    scene = scene_of(*bodies, camera=CAMERA.replace(res=(45, 31)), lights=[LIGHT])
    assert_lanes_agree(new_renderer, device_name, scene, method)


UNSHADED = 0.98
"""Of the light: what arrives where nothing is in its way, on the mean."""


@pytest.mark.slow
@pytest.mark.parametrize("res", [48, 512])
@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_strands_of_one_layer_do_not_shade_themselves(renderer, tilt, res):
    """Seen from where the light is, nothing is in its way, with texels wider and narrower than strands."""
    count, width = 40, 0.02
    x = np.linspace(-0.5, 0.5, count)
    points = [(at, side, tilt * side) for at in x for side in (-0.5, 0.5)]
    curtain = tfm.Curves(points, [2] * count, width, opacity=0.9)
    scene = tfm.Scene(
        curtain,
        tfm.Medium(sigma_s=1.0),
        tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), fov=10, res=(60, 60)),
        [tfm.SpotLight(from_=(0.1, 0.1, 4), to=(0, 0, 0), cone=12)],
        map=tfm.MapSettings(res=res, steps=60),
        march=tfm.MarchSettings(steps=40),
    )
    for method in ("tfm", "dual"):
        result = renderer.render(scene, method=method)
        shown = result.image[..., 3] > 0.1
        assert shown.mean() > 0.3
        arrives = result.aovs["light_transmittance"][shown]
        assert arrives.mean() > UNSHADED, method
