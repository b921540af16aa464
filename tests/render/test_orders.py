"""Orders of scattering after the first: as the float64 reference has them, and as the light's energy does."""

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import LIGHTS, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device import launch
from tfm_cl.plan import orders
from tfm_cl.render import frame
from tfm_cl.render import orders as of_render
from tfm_cl.render.regions import LitRegions

pytestmark = pytest.mark.lanes

RGB = make_scene().medium.replace(phase=tfm.Isotropic(), orders=3)
GREY = tfm.Medium(sigma_s=0.8, sigma_a=0.2, orders=3)
SCENE = make_scene(medium=RGB)
GRID, SPOT = SCENE.volume, SCENE.lights[0]
SUN = tfm.SunLight(from_=(1, 2, 1), to=(0, 0, 0))
BOX = tfm.BoxVolume(from_=(-0.9, -0.5, -0.6), to=(0.4, 0.7, 0.3), density=0.7)
BALL = tfm.SphereVolume(centre=(0.4, 0.3, 0.2), radius=0.6, density=1.3)
OTHER = GRID.transformed(np.diag([1.2, -1, 0.8, 1]))
BROWN = tfm.Medium(sigma_s=(0.7, 0.4, 0.2), sigma_a=(0.2, 0.4, 0.6), phase="hg:0.3", orders=3)
POINTS = tfm.Points([[0.3, 0.2, 0.1], [-0.4, 0.1, -0.3], [0.1, -0.5, 0.2]], [0.5, 0.4, 0.35], [1.5, 2, 1])
SOLIDS = [tfm.SphereSolid(centre=(0.5, 0.6, 0.3), radius=0.3), tfm.PlaneSolid(point=(0, -0.8, 0))]
CASES = {
    "colours": SCENE,
    "grey": SCENE.replace(medium=GREY),
    "lobe": make_scene(medium=RGB.replace(phase="hg:0.8")),
    "lobe, an even sky": make_scene(
        medium=RGB.replace(phase="hg:0.8"), lights=[tfm.EnvironmentLight(intensity=0.3, samples=4), SUN]
    ),
    "grey lobe, a map of depths": make_scene(
        medium=GREY.replace(phase="hg:-0.3"), map=SCENE.map.replace(basis="fourier", coeffs=7)
    ),
    "coloured lights": SCENE.replace(
        medium=GREY, lights=[SPOT, SPOT.replace(from_=(-2, 1, 2.5), intensity=(0.5, 1, 3)), SUN]
    ),
    "solids": SCENE.replace(medium=GREY, solids=SOLIDS, shadow=tfm.ShadowSettings(res=64)),
    "solids, a lobe, a glow": make_scene(
        medium=RGB.replace(phase="hg:0.6", emission=(0.4, 0.2, 0.1)),
        solids=[SOLIDS[0].replace(albedo=(0.9, 0.5, 0.2)), SOLIDS[1]],
        shadow=tfm.ShadowSettings(res=64),
    ),
    "coloured voxels": SCENE.replace(
        volume=tfm.Volume(
            blobs(),
            world_from_index=GRID.world_from_index,
            density_scale=4.0,
            colour=np.linspace(0.2, 1, blobs().size * 3).reshape(*blobs().shape, 3),
        )
    ),
    "grid, box, ball": SCENE.replace(volume=[GRID, BOX, BALL], medium=GREY),
    "box": SCENE.replace(volume=BOX),
    "two media": SCENE.replace(volume=[GRID, OTHER.with_medium(BROWN), BALL.with_medium(GREY)]),
    "two media of lobes": SCENE.replace(
        volume=[GRID.with_medium(RGB.replace(phase="hg:0.8")), BOX.with_medium(BROWN)], lights=[SPOT, SUN]
    ),
    "glow": SCENE.replace(medium=RGB.replace(emission=(2, 1, 0.5))),
    "grey glow, no light": SCENE.replace(medium=GREY.replace(emission=(2, 1, 0.5)), lights=[]),
    "two media, one glows": SCENE.replace(
        volume=[GRID.with_medium(RGB.replace(phase="hg:0.8", emission=(2, 1, 0.5))), BOX.with_medium(BROWN)]
    ),
    "one glows, one lights by itself": SCENE.replace(
        volume=[GRID, BALL.with_medium(tfm.Medium(sigma_s=0, sigma_a=0.1, emission=2))],
        medium=RGB.replace(emission=1, emission_lights=2),
    ),
    "fog": SCENE.replace(volume=[GRID, tfm.EverywhereVolume(density=0.2, medium=BROWN)], solids=SOLIDS[:1]),
}
OF_PRIMITIVES = {
    "points": SCENE.replace(volume=[POINTS], medium=RGB.replace(phase="hg:0.3")),
    "points, grid": SCENE.replace(volume=[GRID, POINTS.with_medium(BROWN.replace(emission=(0.5, 0.3, 0)))]),
}


