"""Points: particles in maps and pictures, against closed forms, the float64 reference and each other."""

import numpy as np
import primitive_scenes
import pytest
from primitive_scenes import (
    BLUE,
    BROWN,
    CORNERS,
    GRID,
    LIGHT,
    LIGHTS,
    SAMPLED,
    SCENE,
    WHITE,
    assert_lanes_agree,
    assert_makes_numbers,
    assert_same,
    both_methods,
    colours,
    every_light,
    map_of,
)
from scenes import blobs
from scipy.integrate import quad
from tolerances import FAST_MATH, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import DeviceMemoryError, SceneError
from tfm_cl.reference.primitives import meet
from tfm_cl.scene.lights import PointLight, SpotLight, SunLight
from tfm_cl.scene.settings import ShadowSettings
from tfm_cl.scene.solids import PlaneSolid, SphereSolid

MAP_PASS = 20 * PASS
"""Of the brightest, with a map: the power α amplifies its rounding, as in the view pass's own tests."""
DEPTH_OF_ONE = 5e-6
"""Optical depth of one point near 0.5, at a distance of some units that is rounded to 2e-7 of them."""
BESIDE = 4e-6
"""x = 1 - b²/r² of rays that pass a point's middle at b: by how much the direction of rays rounds that."""
WIDEST = 2.0
"""Radius, in texels or pixels, below which a point is widened."""

HAZE = tfm.Medium(sigma_s=(1.0, 0.9, 0.8), sigma_a=0.05, phase=tfm.HenyeyGreenstein(0.5))
FOG = tfm.EverywhereVolume(density=0.12, medium=HAZE)
CAMERA = SCENE.camera
PROFILES = ["ball", "gaussian", "smooth"]

every_profile = pytest.mark.parametrize("profile", PROFILES)


# --- one point, in closed form -----------------------------------------------------------------------------

THROUGH = {
    "ball": lambda x: 2 * np.sqrt(x),
    "gaussian": lambda x: np.exp(-4.5 * (1 - x)) * _gauss(np.sqrt(x)),
    "smooth": lambda x: 32 / 35 * x**3.5,
}
"""By profile, of radius and density 1: the integral along a line that passes the middle at sqrt(1 - x)."""
MASS = {
    "ball": 4 * np.pi / 3,
    "gaussian": 4 * np.pi * quad(lambda r: r**2 * np.exp(-4.5 * r**2), 0, 1)[0],
    "smooth": 64 * np.pi / 315,
}
"""Of a point of radius and density 1."""
SIZES = [1 / 50, 0.4, 1.9, 2.1, 8, 50]
"""Radius in texels or pixels."""
ASIDE = np.array([0.213, 0.121, -0.3])
"""Where the point is."""


