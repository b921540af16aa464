"""Mixtures of bodies in the float64 reference: against closed forms, quadrature, and each other."""

import itertools

import numpy as np
import pytest
from scenes import blobs, turned
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError
from tfm_cl.scene.fields import fields_of
from tfm_cl.scene.lights import EnvironmentLight, PointLight, SpotLight, SunLight
from tfm_cl.scene.solids import SphereSolid

SAME = 1e-12
"""Relative to the brightest: the same sums in another order."""
MAP = 1e-2
"""Of the brightest: 8 or 16 numbers a texel, and the width of texels."""
QUADRATURE = 1e-3
"""Midpoints of 60 to 150 steps against some thousand, of functions with kinks."""
CORE = 2e-4
"""Of the brightest: 300 steps of two placements, where the density is constant but for the border's ways."""

WARM = tfm.Medium(sigma_s=(1.0, 0.7, 0.4), sigma_a=(0.1, 0.2, 0.5), phase=tfm.HenyeyGreenstein(0.4))
COLD = tfm.Medium(sigma_s=(0.2, 0.5, 1.1), sigma_a=(0.3, 0.1, 0.0), phase=tfm.HenyeyGreenstein(-0.3))
GREEN = tfm.Medium(sigma_s=(0.1, 0.9, 0.2), sigma_a=(0.5, 0.0, 0.4))
BRIGHTER = WARM.replace(sigma_s=(2.0, 1.4, 0.8), sigma_a=(0.2, 0.4, 1.0))  # of the same colour
CAMERA = tfm.Camera(from_=(0.4, 0.6, 4.0), to=(0.0, 0.1, 0.0), fov=40, res=(9, 7))
SPOT = SpotLight(from_=(2.2, 2.5, 1.0), to=(0, 0, 0), cone=22, intensity=(30, 20, 10))
WITHIN = PointLight(from_=(0.2, 0.1, -0.4), reach=1.2, intensity=(1, 2, 3))
SUN = SunLight(from_=(1, 2, 0.5), to=(0, 0, 0), intensity=(5, 4, 6))
AMBIENT = tfm.Ambient(radiance=(0.5, 1.0, 2.0))
FEW = {"march": {"steps": 8}, "map": {"res": 8, "steps": 8}}
"""For what holds however many steps there are."""
FIRST = turned(25, (1, 2, 0.5), (0.12, 0.16, 0.11), (-0.9, -0.8, -0.8))
SECOND = turned(-40, (0.3, 1, 2), (0.08, 0.1, 0.12), (-0.2, -0.6, -0.3))


def grid(matrix=FIRST, medium=None, seed=7, scale=2.0, **changes):
    return tfm.Volume(
        blobs(seed=seed), world_from_index=matrix, density_scale=scale, medium=medium, **changes
    )


def rainbow():
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in (14, 12, 16)), indexing="ij")
    return np.stack([1.5 - 1.4 * x, 0.6 + 0.5 * np.sin(7 * y + 2 * z), 0.1 + 1.2 * x * z], axis=-1)


def box(low=(-1.2, -0.9, -1.1), high=(1.0, 1.1, 1.3), density=0.5, medium=None):
    return tfm.BoxVolume(from_=low, to=high, density=density, medium=medium)


def ball(centre=(0.3, 0.2, 0.1), radius=0.8, density=0.7, medium=None):
    return tfm.SphereVolume(centre=centre, radius=radius, density=density, medium=medium)


def fog(density=0.1, medium=None):
    return tfm.EverywhereVolume(density=density, medium=medium)


def scene_of(bodies, lights=(SPOT,), march=None, **changes):
    of_map = changes.pop("map", {})
    return tfm.Scene(
        bodies,
        changes.pop("medium", WARM),
        changes.pop("camera", CAMERA),
        list(lights),
        march=tfm.MarchSettings(**{"steps": 24, "cutoff": 0.0, "method": "dual", **(march or {})}),
        map=tfm.MapSettings(
            **{"basis": "dct", "coeffs": 8, "density_weighting": 4.0, "res": 16, "steps": 24, **of_map}
        ),
        **changes,
    )


