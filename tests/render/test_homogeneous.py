"""Media of constant density: against integrals in float64, written here once more."""

import numpy as np
import pytest
from tolerances import FLOAT32, LIGHTS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device import launch
from tfm_cl.errors import SceneError
from tfm_cl.files import image_io
from tfm_cl.files.image_io.image import Image
from tfm_cl.render import batches as module
from tfm_cl.render.visibility import Visibility
from tfm_cl.scene.lights import EnvironmentLight, PointLight, SpotLight, SunLight
from tfm_cl.scene.solids import PlaneSolid, SphereSolid

pytestmark = pytest.mark.lanes

STEPS = 400
QUADRATURE = 1e-3
"""Midpoints on smooth functions err by 1e-5; where a light's way into the medium has a kink, by more."""
SHADOW_EDGE = 0.02
"""Of the brightest pixel: an edge of a shadow falls within a texel of the shadow map, and within a step."""
CHORD = 1e-5
"""Transmittance of a chord: where a ray grazes the ball its length is the root of a small difference."""
MEDIUM = tfm.Medium(sigma_s=(1.0, 0.7, 0.4), sigma_a=(0.1, 0.2, 0.5), phase=tfm.HenyeyGreenstein(0.4))
CAMERA = tfm.Camera(from_=(0.4, 0.6, 4.0), to=(0.0, 0.1, 0.0), fov=40, res=(24, 18))
VOLUMES = {
    "box": tfm.BoxVolume(from_=(-1.2, -0.9, -1.1), to=(1.0, 1.1, 1.3), density=0.8),
    "sphere": tfm.SphereVolume(centre=(0.1, -0.1, 0.05), radius=1.3, density=0.8),
    "everywhere": tfm.EverywhereVolume(density=0.35),
}
every_volume = pytest.mark.parametrize("volume", VOLUMES.values(), ids=VOLUMES)


def scene_of(volume, lights, camera=CAMERA, **changes):
    march = changes.pop("march", tfm.MarchSettings(steps=STEPS, cutoff=0))
    return tfm.Scene(volume, changes.pop("medium", MEDIUM), camera, lights, march=march, **changes)


def in_medium(volume, origins, directions):
    """Part of rays [..., 3] in the medium: begin, end ≥ 0."""
    if volume.shape == "everywhere":
        return np.zeros(origins.shape[:-1]), np.full(origins.shape[:-1], 1e4)
    if volume.shape == "box":
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = ((np.array(face) - origins) / directions for face in (volume.from_, volume.to))
        begin, end = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    else:
        begin, end = sphere_roots(np.array(volume.centre), volume.radius, origins, directions)
    begin, end = np.maximum(begin, 0), np.maximum(end, 0)
    return np.where(begin < end, begin, 0), np.where(begin < end, end, 0)


def sphere_roots(centre, radius, origins, directions):
    offset = origins - centre
    half = (offset * directions).sum(axis=-1)
    square = half**2 - (offset**2).sum(axis=-1) + radius**2
    root = np.sqrt(np.maximum(square, 0))
    return np.where(square > 0, -half - root, np.inf), np.where(square > 0, -half + root, -np.inf)


def hidden(solids, points, directions, distances):
    """Whether a solid lies on the last `distances` of light that travels along ``directions`` to points."""
    blocked = np.zeros(points.shape[:-1], bool)
    for solid in solids:
        if solid.shape == "sphere":
            near, far = sphere_roots(np.array(solid.centre), solid.radius, points, -directions)
            blocked |= (far > 1e-7) & (np.where(near > 1e-7, near, far) < distances)
        else:
            # On one side the point, on the other the light.
            height = points[..., 1] - solid.point[1]
            blocked |= height * (height - distances * directions[..., 1]) < 0
    return blocked


def nearest_solid(solids, rays):
    """Distance, normal and albedo of what rays meet."""
    count = len(rays.origins)
    distance, normal, albedo = np.full(count, np.inf), np.zeros((count, 3)), np.zeros((count, 3))
    for solid in solids:
        if solid.shape == "sphere":
            near, _ = sphere_roots(np.array(solid.centre), solid.radius, *rays)
            at = (
                rays.origins + np.where(np.isfinite(near), near, 0)[:, None] * rays.directions
            ) - solid.centre
            facing = at / solid.radius
        else:
            near = (solid.point[1] - rays.origins[:, 1]) / rays.directions[:, 1]
            facing = np.broadcast_to([0.0, 1.0, 0.0], (count, 3))
        closer = (near > 0) & (near < distance)
        distance[closer], normal[closer], albedo[closer] = near[closer], facing[closer], solid.albedo
    return distance, normal, albedo