@pytest.fixture
def coarse(monkeypatch):
    """Lattices of few points, two voxels apart, which a reference fills in seconds."""
    monkeypatch.setattr(orders, "WORK", 1)
    monkeypatch.setattr(orders, "WORK_OF_LOBE", 1)
    monkeypatch.setattr(orders, "OF_SMALLEST_BODY", 1 / 6)
    monkeypatch.setattr(orders, "FEWEST_SAMPLES", 2)


@pytest.mark.usefixtures("coarse")
@pytest.mark.quick("colours-tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("what", CASES)
def test_picture_equals_the_reference(renderer, save_on_failure, what, method):
    scene = CASES[what]
    result = renderer.render(scene, method=method)
    image = result.image
    expected, layers = reference.render_with_aovs(scene, method, shadows="map")
    brightest = max(1.0, float(expected[..., :3].max()))
    # Later orders show, far beyond what may differ.
    assert layers["orders"].max() > 1e-2
    with save_on_failure(image, expected.astype(np.float32)):
        assert np.abs(image - expected).max() < 20 * PASS * brightest
    assert np.abs(result.aovs["orders"] - layers["orders"]).max() < 20 * PASS * brightest


@pytest.mark.usefixtures("coarse")
@pytest.mark.quick("colours")
@pytest.mark.parametrize("what", ["colours", "solids, a lobe, a glow", "two media of lobes", "fog"])
def test_launches_however_short_do_the_same(new_renderer, renderer, monkeypatch, what):
    """Where a sweep is cut among its directions, and among the rays of one."""
    whole = renderer.render(CASES[what])
    monkeypatch.setattr(launch, "FIRST_BOUNDED", 1)  # of the kernels, too, that nothing is known of
    with new_renderer(lanes=renderer.lanes, launch_seconds=1e-9) as cut:
        found = cut.render(CASES[what])
    np.testing.assert_array_equal(found.aovs["orders"], whole.aovs["orders"])


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("what", OF_PRIMITIVES)
def test_orders_of_primitives_equal_the_reference(renderer, what):
    """Of its maps, as the reference's own know nothing of what is thinner than texels."""
    scene = OF_PRIMITIVES[what]
    found, maps = renderer.render(scene), renderer.build_maps(scene)
    _, layers = reference.render_with_aovs(scene, maps=maps, shadows="map")
    assert layers["orders"].max() > 1e-2
    assert np.abs(found.aovs["orders"] - layers["orders"]).max() < 20 * PASS


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_orders_of_fire_equal_the_reference(renderer, tmp_path):
    """Of heat that reaches beyond the smoke."""
    path = tmp_path / "fire.npz"
    np.savez(path, density=blobs(), heat=np.roll(blobs(seed=11), 2, axis=1), voxel_size=(0.15, 0.2, 0.14))
    smoke = RGB.replace(phase="hg:0.6", temperature="heat", temperature_scale=2000, Le_scale=3)
    scene = SCENE.replace(volume=tfm.Volume.load(path, density_scale=4.0), medium=smoke, lights=[])
    found, layers = renderer.render(scene), reference.render_with_aovs(scene)[1]
    assert layers["orders"].max() > 1e-2
    assert np.abs(found.aovs["orders"] - layers["orders"]).max() < 20 * PASS * layers["orders"].max()


@pytest.mark.usefixtures("coarse")
def test_points_outside_a_cone_are_dark(renderer):
    """A cone half as wide lights a quarter; on a coarse lattice roughly."""
    wide, narrow = (
        renderer.render(SCENE.replace(lights=[SPOT.replace(cone=cone)])).aovs["orders"].sum()
        for cone in (8, 4)
    )
    assert 0.15 < narrow / wide < 0.4


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("phase", ["isotropic", "hg:0.8"])
def test_lights_are_looked_up_where_they_reach(new_renderer, monkeypatch, phase):
    """Cones, balls, and the sun; a light in the middle, one outside, and one that reaches no point."""
    ball = tfm.PointLight(from_=(0.2, 0.1, 0.3), reach=0.4, intensity=0.3)
    cones = [
        SPOT.replace(from_=(-2, 1, 2.5), cone=6, reach=3.0),
        SPOT.replace(cone=3),
        SPOT.replace(reach=0.5),
    ]
    scene = SCENE.replace(lights=[ball, *cones, SUN], medium=RGB.replace(phase=phase))

    def later(of_cube):
        with monkeypatch.context() as patch, new_renderer() as renderer:
            patch.setattr(of_render, "OF_CUBE", of_cube)
            return renderer.render(scene).aovs["orders"]

    found, everywhere = later(of_render.OF_CUBE), later(1e6)
    assert everywhere.max() > 1e-2
    assert np.abs(found - everywhere).max() < PASS * everywhere.max()
    lattice, lights = orders.lattice_of(scene), [light.fitted(scene.bounds) for light in scene.lights]
    counts = of_render.reached_points(lattice, LitRegions.of(lights))
    numbers = [np.prod(count) for _, count in counts]
    assert numbers[3] == 0 < numbers[0] < numbers[4] == lattice.points


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_points_a_voxel_apart(renderer, monkeypatch):
    monkeypatch.setattr(orders, "WORK", 1 << 30)
    image = renderer.render(SCENE).image
    assert np.abs(image - reference.render(SCENE)).max() < 20 * PASS


@pytest.mark.slow
def test_light_is_linear(renderer):
    """Pictures of two lights of different colours add up: with both, points have three numbers."""
    lights = [SPOT.replace(intensity=(3, 1, 0.2)), SPOT.replace(from_=(-2, 1, 2.5), intensity=(0.2, 2, 1))]
    scene = SCENE.replace(medium=GREY)
    both, *each = (
        renderer.render(scene.replace(lights=some)).image for some in (lights, lights[:1], lights[1:])
    )
    assert np.abs(both - each[0] - each[1])[..., :3].max() < LIGHTS * both.max()


def test_a_crop_is_a_part_of_the_picture(renderer):
    """Light that only the rest of the picture shows is scattered into the part."""
    whole, part = renderer.render(SCENE).image, renderer.render(SCENE, crop=(3, 4, 9, 8)).image
    np.testing.assert_allclose(part, whole[4:8, 3:9], atol=PASS)


@pytest.mark.slow
def test_a_light_beside_the_picture_counts(renderer):
    """The camera looks at a part that no light reaches but by scattering."""
    narrow = SPOT.replace(from_=(-0.5, 3, 0), to=(-0.5, 0, 0), cone=4)
    camera = SCENE.camera.replace(from_=(0.6, 0, 5), to=(0.6, 0, 0), fov=6)
    scene = SCENE.replace(lights=[narrow], camera=camera)
    once = renderer.render(scene.replace(medium=RGB.replace(orders=1)))
    assert once.image[..., :3].max() == 0
    assert renderer.render(scene).image[..., :3].max() > 1e-4


MIXTURES = {
    "isotropic": (
        tfm.Medium(sigma_s=(0.9, 0.8, 0.7), sigma_a=(0.1, 0.2, 0.3), orders=5),
        [tfm.Medium(sigma_s=(0.9, 0.8, 0.7), orders=5), tfm.Medium(sigma_s=0.0, sigma_a=(0.1, 0.2, 0.3))],
    ),
    "lobes": (
        tfm.Medium(phase=tfm.PhaseMixture(phases=("isotropic", "hg:0.8"), weights=(0.4, 0.6)), orders=5),
        [tfm.Medium(sigma_s=0.4, orders=5), tfm.Medium(sigma_s=0.6, phase="hg:0.8")],
    ),
}
SPLIT = 1e-4
"""Of the brightest: sums of a few hundred numbers in another order, and a table in place of another."""


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("what", MIXTURES)
def test_bodies_at_one_place_scatter_as_their_mixture(renderer, what):
    mixture, parts = MIXTURES[what]
    one, several = (
        renderer.render(SCENE.replace(volume=[BALL.with_medium(medium) for medium in media]))
        for media in ([mixture], parts)
    )
    expected = one.aovs["orders"]
    assert expected.max() > 1e-2
    assert np.abs(several.aovs["orders"] - expected).max() < SPLIT * expected.max()


SUNS = 48
LESS = 5e-3
"""By which more orders of a lobe may show less, where all is bright: measured 3.4e-3, of 48 suns."""


def furnace(medium):
    """Light from everywhere, as suns."""
    sky = [
        tfm.SunLight(from_=direction.tolist(), to=(0, 0, 0), intensity=4 * np.pi / SUNS)
        for direction in orders.directions(SUNS, 0)
    ]
    volume = tfm.Volume(blobs((24, 24, 24)), voxel_size=0.1, origin=(-1.15, -1.15, -1.15), density_scale=3.0)
    return tfm.Scene(
        volume,
        medium,
        camera=tfm.Camera(from_=(0.3, 0.4, 6), to=(0, 0, 0), fov=22, res=(16, 16)),
        lights=sky,
        map=tfm.MapSettings(coeffs=12, res=64, steps=64),
        march=tfm.MarchSettings(steps=100),
    )


def brightness(image):
    """Radiance of what hides most of what is behind it, over the part that it hides."""
    hides = image[..., 3] > 0.5
    return float((image[hides, :3].mean(axis=-1) / image[hides, 3]).mean())


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["isotropic", "hg:0.8"])
def test_a_white_furnace(renderer, phase):
    """In light from everywhere, what scatters only is as bright as what is behind it, from below.

    Alpha is what it hides of that; the rest is due to suns instead of a sky, to points, and to directions.
    """
    shares = [
        brightness(renderer.render(furnace(tfm.Medium(phase=phase, orders=count))).image)
        for count in (1, 2, 8, 32, 128)
    ]
    assert (np.diff(shares) > (-LESS if phase != "isotropic" else 0)).all()
    assert shares[0] < 0.5
    assert 0.97 < shares[-1] < 1.01


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["isotropic", "hg:0.8"])
def test_a_furnace_that_glows(renderer, phase):
    """By Kirchhoff's law: what emits as much as it absorbs is as bright as what is behind it, too."""
    grey = tfm.Medium(sigma_s=0.7, sigma_a=0.3, emission=0.3, phase=phase)
    shares = [
        brightness(renderer.render(furnace(grey.replace(orders=count))).image) for count in (1, 2, 8, 32)
    ]
    assert (np.diff(shares) > (-LESS if phase != "isotropic" else 0)).all()
    assert shares[0] < 0.8
    assert 0.97 < shares[-1] < 1.01


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["isotropic", "hg:0.6"])
def test_a_furnace_of_white_walls(renderer, monkeypatch, phase):
    """Between walls of albedo 1, what emits as much as it absorbs tends to a radiance of 1, from below.

    What is missing is due to edges of the room, where points behind the walls stand for others.
    """
    walls = [
        tfm.PlaneSolid(point=normal, normal=np.negative(normal).tolist(), albedo=1.0)
        for normal in np.concatenate([np.eye(3), -np.eye(3)]).tolist()
    ]
    scene = tfm.Scene(
        tfm.BoxVolume(from_=(-1.05, -1.05, -1.05), to=(1.05, 1.05, 1.05)),
        camera=tfm.Camera(from_=(0.1, 0.2, 0.5), to=(0, 0, -1), fov=40, res=(8, 8)),
        lights=[],
        solids=walls,
        march=tfm.MarchSettings(steps=60),
    )
    grey = tfm.Medium(sigma_s=0.7, sigma_a=0.3, emission=0.3, phase=phase)

    def share(count, points):
        """Of what the medium hides of the walls: these show none of the light."""
        monkeypatch.setattr(orders, "OF_SMALLEST_BODY", 1 / points)
        found = renderer.render(scene.replace(medium=grey.replace(orders=count)))
        return float((found.image[..., 0] / (1 - found.aovs["transmittance"][..., 0])).mean())

    shares = [share(count, 8) for count in (1, 2, 8, 64)]
    assert (np.diff(shares) > 0).all()
    assert shares[0] < 0.4
    assert 0.98 < shares[-1] < 1
    assert 0.98 < share(64, 16) < 1