def pictures(scene, method=None):
    image, layers = reference.render_with_aovs(scene, method)
    return {"image": image, **layers}


def assert_same(one, other, tolerance=SAME):
    assert one["image"][..., :3].max() > 1e-3
    for name, picture in one.items():
        largest = max(1.0, np.abs(other[name]).max())
        # Means are divided by an opacity that may be next to nothing.
        seen = other["image"][..., 3] > 1e-3 if name in ("depth", "light_transmittance") else slice(None)
        difference = np.abs(picture - other[name])[seen].max(initial=0)
        assert difference <= tolerance * largest, (name, difference)


MIXTURES = {
    "two media": [grid(medium=WARM), grid(SECOND, COLD, 11)],
    "three media": [
        grid(medium=WARM),
        grid(SECOND, COLD, 11),
        grid(SECOND @ turned(50, (1, 0, 0)), GREEN, 3),
    ],
    "one colour twice": [grid(medium=WARM), grid(SECOND, BRIGHTER, 11)],
    "coloured beside grey": [grid(medium=WARM, colour=rainbow()), grid(SECOND, COLD, 11)],
    "grid in a box": [grid(), box(medium=COLD)],
    "grid, ball and fog": [grid(), ball(medium=GREEN), fog(medium=COLD)],
    "box and ball": [box(), ball(medium=COLD)],
}
FIELDS = {
    "two media": 2,
    "three media": 3,
    "one colour twice": 1,
    "coloured beside grey": 3,
    "grid in a box": 1,
    "grid, ball and fog": 1,
    "box and ball": 0,
}
every_mixture = pytest.mark.parametrize("bodies", MIXTURES.values(), ids=MIXTURES)
both_methods = pytest.mark.parametrize("method", ["tfm", "dual"])