def _gauss(s):
    """∫ e^(-9t²/2) dt from -s to s, by quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    return s * (weights * np.exp(-4.5 * (s[..., None] * nodes) ** 2)).sum(axis=-1)


def alone(profile, radius, density):
    """One point; with the corners."""
    positions = np.concatenate([[ASIDE], CORNERS])
    return tfm.Points(positions, [radius, 0.1, 0.1], [density, 1e-9, 1e-9], profile=profile)


def depth_of(profile, radius, density, rays, width):
    """Optical depth of the point along whole rays, so wide where it is; and how far it may be rounded."""
    if radius < WIDEST * width:
        density *= MASS[profile] * radius**3 / (MASS["smooth"] * (WIDEST * width) ** 3)
        profile, radius = "smooth", WIDEST * width
    away = ASIDE - rays[0]
    beside = away - (away * rays[1]).sum(axis=-1, keepdims=True) * rays[1]
    x = 1 - (beside**2).sum(axis=-1) / radius**2
    depth, more = (
        np.where(at > 0, radius * density * THROUGH[profile](np.maximum(at, 0)), 0) for at in (x, x + BESIDE)
    )
    return depth, DEPTH_OF_ONE + more - depth


def bright_enough(size):
    """A factor for the density of a point that is so small: so that it is seen when it is widened."""
    return max(1, (0.4 / size) ** 2)


@pytest.mark.lanes
@every_profile
def test_one_point_in_the_picture(renderer, profile):
    camera = tfm.Camera(from_=(0.3, 0.2, 9), to=(0, 0, 0), fov=20, res=(64, 48))
    width = camera.pixel_width * np.linalg.norm(ASIDE - camera.from_)
    rays = [values.reshape(48, 64, 3) for values in camera.rays()]
    for size in SIZES:
        radius = size * width
        density = 0.5 / radius * bright_enough(size)
        points = tfm.Points([ASIDE], radius, density, profile=profile)  # with nothing else in its bounds
        scene = tfm.Scene(points, WHITE, camera, (), march=tfm.MarchSettings(steps=40))
        result = renderer.render(scene)
        expected, rounded = depth_of(profile, radius, density, rays, width)
        assert expected.max() > 0.01
        depth = -np.log(result.aovs["transmittance"].astype(float))
        assert (np.abs(depth - expected[..., None]) <= rounded[..., None]).all(), size
        assert (np.abs(result.image[..., 3] + np.expm1(-expected)) <= rounded).all(), size


@pytest.mark.lanes
@pytest.mark.quick("spot")
@every_light
def test_one_point_in_a_map(renderer, light):
    fitted = LIGHTS[light].fitted(np.array([CORNERS[0] - 0.1, CORNERS[1] + 0.1]))
    wide = fitted.footprint(np.linalg.norm(fitted.frame().world_from_light[:3, 3] - ASIDE))
    for profile in PROFILES:
        for size in SIZES:
            res = 200 if size > 10 else 48  # so that the point is within the corners
            width = wide / res
            radius = size * width
            density = 0.5 / radius * bright_enough(size)
            found = map_of(renderer, alone(profile, radius, density), LIGHTS[light], res)
            expected, rounded = depth_of(profile, radius, density, found.rays, found.texel_at(ASIDE))
            expected = np.where(found.lit, expected, 0)
            assert expected.max() > 0.005
            assert (np.abs(found.depth - expected) <= rounded).all(), (profile, size)


@pytest.mark.slow
@every_light
def test_the_mean_optical_depth_of_a_map_does_not_depend_on_its_resolution(renderer, light):
    """∫ τ over the light's area is what the point holds; over directions, that over its distance squared."""
    for profile in PROFILES:
        radius, density = 0.05, 2.0
        held = MASS[profile] * radius**3 * density
        if light != "sun":
            held /= ((ASIDE - LIGHTS[light].from_) ** 2).sum()
        for res in (24, 64, 256):  # a radius of 0.4 to 5 texels
            found = map_of(renderer, alone(profile, radius, density), LIGHTS[light], res)
            # The border of a ball is sharp: more of it lies between the texels' middles.
            tolerance = 3 * SAMPLED if profile == "ball" else SAMPLED
            assert (found.depth * found.areas).sum() == pytest.approx(held, rel=tolerance), (profile, res)


@pytest.mark.lanes
def test_a_point_of_two_texels_or_less_is_as_dark_from_everywhere(renderer):
    """Moving by parts of a pixel changes what a pixel shows, not what they show together."""
    camera = tfm.Camera(from_=(0, 0, 10), to=(0, 0, 0), fov=10, res=(32, 32))
    width, sums = camera.pixel_width * 10, []
    for shift in np.linspace(0, 1, 5):
        points = tfm.Points([[shift * width, 0.7 * shift * width, 0]], width / 5, 3 / width)
        result = renderer.render(tfm.Scene(points, WHITE, camera, ()))
        sums.append(-np.log(result.aovs["transmittance"][..., 0].astype(float)).sum())
    expected = MASS["smooth"] / 125 * 3  # in pixels
    np.testing.assert_allclose(sums, expected, rtol=SAMPLED)


