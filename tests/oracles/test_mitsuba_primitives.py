"""Points, strands and polygons against Mitsuba 3's spheres, curves and meshes.

Balls of constant density are spheres with a medium inside, and points of other profiles a fine grid; they are
judged as in `test_mitsuba`. Strands and polygons are black there. Mitsuba's strands are round: they have a
depth, ends and joints that ribbons lack. So they end out of sight, fog is behind them and not around them,
and where single pixels are compared they are straight, or the wedges of their bends are allowed for. Without
a medium nothing is left to chance: shadows on a plane are compared pixel by pixel.
"""

import logging

import numpy as np
import pytest
from oracles.mitsuba_agreement import (
    SYSTEMATIC,
    agreement,
    failures,
    image_of,
    mitsuba_batches,
    write_report,
)
from oracles.mitsuba_scene import MitsubaScene
from scenes import turned
from scipy.ndimage import gaussian_filter

import tfm_cl as tfm
from tfm_cl.scene.lights import SunLight
from tfm_cl.scene.solids import PlaneSolid

LOG = logging.getLogger(__name__)
STEPS = 400
OF_WHOLE_PIXELS, OF_A_GRID, SAMPLES = 8, 16, 64
"""Samples per pixel and batch; the first are of pictures of more pixels."""
OF_THE_MAPS = 3e-3
"""Part of the mean by which the maps below differ from the dual march: up to 2.6e-3."""
ALLOWED = {"dual": SYSTEMATIC, "tfm": SYSTEMATIC + OF_THE_MAPS}
"""Bias of the mean beyond noise, for each method. With some 200 samples balls, shafts and veils in fog differ
by up to 1.2e-3 ± 1.3e-3 in the dual march; 1600 × 1600 steps move that by less than 3e-4."""
WIDE = 3.0
"""A wrong scene is off by so many times what is allowed of a right one, noise included."""

both_methods = pytest.mark.parametrize("method", ALLOWED)
pytestmark = pytest.mark.slow

HG = tfm.Medium(sigma_s=(1.0, 0.8, 0.5), sigma_a=(0.1, 0.4, 0.8), phase=tfm.HenyeyGreenstein(0.5))
ISOTROPIC = tfm.Medium(sigma_s=(0.3, 0.7, 1.0), sigma_a=(0.5, 0.3, 0.1))
BLACK = tfm.Medium(sigma_s=0.0, sigma_a=1.0)

MAP = tfm.MapSettings(basis="dct", coeffs=32, res=256, steps=STEPS, density_weighting=10.0)
SHARP = MAP.replace(res=512, density_weighting=1.0)
"""For what is opaque. Between a dark texel and a lit one T is to be interpolated, which keeps the shadow's
size: T^(1/α), τ and σ widen it by about half a texel a side."""


def lights(at, to, cone=30, power=60.0):
    colour = np.array([1, 5 / 6, 2 / 3])
    spot = tfm.SpotLight(from_=at, to=to, cone=cone, intensity=power * colour, falloff="inverse-square")
    return {"spot": spot, "sun": SunLight(from_=at, to=to, intensity=3 * colour)}


def scene_of(bodies, light, method="dual", **changes):
    scene = tfm.Scene(
        bodies,
        camera=tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0, 0, 0), fov=26, res=(32, 24)),
        lights=[light],
        map=SHARP,
        march=tfm.MarchSettings(method=method, steps=STEPS),
    )
    return scene.replace(**changes)


@pytest.fixture(scope="module")
def mitsuba():
    with mitsuba_batches() as batches:
        yield batches


def exactly(scene, **options):
    """Mitsuba's picture of a scene in which nothing is left to chance."""
    return MitsubaScene(scene, **options).batches(1, 1, seed=1)[0]


def assert_agrees(image, expected, mitsuba, folder, method="dual", but=()):
    found = agreement(image, expected)
    wrong = set(failures(found, mitsuba.is_scalar, ALLOWED[method])) - set(but)
    assert not wrong, f"{wrong}: {write_report(folder, found, image, expected)}"