# --- pieces ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("body", [box(), ball(), fog()], ids=["box", "sphere", "everywhere"])
def test_intervals_of_bodies_against_points(body, rng):
    origins, directions = rng.normal(size=(2, 500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:30] = np.repeat(np.eye(3), 10, axis=0)
    limit = rng.uniform(0, 4, 500)
    begin, end = reference.body_interval(body, origins, directions, limit)
    t = rng.uniform(0, 5, (500, 100))
    points = origins[:, None] + t[..., None] * directions[:, None]
    inside = body.contains(points)
    np.testing.assert_array_equal((t > begin[:, None]) & (t < end[:, None]), inside & (t < limit[:, None]))


@pytest.mark.parametrize("light", [SPOT, WITHIN, SUN], ids=["spot", "point within", "sun"])
def test_ways_of_the_light_against_points(light, rng):
    scene = scene_of([box(), ball(), box((-0.5, 3, -9), (9, 30, 9))], [light])
    fitted = light.fitted(scene.occupied_bounds)
    points = rng.uniform(-1.5, 1.5, (40, 3))
    found = reference.light_ways(scene, fitted, points)

    far, count = 60.0, 60_000
    upstream = -fitted.arrival(points).direction
    length = np.minimum(fitted.source_distance(points), far)
    along = (np.arange(count) + 0.5) / count
    for i, body in enumerate(scene.bodies):
        for n in range(len(points)):
            at = points[n] + (along * length[n])[:, None] * upstream[n]
            assert found[n, i] == pytest.approx(body.contains(at).mean() * length[n], abs=2 * far / count)


def test_a_sun_is_followed_upstream_of_where_its_map_begins():
    # The map is fitted to the grid; the box lies before it, and around where its rays begin.
    canopy = box((-3, 2, -3), (3, 5, 3), density=0.4)
    down = SunLight(from_=(0, 1, 0), to=(0, 0, 0))
    scene = scene_of([grid(), canopy], [down])
    fitted = down.fitted(scene.grids[0].occupied_bounds)
    points = np.array([[0.0, 0, 0], [0.0, 3, 0], [0.0, 9, 0]])
    assert fitted.arrival(points).distance[1] < 0
    np.testing.assert_allclose(reference.light_ways(scene, fitted, points)[:, 0], [3, 2, 0], atol=ROUNDED)


def test_field_density_is_the_extinction_of_every_channel(rng):
    bodies = MIXTURES["coloured beside grey"]
    scene, points = scene_of(bodies), rng.uniform(-0.8, 0.8, (300, 3))
    fields = fields_of(scene)
    coloured = np.stack([reference.density(part, points) for part in bodies[0].channels], axis=-1)
    expected = coloured * WARM.sigma_t + reference.density(bodies[1], points)[:, None] * COLD.sigma_t
    found = reference.field_density(scene.grids, fields.weights, points) @ fields.rgb_from_field.T
    assert expected.max() > 1
    np.testing.assert_allclose(found, expected, atol=ROUNDED)


@every_mixture
def test_fields_of_the_mixtures(bodies):
    names = {id(value): name for name, value in MIXTURES.items()}
    assert fields_of(scene_of(bodies)).count == FIELDS[names[id(bodies)]]


# --- mixtures that are one body --------------------------------------------------------------------------


@both_methods
def test_overlapping_boxes_are_a_denser_box(method):
    whole = scene_of(box(density=0.8), [SPOT, SUN], ambient=AMBIENT)
    parts = whole.replace(volume=[box(density=0.5), box(density=0.3)])
    one, other = (pictures(scene, method) for scene in (whole, parts))
    assert_same(other, one)


@both_methods
def test_halves_are_a_box(method):
    middle = 0.15
    whole = scene_of(box(), [SPOT, SUN, WITHIN], ambient=AMBIENT)
    halves = whole.replace(volume=[box(high=(middle, 1.1, 1.3)), box(low=(middle, -0.9, -1.1))])
    one, other = (pictures(scene, method) for scene in (whole, halves))
    assert_same(other, one)


@both_methods
def test_halves_of_a_box_around_a_grid(method):
    whole = scene_of([grid(medium=COLD), box()], [SPOT, WITHIN], ambient=AMBIENT)
    halves = whole.replace(
        volume=[box(high=(0.15, 1.1, 1.3)), grid(medium=COLD), box(low=(0.15, -0.9, -1.1))]
    )
    assert_same(pictures(halves, method), pictures(whole, method))


@both_methods
def test_a_grid_of_a_scaled_medium_is_a_denser_grid(method):
    scaled = scene_of([grid(), grid(SECOND, BRIGHTER, 11)], map={"density_weighting": "auto"})
    denser = scaled.replace(volume=[grid(), grid(SECOND, None, 11, scale=4.0)])
    # A map's number stands for the transmittance of the density: its unit differs.
    assert_same(pictures(scaled, method), pictures(denser, method), SAME if method == "dual" else MAP)


def test_fog_in_a_constant_grid_is_a_denser_grid():
    # Rays through the core: they leave the grid where its density falls off, over one voxel of 60.
    count, half = 60, 1.0
    voxels = np.ones((count,) * 3, np.float32)
    at = {"voxel_size": 2 * half / count, "origin": (-half,) * 3}
    camera = tfm.Camera(from_=(0.1, 0.05, 0.2), to=(0.3, 0.2, -1), fov=20, res=(3, 3))
    lamp = PointLight(
        from_=(-0.4, 0.3, 0.1), reach=0.6, intensity=100
    )  # all that is lit lies within the core
    march = {"steps": 300}
    mixture = scene_of(
        [tfm.Volume(voxels, **at, density_scale=0.6), fog(0.5)],
        [lamp],
        march,
        camera=camera,
        map={"steps": 300},
    )
    denser = mixture.replace(volume=[tfm.Volume(voxels, **at, density_scale=1.1)])
    ours, truth = (reference.render(scene)[..., :3] for scene in (mixture, denser))
    assert truth.max() > 0.01
    np.testing.assert_allclose(ours, truth, atol=CORE * truth.max())


# --- against quadrature ----------------------------------------------------------------------------------


def exact_pixel(scene, nodes=400, light_nodes=400):
    """Single scattering of a scene of one pixel (eq. 4-6): midpoints between all surfaces on the ray."""
    rays = reference.camera_rays(scene.camera)
    origin, direction = rays.origins[0], rays.directions[0]
    ends = [reference.body_interval(body, *rays) for body in scene.homogeneous]
    ends += [light.interval(*rays) for light in scene.lights]
    cuts = np.unique(np.clip([0, 9, *np.ravel(ends)], 0, 9))
    steps = np.repeat(np.diff(cuts) / nodes, nodes)[:, None]
    t = (np.cumsum(steps) - steps[:, 0] / 2)[:, None]
    points = origin + t * direction

    def densities(at):
        of_grids = [reference.density(body, at) for body in scene.grids]
        of_shapes = [body.density * body.contains(at) for body in scene.homogeneous]
        return np.stack([*of_grids, *of_shapes], axis=-1)

    media = [scene.medium_of(body) for body in (*scene.grids, *scene.homogeneous)]
    sigma_t = np.array([medium.sigma_t for medium in media])
    sigma_s = np.array([medium.sigma_s for medium in media])
    here = densities(points)
    depth = here @ sigma_t * steps
    seen = np.exp(-(np.cumsum(depth, axis=0) - depth / 2)) * steps
    radiance = (seen * (here @ sigma_s)).sum(axis=0) * scene.ambient.radiance
    for light in scene.lights:
        lit = light.reaches(points) & (here.sum(axis=1) > 0)
        offset = points[lit] - light.from_
        distance = np.linalg.norm(offset, axis=1)
        s = (np.arange(light_nodes) + 0.5) / light_nodes
        between = densities(np.array(light.from_) + s[:, None] * offset[:, None]).mean(axis=1)
        arrives = np.exp(-between * distance[:, None] @ sigma_t) * light.intensity
        if light.falloff == "inverse-square":
            arrives /= distance[:, None] ** 2
        mu = -(offset @ direction) / distance
        phases = np.stack([medium.phase.evaluate(mu) for medium in media], axis=-1)
        radiance += (seen[lit] * ((here[lit] * phases) @ sigma_s) * arrives).sum(axis=0)
    return radiance, np.exp(-depth.sum(axis=0))


ONE_PIXEL = CAMERA.replace(res=(1, 1), to=(0.1, 0.1, 0.0))


@pytest.mark.parametrize(
    "bodies",
    [
        [box(density=1.2, medium=WARM), box(density=0.6, medium=COLD)],
        [box(), ball(medium=COLD)],
        [grid(medium=WARM), grid(SECOND, COLD, 11)],
        [grid(), ball((0.6, 0.4, 1.2), 1.0, medium=GREEN)],
    ],
    ids=["two media in one box", "box and ball", "two grids", "grid and ball"],
)
def test_a_ray_against_quadrature(bodies):
    lights = [PointLight(from_=(1.3, 1.6, 0.9), falloff="inverse-square"), SPOT.replace(intensity=2)]
    scene = scene_of(bodies, lights, {"steps": 150}, camera=ONE_PIXEL, ambient=AMBIENT, map={"steps": 150})
    image, layers = reference.render_with_aovs(scene)
    radiance, transmittance = exact_pixel(scene)
    assert radiance.min() > 0.05
    np.testing.assert_allclose(image[0, 0, :3], radiance, rtol=QUADRATURE)
    np.testing.assert_allclose(layers["transmittance"][0, 0], transmittance, rtol=QUADRATURE)


def test_two_media_in_a_box_have_a_closed_form():
    # Light from the camera itself: both ways are one, and L = I Σ σ_s p(-1) (1 - e^(-2 σ L)) / (2 σ).
    light = PointLight(from_=ONE_PIXEL.from_, intensity=(1, 2, 3))
    bodies = [box(density=1.2, medium=WARM), box(density=0.6, medium=COLD)]
    scene = scene_of(bodies, [light], {"steps": 800}, camera=ONE_PIXEL)
    begin, end = reference.body_interval(bodies[0], *reference.camera_rays(ONE_PIXEL))
    sigma = sum(body.density * body.medium.sigma_t for body in bodies)
    back = sum(
        body.density * np.array(body.medium.sigma_s) * body.medium.phase.evaluate(-1) for body in bodies
    )
    expected = light.intensity * back * -np.expm1(-2 * sigma * (end - begin)) / (2 * sigma)
    image, layers = reference.render_with_aovs(scene)
    np.testing.assert_allclose(image[0, 0, :3], expected, rtol=1e-5)  # 800 steps, second order
    np.testing.assert_allclose(layers["transmittance"][0, 0], np.exp(-sigma * (end - begin)), rtol=ROUNDED)


# --- what holds for every mixture ------------------------------------------------------------------------


@both_methods
@every_mixture
def test_the_order_of_bodies_does_not_matter(bodies, method):
    expected = None
    for order in itertools.islice(itertools.permutations(bodies), 3):
        found = pictures(scene_of(order, [SPOT, WITHIN], ambient=AMBIENT, **FEW), method)
        expected = expected or found
        assert_same(found, expected)


@both_methods
@every_mixture
def test_pictures_are_linear_in_the_lights(bodies, method):
    scene = scene_of(bodies, [SPOT, WITHIN], ambient=AMBIENT, **FEW)
    together = pictures(scene, method)
    alone = [
        pictures(scene.replace(lights=lights, ambient=ambient), method)
        for lights, ambient in (([SPOT], None), ([WITHIN], None), ([], AMBIENT))
    ]
    total = sum(picture["image"][..., :3] for picture in alone)
    np.testing.assert_allclose(together["image"][..., :3], total, rtol=SAME, atol=SAME)
    for picture in alone:
        np.testing.assert_array_equal(picture["image"][..., 3], together["image"][..., 3])
        np.testing.assert_array_equal(picture["transmittance"], together["transmittance"])
        np.testing.assert_array_equal(picture["depth"], together["depth"])


@every_mixture
def test_maps_of_the_fields_give_what_the_dual_march_gives(bodies):
    scene = scene_of(bodies, map={"coeffs": 16, "res": 48, "steps": 48}, march={"steps": 12})
    dual, from_maps = (reference.render(scene, method)[..., :3] for method in ("dual", "tfm"))
    assert dual.max() > 0.01
    assert np.abs(dual - from_maps).max() < MAP * dual.max()
    if not scene.grids:
        np.testing.assert_array_equal(dual, from_maps)


@every_mixture
def test_without_lights_there_is_ambient_light_alone(bodies):
    scene = scene_of(bodies, [], ambient=AMBIENT, **FEW)
    for method in ("tfm", "dual"):
        image, layers = reference.render_with_aovs(scene, method)
        assert image[..., :3].max() > 0.01
        assert not layers["light_transmittance"].any()
        # No more than all that does not pass is scattered.
        bound = (1 - layers["transmittance"]) * AMBIENT.radiance
        assert (image[..., :3] <= bound + ROUNDED).all()
    dark = reference.render(scene.replace(ambient=None))
    assert not dark[..., :3].any()
    np.testing.assert_array_equal(dark[..., 3], image[..., 3])


def test_ambient_light_of_one_medium_is_its_albedo_of_what_does_not_pass():
    for bodies in ([grid(), box()], [grid(), fog()], [grid(), grid(SECOND, WARM, 11), ball()]):
        image, layers = reference.render_with_aovs(scene_of(bodies, [], ambient=AMBIENT))
        albedo = np.divide(WARM.sigma_s, WARM.sigma_t)
        expected = albedo * AMBIENT.radiance * (1 - layers["transmittance"])
        np.testing.assert_allclose(image[..., :3], expected, atol=ROUNDED)


@both_methods
def test_a_coloured_grid_is_three_grey_scenes(method):
    colour, lights = rainbow(), [SPOT, SUN]
    coloured = scene_of(grid(colour=colour), lights, ambient=AMBIENT, **FEW)
    found = pictures(coloured, method)
    for c in range(3):
        grey = scene_of(
            coloured.bodies[0].channels[c],
            [light.replace(intensity=light.intensity[c]) for light in lights],
            medium=WARM.replace(sigma_s=WARM.sigma_s[c], sigma_a=WARM.sigma_a[c]),
            ambient=tfm.Ambient(radiance=AMBIENT.radiance[c]),
            **FEW,
        )
        expected = pictures(grey, method)
        np.testing.assert_allclose(found["image"][..., c], expected["image"][..., c], rtol=1e-9, atol=SAME)
        np.testing.assert_allclose(
            found["transmittance"][..., c], expected["transmittance"][..., c], rtol=1e-9
        )


def test_auto_density_weighting_is_each_fields_own():
    colour = np.broadcast_to(np.float32([1, 0.4, 3]), (14, 12, 16, 3))
    scene = scene_of(grid(colour=colour), medium=tfm.Medium(sigma_s=0.8), map={"density_weighting": "auto"})
    for field in range(3):
        grey = scene.replace(volume=scene.bodies[0].channels[field])
        assert reference.density_weighting(scene, field) == pytest.approx(reference.density_weighting(grey))
    assert len({reference.density_weighting(scene, field) for field in range(3)}) > 1


# --- the steps -------------------------------------------------------------------------------------------


def test_few_steps_follow_the_definition():
    """Far from convergence, number by number: a grid in the middle of a box, lit by a narrow cone."""
    steps, light_steps = 5, 3
    voxels = tfm.Volume(np.full((2, 2, 2), 1.5, np.float32), voxel_size=0.4, origin=(-0.4,) * 3, medium=COLD)
    haze = box((-2, -2, -2), (2, 2, 2), density=0.2)
    camera = tfm.Camera(from_=(0, 0, 5), to=(0, 0, 0), res=(1, 1))
    light = SpotLight(from_=(0, 4, 0.4), to=(0, 0, 0.4), cone=17.0, intensity=(1, 2, 3))
    march = {"steps": steps, "sampling": "world"}
    scene = scene_of([voxels, haze], [light], march, camera=camera, map={"steps": light_steps})

    def trilinear(at):
        index = (at + 0.4) / 0.4 - 0.5
        return 1.5 * np.prod(np.clip(np.minimum(index + 1, 2 - index), 0, 1))

    half = 4 * np.tan(np.radians(17))  # of the cone on the camera's ray, 0.4 before and behind its middle
    begin, end = 5 - 0.4 - half, 5 - 0.4 + half
    near, far = 5 - 0.6, 5 + 0.6  # the grid with its border
    through = np.exp(-0.2 * (begin - 3) * WARM.sigma_t)  # the haze before the cone; the grid lies behind it
    assert begin < near < far < end
    edges = []
    for low, high, count in (
        (begin, near, int(np.ceil(steps * (near - begin) / (end - begin)))),
        (near, far, steps),
        (far, end, int(np.ceil(steps * (end - far) / (end - begin)))),
    ):
        edges += [
            (low + (high - low) * n / count, low + (high - low) * (n + 1) / count) for n in range(count)
        ]
    source = np.array(light.from_)
    radiance = np.zeros(3)
    for t0, t1 in edges:
        point = np.array([0, 0, 5 - (t0 + t1) / 2])
        distance = np.linalg.norm(point - source)
        towards = (point - source) / distance
        mu = towards[2]  # towards the camera, which is along z
        amounts = trilinear(point) * (t1 - t0), 0.2 * (t1 - t0)
        depth = amounts[0] * COLD.sigma_t + amounts[1] * WARM.sigma_t
        inside = (source[1] - 2) / -towards[1]  # where the light enters the haze
        # The grid's box, from above or through a side; it ends at the point or where the box does.
        with np.errstate(divide="ignore"):
            planes = np.sort(
                (np.array([[-0.6] * 3, [0.6] * 3]) - source) / np.where(towards, towards, 1e-300), 0
            )
        k_in, k_out = planes[0].max(), planes[1].min()
        length = max(min(distance, k_out) - k_in, 0)
        tau = sum(
            trilinear(source + (k_in + (m + 0.5) / light_steps * length) * towards) * length / light_steps
            for m in range(light_steps)
        )
        left = np.exp(-tau * COLD.sigma_t - 0.2 * (distance - inside) * WARM.sigma_t)
        scatters = amounts[0] * np.array(COLD.sigma_s) * COLD.phase.evaluate(mu)
        scatters += amounts[1] * np.array(WARM.sigma_s) * WARM.phase.evaluate(mu)
        radiance += through * (1 - np.exp(-depth)) * scatters / depth * left * light.intensity
        through = through * np.exp(-depth)
    np.testing.assert_allclose(reference.render(scene)[0, 0, :3], radiance, rtol=1e-9)


def test_what_lies_before_the_light_dims_it_unless_as_the_paper_has_it():
    # Fog and a grid stand between the camera and the lit part of a ball.
    bodies = [grid(turned(0, (0, 0, 1), (0.05,) * 3, (-0.15, 0.1, 2.0))), ball(medium=COLD)]
    lamp = PointLight(from_=(0.3, 0.9, 0.1), reach=0.9, intensity=4)
    scene = scene_of(bodies, [lamp], {"steps": 60}, camera=ONE_PIXEL, map={"steps": 60})
    consistent = reference.render(scene)[0, 0, :3]
    paper = reference.render(scene.replace(march=scene.march.replace(attenuation="paper")))[0, 0, :3]
    rays = reference.camera_rays(ONE_PIXEL)
    t = np.linspace(0, 3, 3000)
    tau = reference.density(bodies[0], rays.origins + t[:, None] * rays.directions).mean() * 3
    lit, _ = lamp.interval(*rays)
    inside, _ = reference.body_interval(bodies[1], *rays)
    before = np.exp(-tau * WARM.sigma_t - max(lit[0] - inside[0], 0) * bodies[1].density * COLD.sigma_t)
    assert tau > 0.3
    np.testing.assert_allclose(consistent, paper * before, rtol=QUADRATURE)


def test_a_medium_everywhere_is_marched_as_far_as_it_is_seen():
    cutoff, density = 1e-3, 0.35
    deepest = density * WARM.sigma_t.min()
    end = -np.log(cutoff) / deepest
    lamp = PointLight(from_=(0.2, 0.1, -0.4))
    scene = scene_of(
        fog(density), [lamp], {"steps": 7, "cutoff": cutoff, "sampling": "world"}, camera=ONE_PIXEL
    )
    rays = reference.camera_rays(ONE_PIXEL)
    edges = np.arange(8) / 7 * end
    t = (edges[1:] + edges[:-1]) / 2
    offset = rays.origins + t[:, None] * rays.directions - lamp.from_
    distance = np.linalg.norm(offset, axis=1)
    mu = -(offset @ rays.directions[0]) / distance
    opacity = -np.diff(np.exp(-density * np.outer(edges, WARM.sigma_t)), axis=0)
    albedo = np.divide(WARM.sigma_s, WARM.sigma_t)
    arrives = WARM.phase.evaluate(mu)[:, None] * np.exp(-density * np.outer(distance, WARM.sigma_t))
    expected = (opacity * albedo * arrives).sum(axis=0)
    np.testing.assert_allclose(reference.render(scene)[0, 0, :3], expected, rtol=1e-9)


@pytest.mark.parametrize("light", [SUN, EnvironmentLight(samples=2)], ids=["sun", "environment"])
def test_light_from_infinity_cannot_cross_a_medium_everywhere(light):
    with pytest.raises(SceneError, match=r"light 2 .* comes from infinitely far away"):
        reference.render(scene_of([grid(), fog()], [SPOT, light]))


# --- depth, solids, single bodies ------------------------------------------------------------------------


def test_depth_of_one_body_is_a_closed_form():
    sigma = 0.8
    camera = tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(1, 1))
    grey = tfm.Medium(sigma_s=1.0)

    def depth(body):
        return reference.render_with_aovs(scene_of(body, [], camera=camera, medium=grey))[1]["depth"][0, 0]

    x, weights = np.polynomial.legendre.leggauss(30)
    for density in (0.8, 5.1e-3, 4.9e-3, 1e-4):  # on both sides of where a series takes over
        opacity = weights * np.exp(-density * (1 + x))
        mean = opacity @ (1 + x) / opacity.sum()
        assert depth(tfm.BoxVolume(density=density)) == pytest.approx(3 + mean, rel=ROUNDED)
    assert depth(tfm.BoxVolume(density=1e-30)) == pytest.approx(4, rel=ROUNDED)
    assert depth(fog(sigma)) == pytest.approx(1 / sigma, rel=ROUNDED)