def expected(scene, nodes=300):
    """Render eq. 4-6 by Gauss-Legendre quadrature: RGB, transmittance, and the solids' distance."""
    volume, medium, solids = scene.volume, scene.medium, scene.solids
    rays = reference.camera_rays(scene.camera)
    surface, normal, albedo = nearest_solid(solids, rays)
    first, last = in_medium(volume, *rays)
    last = np.maximum(np.minimum(last, surface), first)
    sigma_t, sigma_s = medium.sigma_t * volume.density, np.array(medium.sigma_s) * volume.density
    through = np.exp(-(last - first)[:, None] * sigma_t)
    x, weights = np.polynomial.legendre.leggauss(nodes)
    x, weights = (x + 1) / 2, weights / 2
    image = np.zeros((len(first), 3))
    lights = [
        part.fitted(volume.bounds) if part.needs_fitting else part
        for light in scene.lights
        for part in light.parts()
    ]
    for light in lights:
        begin, end = light.interval(*rays)
        begin, end = np.maximum(begin, first), np.minimum(end, last)
        # Where nothing is seen any more, no nodes are wasted.
        end = np.minimum(end, first + 25 / sigma_t.min())
        lit = np.flatnonzero(begin < end)
        if len(lit):
            t = begin[lit, None] + (end - begin)[lit, None] * x
            directions = np.broadcast_to(rays.directions[lit, None], (*t.shape, 3))
            points = rays.origins[lit, None] + t[..., None] * directions
            arrival, direction, distance, way = arriving(volume, light, points)
            visible = ~hidden(solids, points, direction, distance)
            phase = medium.phase.widened(light.spread).evaluate(-(direction * directions).sum(axis=-1))
            strength = (arrival.strength.reshape(t.shape) * phase * visible)[..., None]
            strength = strength * light.intensity_at(arrival.position).reshape(*t.shape, 3)
            decay = np.exp(-(way + t - first[lit, None])[..., None] * sigma_t)
            image[lit] += (end - begin)[lit, None] * np.einsum(
                "rnc,n->rc", strength * decay * sigma_s, weights
            )
        met = np.flatnonzero(np.isfinite(surface))
        if len(met):
            points = rays.origins[met] + surface[met, None] * rays.directions[met]
            arrival, direction, distance, way = arriving(volume, light, points)
            cosine = np.maximum(-(direction * normal[met]).sum(axis=-1), 0) * light.reaches(points)
            visible = ~hidden(solids, points + 1e-6 * normal[met], direction, distance)
            reflected = (arrival.strength * cosine * visible / np.pi)[:, None] * albedo[met]
            reflected = reflected * light.intensity_at(arrival.position)
            image[met] += reflected * np.exp(-way[:, None] * sigma_t) * through[met]
    shape = scene.camera.res[::-1]
    return image.reshape(*shape, 3), through.reshape(*shape, 3), surface.reshape(shape)


def arriving(volume, light, points):
    """The light's arrival at points [..., 3], its direction, distance, and its way in the medium."""
    arrival = light.arrival(points.reshape(-1, 3))
    shape = points.shape[:-1]
    direction, distance = arrival.direction.reshape(points.shape), arrival.distance.reshape(shape)
    begin, end = in_medium(volume, points, -direction)
    return arrival, direction, distance, np.maximum(np.minimum(end, distance) - begin, 0)


def assert_close(image, reference_image, tolerance):
    assert reference_image.max() > 0
    assert np.abs(image[..., :3] - reference_image).max() < tolerance * reference_image.max()


LIGHTS_AND_PLACES = {
    "spot outside": SpotLight(from_=(2.2, 2.5, 1.0), to=(0, 0, 0), cone=20, intensity=(3, 2, 1)),
    "spot inside": SpotLight(from_=(0.5, 0.6, 0.2), to=(-0.3, -1, 0), cone=35, blend=0.5),
    "spot with a reach": SpotLight(from_=(0.5, 0.6, 0.2), to=(-0.3, -1, 0), cone=50, reach=1.1),
    "point outside": PointLight(from_=(-1.8, 0.7, 0.9), falloff="inverse-square"),
    "point with a reach": PointLight(from_=(0.2, 0.1, -0.4), reach=0.9, intensity=(1, 2, 3)),
}