def assert_wrong(image, expected, mitsuba):
    """The mean of some channel is off by far."""
    found = agreement(image, expected)
    times_allowed = np.abs(found.bias) / (3 * found.standard_error + ALLOWED["dual"])
    assert times_allowed.max() > (1.0 if mitsuba.is_scalar else WIDE)


# --- points ------------------------------------------------------------------------------------------------


def apart(count, seed):
    """Middles and radii of balls that do not touch; wide enough not to be widened in the pictures."""
    rng, middles, radii = np.random.default_rng(seed), np.empty((0, 3)), np.empty(0)
    while len(radii) < count:
        radius = rng.uniform(0.22, 0.45)
        middle = rng.uniform(radius - 0.95, 0.95 - radius, 3)
        if (np.linalg.norm(middles - middle, axis=1) > radii + radius + 1e-3).all():
            middles, radii = np.vstack([middles, middle]), np.append(radii, radius)
    return middles, radii


MIDDLES, RADII = apart(12, 3)
DENSITIES = np.random.default_rng(4).uniform(0.8, 5, 12)
COLOURS = np.random.default_rng(6).uniform(0.2, 1.2, (12, 3))


def some_balls(numbers=slice(None), medium=ISOTROPIC, colours=None, scale=1.0):
    colour = None if colours is None else colours[numbers]
    densities = scale * DENSITIES[numbers]
    return tfm.Points(
        MIDDLES[numbers], RADII[numbers], densities, profile="ball", colour=colour, medium=medium
    )


EVEN, ODD = slice(0, None, 2), slice(1, None, 2)
BALLS = {
    "isotropic": (some_balls(),),
    "a colour each": (some_balls(medium=HG, colours=COLOURS),),
    "two media": (some_balls(EVEN, HG, COLOURS), some_balls(ODD)),
}
ABOVE = lights((2.2, 3.0, 1.2), (0, 0, 0), 16, 30.0)


def ball_scene(balls, light, method="dual"):
    return scene_of(BALLS[balls], ABOVE[light], method, map=MAP)


@both_methods
@pytest.mark.parametrize("light", ABOVE)
@pytest.mark.parametrize("balls", BALLS)
def test_balls(renderer, mitsuba, tmp_path, balls, light, method):
    """They shade each other."""
    expected = mitsuba(ball_scene, SAMPLES, balls, light)
    image = image_of(renderer, ball_scene(balls, light, method))
    assert_agrees(image, expected, mitsuba, tmp_path, method)


SPOILT = {
    "colours exchanged": (some_balls(EVEN, HG, COLOURS[::-1]), some_balls(ODD)),
    "media exchanged": (some_balls(EVEN, ISOTROPIC, COLOURS), some_balls(ODD, HG)),
    "one left out": (some_balls(slice(2, None, 2), HG, COLOURS), some_balls(ODD)),
    "some denser": (some_balls(EVEN, HG, COLOURS), some_balls(ODD, scale=1.5)),
}


@pytest.mark.parametrize("spoil", SPOILT)
@pytest.mark.parametrize("light", ABOVE)
def test_the_check_sees_wrong_balls(renderer, mitsuba, light, spoil):
    image = image_of(renderer, scene_of(SPOILT[spoil], ABOVE[light]))
    assert_wrong(image, mitsuba(ball_scene, SAMPLES, "two media", light), mitsuba)


@pytest.mark.parametrize("light", ABOVE)
def test_the_check_sees_balls_that_do_not_shade_each_other(renderer, mitsuba, light):
    alone = [scene_of((body,), ABOVE[light]) for body in BALLS["two media"]]
    image = sum(image_of(renderer, scene) for scene in alone)
    assert_wrong(image, mitsuba(ball_scene, SAMPLES, "two media", light), mitsuba)