AMONG = {
    "spot": SpotLight(from_=(3, 5, 2), to=(0, 0, 0), cone=20),
    "wide spot": SpotLight(from_=(0.1, 0.2, 4), to=(0, 0, -1), cone=70),
    "wide spot inside": SpotLight(from_=(0.1, 0.2, 0.3), to=(0, 0, -1), cone=80),
    "sun": SunLight(from_=(1, 2, 0.4), to=(0, 0, 0)),
    "point light": PointLight(from_=(0.1, 0.2, 3.0)),
    "point light inside": PointLight(from_=(0.1, 0.2, 0.3)),
    "point light at the border": PointLight(from_=(2.1, 0.2, 0.3)),
}


def scattered_points(rng, middle, width_at):
    """Many, none of which is widened: rays are so wide at a distance from the middle."""
    positions = rng.uniform(-2, 2, (300, 3))
    distances = np.linalg.norm(positions - middle, axis=1)
    radii = 3 * np.array([width_at(distance) for distance in distances]) * rng.uniform(1, 1.5, 300)
    few = radii < 1
    assert few.sum() > 50
    return tfm.Points(positions[few], radii[few], 0.2 / radii[few], profile="ball")


def assert_gathers_all(found, points, rays):
    """Float32 finds of each ray what it crosses: no list of any bin of rays lacks a point."""
    exact = np.concatenate(
        [
            meet(points, part).between(np.zeros(len(part.origins)), np.full(len(part.origins), 100.0))[:, 0]
            for part in (rays.part(slice(first, first + 4096)) for first in range(0, len(found), 4096))
        ]
    )
    assert exact.max() > 0.3
    # Some dozens of points, each of which a ray may graze.
    np.testing.assert_allclose(found, exact, rtol=50 * PASS, atol=50 * PASS)


@pytest.mark.slow
@pytest.mark.parametrize("res", [50, 160])
@pytest.mark.parametrize("light", AMONG)
def test_light_rays_gather_all_points_that_they_cross(renderer, rng, light, res):
    bounds = np.array([[-3.0] * 3, [3.0] * 3])
    fitted = AMONG[light].fitted(bounds)
    middle = fitted.frame().world_from_light[:3, 3]
    points = scattered_points(rng, middle, lambda distance: fitted.footprint(distance) / res)
    found = map_of(renderer, points, AMONG[light], res)
    assert_gathers_all(found.depth[found.lit], points, found.rays.part(np.flatnonzero(found.lit)))


@pytest.mark.quick("160")
@pytest.mark.parametrize("fov", [20, 100, 160])
def test_camera_rays_gather_all_points_that_they_cross(renderer, rng, fov):
    camera = tfm.Camera(from_=(0.1, 0.2, 0.3), to=(0, 0, -2), fov=fov, res=(121, 77))
    points = scattered_points(rng, camera.from_, lambda distance: distance * camera.pixel_width)
    transmittance = renderer.render(tfm.Scene(points, WHITE, camera, ())).aovs["transmittance"][..., 0]
    assert_gathers_all(-np.log(transmittance.astype(float)).ravel(), points, reference.camera_rays(camera))


# --- against the float64 reference -------------------------------------------------------------------------


def random_points(seed=1, profile="smooth", count=7, **changes):
    """Wider than two texels and pixels of the scenes below: as the reference has them."""
    rng = np.random.default_rng(seed)
    positions, radii = rng.uniform(-0.7, 0.7, (count, 3)), rng.uniform(0.35, 0.6, count)
    return tfm.Points(positions, radii, rng.uniform(0.5, 2, count), profile=profile, **changes)


CLOUD = random_points()


def scene_of(*bodies, **changes):
    settings = {"camera": CAMERA, "map": SCENE.map.replace(density_weighting=10.0, res=48, steps=24)}
    return primitive_scenes.scene_of(*bodies, **(settings | changes))


def assert_equals_reference(renderer, save_on_failure, scene, method, **options):
    result = renderer.render(scene, method=method)
    expected, layers = reference.render_with_aovs(scene, method, **options)
    tolerance = MAP_PASS * max(1.0, float(expected[..., :3].max()))
    assert expected[..., :3].max() > 0.3
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < tolerance
    # What is a mean, weighted by opacity, has few digits where there is hardly any.
    seen = layers["transmittance"].mean(axis=-1) < 0.95
    for name in ("transmittance", "depth", "light_transmittance"):
        difference = np.abs(result.aovs[name] - layers[name])[seen]
        limit = 5 if name == "light_transmittance" else 1
        assert difference.max() < limit * MAP_PASS * max(1.0, float(layers[name][seen].max())), name
    return result