def later_orders(scene, rng, samples):
    """Estimates ``[pixels, samples]`` of what a ball around the origin scatters.

    Twice of a sun; and once and twice of what it emits.
    """
    ball, medium, sun = scene.volume, scene.medium, scene.lights[0]
    extinction = ball.density * float(medium.sigma_t[0])
    albedo, glow = float(medium.albedo[0]), medium.emission[0] / float(medium.sigma_t[0])
    to_sun = np.subtract(sun.from_, sun.to) / np.linalg.norm(np.subtract(sun.from_, sun.to))
    origins, directions = (np.repeat(rays, samples, axis=0) for rays in scene.camera.rays(None))

    def inside(points, ways):
        """Distances at which lines enter and leave the ball."""
        middle = -(points * ways).sum(axis=-1)
        half = np.sqrt(np.maximum(ball.radius**2 - (points**2).sum(axis=-1) + middle**2, 0))
        return middle - half, middle + half

    def fly(points, ways, enter, leave):
        """Where it is scattered next, by free flight within the ball, and the opacity."""
        opacity = -np.expm1(-extinction * (leave - enter))
        at = enter - np.log1p(-rng.uniform(size=len(points)) * opacity) / extinction
        return points + at[:, None] * ways, opacity

    def fly_on(points):
        """Likewise from points inside, in any direction."""
        z, angle = rng.uniform(-1, 1, len(points)), rng.uniform(0, 2 * np.pi, len(points))
        across = np.sqrt(1 - z**2)
        ways = np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=-1)
        return fly(points, ways, np.zeros(len(points)), inside(points, ways)[1])

    first, seen = fly(origins, directions, *inside(origins, directions))
    second, once = fly_on(first)
    _, twice = fly_on(second)
    _, out = inside(second, np.broadcast_to(to_sun, second.shape))
    of_sun = albedo * once * np.exp(-extinction * out) / (4 * np.pi) * sun.intensity[0]
    of_glow = glow * once * (1 + albedo * twice)
    return [(albedo * seen * light).reshape(-1, samples) for light in (of_sun, of_glow)]


