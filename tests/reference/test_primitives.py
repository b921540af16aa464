"""Primitives in the float64 reference: what points leave along rays, against quadrature and closed forms."""

import numpy as np
import pytest
from scenes import make_scene
from scipy import integrate
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.reference.bodies import march_bounds, optical_depths, step_depths
from tfm_cl.reference.geometry import Rays, ball_interval
from tfm_cl.reference.primitives import amounts, meet
from tfm_cl.scene.lights import PointLight, SpotLight, SunLight
from tfm_cl.scene.solids import SphereSolid

DENSITY = {
    "ball": np.ones_like,
    "gaussian": lambda r: np.exp(-4.5 * r**2),
    "smooth": lambda r: (1 - r**2) ** 3,
}
"""By profile, of the distance from the middle in radii; 0 beyond 1."""
SAME = 1e-12
"""The same sums in another order."""
QUADRATURE = 2e-3
"""Of the brightest: midpoints of hundreds of steps, in which a ball's border lies somewhere."""

every_profile = pytest.mark.parametrize("profile", DENSITY)
ONE = np.ones((1, 1, 1))
"""Weights of one body, of one channel."""


def density_of(points, at):
    """[..., channels] at positions [..., 3]."""
    distance = np.linalg.norm(at[..., None, :] - points.positions, axis=-1) / points.radii
    held = np.where(distance < 1, DENSITY[points.profile](np.minimum(distance, 1)) * points.densities, 0)
    colour = np.ones((len(points.positions), 1)) if points.colour is None else points.colour
    return held @ colour


def random_points(rng, profile="smooth", count=12, **changes):
    return tfm.Points(
        rng.uniform(-1, 1, (count, 3)),
        rng.uniform(0.2, 0.7, count),
        rng.uniform(0.2, 2, count),
        profile=profile,
        **changes,
    )


def random_rays(rng, count=40):
    origins = rng.uniform(-1.5, 1.5, (count, 3))
    directions = rng.uniform(-1, 1, (count, 3)) - origins
    return Rays(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))


# --- integrals -------------------------------------------------------------------------------------------


@every_profile
@pytest.mark.parametrize("coloured", [False, True], ids=["grey", "coloured"])
def test_what_lies_between_two_distances_against_quadrature(rng, profile, coloured):
    points = random_points(rng, profile, colour=rng.uniform(0, 2, (12, 3)) if coloured else None)
    rays = random_rays(rng)
    begin = rng.uniform(0, 1, 40)
    end = begin + rng.uniform(0, 2, 40)
    found = meet(points, rays).between(begin, end)
    assert found.shape == (40, 3 if coloured else 1)

    steps = 20_000
    along = begin + (end - begin) * (np.arange(steps)[:, None] + 0.5) / steps
    at = rays.origins + along[..., None] * rays.directions
    expected = density_of(points, at).mean(axis=0) * (end - begin)[:, None]
    # Where density ends at once, that lies within a step of 1e-4; 12 points of a density of 4 end twice.
    tolerance = {"ball": 2e-3, "gaussian": 2e-3 * np.exp(-4.5), "smooth": 1e-6}[profile]
    np.testing.assert_allclose(found, expected, atol=tolerance)
    assert found.max() > 0.3


@every_profile
def test_a_point_holds_its_mass(profile):
    radius, density = 0.7, 1.3
    points = tfm.Points([[0.1, -0.2, 0.3]], radius, density, profile=profile)
    # Parallel rays across it: rings of equal width.
    middles = (np.arange(4000) + 0.5) / 4000 * radius
    origins = points.positions + np.stack([middles, 0 * middles, np.full_like(middles, -5)], axis=1)
    along_z = np.broadcast_to([0.0, 0.0, 1.0], origins.shape)
    depths = meet(points, Rays(origins, along_z)).between(0 * middles, 0 * middles + 10)[:, 0]
    held = (depths * 2 * np.pi * middles).sum() * radius / 4000
    mass, _ = integrate.quad(lambda r: 4 * np.pi * r**2 * DENSITY[profile](np.asarray(r)), 0, 1)
    assert held == pytest.approx(mass * radius**3 * density, rel=1e-5)
    assert points.unit_mass == pytest.approx(mass, rel=ROUNDED)


def test_the_chord_of_a_ball(rng):
    rays = random_rays(rng, 200)
    centre, radius = np.array([0.2, 0.1, -0.1]), 0.6
    points = tfm.Points([centre], radius, 3.0, profile="ball")
    begin, end = ball_interval(centre, radius, *rays, np.inf)
    found = meet(points, rays).between(np.zeros(200), np.full(200, 100.0))
    np.testing.assert_allclose(found[:, 0], 3 * (end - begin), atol=ROUNDED)


