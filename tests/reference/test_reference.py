"""The float64 reference against closed forms that share none of its code."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.optimize import brentq
from scipy.special import roots_legendre

from tfm_cl import reference
from tfm_cl.errors import SceneError
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.camera import Camera
from tfm_cl.scene.lights import EnvironmentLight, PointLight, SpotLight, SunLight
from tfm_cl.scene.lights.base import texel_positions
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.phases import HenyeyGreenstein, Isotropic
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.settings import MapSettings, MarchSettings

BOX = (5, 6, 7)  # voxels x, y, z of the constant volume
LEVEL = 1.25  # its density
# Rotated by 30° about an oblique axis, and with three different voxel sizes.
ROTATION = np.linalg.qr(np.array([[2.0, -1.0, 0.3], [0.8, 2.2, -0.7], [-0.1, 0.9, 1.9]]))[0]
OBLIQUE = np.eye(4)
OBLIQUE[:3, :3] = ROTATION * (0.3, 0.2, 0.25)
OBLIQUE[:3, 3] = -OBLIQUE[:3, :3] @ (2.0, 2.5, 3.0)  # the middle of BOX at 0


def random_rays(rng, count, spread=3.0):
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return rng.normal(size=(count, 3)) * spread, directions


def random_volume(rng, **values):
    return Volume(rng.uniform(size=(5, 4, 6)) ** 3, world_from_index=OBLIQUE, **values)


def constant_volume(**values):
    return Volume(np.ones(BOX[::-1]), world_from_index=OBLIQUE, density_scale=LEVEL, **values)


def index_of(points):
    return np.linalg.solve(OBLIQUE[:3, :3], (points - OBLIQUE[:3, 3]).T).T


def segment_depth(starts, stops):
    """Exact ∫ D of `constant_volume` over segments [n, 3], without the reference.

    Its density is a product of three trapezoids in index space: along a line a cubic between the planes
    -1, 0, N-1, N of each axis, which two Gauss nodes per piece integrate exactly.
    """
    begin, end = index_of(starts), index_of(stops)
    planes = np.array([[-1, 0, n - 1, n] for n in BOX], dtype=float)
    span = np.where(np.abs(end - begin) < 1e-12, 1e-12, end - begin)
    cuts = np.clip((planes - begin[:, :, None]) / span[:, :, None], 0, 1).reshape(len(begin), -1)
    cuts = np.sort(np.concatenate([cuts, np.zeros((len(begin), 1)), np.ones((len(begin), 1))], axis=-1))
    middle, half = (cuts[:, 1:] + cuts[:, :-1]) / 2, np.diff(cuts) / 2
    total = np.zeros(len(begin))
    for node in (-1, 1):
        s = (middle + node * half / np.sqrt(3))[:, :, None]
        index = begin[:, None] + s * (end - begin)[:, None]
        trapezoid = np.clip(np.minimum(index + 1, np.array(BOX) - index), 0, 1)
        total += (half * trapezoid.prod(axis=-1)).sum(axis=-1)
    return LEVEL * total * np.linalg.norm(stops - starts, axis=-1)


FAR = 12.0
"""Beyond everything, from every camera used here."""


def pixel_ray(camera, column, row):
    (width, height), forward = camera.res, np.subtract(camera.to, camera.from_)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera.up)
    right /= np.linalg.norm(right)
    tangent = np.tan(np.radians(camera.fov / 2))
    ray = forward + right * ((column + 0.5) / width * 2 - 1) * tangent * width / height
    ray += np.cross(right, forward) * (1 - (row + 0.5) / height * 2) * tangent
    return ray / np.linalg.norm(ray)


def angle_to_axis(light, points):
    offset, axis = points - light.from_, np.subtract(light.to, light.from_)
    return np.arctan2(np.linalg.norm(np.cross(offset, axis), axis=-1), offset @ axis)


def cone_crossings(light, eye, ray):
    """Where a ray meets the edge of the cone and the start of its soft border."""
    scan, found = np.linspace(0, FAR, 4001), []
    for limit in np.radians(light.cone) * np.array([1, 1 - light.blend]):

        def over(t, limit=limit):
            return angle_to_axis(light, eye + np.multiply.outer(t, ray)) - limit

        changes = np.flatnonzero(np.diff(over(scan) > 0))
        found += [brentq(over, scan[i], scan[i + 1], xtol=1e-13) for i in changes]
    return found


def light_at(light, medium, points, ray):
    """Light towards the camera per unit of scattering, and its transmittance, both RGB."""
    source, cone, offset = np.array(light.from_), np.radians(light.cone), points - light.from_
    distance, angle = np.linalg.norm(offset, axis=-1), angle_to_axis(light, points)
    tau = segment_depth(np.broadcast_to(source, points.shape), points)
    transmittance = np.exp(-np.outer(tau, np.add(medium.sigma_s, medium.sigma_a)))
    x = np.clip((cone - angle) / (cone * light.blend), 0, 1) if light.blend else np.ones_like(angle)
    emitted = (3 * x**2 - 2 * x**3) / (distance**2 if light.falloff == "inverse-square" else 1)
    g, mu = medium.phase.g, -(offset @ ray) / distance
    phase = (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * mu) ** 1.5)
    return np.outer(emitted * phase, light.intensity) * transmittance, transmittance


def exact_pixel(scene, column, row):
    """RGBA and layers of one pixel of a `constant_volume` scene by Gauss quadrature between all kinks."""
    medium, eye, ray = scene.medium, np.array(scene.camera.from_), pixel_ray(scene.camera, column, row)
    sigma_t, sigma_s = np.add(medium.sigma_s, medium.sigma_a), np.array(medium.sigma_s)
    begin, end = index_of(np.array([eye, eye + FAR * ray]))
    planes = np.array([[-1, 0, n - 1, n] for n in BOX])
    kinks = np.clip((planes - begin[:, None]) / (end - begin)[:, None] * FAR, 0, FAR).ravel()

    def march(cuts):
        """Distances, weights, points, and T_cam D, RGB."""
        x, weights = roots_legendre(24)
        cuts = np.unique(np.concatenate([kinks, cuts, np.linspace(0, FAR, 49)]))
        half = np.diff(cuts)[:, None] / 2
        t = (cuts[:-1, None] + half * (1 + x)).ravel()
        points = eye + np.outer(t, ray)
        index = index_of(points)
        dense = LEVEL * np.clip(np.minimum(index + 1, np.array(BOX) - index), 0, 1).prod(axis=-1)
        tau = segment_depth(np.broadcast_to(eye, points.shape), points)
        return t, (half * weights).ravel(), points, dense[:, None] * np.exp(-np.outer(tau, sigma_t))

    t, weights, _, seen = march([])
    opaque = (sigma_t * seen).mean(axis=-1) * weights
    transmittance = np.exp(-segment_depth(eye[None], (eye + FAR * ray)[None]) * sigma_t)
    radiance, reached, norm = np.zeros(3), np.zeros(3), 1e-300
    for light in scene.lights:
        _, weights, points, seen = march(cone_crossings(light, eye, ray))
        weights = np.where(angle_to_axis(light, points) < np.radians(light.cone), weights, 0)
        scattered, light_transmittance = light_at(light, medium, points, ray)
        radiance += weights @ (scattered * sigma_s * seen)
        visible = weights * (sigma_t * seen).mean(axis=-1)
        reached, norm = reached + visible @ light_transmittance, norm + visible.sum()
    return {
        "rgba": np.append(radiance, 1 - transmittance.mean()),
        "depth": (opaque * t).sum() / max(opaque.sum(), 1e-300),
        "transmittance": transmittance,
        "light_transmittance": reached / norm,
    }


CAMERA = Camera(from_=(0.3, 0.4, 3.4), to=(0.0, 0.1, 0.0), fov=34.0, res=(3, 3))
INSIDE = Camera(from_=(0.1, 0.15, 0.1), to=(1.0, 0.2, 0.4), fov=70.0, res=(3, 2))
COLOURED = Medium(sigma_s=(1.4, 0.9, 0.5), sigma_a=(0.1, 0.4, 0.2), phase=HenyeyGreenstein(0.4))
WIDE = SpotLight(from_=(2.0, 2.5, 1.0), to=(0, 0, 0), cone=40.0, intensity=(2, 3, 4))
NARROW = SpotLight(
    from_=(-2, 1.5, 0.5),
    to=(0, 0.1, 0),
    cone=9.0,
    falloff="inverse-square",
    blend=0.6,
    intensity=(30, 20, 10),
)
BESIDE_CAMERA = SpotLight(from_=(0.6, 0.9, 2.8), to=(0.0, 0.0, 0.0), cone=12.0)
WITHIN = SpotLight(from_=(0.05, 0.1, -0.1), to=(0.5, 0.4, 0.6), cone=50.0)


def scene_of(volume=None, lights=(WIDE,), camera=CAMERA, medium=COLOURED, march=None, **of_map):
    return Scene(
        volume=volume or constant_volume(),
        lights=list(lights),
        camera=camera,
        medium=medium,
        march=MarchSettings(**{"method": "dual", "steps": 60, **(march or {})}),
        map=MapSettings(**{"basis": "dct", "density_weighting": 10.0, "res": 16, "steps": 60, **of_map}),
    )


# --- geometry and density ------------------------------------------------------------------------------


def test_density_is_trilinear_on_zero_padding():
    rng = np.random.default_rng(1)
    volume = random_volume(rng, density_scale=2.5)
    index = rng.uniform(-3, 9, size=(20_000, 3))
    points = index @ OBLIQUE[:3, :3].T + OBLIQUE[:3, 3]
    padded = np.pad(volume.data.astype(float), 4)
    expected = map_coordinates(padded, index.T[::-1] + 4, order=1)
    np.testing.assert_allclose(reference.density(volume, points), 2.5 * expected, rtol=0, atol=1e-12)


def test_density_far_outside_is_zero():
    far = np.array([[1e30, 0, 0], [0, -1e200, 3], [50.0, 50.0, 50.0]])
    assert not reference.density(constant_volume(), far).any()


def inside_of_interval(interval, t):
    begin, end = interval
    return (t > begin[:, None]) & (t < end[:, None])


def test_march_bounds_against_points():
    rng = np.random.default_rng(2)
    origins, directions = random_rays(rng, 4000, spread=1.0)
    # Along the voxel axes, one component of the direction is 0 in index space.
    directions[:600] = np.repeat(OBLIQUE[:3, :3].T / np.linalg.norm(OBLIQUE[:3, :3], axis=0)[:, None], 200, 0)
    interval = reference.march_bounds(constant_volume(), origins, directions)
    t = rng.uniform(0, 6, size=(4000, 200))
    index = index_of((origins[:, None] + t[..., None] * directions[:, None]).reshape(-1, 3)).reshape(
        4000, 200, 3
    )
    slack = np.minimum(index + 1, np.array(BOX) - index).min(axis=-1)
    clear = np.abs(slack) > 1e-9
    inside = inside_of_interval(interval, t)
    assert (inside == (slack > 0))[clear].all()
    assert inside.any(axis=1).mean() > 0.2
    assert (interval[0] >= 0).all()
    assert (interval[0] <= interval[1]).all()


def test_march_bounds_of_axis_parallel_rays():
    volume = Volume(np.ones((2, 3, 4)), voxel_size=1.0, origin=(0.5, 0.5, 0.5))  # centres at 1, 2, 3 …
    origins = np.array([[-5.0, 1, 1], [-5.0, 9, 1], [2.0, 1, 1], [9.0, 1, 1]])
    directions = np.tile([1.0, 0, 0], (4, 1))
    begin, end = reference.march_bounds(volume, origins, directions)
    np.testing.assert_allclose(begin, [5, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(end, [10, 0, 3, 0], atol=1e-12)


def cone_cases(light, rng):
    """Random rays and, by name, the special ones."""
    apex, axis = np.array(light.from_), np.subtract(light.to, light.from_)
    axis /= np.linalg.norm(axis)
    side = np.cross(axis, (0.3, 0.5, -0.7))
    side /= np.linalg.norm(side)
    cone = np.radians(light.cone)
    count = 1500
    origins, directions = random_rays(rng, count)
    around = rng.uniform(0, 2 * np.pi, count)[:, None]
    radial = np.cos(around) * side + np.sin(around) * np.cross(axis, side)
    generator = np.cos(cone) * axis + np.sin(cone) * radial
    sign = rng.choice([-1.0, 1.0], size=(count, 1))
    depth = rng.uniform(0.1, 4, size=(count, 1))
    within = apex + depth * (axis + rng.uniform(0, 0.9, (count, 1)) * np.tan(cone) * radial)
    return {
        "random": (apex + origins, directions),
        "far away": (apex + 1e4 * directions + origins * 0.1, -directions),
        "from inside": (within, directions),
        "from the apex": (np.broadcast_to(apex, origins.shape), directions),
        "through the apex": (apex - depth * directions, directions),
        "parallel to the side": (apex + origins, sign * generator),
        "inside, parallel to the side": (within, sign * generator),
        "along the axis": (apex + origins, np.broadcast_to(sign * axis, origins.shape)),
        "on the axis": (apex + (depth - 2) * axis, np.broadcast_to(sign * axis, origins.shape)),
        "across the axis": (within, np.cross(radial, axis)),
    }


@pytest.mark.parametrize("cone", [0.5, 25.0, 60.0, 89.0])
def test_cone_interval_against_points(cone):
    rng = np.random.default_rng(int(cone))
    light = SpotLight(from_=(0.4, -0.3, 0.8), to=(-0.5, 0.6, -0.1), cone=cone)
    apex, axis = np.array(light.from_), np.subtract(light.to, light.from_)
    axis /= np.linalg.norm(axis)
    for name, (origins, directions) in cone_cases(light, rng).items():
        interval = reference.cone_interval(light, origins, directions)
        assert (interval[0] >= 0).all(), name
        assert not np.isnan(interval).any(), name
        nearest = np.maximum(((apex - origins) * directions).sum(axis=-1, keepdims=True), 0)
        t = np.abs(nearest + rng.normal(size=(len(origins), 60)) * np.array([0.02, 0.3, 3, 60]).repeat(15))
        # Two more just inside and two just outside what is claimed, where an error would show first.
        ends = np.stack(np.where(np.isfinite(interval), interval, 0), axis=-1)
        t = np.concatenate([t, np.maximum(ends - 1e-5, 1e-9), ends + 1e-5], axis=1)
        offset = origins[:, None] + t[..., None] * directions[:, None] - apex
        height = offset @ axis
        away = np.linalg.norm(offset - height[..., None] * axis, axis=-1)
        slack = height * np.sin(np.radians(cone)) - away * np.cos(np.radians(cone))  # > 0: inside
        clear = np.abs(slack) > 1e-11 * (1 + np.abs(t) + np.linalg.norm(origins, axis=-1, keepdims=True))
        assert clear.mean() > 0.5, name
        wrong = clear & (inside_of_interval(interval, t) != (slack > 0))
        assert not wrong.any(), f"{name}: {np.count_nonzero(wrong)} points"


# --- steps ---------------------------------------------------------------------------------------------


def test_world_steps_are_uniform():
    boundaries, samples = reference.edges(np.array([1.0]), np.array([3.0]), 4)
    np.testing.assert_allclose(boundaries, [[1, 1.5, 2, 2.5, 3]], rtol=1e-15)
    np.testing.assert_allclose(samples, [[1.25, 1.75, 2.25, 2.75]], rtol=1e-15)


def test_projective_samples_are_uniform_after_the_divide():
    rng = np.random.default_rng(3)
    ends = rng.uniform((-1, -1, 0.2), (1, 1, 4), size=(50, 2, 3))  # light space, z is the depth
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    w = ends[:, 0, 2], ends[:, 1, 2]
    for distances in reference.edges(np.zeros(50), length, 10, w, max_stretch=1e6):
        points = ends[:, :1] + (distances / length[:, None])[..., None] * (ends[:, 1:] - ends[:, :1])
        screen = points[..., :2] / points[..., 2:]
        np.testing.assert_allclose(np.diff(screen, n=2, axis=1), 0, atol=1e-12)


def test_weights_sum_to_the_segment_and_samples_lie_in_their_steps():
    rng = np.random.default_rng(4)
    begin, length, *w = rng.uniform(0, 5, size=(4, 200))
    w[0][:20] = 0
    w[1][10:30] = 0
    boundaries, samples = reference.edges(begin, begin + length, 37, (w[0], w[1]), max_stretch=4.0)
    np.testing.assert_allclose(np.diff(boundaries).sum(axis=1), length, rtol=1e-13)
    assert (np.diff(boundaries) > 0).all()
    assert ((samples > boundaries[:, :-1]) & (samples < boundaries[:, 1:])).all()
    assert np.diff(boundaries).max(axis=1).max() <= (4 * length / 37).max()
    assert (np.diff(boundaries).max(axis=1) <= 4 * length / 37).all()
    # Both ends at the light: no warp.
    np.testing.assert_allclose(np.diff(boundaries)[10:20], (length[10:20] / 37)[:, None].repeat(37, 1))


def test_max_stretch_is_reached():
    one = np.ones(1)
    steps = np.diff(reference.edges(0 * one, one, 10_000, (0.001 * one, one), max_stretch=4.0)[0][0])
    assert steps.max() * 10_000 == pytest.approx(4, rel=1e-3)


# --- the medium and the light ----------------------------------------------------------------------------


@pytest.mark.parametrize("g", [-0.95, -0.6, 0.0, 0.2, 0.5, 0.9, 0.97])
def test_henyey_greenstein_is_normalised_with_mean_cosine_g(g):
    mu, weights = roots_legendre(400)
    p = 2 * np.pi * weights * HenyeyGreenstein(g).evaluate(mu)
    assert p.sum() == pytest.approx(1, rel=1e-9)
    assert (p * mu).sum() == pytest.approx(g, rel=1e-9, abs=1e-12)


def test_isotropic_is_henyey_greenstein_without_asymmetry():
    mu = np.linspace(-1, 1, 5)
    np.testing.assert_allclose(Isotropic().evaluate(mu), HenyeyGreenstein(0.0).evaluate(mu), rtol=1e-15)


@pytest.mark.parametrize("light", [WIDE, WITHIN], ids=["outside", "inside"])
def test_light_march_converges_in_second_order(light):
    rng = np.random.default_rng(5)
    points = rng.uniform(-0.6, 0.6, size=(200, 3))
    exact = segment_depth(np.broadcast_to(light.from_, points.shape), points)
    errors = []
    for steps in (50, 100, 200):
        scene = scene_of(steps=steps)
        errors.append(np.sqrt(((reference.light_optical_depth(scene, light, points) - exact) ** 2).mean()))
    assert exact.mean() > 0.3
    assert errors[0] < 2e-4
    assert errors[2] < errors[0] / 10


def test_light_march_between_light_and_medium_is_clear():
    light = SpotLight(from_=(0, 0, 50), to=(0, 0, 0))
    points = np.array([[0.0, 0, 20], [0.0, 0, 50]])
    assert not reference.light_optical_depth(scene_of(), light, points).any()


def test_light_march_stops_where_the_medium_does():
    behind = np.array(WIDE.from_) + np.array([[2.0], [30.0]]) * np.subtract(WIDE.to, WIDE.from_)
    near, far = reference.light_optical_depth(scene_of(steps=5), WIDE, behind)
    assert near > 0.5
    assert near == pytest.approx(far, rel=1e-12)


def test_falloff_and_blend():
    light = SpotLight(
        from_=(0, 0, 0), to=(0, 0, 1), cone=40.0, blend=0.5, falloff="inverse-square", intensity=(1, 2, 3)
    )
    angle = np.radians([0, 19.9, 20, 25, 30, 40])
    points = 2 * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    gain = np.array([1, 1, 1, 0.84375, 0.5, 0])  # 3x² - 2x³ at x = 3/4 and 1/2
    arriving = reference.unshadowed(constant_volume(), light, points)
    np.testing.assert_allclose(arriving, np.outer(gain, [1, 2, 3]) / 4, atol=1e-12)


def test_inverse_square_stays_finite_at_the_light():
    light = SpotLight(from_=(0, 0, 0), to=(0, 0, 1), falloff="inverse-square")
    volume = constant_volume()
    diagonal = np.linalg.norm(volume.bounds[1] - volume.bounds[0])
    assert reference.unshadowed(volume, light, np.zeros((1, 3)))[0, 0] == pytest.approx(1e12 / diagonal**2)


# --- the map -------------------------------------------------------------------------------------------


def exact_dct(tau, count):
    j = np.arange(1, count)
    rest = 2 * tau * (1 - (-1.0) ** j * np.exp(-tau)) / (tau**2 + (j * np.pi) ** 2)
    return np.concatenate([[(1 - np.exp(-tau)) / tau], rest])


def fitted(scene, light):
    """The light as its map in the scene sees it."""
    return light.fitted(scene.volume.occupied_bounds)


def test_map_of_a_homogeneous_medium_converges_to_the_closed_form(monkeypatch):
    # Without the border, which no volume file can lack, T = e^(-τu) exactly.
    monkeypatch.setattr(reference.bodies, "density", lambda _, points: np.full(points.shape[:-1], 3.0))
    errors = []
    for steps in (25, 50, 100, 200):
        scene = scene_of(res=3, steps=steps, coeffs=6, density_weighting=2.0)
        coefficients = reference.build_map(scene, NARROW)
        rays = reference.texel_rays(fitted(scene, NARROW), 3)
        begin, end = reference.march_bounds(scene.volume, *rays)
        expected = [
            exact_dct(3 * (k_out - k_in) / 2.0, 6) if k_out > k_in else np.eye(6)[0]
            for k_in, k_out in zip(begin, end, strict=True)
        ]
        errors.append(np.abs(coefficients - np.reshape(expected, (3, 3, 6))).max())
    assert (end > begin).sum() >= 5
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4, rtol=0.05)
    assert errors[-1] < 1e-4


def test_map_of_a_real_volume_converges_to_quadrature():
    light = SpotLight(from_=(0.2, 0.3, 3.0), to=(0.0, 0.1, 0.0), cone=10.0)
    scene = scene_of(res=1, steps=1000, coeffs=5, density_weighting=1.0)
    coefficients = reference.build_map(scene, light)[0, 0]
    axis = np.subtract(light.to, light.from_) / np.linalg.norm(np.subtract(light.to, light.from_))
    begin, end = reference.march_bounds(scene.volume, np.array([light.from_]), axis[None])
    source = np.array([light.from_])

    u = (np.arange(8000) + 0.5) / 8000
    points = source + (begin + u * (end - begin))[:, None] * axis
    f = np.exp(-segment_depth(np.broadcast_to(source, points.shape), points))
    for j, value in enumerate(coefficients):
        exact = (f * np.cos(j * np.pi * u)).mean() * (2 if j else 1)
        assert value == pytest.approx(exact, abs=1e-5)


def test_map_rows_start_at_the_lowest_y_and_misses_are_clear():
    # One voxel to the upper left of the axis, as the light sees it: x right, y up.
    light = SpotLight(from_=(0, 0, 5), to=(0, 0, 0), cone=20.0)
    # Another, far to the other side, so that the map looks at both and some rays miss the medium.
    offset = np.array([0.9, -0.9, 0])
    density = np.zeros((1, 7, 7))
    density[0, 0, 6] = density[0, 6, 0] = 1
    volume = Volume(density, voxel_size=0.3, origin=(-1.05, -1.05, -0.15))
    scene = scene_of(volume, [light], res=8, coeffs=4)
    coefficients = reference.build_map(scene, light)
    (x, y), *_ = (fitted(scene, light).arrival(offset[None]).position * 8).astype(int)
    assert x != y
    assert coefficients[y, x, 0] < 0.999
    np.testing.assert_array_equal(coefficients[y, y], [1, 0, 0, 0])
    dark = coefficients[..., 0] < 0.999
    assert {(r // 4, c // 4) for r, c in np.argwhere(dark)} == {(y // 4, x // 4), (x // 4, y // 4)}


@pytest.mark.parametrize("light", [WIDE, WITHIN], ids=["outside", "inside"])
def test_as_many_coefficients_as_steps_reproduce_the_steps(light):
    # An inverse DCT of the full length is exact at the step midpoints of a texel's own ray.
    steps = 24
    volume = random_volume(np.random.default_rng(6), density_scale=8.0)
    scene = scene_of(volume, [light], res=7, steps=steps, coeffs=steps, density_weighting=3.0)
    rays = reference.texel_rays(fitted(scene, light), 7)
    begin, end = reference.march_bounds(volume, *rays)
    t = begin[:, None] + (end - begin)[:, None] * (np.arange(steps) + 0.5) / steps
    points = rays.origins[:, None] + t[..., None] * rays.directions[:, None]
    d = reference.density(volume, points) * (end - begin)[:, None] / steps
    tau = np.cumsum(d, axis=1) - d / 2
    hit = end > begin
    found = reference.map_optical_depth(
        scene, light, reference.build_map(scene, light), points[hit].reshape(-1, 3)
    )
    assert tau.max() > 2
    np.testing.assert_allclose(found, tau[hit].ravel(), atol=1e-9)


def test_map_is_bilinear_and_clamps_to_its_edge():
    light = SpotLight(from_=(0, 0, 3), to=(0, 0, 0), cone=20.0)
    around = Volume(np.ones((5, 5, 5)), voxel_size=1.0, origin=(-2.5, -2.5, -2.5))  # every ray meets it
    scene = scene_of(around, density_weighting=1.0)
    coefficients = np.exp(-np.array([[[1.0], [2.0]], [[3.0], [4.0]]]))
    of_map = fitted(scene, light)

    def lookup(x, y):
        origins, directions = of_map.rays((np.array([[x, y]]) + 1) / 2)
        (point,) = origins + 2.5 * directions
        return reference.map_optical_depth(scene, light, coefficients, point[None])[0]

    assert lookup(0.5, -0.5) == pytest.approx(2)
    assert lookup(-0.5, 0.5) == pytest.approx(3)
    assert lookup(-1, -1) == pytest.approx(1)
    assert lookup(1, 1) == pytest.approx(4)
    quarter = 0.75 * np.exp(-1) + 0.25 * np.exp(-2)
    assert lookup(-0.25, -0.5) == pytest.approx(-np.log(quarter))
    assert lookup(0, 0) == pytest.approx(-np.log(np.exp(-np.arange(1.0, 5)).mean()))


def test_negative_and_bright_ripples_are_clamped():
    light, points = SpotLight(from_=(0, 0, 3), to=(0, 0, 0)), np.zeros((1, 3))
    scene = scene_of(density_weighting=2.0)
    dark = reference.map_optical_depth(scene, light, np.full((1, 1, 1), -0.05), points)
    assert dark[0] == pytest.approx(2 * 37 * np.log(10))
    assert reference.map_optical_depth(scene, light, np.full((1, 1, 1), 1.2), points)[0] == 0


@pytest.mark.parametrize(("sigma", "limit"), [(0.001, None), (0.5, 1), (2.0, None), (60.0, 16)])
def test_auto_density_weighting(sigma, limit):
    medium = Medium(sigma_s=(0, sigma / 2, 0), sigma_a=(0, sigma / 2, 0))
    scene = scene_of(lights=[NARROW, WIDE], medium=medium, density_weighting="auto", steps=60)
    deepest = 0.0
    for light in scene.lights:
        starts, directions = fitted(scene, light).rays(texel_positions(64))
        deepest = max(deepest, segment_depth(starts, starts + 9 * directions).max())
    of_medium = min(max(sigma * deepest / 2, 1), 16)
    if limit:
        assert of_medium == limit or sigma * deepest / 2 == pytest.approx(of_medium)
    for order in (1, -1):
        found = reference.density_weighting(scene.replace(lights=scene.lights[::order]))
        assert found == pytest.approx(max(1, of_medium / sigma), rel=3e-3)


# --- images --------------------------------------------------------------------------------------------

SCENES = {
    "one wide light": {"lights": [WIDE]},
    "narrow, soft, inverse-square": {"lights": [NARROW]},
    "light beside the camera": {"lights": [BESIDE_CAMERA]},
    "light within the medium": {"lights": [WITHIN]},
    "camera within the medium, two lights": {"lights": [WIDE, NARROW], "camera": INSIDE},
    "world sampling": {"lights": [NARROW, WIDE], "march": {"sampling": "world"}},
}


@pytest.mark.parametrize("name", SCENES)
def test_image_converges_to_the_analytic_integral(name):
    scenes = [
        scene_of(**{**SCENES[name], "march": {**SCENES[name].get("march", {}), "steps": n}, "steps": n})
        for n in (20, 40, 80)
    ]
    results = [reference.render_with_aovs(scene) for scene in scenes]
    height, width, _ = results[0][0].shape
    exact = [[exact_pixel(scenes[0], x, y) for x in range(width)] for y in range(height)]

    def layer(name):
        return np.array([[pixel[name] for pixel in row] for row in exact])

    rgba, aovs = results[-1]
    rgb = layer("rgba")[..., :3]
    assert rgb.max() > 0.01
    np.testing.assert_allclose(rgba[..., :3], rgb, atol=5e-4 * rgb.max())
    np.testing.assert_allclose(rgba[..., 3], layer("rgba")[..., 3], atol=1e-4)
    np.testing.assert_allclose(aovs["transmittance"], layer("transmittance"), atol=1e-4)
    np.testing.assert_allclose(aovs["light_transmittance"], layer("light_transmittance"), atol=2e-3)
    seen = layer("rgba")[..., 3] > 1e-6
    np.testing.assert_allclose(aovs["depth"][seen], layer("depth")[seen], rtol=1e-3)
    errors = [np.sqrt(((image[..., :3] - rgb) ** 2).mean()) for image, _ in results]
    assert errors[-1] < errors[0] / 6  # 16 for a smooth density; its kinks are hit or missed


def scalar_density(point):
    index = index_of(np.array([point]))[0]
    return LEVEL * float(np.clip(np.minimum(index + 1, np.array(BOX) - index), 0, 1).prod())


def scalar_bounds(origin, direction):
    begin, end = index_of(np.array([origin, origin + FAR * direction]))
    at = np.sort((np.array([[-1] * 3, BOX]) - begin) / (end - begin) * FAR, axis=0)
    return max(at[0].max(), 0.0), at[1].min()


@pytest.mark.parametrize("sampling", ["projective", "world"])
@pytest.mark.parametrize("pixel", [(1, 1), (0, 1), (2, 1)])
def test_few_steps_follow_the_definition(pixel, sampling):
    # Far from convergence every choice of the discretisation shows: the formulas once more, number by number.
    steps, light_steps, stretch, sigma = 5, 3, 1.5, 3.0
    light = SpotLight(from_=(0.9, 1.1, 1.6), to=(0.1, 0, -0.2), cone=16.0)
    scene = scene_of(
        lights=[light],
        medium=Medium(sigma_s=sigma),
        march={"steps": steps, "max_stretch": stretch, "sampling": sampling},
        steps=light_steps,
    )
    eye, source, ray = np.array(CAMERA.from_), np.array(light.from_), pixel_ray(CAMERA, *pixel)
    near, far = scalar_bounds(eye, ray)
    edge = cone_crossings(light, eye, ray)
    axis = np.subtract(light.to, light.from_) / np.linalg.norm(np.subtract(light.to, light.from_))
    begin, end = max(near, min(edge)), min(far, max(edge))
    dark = int(np.ceil(steps * (begin - near) / (far - near)))
    tau = sum(
        scalar_density(eye + (near + (n + 0.5) / dark * (begin - near)) * ray) * (begin - near) / dark
        for n in range(dark)
    )
    w = [(eye + t * ray - source) @ axis if sampling == "projective" else 1.0 for t in (begin, end)]
    w = [max(depth, max(w) / stretch) for depth in w]
    place = [s * w[0] / (s * w[0] + (1 - s) * w[1]) for s in np.arange(2 * steps + 1) / (2 * steps)]
    radiance = 0.0
    for n in range(steps):
        point = eye + (begin + place[2 * n + 1] * (end - begin)) * ray
        length = (place[2 * n + 2] - place[2 * n]) * (end - begin)
        distance = np.linalg.norm(point - source)
        towards = (point - source) / distance
        k_in, _ = scalar_bounds(source, towards)
        light_tau = sum(
            scalar_density(source + (k_in + (m + 0.5) / light_steps * (distance - k_in)) * towards)
            * (distance - k_in)
            / light_steps
            for m in range(light_steps)
        )
        step = scalar_density(point) * length
        radiance += np.exp(-sigma * (tau + light_tau)) * (1 - np.exp(-sigma * step)) / (4 * np.pi)
        tau += step
    column, row = pixel
    image = reference.render(scene, crop=(column, row, column + 1, row + 1))
    assert near < begin < end  # it starts in the dark
    np.testing.assert_allclose(image[0, 0, :3], radiance, rtol=1e-9)


def depth_by_sampling(volume, origins, directions, far, count=4000):
    t = (np.arange(count) + 0.5) / count * far
    index = index_of((origins[:, None] + t[:, None] * directions[:, None]).reshape(-1, 3))
    padded = np.pad(volume.data.astype(float), 2)
    values = map_coordinates(padded, index.T[::-1] + 2, order=1, mode="constant")
    return volume.density_scale * values.reshape(len(origins), count).mean(axis=1) * far


def test_light_at_the_camera_has_a_closed_form_in_any_density():
    # Both transmittances are the same function, so L = albedo p(-1) I ∫ σ_t D e^(-2 σ_t τ) dt.
    volume = random_volume(np.random.default_rng(7), density_scale=6.0)
    light = SpotLight(from_=CAMERA.from_, to=CAMERA.to, cone=60.0, intensity=(5, 6, 7))
    rgba = reference.render(scene_of(volume, [light], march={"steps": 150}, steps=150))
    tau = depth_by_sampling(volume, *reference.camera_rays(CAMERA), far=8.0)
    tau = np.outer(tau, COLOURED.sigma_t)
    albedo = np.divide(COLOURED.sigma_s, COLOURED.sigma_t)
    back = float(COLOURED.phase.evaluate(-1))
    expected = albedo * back * np.array([5, 6, 7]) * (1 - np.exp(-2 * tau)) / 2
    assert tau.max() > 1
    np.testing.assert_allclose(rgba[..., :3].reshape(-1, 3), expected, atol=2e-3 * expected.max())


@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_no_more_light_leaves_than_was_taken_out(method):
    volume = random_volume(np.random.default_rng(8), density_scale=20.0)
    medium = Medium(sigma_s=(3, 1, 0.2), phase=HenyeyGreenstein(-0.3))
    rgba, aovs = reference.render_with_aovs(scene_of(volume, medium=medium), method)
    phase_max = float(medium.phase.evaluate(-1))
    bound = np.array(WIDE.intensity) * phase_max * (1 - aovs["transmittance"])
    assert (rgba[..., :3] >= 0).all()
    assert (rgba[..., :3] <= bound + 1e-15).all()
    assert rgba[..., :3].max() > 0.1 * bound.max()
    assert (aovs["light_transmittance"] <= 1 + 1e-12).all()


def test_black_medium_hides_and_does_not_glow():
    rgba = reference.render(scene_of(medium=Medium(sigma_s=0.0, sigma_a=2.0)))
    assert not rgba[..., :3].any()
    assert rgba[..., 3].max() > 0.5


@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("empty", ["no density", "no extinction"])
def test_nothing_there_is_an_empty_image(empty, method):
    volume = constant_volume() if empty == "no extinction" else Volume(np.zeros((3, 3, 3)))
    medium = Medium(sigma_s=0.0) if empty == "no extinction" else COLOURED
    scene = scene_of(volume, medium=medium, density_weighting="auto", steps=8)
    rgba, aovs = reference.render_with_aovs(scene, method)
    assert not rgba.any()
    assert (aovs["transmittance"] == 1).all()
    assert not aovs["depth"].any()
    assert not aovs["light_transmittance"].any()


@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_image_is_linear_in_the_lights(method):
    lights = [WIDE, NARROW, WITHIN]
    quick = {"march": {"steps": 20}, "steps": 20}
    both = reference.render(scene_of(lights=lights, **quick), method)
    each = [reference.render(scene_of(lights=[light], **quick), method) for light in lights]
    np.testing.assert_allclose(both[..., :3], sum(image[..., :3] for image in each), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(both[..., 3], each[0][..., 3], rtol=1e-12)
    brighter = WIDE.replace(intensity=(4, 9, 0))  # × 2, 3, 0
    np.testing.assert_allclose(
        reference.render(scene_of(lights=[brighter], **quick), method)[..., :3],
        each[0][..., :3] * (2, 3, 0),
        atol=1e-12,
    )


def test_light_transmittance_is_weighted_by_what_the_camera_sees():
    # Two equal lights in one place count twice, not once: the mean does not move.
    one = reference.render_with_aovs(scene_of(lights=[WIDE], steps=9))[1]["light_transmittance"]
    two = reference.render_with_aovs(scene_of(lights=[WIDE, WIDE], steps=9))[1]["light_transmittance"]
    assert 0 < one.max() < 1
    np.testing.assert_allclose(one, two, rtol=1e-12)


@pytest.mark.parametrize("chunk", [1 << 13, 5])
def test_crop_and_chunks_do_not_change_pixels(monkeypatch, chunk):
    scene = scene_of(
        lights=[WIDE, NARROW], camera=CAMERA.replace(res=(5, 4)), march={"steps": 9}, steps=9, res=4
    )
    whole, layers = reference.render_with_aovs(scene, "tfm")
    monkeypatch.setattr(reference.geometry, "CHUNK", chunk)
    part, cropped = reference.render_with_aovs(scene, "tfm", crop=(1, 0, 4, 2))
    assert part.shape == (2, 3, 4)
    np.testing.assert_allclose(part, whole[0:2, 1:4], rtol=1e-12, atol=1e-15)
    of_all = {"depth", "transmittance", "light_transmittance"}
    assert cropped.keys() == of_all | {"ambient", "light.1", "light.2"}
    for name, layer in cropped.items():
        np.testing.assert_allclose(layer, layers[name][0:2, 1:4], rtol=1e-12, atol=1e-15)


def test_crop_outside_the_frame_is_refused():
    with pytest.raises(SceneError, match=r"crop = \[1, 0, 4, 2\]: should be inside the 3×3 frame"):
        reference.render(scene_of(), crop=(1, 0, 4, 2))


def test_stretch_of_one_is_world_sampling():
    narrow = {"lights": [WITHIN], "medium": Medium(sigma_s=5.0)}
    stretched, free = (
        reference.render(scene_of(**narrow, march={"steps": 7, "max_stretch": stretch})) for stretch in (1, 9)
    )
    world = reference.render(scene_of(**narrow, march={"steps": 7, "sampling": "world"}))
    np.testing.assert_allclose(stretched, world, rtol=1e-12, atol=1e-15)
    assert np.abs(free - world).max() > 1e-3 * world[..., :3].max()


def test_map_image_tends_to_the_dual_march():
    volume = random_volume(np.random.default_rng(9), density_scale=10.0)
    light = SpotLight(from_=(2.0, 2.5, 1.0), to=(0, 0, 0), cone=20.0, intensity=(2, 3, 4))
    of_map = {"steps": 64, "res": 48, "density_weighting": 4.0}
    dual = reference.render(scene_of(volume, [light], **of_map))[..., :3]
    errors = [
        np.abs(reference.render(scene_of(volume, [light], **of_map, coeffs=n), "tfm")[..., :3] - dual).max()
        for n in (1, 2, 4, 12)  # beyond, resolution and steps are what is left
    ]
    assert (np.diff(errors) < 0).all()
    assert errors[-1] < 0.005 * dual.max() < errors[0]


def test_method_is_the_scenes_unless_given():
    scene = scene_of(march={"method": "tfm", "steps": 9}, coeffs=1, steps=9)
    assert (reference.render(scene) == reference.render(scene, "tfm")).all()
    assert (reference.render(scene, "dual") != reference.render(scene, "tfm")).any()


# --- other lights --------------------------------------------------------------------------------------


@pytest.mark.parametrize("march", [{"method": "dual"}, {"method": "tfm"}], ids=["dual", "tfm"])
def test_a_sun_is_a_spot_from_far_away(march):
    direction = np.array([0.4, -0.8, -0.45]) / np.linalg.norm([0.4, -0.8, -0.45])
    sun = SunLight(from_=(0, 0, 0), to=tuple(direction), intensity=(20, 30, 40))
    far = SpotLight(
        from_=tuple(-1e6 * direction), to=(0, 0, 0), cone=np.degrees(2e-6), intensity=sun.intensity
    )
    images = [
        reference.render(scene_of(lights=[light], march=march, res=48, coeffs=8)) for light in (sun, far)
    ]
    assert images[0][..., :3].max() > 0.5
    # Rays differ by a millionth; the maps' texels are of other widths.
    np.testing.assert_allclose(*images, atol=1e-5 if march["method"] == "dual" else 5e-3)


def test_light_march_along_a_suns_rays():
    rng = np.random.default_rng(8)
    sun, points = SunLight(from_=(1, 2, 1.5), to=(0, 0, 0)), rng.uniform(-0.6, 0.6, size=(200, 3))
    against = np.array(sun.from_) / np.linalg.norm(sun.from_)
    exact = segment_depth(points + FAR * against, points)
    found = reference.light_optical_depth(scene_of(lights=[sun], steps=400), sun, points)
    assert exact.mean() > 0.3
    np.testing.assert_allclose(found, exact, atol=2e-4)


@pytest.mark.parametrize("falloff", ["none", "inverse-square"])
def test_a_point_light_is_a_spot_without_a_cone(falloff):
    place = {"from_": (1.5, 2.5, 1.0), "intensity": (50, 60, 70), "falloff": falloff}
    spot, point = SpotLight(**place, to=(0, 0, 0), cone=80.0), PointLight(**place)
    march = {"sampling": "world"}  # a point light's projective depth is constant
    images = [reference.render(scene_of(lights=[light], march=march)) for light in (spot, point)]
    assert images[0][..., :3].max() > 0.1
    np.testing.assert_allclose(*images, rtol=1e-12)
    projective = reference.render(scene_of(lights=[point], march={"sampling": "projective"}))
    assert (projective == images[1]).all()


def test_a_point_lights_map_has_what_the_march_has():
    point = PointLight(from_=(0.05, 0.1, -0.1), intensity=(5, 6, 7))  # within: all of the sphere is used
    scene = scene_of(random_volume(np.random.default_rng(4)), [point], res=96, coeffs=16, steps=100)
    images = [reference.render(scene, method) for method in ("tfm", "dual")]
    np.testing.assert_allclose(*images, atol=0.02 * images[1].max())


def test_an_environment_is_the_sum_of_its_suns():
    sky = EnvironmentLight(intensity=(1, 2, 3), samples=3)
    bounds = constant_volume().bounds
    suns = [part.fitted(bounds) for part in sky.parts()]
    whole = reference.render(scene_of(lights=[sky]))
    parts = [reference.render(scene_of(lights=[sun])) for sun in suns]
    np.testing.assert_allclose(whole[..., :3], np.sum(parts, axis=0)[..., :3], rtol=1e-12)
    np.testing.assert_allclose(whole[..., 3], parts[0][..., 3], rtol=1e-12)
    assert whole[..., :3].max() > 0.1


def test_a_disk_of_light_is_the_sum_of_its_points():
    disk = WIDE.replace(radius=0.5, samples=3)
    whole = reference.render(scene_of(lights=[disk]))
    parts = [reference.render(scene_of(lights=[part])) for part in disk.parts()]
    np.testing.assert_allclose(whole[..., :3], np.sum(parts, axis=0)[..., :3], rtol=1e-12)


def test_a_texture_colours_what_arrives(tmp_path):
    np.save(tmp_path / "halves.npy", np.array([[[1.0, 0, 0], [0, 0, 1]]]))  # red left, blue right
    light = SpotLight(from_=(0, 0, 3), to=(0, 0, 0), texture=str(tmp_path / "halves.npy"), intensity=2)
    points = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    arriving = reference.unshadowed(constant_volume(), light, points)
    np.testing.assert_allclose(arriving, [[2, 0, 0], [1, 0, 1], [0, 0, 2]], atol=1e-12)