def overlapping(profile):
    rng = np.random.default_rng(5)
    middles, radii = rng.uniform(-0.5, 0.5, (10, 3)), rng.uniform(0.3, 0.55, 10)
    densities = rng.uniform(1, 5, 10)
    colours = rng.uniform(0.3, 1.2, (10, 3))
    return (tfm.Points(middles, radii, densities, profile=profile, colour=colours, medium=HG),)


def overlapping_scene(profile, light, method="dual"):
    return scene_of(overlapping(profile), ABOVE[light], method, map=MAP)


@both_methods
@pytest.mark.parametrize(("profile", "light"), [("gaussian", "spot"), ("smooth", "sun")])
def test_overlapping_points(renderer, mitsuba, tmp_path, profile, light, method):
    """A grid of half as many voxels along each axis is brighter by 5e-3: its interpolation is too coarse."""
    expected = mitsuba(overlapping_scene, OF_A_GRID, profile, light)
    image = image_of(renderer, overlapping_scene(profile, light, method))
    # A Gaussian ends at 1 % of its height, which the grid's voxels smooth.
    but = {"lit_where_ours_is_black"} if profile == "gaussian" else ()
    assert_agrees(image, expected, mitsuba, tmp_path, method, but)


# --- strands -----------------------------------------------------------------------------------------------

COVERED = 1e-2
"""Of the area that thin strands cover: they are widened, and sampled at the middles of pixels or of texels.
Measured up to 2.3e-3 in pictures, and 6.7e-3 in maps."""
BLUR = 3
"""Pixels, of a Gaussian."""
BLURRED = 3.5e-2
"""Of the mean: root mean square difference of blurred pictures. Measured up to 2.1e-2 in pictures, and 2.9e-2
in maps; of this up to 1.0e-2 is noise."""
RIMS = 5e-4
"""Share of the pixels whose rays pass an edge so near that rounding decides, or that it is within a cone's
outline but not the ribbon's: that is wider by the square of the radius over the distance."""
RIMS_OF_THIN = 2.5e-3
"""Of strands whose width is some 1000 times what float32 places rays by. Measured up to 1.6e-3, in both
directions."""
WEDGES = 3e-3
"""Share of the pixels in wedges that are open between ribbons, and that the cones' round joints fill."""
SAME = 1e-5
"""Of a plane's brightness; measured 6e-6."""

PICTURE = tfm.Camera(from_=(0.2, 0.1, 6), to=(0.2, 0.1, 0), fov=20, res=(96, 72))
PIXEL = PICTURE.pixel_width * 6
PLANE = PlaneSolid(point=(0, 0, -1.5), normal=(0, 0, 1), albedo=(0.8, 0.5, 0.3))
BETWEEN = tfm.Camera(from_=(0, 0, -0.8), to=(0, 0, -1.5), fov=70, up=(0, 1, 0), res=(96, 72))
"""Sees the plane and not what is before it."""
BEHIND = lights((0.8, 0.6, 5), (0, 0, -1.5))


def strands(count, width, *, bent=True):
    """In all directions across the view, beyond the pictures' edges and those of their light."""
    rng, s, points = np.random.default_rng(1), np.linspace(-3.2, 3.2, 61 if bent else 5), []
    for _ in range(count):
        angle, height = rng.uniform(0, np.pi), bent * rng.uniform(0.05, 0.2)
        side = rng.uniform(-1.3, 1.3) + height * np.sin(1.5 * s + rng.uniform(0, 6))
        depth = rng.uniform(-0.5, 0.5) + bent * 0.2 * np.sin(s + rng.uniform(0, 6))
        x, y = np.cos(angle) * s - np.sin(angle) * side, np.sin(angle) * s + np.cos(angle) * side
        points.append(np.stack([x, y, depth], axis=1))
    return tfm.Curves(np.concatenate(points), [len(s)] * count, width, medium=BLACK)