@pytest.mark.quick(
    "camera outside-spot outside-box",
    "camera inside-spot inside-sphere",
    "camera inside-point with a reach-box",
    "camera inside-point outside-everywhere",
)
@every_volume
@pytest.mark.parametrize("light", LIGHTS_AND_PLACES.values(), ids=LIGHTS_AND_PLACES)
@pytest.mark.parametrize("inside", [False, True], ids=["camera outside", "camera inside"])
def test_one_light_against_quadrature(renderer, volume, light, inside):
    camera = CAMERA.replace(from_=(0.3, 0.2, 0.6), to=(0, -0.1, -1), fov=70) if inside else CAMERA
    scene = scene_of(volume, [light], camera)

    result = renderer.render(scene)

    image, through, _ = expected(scene)
    assert_close(result.image, image, QUADRATURE)
    assert np.abs(result.aovs["transmittance"] - through).max() < CHORD
    assert np.abs(result.image[..., 3] - (1 - through.mean(axis=-1))).max() < CHORD


@pytest.mark.parametrize("falloff", ["none", "inverse-square"])
@pytest.mark.parametrize("sampling", ["projective", "world"])
def test_sampling_and_falloff(renderer, falloff, sampling):
    light = SpotLight(from_=(1.6, 2.0, 1.0), to=(0, 0, 0), cone=20, falloff=falloff)
    scene = scene_of(VOLUMES["box"], [light], march=tfm.MarchSettings(steps=STEPS, sampling=sampling))

    assert_close(renderer.render(scene).image, expected(scene)[0], QUADRATURE)


@pytest.mark.quick("box")
@pytest.mark.parametrize("name", ["box", "sphere"])
def test_light_from_infinity(renderer, name):
    sun = SunLight(from_=(1, 2, 0.5), to=(0, 0, 0), intensity=(1, 0.5, 2))
    sky = EnvironmentLight(intensity=(0.1, 0.2, 0.3), samples=7)
    scene = scene_of(VOLUMES[name], [sun, sky])

    assert_close(renderer.render(scene).image, expected(scene)[0], QUADRATURE)


@pytest.mark.parametrize("kind", [SunLight, EnvironmentLight])
def test_light_from_infinity_cannot_cross_a_medium_everywhere(renderer, kind):
    light = kind(from_=(0, 1, 0), to=(0, 0, 0)) if kind is SunLight else kind()
    scene = scene_of(VOLUMES["everywhere"], [LIGHTS_AND_PLACES["spot outside"], light])

    with pytest.raises(SceneError, match=r"light 2 .* comes from infinitely far away"):
        renderer.render(scene)


def test_grey_media_and_textures(renderer, tmp_path, rng):
    pixels = np.ones((5, 8, 4), np.float32)
    pixels[..., :3] = rng.random((5, 8, 3)) * 2
    image_io.save(tmp_path / "window.exr", Image(rgba=pixels), pixel_type="float")
    spot = {"from_": (1.6, 2.0, 1.0), "to": (0, 0, 0), "cone": 25}
    lights = [SpotLight(**spot, texture=str(tmp_path / "window.exr")), SpotLight(**spot, intensity=0.3)]
    scene = scene_of(VOLUMES["box"], lights, medium=tfm.Medium(sigma_s=0.7, sigma_a=0.2))

    # Bilinear textures have kinks at every texel.
    assert_close(renderer.render(scene).image, expected(scene, 800)[0], 3 * QUADRATURE)


def test_ambient_light_in_closed_form(renderer):
    dark = SpotLight(from_=(0, 9, 0), to=(0, 10, 0), cone=5)
    ambient = tfm.Ambient(radiance=(0.5, 1.0, 2.0))
    albedo = np.array(MEDIUM.sigma_s) / MEDIUM.sigma_t
    for volume in VOLUMES.values():
        result = renderer.render(scene_of(volume, [dark], ambient=ambient))
        limit = albedo * [0.5, 1.0, 2.0] * (1 - expected(scene_of(volume, [dark]))[1])
        assert np.abs(result.image[..., :3] - limit).max() < CHORD
    # A ray to infinity scatters all that it can (eq. 7).
    assert np.allclose(result.image, [*(albedo * [0.5, 1.0, 2.0]), 1], rtol=4 * FLOAT32)