@every_profile
def test_steps_add_up_to_the_whole(rng, profile):
    points, rays = random_points(rng, profile), random_rays(rng)
    cuts = np.sort(rng.uniform(0, 4, (40, 9)), axis=1)
    parts = amounts([points], ONE, rays, cuts)
    whole = amounts([points], ONE, rays, cuts[:, [0, -1]])
    assert (parts >= 0).all()
    np.testing.assert_allclose(parts.sum(axis=1), whole[:, 0], atol=SAME)
    np.testing.assert_allclose(points.depths_along(rays.origins[0], rays.directions[0], cuts[0]), parts[0])


def test_many_points_are_looked_at_in_parts(rng, monkeypatch):
    points, rays = random_points(rng, count=50), random_rays(rng)
    ends = np.broadcast_to([0.0, 5.0], (40, 2))
    whole = amounts([points], ONE, rays, ends)
    monkeypatch.setattr("tfm_cl.reference.primitives.PAIRS", 300)
    np.testing.assert_allclose(amounts([points], ONE, rays, ends), whole, rtol=SAME)


def test_channels_go_to_fields_by_the_weights(rng):
    grey, coloured = random_points(rng), random_points(rng, "ball", colour=rng.uniform(0, 1, (12, 3)))
    weights, rays = rng.uniform(0, 1, (2, 3, 2)), random_rays(rng)
    ends = np.broadcast_to([0.2, 2.0], (40, 2))
    found = amounts([grey, coloured], weights, rays, ends)[:, 0]
    of_grey = meet(grey, rays).between(*ends.T)
    of_coloured = meet(coloured, rays).between(*ends.T)
    np.testing.assert_allclose(found, of_grey * weights[0, 0] + of_coloured @ weights[1], atol=SAME)


# --- among what is marched ---------------------------------------------------------------------------------


def test_all_primitives_have_one_box(rng):
    one, other = random_points(rng), random_points(rng)
    far = tfm.Points(other.positions + np.array([4, 0, 0]), other.radii)
    rays = random_rays(rng, 300)
    low = np.minimum(one.bounds[0], far.bounds[0])
    high = np.maximum(one.bounds[1], far.bounds[1])
    begin, end = march_bounds([one, far], *rays)
    t = rng.uniform(0, 6, (300, 50))
    at = rays.origins[:, None] + t[..., None] * rays.directions[:, None]
    inside = ((at > low) & (at < high)).all(axis=-1)
    np.testing.assert_array_equal(inside, (t > begin[:, None]) & (t < end[:, None]))


def test_the_march_goes_from_the_grid_to_the_points():
    volume = make_scene().volume
    far = tfm.Points([[0, 0, -6.0]], 0.5)
    rays = Rays(np.array([[0.0, 0.0, 5.0]]), np.array([[0.0, 0.0, -1.0]]))
    (begin,), (end,) = march_bounds([volume, far], *rays)
    (of_grid,), _ = march_bounds(volume, *rays)
    assert begin == pytest.approx(of_grid)
    assert end == pytest.approx(11.5)


def test_depths_of_a_grid_and_points_add_up(rng):
    volume, points, rays = make_scene().volume, random_points(rng), random_rays(rng)
    weights = np.zeros((2, 3, 1))
    weights[:, 0] = [[2.0], [3.0]]
    ends = (np.full(40, 0.1), np.full(40, 2.1))
    both = optical_depths([volume, points], weights, rays, ends, 50)
    of_grid = optical_depths(volume, weights[:1], rays, ends, 50)
    of_points = optical_depths(points, weights[1:], rays, ends, 1)
    np.testing.assert_allclose(both, of_grid + of_points, atol=SAME)
    cuts, samples = reference.edges(*ends, 50)
    steps = step_depths([volume, points], weights, rays, cuts, samples)
    np.testing.assert_allclose(steps.sum(axis=1), both, atol=SAME)


LIGHTS = {
    "spot": SpotLight(from_=(2, 3, 1), to=(0, 0, 0), cone=35),
    "sun": SunLight(from_=(2, 3, 1), to=(0, 0, 0)),
    "point light inside": PointLight(from_=(0.1, 0.2, 0.1)),
}


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_optical_depth_to_lights_against_quadrature(rng, light):
    points = random_points(rng, medium=tfm.Medium(sigma_s=0.5))
    scene = tfm.Scene(points, lights=[light])
    at = rng.uniform(-0.8, 0.8, (30, 3))
    found = reference.light_optical_depth(scene, light, at)

    arrival = light.fitted(points.occupied_bounds).arrival(at)
    length = np.minimum(light.fitted(points.occupied_bounds).source_distance(at), 10.0)
    along = (np.arange(20_000)[:, None] + 0.5) / 20_000 * length
    density = density_of(points, at - along[..., None] * arrival.direction)
    np.testing.assert_allclose(found, density[..., 0].mean(axis=0) * length, atol=1e-5)