def strand_scene(count, width, bent=True):
    return scene_of((strands(count, width, bent=bent),), BEHIND["sun"], camera=PICTURE, lights=[])


def blurred(image):
    """Mean of the channels, blurred, without its borders."""
    border = 3 * BLUR
    return gaussian_filter(image.mean(axis=-1), BLUR)[border:-border, border:-border]


def cover_errors(found, expected):
    """Errors of what is covered, against batches: of the mean, of the blurred picture; noise of the mean."""
    means, picture = expected.mean(axis=(1, 2, 3)), expected.mean(axis=0)
    level = means.mean()
    difference = blurred(found) - blurred(picture)
    noise = means.std(ddof=1) / np.sqrt(len(means)) / level
    errors = found.mean() / level - 1, np.sqrt((difference**2).mean()) / level, noise
    LOG.info("mean %.4f, error of it %.1e, of the blurred picture %.1e, noise %.1e", level, *errors)
    return errors


THIN = {"0.2 pixels": (120, 0.2 * PIXEL), "0.5 pixels": (60, 0.5 * PIXEL), "1.5 pixels": (25, 1.5 * PIXEL)}
"""Numbers and widths."""


@pytest.mark.parametrize("size", THIN)
def test_what_thin_strands_cover(renderer, mitsuba, size):
    expected = 1 - mitsuba(strand_scene, OF_WHOLE_PIXELS, *THIN[size], backlit=True, whole_pixels=True)
    result = renderer.render(strand_scene(*THIN[size]))
    of_mean, of_picture, noise = cover_errors(result.image[..., 3:].astype(np.float64), expected)
    assert expected.mean() > 0.2
    assert noise < COVERED / 5 or mitsuba.is_scalar
    assert abs(of_mean) < COVERED + 3 * noise
    assert of_picture < BLURRED


@pytest.mark.parametrize("spoil", ["wider", "moved"])
def test_the_check_sees_wrong_strands(renderer, mitsuba, spoil):
    count, width = THIN["0.5 pixels"]
    expected = 1 - mitsuba(strand_scene, OF_WHOLE_PIXELS, count, width, backlit=True, whole_pixels=True)
    if spoil == "wider":
        wrong = strand_scene(count, 1.05 * width)
    else:
        from_, to = np.add([PICTURE.from_, PICTURE.to], (PIXEL, 0, 0))
        wrong = strand_scene(count, width).replace(camera=PICTURE.replace(from_=from_, to=to))
    of_mean, of_picture, noise = cover_errors(renderer.render(wrong).image[..., 3:], expected)
    if spoil == "wider":
        assert of_mean > COVERED + 3 * noise
    else:
        assert of_picture > BLURRED


@pytest.mark.usefixtures("mitsuba")
@pytest.mark.parametrize("bent", [False, True], ids=["straight", "bent"])
def test_wide_strands_in_the_picture(renderer, bent):
    """Each pixel is covered or not; where strands bend, ribbons leave wedges open."""
    scene = strand_scene(8, 6 * PIXEL, bent)
    expected, result = 1 - exactly(scene, backlit=True)[..., 0], renderer.render(scene).image[..., 3]
    missing, too_much = expected - result > SAME, result - expected > SAME
    assert 0.2 < expected.mean() < 0.8
    assert too_much.mean() < RIMS
    assert missing.mean() < (WEDGES if bent else RIMS)


SHADOWS = {"0.3 pixels": (120, 0.004), "1.5 pixels": (50, 0.02), "7 pixels": (10, 0.1)}
"""Numbers and widths."""


def shadow_scene(count, width, light, method="dual"):
    bodies = (strands(count, width, bent=False),)
    return scene_of(bodies, BEHIND[light], method, camera=BETWEEN, solids=[PLANE])


def without_strands(renderer, light):
    return image_of(renderer, shadow_scene(1, 1e-9, light))