@pytest.mark.slow
def test_orders_of_a_ball(renderer, rng):
    """Against estimates of their own; points are a 24th of the radius apart."""
    scene = tfm.Scene(
        tfm.SphereVolume(radius=1.0, density=1.5),
        tfm.Medium(sigma_s=0.9, sigma_a=0.1, orders=2),
        camera=tfm.Camera(from_=(0, 0, 6), to=(0, 0, 0), fov=16, res=(8, 8)),
        lights=[SUN],
        march=tfm.MarchSettings(steps=200),
    )
    glowing = scene.replace(medium=scene.medium.replace(emission=0.4))
    pictures = [scene, glowing.replace(lights=[])]
    for one, estimates in zip(pictures, later_orders(glowing, rng, 20_000), strict=True):
        found = renderer.render(one).aovs["orders"][..., 0].ravel()
        expected, error = estimates.mean(axis=1), estimates.std(axis=1) / np.sqrt(estimates.shape[1])
        total, noise = expected.mean(), np.sqrt((error**2).sum()) / len(error)
        assert noise < 2e-3 * total
        assert abs(found.mean() / total - 1) < 1e-2
        assert np.abs(found - expected).max() < 4 * error.max() + 0.03 * expected.max()


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_lights_at_points_are_found_once_for_all_cameras(new_renderer, monkeypatch):
    """As a lobe scatters them; each time, where they take more memory than may be kept."""
    scene, moved = CASES["lobe"], SCENE.camera.replace(from_=(1, 0.5, 4.5))
    with new_renderer() as renderer:
        assert renderer.render(scene).stats.made["lights of orders"] == 1
        found = renderer.render(scene.replace(camera=moved))
        assert not found.stats.made
    monkeypatch.setattr(frame, "MOST_BYTES_OF_LIGHTS", 0)
    with new_renderer() as renderer:
        anew = renderer.render(scene.replace(camera=moved))
        assert "lights of orders" not in anew.stats.made
    np.testing.assert_array_equal(found.aovs["orders"], anew.aovs["orders"])