# --- pictures --------------------------------------------------------------------------------------------


def scene_of(*bodies, **changes):
    scene = make_scene(
        volume=bodies,
        march=tfm.MarchSettings(steps=40, cutoff=0.0, method="dual"),
        camera=make_scene().camera.replace(res=(9, 7)),
        lights=[SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=30, intensity=(30, 25, 20))],
    )
    return scene.replace(**changes)


def assert_same(one, other, tolerance=SAME):
    (image, layers), (expected, expected_layers) = one, other
    assert expected[..., :3].max() > 0.1
    seen = expected[..., 3] > 1e-3
    np.testing.assert_allclose(image, expected, atol=tolerance * expected.max())
    for name, layer in layers.items():
        np.testing.assert_allclose(layer[seen], expected_layers[name][seen], atol=tolerance, err_msg=name)


@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_splitting_and_order_change_nothing(rng, method):
    points = random_points(rng, colour=rng.uniform(0.2, 1, (12, 3)))
    mixed = rng.permutation(12)

    def some(numbers):
        of_them = points.positions[numbers], points.radii[numbers], points.densities[numbers]
        return tfm.Points(*of_them, colour=points.colour[numbers])

    whole = reference.render_with_aovs(scene_of(points), method)
    assert_same(reference.render_with_aovs(scene_of(some(mixed)), method), whole)
    assert_same(reference.render_with_aovs(scene_of(some(mixed[:5]), some(mixed[5:])), method), whole)


@pytest.mark.parametrize(
    "changes", [{}, {"ambient": tfm.Ambient(radiance=(0.5, 1.0, 2.0))}], ids=["lit", "sky"]
)
def test_a_ball_is_the_homogeneous_one(changes):
    where = {"centre": (0.2, 0.1, -0.1), "radius": 0.8, "density": 1.5}
    march = tfm.MarchSettings(steps=400, cutoff=0.0, method="dual")
    point = tfm.Points([where["centre"]], where["radius"], where["density"], profile="ball")
    image, layers = reference.render_with_aovs(scene_of(point, march=march, **changes))
    expected, expected_layers = reference.render_with_aovs(
        scene_of(tfm.SphereVolume(**where), march=march, **changes)
    )
    np.testing.assert_allclose(layers["transmittance"], expected_layers["transmittance"], atol=SAME)
    np.testing.assert_allclose(image, expected, atol=QUADRATURE * expected.max())
    np.testing.assert_allclose(layers["depth"], expected_layers["depth"], atol=4 * QUADRATURE)
    assert expected[..., :3].max() > 0.2


def test_each_body_scatters_by_its_own_medium():
    """Two clouds apart, one before the other nowhere: each looks as if it were alone."""
    left, right = (tfm.Points([[x, 0, 0]], 0.3, 2.0, profile="gaussian") for x in (-0.7, 0.7))
    warm, cold = tfm.Medium(sigma_s=(1.0, 0.6, 0.3)), tfm.Medium(sigma_s=(0.3, 0.5, 1.0), sigma_a=0.2)
    lights = [SunLight(from_=(0, 0, 5), to=(0, 0, 0), intensity=50)]
    march = tfm.MarchSettings(steps=400, cutoff=0.0, method="dual", sampling="world")
    pictures = [
        reference.render(scene_of(*bodies, lights=lights, march=march))
        for bodies in (
            (left.with_medium(warm), right.with_medium(cold)),
            (left.with_medium(warm),),
            (right.with_medium(cold),),
        )
    ]
    assert min(picture[..., :3].max() for picture in pictures) > 0.05
    np.testing.assert_allclose(pictures[0], pictures[1] + pictures[2], atol=QUADRATURE * pictures[0].max())


def test_a_solid_ends_what_lies_behind_it():
    points = tfm.Points([[0, 0, 0]], 0.5, 1.0, profile="ball", medium=tfm.Medium(sigma_a=1.0, sigma_s=0.0))
    camera = tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(1, 1))
    solid = SphereSolid(centre=(0, 0, -1), radius=1.2)  # to z = 0.2
    _, layers = reference.render_with_aovs(scene_of(points, camera=camera, solids=[solid]))
    np.testing.assert_allclose(layers["transmittance"][0, 0], np.exp(-0.3), rtol=1e-6)