def random_lights(rng, count, **changes):
    lights = []
    for n in range(count):
        at = rng.uniform(-1.6, 1.6, 3)
        common = {
            "from_": at,
            "intensity": rng.uniform(0, 2, 3),
            "reach": None if n % 3 else rng.uniform(0.5, 2),
        }
        if n % 4 == 3:
            light = PointLight(**common, falloff=("none", "inverse-square")[n // 4 % 2])
        else:
            light = SpotLight(
                **common, to=at + rng.normal(size=3), cone=rng.uniform(8, 60), blend=n % 2 * 0.4
            )
        lights.append(light.replace(**changes))
    return lights


SOLIDS = (
    SphereSolid(centre=(0.3, -0.2, 0.2), radius=0.35, albedo=(0.9, 0.5, 0.3)),
    SphereSolid(centre=(-0.6, 0.3, -0.4), radius=0.25, albedo=(0.2, 0.6, 0.9)),
    PlaneSolid(point=(0, -0.8, 0), normal=(0, 1, 0), albedo=(0.6, 0.6, 0.6)),
)


@pytest.mark.slow
@every_volume
def test_many_lights_are_the_sum_of_each(renderer, rng, volume):
    lights = random_lights(rng, 12)
    scene = scene_of(volume, lights, solids=SOLIDS, march=tfm.MarchSettings(steps=20))

    together = renderer.render(scene)

    alone = [renderer.render(scene.replace(lights=(light,))) for light in lights]
    image = np.sum([result.image[..., :3].astype(np.float64) for result in alone], axis=0)
    assert np.abs(together.image[..., :3] - image).max() < LIGHTS * image.max()
    assert (together.aovs["samples"] == np.sum([result.aovs["samples"] for result in alone], axis=0)).all()


@pytest.mark.slow
def test_batches_do_not_show(renderer, rng, monkeypatch):
    scene = scene_of(VOLUMES["box"], random_lights(rng, 20), solids=SOLIDS, march=tfm.MarchSettings(steps=10))
    whole = renderer.render(scene)
    batches = []
    monkeypatch.setattr(module, "BATCH_BYTES", 1 << 18)
    monkeypatch.setattr(launch, "MOST_SAMPLES", 4 * 1024 * 10)

    cut = renderer.render(scene, progress=lambda stage, _: batches.append(stage))

    assert len(set(batches)) >= 6
    assert np.abs(cut.image - whole.image).max() < LIGHTS * whole.image.max()


def test_crop_is_a_part_of_the_frame(renderer, rng):
    camera = CAMERA.replace(res=(61, 47))
    scene = scene_of(VOLUMES["box"], random_lights(rng, 9), camera, march=tfm.MarchSettings(steps=8))
    full = renderer.render(scene)

    part = renderer.render(scene, crop=(5, 3, 50, 41))

    assert (part.image == full.image[3:41, 5:50]).all()
    for name, layer in full.aovs.items():
        assert (part.aovs[name] == layer[3:41, 5:50]).all(), name


@pytest.mark.slow
def test_lights_with_solids_against_the_reference(renderer, rng):
    scene = scene_of(
        VOLUMES["box"], random_lights(rng, 64), solids=SOLIDS, shadow=tfm.ShadowSettings(res=1024)
    )

    result = renderer.render(scene)

    image, _, surface = expected(scene, 200)
    error = np.abs(result.image[..., :3] - image).max(axis=-1) / image.max()
    assert np.median(error) < QUADRATURE / 10
    assert error.max() < SHADOW_EDGE / 2
    assert (result.image[np.isfinite(surface), 3] == 1).all()
    shown = np.isfinite(surface)
    assert np.allclose(result.aovs["solid_distance"][shown], surface[shown], rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "filter_"), [("box", "nearest"), ("sphere", "pcf"), ("everywhere", "pcf")])
def test_a_shaft_of_shadow(renderer, name, filter_):
    # The camera looks across the shadow of a ball: part of each ray is dark.
    ball = SphereSolid(centre=(0, 0.6, 0), radius=0.3, albedo=0.5)
    light = SpotLight(from_=(0, 2.5, 0), to=(0, 0, 0), cone=25)
    scene = scene_of(
        VOLUMES[name], [light], solids=[ball], shadow=tfm.ShadowSettings(res=2048, filter=filter_)
    )
    scene = scene.replace(camera=CAMERA.replace(from_=(0, 0, 4), to=(0, 0, 0)))

    result = renderer.render(scene)

    image, _, _ = expected(scene, 800)
    lit, _, _ = expected(scene.replace(solids=()), 200)
    assert (image < 0.7 * lit).any()
    assert_close(result.image, image, SHADOW_EDGE / 2)


@pytest.mark.slow
def test_solids_outside_the_medium(renderer):
    # Light and view cross the medium only in part.
    plane = PlaneSolid(point=(0, -1.6, 0), normal=(0, 1, 0), albedo=(0.9, 0.6, 0.3))
    camera = CAMERA.replace(from_=(0, 2.5, 3))
    for volume in VOLUMES.values():
        light = SpotLight(from_=(0.3, 3, 0.2), to=(0, 0, 0), cone=40, falloff="inverse-square")
        scene = scene_of(volume, [light], camera, solids=[plane])
        assert_close(renderer.render(scene).image, expected(scene)[0], SHADOW_EDGE / 4)


@pytest.mark.slow
def test_small_lights_have_small_shadow_maps(renderer, monkeypatch):
    sizes = []
    shadow_maps = Visibility.shadow_maps

    def watched(self, scene, lights, wanted):
        sizes.extend(wanted)
        return shadow_maps(self, scene, lights, wanted)

    monkeypatch.setattr(Visibility, "shadow_maps", watched)
    camera = CAMERA.replace(res=(320, 240))
    tiny = SpotLight(from_=(0.3, 0.3, 0.2), to=(0.3, 0, 0.2), cone=20, reach=0.2)  # above a ball
    small = tiny.replace(reach=0.8)
    scene = scene_of(VOLUMES["box"], [tiny, small, tiny.replace(reach=None, cone=80)], camera, solids=SOLIDS)

    renderer.render(scene.replace(march=tfm.MarchSettings(steps=4)))

    assert sizes[0] < sizes[1] < sizes[2] <= 1024
    assert all(size & (size - 1) == 0 and size >= 32 for size in sizes)


@pytest.mark.slow
def test_equals_the_grid_path(renderer):
    # 96 voxels a side: the border of one voxel, where density falls off, is 1 % of the box.
    count = 96
    grid = tfm.Volume(np.ones((count,) * 3, np.float32), voxel_size=2 / count, origin=(-1, -1, -1))
    lights = [
        SpotLight(from_=(1.6, 2.0, 1.0), to=(0, 0, 0), cone=20, falloff="inverse-square"),
        SpotLight(from_=(-0.4, 0.5, 0.2), to=(0, -1, 0), cone=30, reach=1.2),
        PointLight(from_=(0.2, 0.1, -0.4), reach=0.9),
    ]
    box = scene_of(tfm.BoxVolume(), lights, ambient=tfm.Ambient(radiance=0.1), solids=SOLIDS[:1])
    for attenuation in ("consistent", "paper"):
        box = box.replace(march=tfm.MarchSettings(steps=200, attenuation=attenuation))
        closed = renderer.render(box)
        marched = renderer.render(box.replace(volume=grid, map=tfm.MapSettings(steps=200)), method="dual")
        assert_close(closed.image, marched.image[..., :3], 0.03)
        error = np.abs(closed.image - marched.image)
        assert error.mean() < 0.005 * marched.image.mean()
        # But for rays that graze the box, of which the grid keeps half a voxel.
        inside = closed.image[..., 3] > 0.3
        for name in ("transmittance", "light_transmittance"):
            assert np.abs(closed.aovs[name] - marched.aovs[name])[inside].mean() < 0.005, name
        assert np.allclose(closed.aovs["depth"][inside], marched.aovs["depth"][inside], rtol=0.01)


@pytest.mark.slow
def test_grid_path_knows_the_reach(renderer, small_scene):
    lights = [
        SpotLight(from_=(0.5, 0.6, 0.2), to=(-0.3, -1, 0), cone=50, reach=1.1),
        PointLight(from_=(0.2, 0.1, -0.4), reach=0.9, falloff="inverse-square"),
    ]
    for light in lights:
        scene = small_scene.replace(lights=(light,))
        found = renderer.render(scene, method="dual").image
        assert np.abs(found - reference.render(scene, "dual")).max() < 1e-4
        assert (
            np.abs(found - renderer.render(scene.replace(lights=(light.replace(reach=None),))).image).max()
            > 0.001
        )


def test_inverse_square(renderer):
    near, far = (
        renderer.render(
            scene_of(
                tfm.BoxVolume(from_=(-0.1,) * 3, to=(0.1,) * 3, density=0.01),
                [PointLight(from_=(0, distance, 0), falloff="inverse-square")],
                CAMERA.replace(from_=(0, 0, 1), to=(0, 0, 0)),
            )
        )
        for distance in (100, 200)
    )
    lit = far.image[..., 0] > 0
    assert lit.any()
    # The box is a thousandth of the distance wide.
    assert np.allclose(near.image[lit, 0] / far.image[lit, 0], 4, rtol=5e-3)


def test_closed_form_depth(renderer):
    sigma, half = 0.8, 1.0
    scene = tfm.Scene(
        tfm.BoxVolume(density=sigma),
        camera=tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(1, 1)),
        lights=[PointLight(from_=(0, 3, 0))],
    )
    decay = np.exp(-2 * half * sigma)
    expected_depth = 3 + 1 / sigma - 2 * half * decay / (1 - decay)
    assert renderer.render(scene).aovs["depth"][0, 0] == pytest.approx(expected_depth, rel=1e-6)
    thin = scene.replace(volume=tfm.BoxVolume(density=1e-6))
    assert renderer.render(thin).aovs["depth"][0, 0] == pytest.approx(4, rel=1e-5)
    endless = scene.replace(volume=tfm.EverywhereVolume(density=sigma))
    assert renderer.render(endless).aovs["depth"][0, 0] == pytest.approx(1 / sigma, rel=1e-6)