@pytest.mark.slow
def test_they_are_found_again_for_what_they_depend_on_alone(new_renderer):
    scene = make_scene(medium=GREY)
    changes = {"emission": (1, 1, 1), "eccentricity": 0.5, "phase": "hg:0.3", "sigma_a": 0.4}
    with new_renderer() as renderer:
        renderer.render(scene)
        made = {
            key: renderer.render(scene.replace(medium=GREY.replace(**{key: value}))).stats.made.get(
                "orders", 0
            )
            for key, value in changes.items()
        }
    assert made == {"emission": 1, "eccentricity": 0, "phase": 1, "sigma_a": 1}


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_what_parts_the_points_is_traced_once_for_all_lights(new_renderer):
    scene = CASES["solids, a lobe, a glow"]
    other = scene.replace(lights=[light.replace(intensity=2) for light in scene.lights])
    lighter = scene.replace(solids=[solid.replace(albedo=0.9) for solid in scene.solids])
    with new_renderer() as renderer:
        made = [renderer.render(each).stats.made for each in (scene, other, lighter)]
        again = renderer.render(other)
    assert [(one["orders"], one.get("walls", 0), one.get("rooms", 0)) for one in made] == [
        (1, 1, 1),
        (1, 0, 0),
        (1, 1, 1),
    ]
    with new_renderer() as renderer:
        np.testing.assert_array_equal(renderer.render(other).image, again.image)