@pytest.mark.parametrize("steps", [1, 7, 40])
def test_depth_of_a_mixture_is_the_closed_form(steps):
    # Steps without grids know their mean distances: however few there are, two boxes of one extent are one.
    camera = tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(1, 1))
    one = scene_of(tfm.BoxVolume(density=0.8), [], {"steps": steps}, camera=camera)
    two = one.replace(volume=[tfm.BoxVolume(density=0.5), tfm.BoxVolume(density=0.3)])
    exact, found = (reference.render_with_aovs(scene)[1]["depth"] for scene in (one, two))
    np.testing.assert_allclose(found, exact, rtol=ROUNDED)


def test_solids_in_a_mixture():
    # A white ball before a black background, seen through fog and lit through it.
    stone = SphereSolid(centre=(0.1, 0.1, 0), radius=0.5, albedo=(0.5, 0.6, 0.7))
    lamp = PointLight(from_=ONE_PIXEL.from_, intensity=(3, 2, 1))
    bodies = [box((-2, -2, 1), (2, 2, 2), density=0.7), box((-2, -2, -2), (2, 2, 3), 0.2, COLD)]
    scene = scene_of(bodies, [lamp], camera=ONE_PIXEL, solids=[stone], ambient=AMBIENT)
    rays = reference.camera_rays(ONE_PIXEL)
    hit, normal = stone_hit(stone, rays)
    ways = [float(np.subtract(*reference.body_interval(body, *rays, hit)[::-1])[0]) for body in bodies]
    depth = 0.7 * ways[0] * WARM.sigma_t + 0.2 * ways[1] * COLD.sigma_t
    image, layers = reference.render_with_aovs(scene.replace(ambient=None))
    black = scene.replace(ambient=None, solids=[stone.replace(albedo=(0, 0, 0))])
    surface = (image - reference.render(black))[0, 0, :3]
    cosine = -(rays.directions[0] @ normal)
    expected = np.array(stone.albedo) / np.pi * cosine * np.array(lamp.intensity) * np.exp(-2 * depth)
    np.testing.assert_allclose(surface, expected, rtol=1e-5)  # the tracer's distances are float32
    np.testing.assert_allclose(layers["transmittance"][0, 0], np.exp(-depth), rtol=1e-5)
    assert image[0, 0, 3] == 1
    of_ambient = (reference.render(scene) - image)[0, 0, :3]
    reflected = np.array(stone.albedo) * AMBIENT.radiance * np.exp(-depth)
    assert (of_ambient > reflected).all()  # and what the bodies scatter


def stone_hit(stone, rays):
    offset = rays.origins[0] - stone.centre
    along = -(offset @ rays.directions[0])
    hit = along - np.sqrt(stone.radius**2 - offset @ offset + along**2)
    return hit, (offset + hit * rays.directions[0]) / stone.radius


@pytest.mark.parametrize("solids", [(), (SphereSolid(centre=(0, 0, 0), radius=0.1),)], ids=["bare", "solid"])
def test_maps_look_at_the_grids_unless_solids_shadow_all_bodies(solids):
    scene = scene_of([grid(), box((-3, -3, -3), (3, 3, 3))], solids=solids)
    bounds = scene.occupied_bounds if solids else scene.grids[0].occupied_bounds
    found = reference.fitting.fitted(scene, SUN)
    assert found.map_key() == SUN.fitted(bounds).map_key()


def test_maps_to_compare_with_are_one_for_each_light_and_field():
    scene = scene_of(MIXTURES["two media"], [SPOT, WITHIN])
    with pytest.raises(SceneError, match="3 maps to compare with, of 2 lights and 2 fields"):
        reference.render(scene, "tfm", maps=[None] * 3)