@pytest.mark.slow
@pytest.mark.lanes
@both_methods
@every_profile
def test_every_profile(renderer, save_on_failure, profile, method):
    assert_equals_reference(renderer, save_on_failure, scene_of(random_points(profile=profile)), method)


MIXTURES = {
    "coloured": (random_points(colour=colours(7)),),
    "two bodies of their own media": (
        random_points(medium=BLUE, profile="gaussian"),
        random_points(4, "ball", medium=BROWN),
    ),
    "two bodies of one medium": (CLOUD, random_points(4, "ball")),
    "with a grid": (GRID, CLOUD),
    "with a grid, before it": (CLOUD.with_medium(BROWN), GRID),
    "with a grid, in fog": (GRID, CLOUD, FOG),
    "with a box and a ball": (
        CLOUD,
        tfm.BoxVolume(from_=(-0.9, -0.7, -0.5), to=(0.5, 0.6, 0.9), density=0.7),
        tfm.SphereVolume(centre=(0.5, 0.3, 0.4), radius=0.6, density=0.9, medium=BROWN),
    ),
    "coloured beside a grid": (random_points(colour=colours(7)), GRID.with_medium(BLUE)),
    "all kinds": (
        random_points(colour=colours(7), medium=BLUE),
        GRID,
        random_points(4).with_medium(BROWN),
        FOG,
    ),
}


@pytest.mark.slow
@pytest.mark.lanes
@both_methods
@pytest.mark.parametrize("mixture", MIXTURES)
def test_mixtures(renderer, save_on_failure, mixture, method):
    assert_equals_reference(renderer, save_on_failure, scene_of(*MIXTURES[mixture]), method)


BASES = {
    "fourier": {"coeffs": 9, "target": "extinction", "fit": "l2"},
    "legendre": {"target": "optical-depth"},
    "dct": {"fit": "visibility"},
    "slices": {"slicing": "uniform"},
    "klt": {},
}


@pytest.mark.slow
@pytest.mark.lanes
@pytest.mark.parametrize("range_", ["box", "trimmed"])
@pytest.mark.parametrize("basis", BASES)
def test_bases(renderer, save_on_failure, basis, range_):
    of_basis = {"coeffs": 8} | BASES[basis]
    settings = tfm.MapSettings(basis=basis, res=48, steps=48, range=range_, **of_basis)
    scene = scene_of(CLOUD, map=settings)
    maps = renderer.build_maps(scene)
    assert_equals_reference(renderer, save_on_failure, scene, "tfm", maps=maps)


LIGHT_KINDS = {
    "soft spot": LIGHT.replace(cone=12, blend=0.5, falloff="inverse-square", intensity=(800, 600, 400)),
    "with a reach": LIGHT.replace(reach=4.2, intensity=(200, 150, 100)),
    "sun": SunLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), intensity=(60, 50, 40)),
    "point light": PointLight(from_=(2.2, 3.0, 1.2), intensity=(60, 50, 40)),
    "point light inside a point": PointLight(from_=tuple(CLOUD.positions[0] + 0.05), intensity=(60, 50, 40)),
    "spot inside": LIGHT.replace(from_=(0.1, 0.3, 0.2), to=(0, -1, 0.2), cone=50),
}


@pytest.mark.slow
@pytest.mark.lanes
@both_methods
@pytest.mark.parametrize("light", LIGHT_KINDS)
def test_every_kind_of_light(renderer, save_on_failure, light, method):
    assert_equals_reference(renderer, save_on_failure, scene_of(CLOUD, lights=[LIGHT_KINDS[light]]), method)


@pytest.mark.slow
@pytest.mark.lanes
@both_methods
@pytest.mark.parametrize("light", ["sun", "point light inside a point"])
def test_lights_on_coloured_points_of_several_bodies(renderer, save_on_failure, light, method):
    bodies = random_points(colour=colours(7), medium=BLUE), random_points(4, medium=BROWN)
    assert_equals_reference(renderer, save_on_failure, scene_of(*bodies, lights=[LIGHT_KINDS[light]]), method)