@pytest.mark.usefixtures("mitsuba")
@pytest.mark.parametrize("light", BEHIND)
@pytest.mark.parametrize("size", SHADOWS)
def test_shadows_of_strands(renderer, size, light):
    """Marched towards the light from every pixel: nothing is widened."""
    scene = shadow_scene(*SHADOWS[size], light)
    expected, image, clear = exactly(scene), image_of(renderer, scene), without_strands(renderer, light)
    assert 0.1 < 1 - expected.mean() / clear.mean() < 0.5
    wrong = ((np.abs(image - expected) / clear).max(axis=-1) > SAME).mean()
    assert wrong < (RIMS if size == "7 pixels" else RIMS_OF_THIN)


@pytest.mark.parametrize("light", BEHIND)
@pytest.mark.parametrize("size", SHADOWS)
def test_shadows_of_strands_in_a_map(renderer, mitsuba, size, light):
    clear = without_strands(renderer, light)
    expected = 1 - mitsuba(shadow_scene, OF_WHOLE_PIXELS, *SHADOWS[size], light, whole_pixels=True) / clear
    image = image_of(renderer, shadow_scene(*SHADOWS[size], light, "tfm"))
    of_mean, of_picture, noise = cover_errors(1 - image / clear, expected)
    assert noise < COVERED / 5 or mitsuba.is_scalar
    assert abs(of_mean) < COVERED + 3 * noise
    assert of_picture < BLURRED


FOG = tfm.BoxVolume(from_=(-0.8, -0.8, -0.9), to=(0.8, 0.8, 0.6), density=0.6, medium=HG)
FROM_THE_SIDE = tfm.Camera(from_=(0.5, -5, -0.2), to=(0, 0, -0.2), up=(0, 0, 1), fov=17, res=(32, 24))
"""Sees the fog below the strands."""


def shafts(light, method="dual", width=0.15):
    rng, s, points = np.random.default_rng(2), np.linspace(-1.9, 1.9, 5), []
    for _ in range(6):
        angle, side, height = rng.uniform(0, np.pi), rng.uniform(-1, 1), rng.uniform(1.0, 1.4)
        x, y = np.cos(angle) * s - np.sin(angle) * side, np.sin(angle) * s + np.cos(angle) * side
        points.append(np.stack([x, y, np.full(len(s), height)], axis=1))
    curves = tfm.Curves(np.concatenate(points), [len(s)] * 6, width, medium=BLACK)
    return scene_of((curves, FOG), BEHIND[light], method, camera=FROM_THE_SIDE)


@both_methods
@pytest.mark.parametrize("light", BEHIND)
def test_shafts_between_strands(renderer, mitsuba, tmp_path, light, method):
    expected = mitsuba(shafts, SAMPLES, light)
    assert_agrees(image_of(renderer, shafts(light, method)), expected, mitsuba, tmp_path, method)


@pytest.mark.parametrize("light", BEHIND)
def test_the_check_sees_wrong_shafts(renderer, mitsuba, light):
    assert_wrong(image_of(renderer, shafts(light, width=0.16)), mitsuba(shafts, SAMPLES, light), mitsuba)


# --- polygons ----------------------------------------------------------------------------------------------


def square(half, degrees, axis, middle):
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return corners @ turned(degrees, axis)[:3, :3].T + middle


VERTICES = np.concatenate(
    [
        square(0.7, 35, (1, 0.3, 0.5), (-0.2, 0.1, 0.2)),
        square(0.5, -40, (1, -0.4, 1), (0.3, -0.2, 0.6)),
        square(0.4, 60, (1, 0.1, 0), (-0.4, 0.5, -0.4)),
    ]
)
FACES = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * n for n in range(3)])
OPACITIES = np.array([0.5, 0.5, 0.25, 0.25, 0.8, 1.0])
"""Of the triangles, which lie before one another and across."""
ASLANT = lights((2.2, 1.5, 5), (0, 0, -0.8))
BEFORE = tfm.Camera(from_=(0.3, 0.2, 5), to=(0, 0, -0.6), fov=36, res=(32, 24))
BELOW = tfm.Camera(from_=(-0.4, -0.3, -0.75), to=(-0.4, -0.3, -1.5), up=(0, 1, 0), fov=125, res=(96, 72))
"""Sees the plane and not the veils."""
LEVELS = 5
"""Different transmittances in the veils' shadow, at least."""
IN_FOG = tfm.BoxVolume(from_=(-1.2, -1, -1), to=(1.1, 1.1, 1.0), density=0.35, medium=HG)