def test_dual_is_the_same_and_there_is_no_light_pass(renderer, rng):
    scene = scene_of(VOLUMES["sphere"], random_lights(rng, 3), march=tfm.MarchSettings(steps=12))
    result, dual = renderer.render(scene), renderer.render(scene, method="dual")

    assert (result.image == dual.image).all()
    assert result.stats.map_bytes == result.stats.samples["light_pass"] == 0
    assert result.stats.seconds["light_pass"] == 0
    assert result.stats.seconds["view_pass"] > 0
    samples = result.aovs["samples"]
    assert ((samples % 12) == 0).all()
    assert samples.max() <= 3 * 12
    assert result.stats.samples["view_pass"] == samples.sum()


HOSTILE = {
    "no density": {"density": 0.0},
    "hardly any density": {"density": 1e-25},
    "huge density": {"density": 1e25},
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", VOLUMES)
@pytest.mark.parametrize("density", HOSTILE.values(), ids=HOSTILE)
def test_hostile_densities_give_finite_pictures(renderer, shape, density):
    apex, square = CAMERA.from_, {"falloff": "inverse-square"}
    lights = [
        SpotLight(from_=apex, to=CAMERA.to, cone=30, **square),
        PointLight(from_=apex, **square),
        PointLight(from_=(0, 0, 0), reach=1e-9),
        # As far away as a light may be.
        SpotLight(from_=(0, 1e14 if shape == "everywhere" else 1e5, 0), to=(0, 0, 0), cone=89, **square),
    ]
    scene = scene_of(VOLUMES[shape].replace(**density), lights, solids=SOLIDS)
    with np.errstate(all="raise", under="ignore"):
        result = renderer.render(scene.replace(march=tfm.MarchSettings(steps=5)))
    assert np.isfinite(result.image).all()
    for name, layer in result.aovs.items():
        assert np.isfinite(layer).all(), name
    bare = renderer.render(scene.replace(solids=(), medium=tfm.Medium(sigma_s=0, sigma_a=0)))
    assert (bare.image == 0).all()


def test_a_light_that_is_not_seen_costs_nothing(renderer):
    light = SpotLight(from_=(0, 9, 0), to=(0, 10, 0), cone=5)
    result = renderer.render(scene_of(VOLUMES["box"], [light]))
    assert (result.image[..., :3] == 0).all()
    assert result.image[..., 3].max() > 0.5
    assert result.stats.samples["view_pass"] == 0