@pytest.mark.slow
@pytest.mark.lanes
@both_methods
def test_several_lights_at_once(renderer, save_on_failure, method):
    lights = [LIGHT_KINDS[name] for name in ("soft spot", "sun", "point light", "with a reach")]
    assert_equals_reference(renderer, save_on_failure, scene_of(CLOUD, lights=lights), method)


CAMERAS = {
    "in a point": CAMERA.replace(from_=tuple(CLOUD.positions[0]), to=(-1, -0.3, -0.4), fov=80),
    "among them": CAMERA.replace(from_=(0.1, 0.1, 0.6), to=(-1, -0.3, -0.4), fov=80),
    "half of them behind it": CAMERA.replace(from_=(0.0, 0.0, 0.0), to=(0, 0, -2), fov=70),
}


@pytest.mark.lanes
@pytest.mark.quick("in a point-tfm")
@both_methods
@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras_inside(renderer, save_on_failure, camera, method):
    scene = scene_of(CLOUD, camera=CAMERAS[camera], lights=[LIGHT.replace(cone=40, intensity=400)])
    assert_equals_reference(renderer, save_on_failure, scene, method)


@pytest.mark.parametrize("light", [LIGHT, LIGHT_KINDS["sun"]], ids=["spot", "sun"])
def test_all_points_behind_the_camera(renderer, light):
    scene = scene_of(CLOUD, camera=CAMERA.replace(to=(0.6, 0.8, 9)), lights=[light])
    result = renderer.render(scene)
    assert (result.image == 0).all()
    assert (result.aovs["transmittance"] == 1).all()


MARCHES = {
    "in the world": {"sampling": "world"},
    "as the paper dims": {"attenuation": "paper"},
    "in more steps than are left at once": {"steps": 300},
    "in every step": {"skip_empty": False},
}


@pytest.mark.slow
@pytest.mark.lanes
@both_methods
@pytest.mark.parametrize("march", MARCHES)
def test_settings_of_the_march(renderer, save_on_failure, march, method):
    settings = tfm.MarchSettings(**{"steps": 30, "cutoff": 0.0, **MARCHES[march]})
    assert_equals_reference(renderer, save_on_failure, scene_of(CLOUD, march=settings), method)


@pytest.mark.lanes
def test_more_steps_of_the_light_than_are_left_at_once(renderer, save_on_failure):
    scene = scene_of(CLOUD, map=SCENE.map.replace(density_weighting=10.0, res=48, steps=300))
    assert_equals_reference(renderer, save_on_failure, scene, "tfm")


SOLIDS = (
    SphereSolid(centre=(0.1, 0.1, 0.2), radius=0.35, albedo=(0.9, 0.5, 0.2)),
    PlaneSolid(point=(0, -0.7, 0)),
)


@pytest.mark.slow
@pytest.mark.lanes
@both_methods
@pytest.mark.parametrize("bodies", [(CLOUD,), (CLOUD, GRID, FOG)], ids=["points", "with a grid in fog"])
def test_solids_cut_points(renderer, save_on_failure, bodies, method):
    scene = scene_of(
        *bodies,
        solids=SOLIDS,
        shadow=ShadowSettings(res=64),
        ambient=tfm.Ambient(radiance=(0.1, 0.2, 0.3)),
    )
    result = assert_equals_reference(renderer, save_on_failure, scene, method, shadows="map")
    assert (result.image[..., 3] == 1).any()


@pytest.mark.lanes
def test_ambient_light_alone(renderer, save_on_failure):
    scene = scene_of(CLOUD, lights=[], ambient=tfm.Ambient(radiance=(0.5, 1.0, 2.0)))
    result = renderer.render(scene)
    expected = reference.render(scene)
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < MAP_PASS