def veil_scene(light, method="dual", more=(), opacities=OPACITIES, **changes):
    veils = tfm.Polygons(VERTICES, FACES, opacities, medium=BLACK)
    return scene_of((veils, *more), ASLANT[light], method, **{"camera": BEFORE, **changes})


def before_a_plane(light, method="dual", camera=BEFORE, **changes):
    return veil_scene(light, method, camera=camera, solids=[PLANE], **changes)


def in_fog(light, method="dual", **changes):
    return veil_scene(light, method, (IN_FOG,), **changes)


def test_veils_let_light_through(renderer, mitsuba, tmp_path):
    expected = mitsuba(veil_scene, SAMPLES, "sun", backlit=True)
    result = renderer.render(veil_scene("sun"))
    let_through = result.aovs["transmittance"].astype(np.float64)
    assert_agrees(let_through, expected, mitsuba, tmp_path)
    np.testing.assert_allclose(result.image[..., 3], 1 - let_through.mean(axis=-1), atol=1e-6)


@both_methods
@pytest.mark.parametrize("light", ASLANT)
def test_a_plane_behind_veils(renderer, mitsuba, tmp_path, light, method):
    """Its light goes through them twice."""
    expected = mitsuba(before_a_plane, SAMPLES, light)
    assert_agrees(image_of(renderer, before_a_plane(light, method)), expected, mitsuba, tmp_path, method)


@pytest.mark.usefixtures("mitsuba")
@pytest.mark.parametrize("light", ASLANT)
def test_shadows_of_veils(renderer, light):
    scene = before_a_plane(light, camera=BELOW)
    expected, image = exactly(scene), image_of(renderer, scene)
    clear = image_of(renderer, before_a_plane(light, camera=BELOW, opacities=1e-9))
    assert len(np.unique((expected / clear)[..., 0].round(3))) > LEVELS
    assert ((np.abs(image - expected) / clear).max(axis=-1) > SAME).mean() < RIMS


@pytest.mark.usefixtures("mitsuba")
@pytest.mark.parametrize("light", ASLANT)
def test_shadows_of_veils_in_a_map(renderer, light):
    clear = image_of(renderer, before_a_plane(light, camera=BELOW, opacities=1e-9))
    expected = 1 - exactly(before_a_plane(light, camera=BELOW)) / clear
    found = 1 - image_of(renderer, before_a_plane(light, "tfm", camera=BELOW)) / clear
    of_mean, of_picture, _ = cover_errors(found, np.array([expected, expected]))
    assert abs(of_mean) < COVERED
    assert of_picture < BLURRED


@both_methods
@pytest.mark.parametrize("light", ASLANT)
def test_veils_in_fog(renderer, mitsuba, tmp_path, light, method):
    expected = mitsuba(in_fog, SAMPLES, light)
    assert_agrees(image_of(renderer, in_fog(light, method)), expected, mitsuba, tmp_path, method)


@pytest.mark.parametrize("make_scene", [before_a_plane, in_fog])
@pytest.mark.parametrize("light", ASLANT)
def test_the_check_sees_wrong_veils(renderer, mitsuba, light, make_scene):
    """Of which one lets more light through."""
    opacities = np.where(OPACITIES == 0.5, 0.2, OPACITIES)
    image = image_of(renderer, make_scene(light, opacities=opacities))
    assert_wrong(image, mitsuba(make_scene, SAMPLES, light), mitsuba)