EXTREMES = {
    "tiny": ([1e-30, 0.3], [1.0, 2.0]),
    "huge": ([1e6, 0.3], [1e-6, 2.0]),
    "of the largest density": ([0.4, 0.3], [1e25, 2.0]),
    "huge, of the largest density": ([1e6, 0.3], [1e25, 2.0]),
    "of no density": ([0.4, 0.3], [0.0, 0.0]),
}


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("extreme", EXTREMES)
def test_extreme_points_make_numbers(renderer, extreme, method):
    points = tfm.Points([[0, 0, 0], [0.5, 0.2, 0.1]], *EXTREMES[extreme])
    result = renderer.render(scene_of(points), method=method)
    assert_makes_numbers(result)
    assert (result.image[..., 3].max() > 0) == (extreme != "of no density")


@pytest.mark.slow
def test_thousands_of_points_in_one_place(renderer):
    """As one that holds as much."""
    alike = tfm.Points(np.tile([0.1, 0.2, 0.1], (5000, 1)), 0.5, 4e-4)
    one = tfm.Points([[0.1, 0.2, 0.1]], 0.5, 2.0)
    result, expected = renderer.render(scene_of(alike)), renderer.render(scene_of(one))
    np.testing.assert_allclose(result.image, expected.image, atol=5000 * FAST_MATH * expected.image.max())


# --- against each other ------------------------------------------------------------------------------------


def many(count=400, seed=3, **changes):
    """Small and large ones, most of which are widened."""
    rng = np.random.default_rng(seed)
    positions, radii = rng.normal(0, 0.4, (count, 3)), 0.5 * rng.uniform(0, 1, count) ** 3 + 1e-3
    return tfm.Points(positions, radii, 0.3 / radii * rng.uniform(0, 1, count), **changes)


def some(points, numbers):
    colour = None if points.colour is None else points.colour[numbers]
    of_them = points.positions[numbers], points.radii[numbers], points.densities[numbers]
    return tfm.Points(*of_them, profile=points.profile, colour=colour)


ROUNDED = 50 * FAST_MATH
"""Of the brightest: sums of hundreds of points in another order."""


@pytest.mark.slow
def test_maps_serve_the_points_that_they_were_made_of(renderer):
    scene = scene_of(CLOUD)
    maps = renderer.build_maps(scene)
    assert (renderer.render(scene, maps=maps).image == renderer.render(scene).image).all()
    assert (renderer.render(scene_of(CLOUD.with_medium(HAZE)), maps=maps).image > 0).any()
    moved = tfm.Points(CLOUD.positions + 0.1, CLOUD.radii, CLOUD.densities)
    with pytest.raises(SceneError, match="was built for another volume; build the maps again"):
        renderer.render(scene_of(moved), maps=maps)


@pytest.mark.slow
@both_methods
def test_the_order_of_points_does_not_matter(renderer, method):
    points = many()
    expected = renderer.render(scene_of(points), method=method)
    mixed = some(points, np.random.default_rng(8).permutation(400))
    assert_same(renderer.render(scene_of(mixed), method=method), expected, ROUNDED)


@pytest.mark.quick("tfm")
@both_methods
def test_splitting_points_into_two_bodies_changes_nothing(renderer, method):
    points = many()
    expected = renderer.render(scene_of(points), method=method)
    numbers = np.random.default_rng(8).permutation(400)
    halves = some(points, numbers[:150]), some(points, numbers[150:])
    assert_same(renderer.render(scene_of(*halves), method=method), expected, ROUNDED)


def test_two_halves_of_a_point_are_the_whole(renderer):
    points = many(100)
    halves = tfm.Points(
        np.repeat(points.positions, 2, axis=0), np.repeat(points.radii, 2), np.repeat(points.densities, 2) / 2
    )
    assert_same(renderer.render(scene_of(halves)), renderer.render(scene_of(points)), ROUNDED)


@pytest.mark.quick("129")
@pytest.mark.parametrize("steps", [127, 128, 129, 256, 257, 700])
def test_what_a_ray_gathers_does_not_depend_on_its_steps(renderer, steps):
    """Steps are served by 128 at a time, at whose borders nothing is lost or counted twice."""
    expected = renderer.render(scene_of(many())).aovs["transmittance"]
    march = tfm.MarchSettings(steps=steps, cutoff=0.0)
    found = renderer.render(scene_of(many(), march=march)).aovs["transmittance"]
    np.testing.assert_allclose(found, expected, atol=steps * FAST_MATH)


ALIKE = [LIGHT_KINDS["point light"].replace(from_=place) for place in ((2.2, 3.0, 1.2), (-4, 5, 6))]
"""Near and far: the same points are in more bins of the near one's."""


@pytest.mark.quick("of one light-dual", "but those of one bin-dual")
@both_methods
@pytest.mark.parametrize(
    "most",
    [12_000, 1000, 2 * len(CLOUD.positions)],
    ids=["of one light", "of both together", "but those of one bin"],
)
def test_lists_that_are_too_long_have_larger_bins(renderer, monkeypatch, method, most):
    """All lights' alike. The sums have the same terms in the same order."""
    scene = scene_of(CLOUD, lights=ALIKE)
    expected = renderer.render(scene, method=method).image
    assert expected[..., :3].max() > 0.3
    monkeypatch.setattr("tfm_cl.device.primitives.MOST_LISTED", most)
    np.testing.assert_array_equal(renderer.render(scene, method=method).image, expected)


def test_lists_of_all_lights_that_are_too_long_in_one_bin_are_refused(renderer, monkeypatch):
    monkeypatch.setattr("tfm_cl.device.primitives.MOST_LISTED", 2 * len(CLOUD.positions) - 1)
    with pytest.raises(DeviceMemoryError, match="2 lights meet primitives in 14 lists' entries"):
        renderer.render(scene_of(CLOUD, lights=ALIKE), method="dual")


def test_points_without_density_change_nothing(renderer):
    points = many(100)
    empty = np.concatenate([points.densities, np.zeros(50)])
    where = np.concatenate([points.positions, points.positions[:50] + 0.01])
    more = tfm.Points(where, np.concatenate([points.radii, np.full(50, 0.02)]), empty)
    assert_same(renderer.render(scene_of(more)), renderer.render(scene_of(points)), 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bodies", "method"),
    [((many(colour=colours(400)),), "dual"), ((many(), GRID, FOG), "tfm")],
    ids=["coloured", "mixed"],
)
def test_lanes_agree(new_renderer, device_name, bodies, method):
    scene = scene_of(*bodies, camera=CAMERA.replace(res=(45, 31)))
    assert_lanes_agree(new_renderer, device_name, scene, method)


def sampled(grid, parts):
    """Points on a lattice with so many a voxel along each axis, which together hold what the grid does."""
    spacing = float(grid.voxel_size[0]) / parts
    low, high = grid.bounds
    axes = [np.arange(a + spacing / 2, b, spacing) for a, b in zip(low, high, strict=True)]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    densities = reference.density(grid, positions)
    held = densities > 0
    radius = 2 * spacing
    return tfm.Points(positions[held], radius, densities[held] * spacing**3 / (MASS["smooth"] * radius**3))


@pytest.mark.slow
def test_a_dense_cloud_becomes_the_grid_that_it_was_sampled_from(renderer):
    """With the power 3/2 of the points' radius: all that they blur is the steps of the grid's gradient."""
    grid = tfm.Volume(blobs((10, 9, 11)), voxel_size=0.2, origin=(-1, -0.9, -0.8), density_scale=2.0)
    changes = {"camera": CAMERA.replace(res=(72, 54)), "march": tfm.MarchSettings(steps=300, cutoff=0.0)}
    of_map = SCENE.map.replace(res=256, steps=200, density_weighting=2.0, coeffs=16)
    expected = renderer.render(scene_of(grid, map=of_map, **changes))
    errors = []
    for parts in (1, 2, 4):
        result = renderer.render(scene_of(sampled(grid, parts), map=of_map, **changes))
        difference = result.image - expected.image
        errors.append(np.sqrt((difference**2).mean()) / expected.image.max())
    assert errors[0] < 0.03
    assert errors[1] < errors[0] / 2**1.5
    assert errors[2] < errors[1] / 2**1.5
