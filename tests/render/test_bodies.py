"""Any mixture of bodies: grids, boxes, balls and fog, each with a medium of its own, in one picture."""

import itertools
import re

import numpy as np
import pytest
from PIL import Image
from scenes import blobs, make_scene, turned
from tolerances import FAST_MATH, LIGHTS, PASS, SKIPPING

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError, VolumeError
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.lights import EnvironmentLight, PointLight, SunLight
from tfm_cl.scene.settings import ShadowSettings
from tfm_cl.scene.solids import BoxSolid, PlaneSolid, SphereSolid

pytestmark = pytest.mark.lanes

MAP_PASS = 20 * PASS
"""Of the brightest, with a map: the power α amplifies its rounding, as in the view pass's own tests."""
TWICE = 2 * PASS
"""Two renders that should be the same, each of which is as far from the truth as `PASS`."""
CHORD = 1e-5
"""Transmittance of a chord: where a ray grazes a ball its length is the root of a small difference."""
MARCHED = 400 * FAST_MATH
"""Transmittance of several bodies after 400 steps: each multiplies by an exponential that is rounded."""
QUADRATURE = 2e-3
"""Of the brightest: 400 midpoints, where a kink of the density or of the light's way lies within a step."""
VOXEL_FACES = 0.01
"""Of the brightest, on average: a grid of ones is a box whose faces fall off over a voxel of 1/48 of it."""
ROUNDED = {"f16": 2e-3, "u8": 1e-2}
"""Of the brightest: 2^-11 of a density, or 1/510 of the largest near it, times optical depths of some
units."""

WHITE = tfm.Medium(sigma_s=1.0)
BROWN = tfm.Medium(sigma_s=(0.8, 0.5, 0.25), sigma_a=(0.2, 0.4, 0.6), phase=tfm.HenyeyGreenstein(-0.3))
BLUE = tfm.Medium(sigma_s=(0.2, 0.5, 1.0), sigma_a=0.1, phase=tfm.HenyeyGreenstein(0.6))
SOOT = tfm.Medium(sigma_s=0, sigma_a=(0.5, 0.7, 0.9))
CLEAR = tfm.Medium(sigma_s=0, sigma_a=0)
HAZE = tfm.Medium(sigma_s=(1.0, 0.9, 0.8), sigma_a=0.05, phase=tfm.HenyeyGreenstein(0.5))

FIRST = turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9))
SECOND = turned(-40, (0.3, 1, 2), (0.08, 0.1, 0.12), (-0.2, -0.6, -0.3))
THIRD = turned(70, (1, 0, 1), (0.06, 0.05, 0.07), (-1.0, -0.9, 1.2))


def grid(matrix=FIRST, scale=4.0, seed=7, shape=(14, 12, 16), **changes):
    return tfm.Volume(blobs(shape, seed), world_from_index=matrix, density_scale=scale, **changes)


def rainbow(shape):
    """A colour that differs from voxel to voxel, up to 1.5."""
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
    rgb = [1.5 - 1.4 * x, 0.6 + 0.5 * np.sin(7 * y + 2 * z), 0.1 + 1.2 * x * z]
    return np.stack(rgb, axis=-1).astype(np.float32)


CLOUD = grid()
OTHER = grid(SECOND, 3.0, 11, (9, 20, 11))
SMALL = grid(THIRD, 6.0, 3)
COLOURED = grid(SECOND, 3.0, 11, (9, 20, 11), colour=rainbow((9, 20, 11)))
FOG = tfm.EverywhereVolume(density=0.12, medium=HAZE)
ROOM = tfm.BoxVolume(from_=(-1.8, -1.6, -1.9), to=(1.7, 1.9, 1.8), density=0.2, medium=HAZE)
BOX = tfm.BoxVolume(from_=(-0.9, -0.7, -0.5), to=(0.5, 0.6, 0.9), density=0.7)
CORNER = tfm.BoxVolume(from_=(-0.2, -0.1, -1.1), to=(1.2, 1.3, 0.4), density=1.1, medium=BLUE)
BALL = tfm.SphereVolume(centre=(0.5, 0.3, 0.4), radius=0.6, density=0.9, medium=BROWN)
BEHIND = tfm.BoxVolume(from_=(-1.5, -1.5, -4.0), to=(1.5, 1.5, -3.0), density=0.6, medium=BLUE)

SCENE = make_scene()
LIGHT, CAMERA = SCENE.lights[0], SCENE.camera

MIXTURES = {
    "a grid of a medium of its own": (CLOUD.with_medium(BROWN),),
    "a grid in fog": (CLOUD, FOG),
    "a grid in a room": (CLOUD, ROOM),
    "a grid before a box": (CLOUD, BEHIND),
    "white beside brown": (CLOUD.with_medium(WHITE), OTHER.with_medium(BROWN)),
    "three tints": (CLOUD.with_medium(WHITE), OTHER.with_medium(BROWN), SMALL.with_medium(BLUE)),
    "soot in a cloud": (CLOUD, OTHER.with_medium(SOOT)),
    "one that is clear": (CLOUD.with_medium(CLEAR), BOX),
    "two boxes": (BOX, CORNER),
    "a box and a ball": (BOX, BALL),
    "boxes and a ball in fog": (BOX, CORNER, BALL, FOG),
    "coloured in fog": (COLOURED, FOG),
    "coloured beside plain": (COLOURED, CLOUD.with_medium(BLUE)),
    "coloured, plain and a ball": (COLOURED, CLOUD, BALL),
    "all kinds": (COLOURED.with_medium(BLUE), CLOUD, SMALL.with_medium(BROWN), BOX, BALL, FOG),
}
every_mixture = pytest.mark.parametrize("mixture", MIXTURES)
both_methods = pytest.mark.parametrize("method", ["tfm", "dual"])


def scene_of(*bodies, **changes):
    """`make_scene` of bodies; rays end where the medium does."""
    changes.setdefault("march", SCENE.march.replace(cutoff=0.0))
    return SCENE.replace(volume=bodies, **changes)


def assert_close(image, expected, tolerance):
    assert np.isfinite(image).all()
    assert np.abs(image - expected).max() <= tolerance * max(1.0, float(np.abs(expected).max()))


def assert_equals_reference(renderer, save_on_failure, scene, method, **options):
    result = renderer.render(scene, method=method)
    expected, layers = reference.render_with_aovs(scene, method, **options)
    tolerance = MAP_PASS * max(1.0, float(expected[..., :3].max()))
    assert expected[..., :3].max() > 0.01
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < tolerance
    for name in ("transmittance", "depth"):
        assert_close(result.aovs[name], layers[name], MAP_PASS)
    # What arrives is a mean, weighted by opacity; where there is hardly any its digits are few.
    seen = expected[..., 3] > 0.05
    assert_close(result.aovs["light_transmittance"][seen], layers["light_transmittance"][seen], 5 * MAP_PASS)
    return result


# --- against the float64 reference -------------------------------------------------------------------------


@pytest.mark.quick("all kinds-tfm")
@both_methods
@every_mixture
def test_picture_and_layers_equal_the_reference(renderer, save_on_failure, mixture, method):
    assert_equals_reference(renderer, save_on_failure, scene_of(*MIXTURES[mixture]), method)


LIGHT_KINDS = {
    "soft": LIGHT.replace(cone=12, blend=0.5, falloff="inverse-square", intensity=(40, 30, 20)),
    "with a reach": LIGHT.replace(reach=4.2),
    "sun": SunLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), intensity=(3, 2.5, 2)),
    "point": PointLight(from_=(2.2, 3.0, 1.2), intensity=(3, 2.5, 2)),
    "point inside": PointLight(from_=(0.1, 0.65, 0.2), intensity=(3, 2.5, 2)),
    "spot inside": LIGHT.replace(from_=(0.1, 0.65, 0.2), to=(0, -1, 0.2), cone=50),
    "area": LIGHT.replace(radius=0.3, samples=4),
    "sky": EnvironmentLight(intensity=(0.5, 0.6, 0.9), samples=3),
}
FROM_INFINITY = ("sun", "sky")


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("light", LIGHT_KINDS)
def test_every_kind_of_light(renderer, save_on_failure, light, method):
    scene = scene_of(CLOUD.with_medium(WHITE), OTHER.with_medium(BROWN), ROOM, lights=[LIGHT_KINDS[light]])
    assert_equals_reference(renderer, save_on_failure, scene, method)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("light", [name for name in LIGHT_KINDS if name not in FROM_INFINITY])
def test_every_kind_of_light_in_fog(renderer, save_on_failure, light, method):
    scene = scene_of(COLOURED, FOG, lights=[LIGHT_KINDS[light]])
    assert_equals_reference(renderer, save_on_failure, scene, method)


@pytest.mark.slow
@both_methods
def test_a_texture_in_fog(renderer, save_on_failure, tmp_path, rng, method):
    path = tmp_path / "window.png"
    Image.fromarray(rng.integers(0, 255, (16, 16, 3), np.uint8)).save(path)
    scene = scene_of(CLOUD, FOG, lights=[LIGHT.replace(texture=str(path))])
    assert_equals_reference(renderer, save_on_failure, scene, method)


CAMERAS = {
    "in the fog and in the grid": CAMERA.replace(from_=(0.1, 0.1, 0.6), to=(-1, -0.3, -0.4), fov=80),
    "in the ball": CAMERA.replace(from_=BALL.centre, to=(-1, 0, 0), fov=90),
    "in the light": CAMERA.replace(from_=(1.6, 2.2, 0.9), to=(0, 0, 0)),
    "away from it": CAMERA.replace(to=(0.6, 0.8, 9), fov=90),
}


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras_inside(renderer, save_on_failure, camera, method):
    lights = [PointLight(from_=(2.2, 3.0, 1.2), intensity=3)]
    scene = scene_of(CLOUD, BALL, FOG, camera=CAMERAS[camera], lights=lights)
    assert_equals_reference(renderer, save_on_failure, scene, method)


MARCHES = {
    "in the world": {"sampling": "world"},
    "as the paper dims": {"attenuation": "paper"},
    "hardly stretched": {"max_stretch": 1.5},
}


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("march", MARCHES)
def test_settings_of_the_march(renderer, save_on_failure, march, method):
    settings = SCENE.march.replace(cutoff=0.0, **MARCHES[march])
    scene = scene_of(CLOUD, CORNER, FOG, march=settings)
    assert_equals_reference(renderer, save_on_failure, scene, method)


SOLIDS = (
    SphereSolid(centre=(0.1, 0.1, 0.2), radius=0.35, albedo=(0.9, 0.5, 0.2)),
    PlaneSolid(point=(0, -0.7, 0)),
)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("mixture", ["a grid in fog", "white beside brown", "two boxes", "all kinds"])
def test_among_solids(renderer, save_on_failure, mixture, method):
    scene = scene_of(
        *MIXTURES[mixture],
        solids=SOLIDS,
        shadow=ShadowSettings(res=64),
        ambient=Ambient(radiance=(0.1, 0.2, 0.3)),
    )
    result = assert_equals_reference(renderer, save_on_failure, scene, method, shadows="map")
    assert (result.image[..., 3] == 1).any()


@pytest.mark.slow
@both_methods
def test_light_shafts_stand_in_the_fog_behind_a_wall(renderer, method):
    """Fog is lit through a hole in the ceiling, and dark beside the shaft."""
    walls = (
        BoxSolid(from_=(-3, 1.5, -3), to=(-0.3, 1.6, 3)),
        BoxSolid(from_=(0.3, 1.5, -3), to=(3, 1.6, 3)),
    )
    lights = [LIGHT.replace(from_=(0, 6, 0), to=(0, 0, 0), cone=30)]
    scene = scene_of(SMALL, FOG, solids=walls, lights=lights, shadow=ShadowSettings(res=256))
    scene = scene.replace(camera=CAMERA.replace(from_=(0, 0.5, 5), to=(0, 0.5, 0), res=(24, 12)))
    row = renderer.render(scene, method=method).image[3, :, 1]
    assert row[11:13].min() > 0.02
    assert max(row[:8].max(), row[16:].max()) < PASS


@pytest.mark.slow
@both_methods
def test_ambient_light(renderer, save_on_failure, method):
    scene = scene_of(*MIXTURES["coloured, plain and a ball"], ambient=Ambient(radiance=(0.5, 1.0, 2.0)))
    assert_equals_reference(renderer, save_on_failure, scene, method)


# --- against closed forms, written here once more ----------------------------------------------------------


def way(body, origins, directions, distances):
    """Length inside a homogeneous body of what begins at origins and is as long as ``distances``."""
    if body.shape == "everywhere":
        return distances
    if body.shape == "box":
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = ((np.array(face) - origins) / directions for face in (body.from_, body.to))
        begin, end = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    else:
        offset = origins - np.array(body.centre)
        half = (offset * directions).sum(axis=-1)
        root = np.sqrt(np.maximum(half**2 - (offset**2).sum(axis=-1) + body.radius**2, 0))
        begin, end = -half - root, -half + root
    return np.maximum(np.minimum(end, distances) - np.maximum(begin, 0), 0)


def extinction_of(scene, body):
    return scene.medium_of(body).sigma_t * body.density


def expected_of(scene, farthest, samples=4000):
    """Sum eq. 4-6 over 4000 midpoints of each camera ray: RGB and transmittance; spots and points only."""
    rays = reference.camera_rays(scene.camera)
    image, depth = np.zeros((len(rays.origins), 3)), np.zeros((len(rays.origins), 3))
    step = farthest / samples
    for body in scene.bodies:
        length = way(body, *rays, np.full(len(rays.origins), farthest))
        depth += length[:, None] * extinction_of(scene, body)
    for i, (origin, direction) in enumerate(zip(*rays, strict=True)):
        t = (np.arange(samples) + 0.5) * step
        points = origin + t[:, None] * direction
        before = np.zeros((samples, 3))
        for body in scene.bodies:
            length = way(body, origin[None], direction[None], t)
            before += length[:, None] * extinction_of(scene, body)
        for light in scene.lights:
            arrival = light.arrival(points)
            toward = -arrival.direction
            distance = np.linalg.norm(np.array(light.from_) - points, axis=-1)
            lit = light.reaches(points)[:, None] * arrival.strength[:, None] * np.array(light.intensity)
            of_light, scattered = np.zeros((samples, 3)), np.zeros((samples, 3))
            cosine = -(arrival.direction @ direction)
            for body in scene.bodies:
                medium = scene.medium_of(body)
                of_light += way(body, points, toward, distance)[:, None] * extinction_of(scene, body)
                inside = way(body, points, toward, np.full(samples, 1e-9)) > 0
                phase = np.asarray(medium.phase.evaluate(cosine))
                scattered += (inside * body.density * phase)[:, None] * np.array(medium.sigma_s)
            image[i] += (np.exp(-before - of_light) * scattered * lit).sum(axis=0) * step
    shape = (*scene.camera.res[::-1], 3)
    return image.reshape(shape), np.exp(-depth).reshape(shape)


HOMOGENEOUS = {
    "two boxes": (BOX, CORNER),
    "a ball in a box": (ROOM, BALL),
    "the box and itself": (BOX, BOX.with_medium(BLUE)),
    "in fog": (BOX, BALL, FOG.replace(density=0.4)),
}


@pytest.mark.quick("spot-two boxes")
@pytest.mark.parametrize("bodies", HOMOGENEOUS)
@pytest.mark.parametrize("light", ["spot", "point inside"])
def test_homogeneous_bodies_against_midpoints(renderer, bodies, light):
    light = LIGHT.replace(cone=70) if light == "spot" else LIGHT_KINDS[light]
    march = tfm.MarchSettings(steps=400, cutoff=0)
    scene = scene_of(*HOMOGENEOUS[bodies], lights=[light], march=march, camera=CAMERA.replace(res=(12, 9)))
    result = renderer.render(scene)
    endless = bodies == "in fog"
    image, transmittance = expected_of(scene, 40.0 if endless else 8.0, 20_000 if endless else 4000)
    assert image.max() > 0.02
    assert np.abs(result.image[..., :3] - image).max() < QUADRATURE * image.max()
    if not endless:
        assert np.abs(result.aovs["transmittance"] - transmittance).max() < CHORD + MARCHED
        assert np.abs(result.image[..., 3] - (1 - transmittance.mean(axis=-1))).max() < CHORD + MARCHED


@pytest.mark.slow
@pytest.mark.parametrize("body", [BOX, BALL, ROOM], ids=["box", "ball", "room"])
def test_a_body_and_itself_are_a_denser_one(renderer, body):
    march = tfm.MarchSettings(steps=200, cutoff=0)
    ambient = Ambient(radiance=(0.1, 0.2, 0.3))
    twice = scene_of(body, body, march=march, ambient=ambient)
    denser = scene_of(body.replace(density=2 * body.density), march=march, ambient=ambient)
    two, one = renderer.render(twice), renderer.render(denser)
    assert_close(two.aovs["transmittance"], one.aovs["transmittance"], CHORD + MARCHED / 2)  # of 200 steps
    assert np.abs(two.image - one.image).max() < QUADRATURE * one.image.max()
    seen = one.image[..., 3] > 0.05
    assert np.allclose(two.aovs["depth"][seen], one.aovs["depth"][seen], rtol=QUADRATURE)


@pytest.mark.slow
@both_methods
def test_fog_and_a_grid_of_ones_is_fog_and_a_box(renderer, method):
    count, low, high = 48, -1.0, 1.0
    ones = tfm.Volume(
        np.ones((count, count, count)),
        voxel_size=(high - low) / count,
        origin=(low, low, low),
        density_scale=0.8,
        medium=BLUE,
    )
    box = tfm.BoxVolume(from_=(low,) * 3, to=(high,) * 3, density=0.8, medium=BLUE)
    settings = {
        "lights": [LIGHT.replace(cone=70)],
        "map": tfm.MapSettings(basis="dct", coeffs=16, density_weighting=1.0, res=96, steps=200),
        "march": tfm.MarchSettings(steps=200, cutoff=0),
    }
    marched = renderer.render(scene_of(ones, FOG, **settings), method=method).image
    exact = renderer.render(scene_of(box, FOG, **settings), method=method).image
    assert np.abs(marched - exact).mean() < VOXEL_FACES * exact.max()


def test_ambient_light_in_two_media_at_once(renderer):
    """Eq. 7 of a mixture: albedos are weighted by extinction."""
    radiance = np.array([0.5, 1.0, 2.0])
    one, other = BOX.with_medium(BROWN), BOX.replace(density=1.3).with_medium(BLUE)
    result = renderer.render(scene_of(one, other, lights=[], ambient=Ambient(radiance=radiance)))
    scattering = sum(np.array(body.medium.sigma_s) * body.density for body in (one, other))
    extinction = sum(body.medium.sigma_t * body.density for body in (one, other))
    limit = scattering / extinction * radiance * (1 - result.aovs["transmittance"])
    assert result.image[..., :3].max() > 0.1
    assert np.abs(result.image[..., :3] - limit).max() < 2 * CHORD


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("body", [BOX, CLOUD, COLOURED], ids=["box", "grid", "coloured grid"])
def test_phase_functions_of_bodies_in_one_place_add_up(renderer, body, method):
    """Half of the density each: where extinction is the same, what scatters is linear in the phase."""
    medium = BROWN.replace(phase=tfm.HenyeyGreenstein(-0.5)), BROWN.replace(phase=tfm.HenyeyGreenstein(0.7))
    key = body.DENSITY_KEY
    half = (
        body.replace(density=body.density / 2)
        if body is BOX
        else body.with_density_scale(body.density_scale / 2)
    )
    assert getattr(half, key) == getattr(body, key) / 2

    both = renderer.render(scene_of(*(half.with_medium(each) for each in medium)), method=method).image
    alone = [renderer.render(scene_of(body.with_medium(each)), method=method).image for each in medium]
    assert np.abs(alone[0] - alone[1]).max() > 0.01
    assert_close(both, (alone[0] + alone[1]) / 2, TWICE if method == "dual" else MAP_PASS)


# --- what must not matter ----------------------------------------------------------------------------------


def halves(volume, axis, at):
    """Two volumes that add up to one: between voxel centres each interpolates to 0 over one voxel."""
    cut = [slice(None)] * 3
    parts = []
    for begin, end in ((0, at), (at, volume.shape[axis])):
        cut[axis] = slice(begin, end)
        shift = np.eye(4)
        shift[2 - axis, 3] = begin
        parts.append(
            tfm.Volume(
                volume.data[tuple(cut)],
                colour=None if volume.colour is None else volume.colour[tuple(cut)],
                world_from_index=volume.world_from_index @ shift,
                density_scale=volume.density_scale,
                medium=volume.medium,
            )
        )
    return parts


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize(("axis", "at"), [(0, 5), (1, 8), (2, 1)])
@pytest.mark.parametrize("volume", [CLOUD, CLOUD.with_medium(BROWN)], ids=["the scene's", "its own"])
def test_a_grid_in_two_halves_is_one(renderer, volume, axis, at, method):
    one, two = halves(volume, axis, at)
    whole = renderer.render(scene_of(volume, FOG), method=method)
    parts = renderer.render(scene_of(one, FOG, two), method=method)
    assert_close(parts.image, whole.image, TWICE)
    assert_close(parts.aovs["depth"], whole.aovs["depth"], TWICE)


@pytest.mark.slow
@both_methods
def test_a_coloured_grid_in_two_halves_is_one(renderer, method):
    whole = renderer.render(scene_of(COLOURED, BALL), method=method).image
    assert_close(renderer.render(scene_of(*halves(COLOURED, 1, 9), BALL), method=method).image, whole, TWICE)


@pytest.mark.quick("boxes and a ball in fog-tfm")
@both_methods
@pytest.mark.parametrize("mixture", ["three tints", "boxes and a ball in fog", "coloured, plain and a ball"])
def test_the_order_does_not_matter(renderer, mixture, method):
    bodies = MIXTURES[mixture]
    images = [
        renderer.render(scene_of(*order), method=method).image
        for order in itertools.islice(itertools.permutations(bodies), 0, 6, 2)
    ]
    for image in images[1:]:
        assert_close(image, images[0], TWICE if method == "dual" else MAP_PASS)


@pytest.mark.slow
@both_methods
@pytest.mark.parametrize("mixture", ["white beside brown", "two boxes", "all kinds"])
def test_lights_add_up(renderer, mixture, method):
    lights = [LIGHT, PointLight(from_=(-1.5, 1.0, 1.5), intensity=(1, 2, 3)), LIGHT_KINDS["spot inside"]]
    scene = scene_of(*MIXTURES[mixture], lights=lights)
    together = renderer.render(scene, method=method)
    alone = [renderer.render(scene.replace(lights=(light,)), method=method) for light in lights]
    total = np.sum([each.image[..., :3].astype(np.float64) for each in alone], axis=0)
    assert np.abs(together.image[..., :3] - total).max() < LIGHTS * total.max()
    for each in alone:
        assert_close(each.aovs["transmittance"], together.aovs["transmittance"], PASS)


@pytest.mark.quick("two boxes-tfm")
@both_methods
@pytest.mark.parametrize("mixture", ["all kinds", "two boxes"])
def test_a_crop_is_a_part_of_the_frame(renderer, mixture, method):
    scene = scene_of(*MIXTURES[mixture])
    whole = renderer.render(scene, method=method)
    part = renderer.render(scene, method=method, crop=(5, 3, 20, 17))
    assert (part.image == whole.image[3:17, 5:20]).all()
    for name, layer in whole.aovs.items():
        assert (part.aovs[name] == layer[3:17, 5:20]).all(), name


@pytest.mark.slow
@both_methods
def test_skipping_leaves_no_trace(renderer, method):
    scene = scene_of(SMALL.with_medium(BROWN), OTHER, ROOM)
    skipping = renderer.render(scene, method=method)
    everything = renderer.render(scene.replace(march=scene.march.replace(skip_empty=False)), method=method)
    assert_close(skipping.image, everything.image, SKIPPING + PASS)


def shifted(body, by):
    if isinstance(body, tfm.Volume):
        matrix = np.eye(4)
        matrix[:3, 3] = by
        return body.transformed(matrix)
    if isinstance(body, tfm.BoxVolume):
        return body.replace(from_=np.add(body.from_, by), to=np.add(body.to, by))
    return body.replace(centre=np.add(body.centre, by)) if isinstance(body, tfm.SphereVolume) else body


@pytest.mark.slow
@both_methods
def test_far_from_the_origin_it_is_the_same(renderer, method):
    by = np.array([3e5, -2e5, 7e5])  # 1e-10 of which float64 still tells apart
    near = scene_of(*MIXTURES["all kinds"])
    far = scene_of(
        *(shifted(body, by) for body in near.bodies),
        camera=CAMERA.replace(from_=CAMERA.from_ + by, to=CAMERA.to + by),
        lights=[LIGHT.replace(from_=LIGHT.from_ + by, to=LIGHT.to + by)],
    )
    near, far = (renderer.render(scene, method=method).image for scene in (near, far))
    assert_close(far, near, MAP_PASS)


# --- settings ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("voxels", ROUNDED)
def test_smaller_voxels(renderer, voxels):
    scene = scene_of(COLOURED.with_medium(BROWN), CLOUD, FOG)
    exact = renderer.render(scene).image
    image = renderer.render(scene.replace(march=scene.march.replace(voxels=voxels))).image
    assert 0 < np.abs(image - exact).max() < ROUNDED[voxels] * max(1.0, exact.max())


@pytest.mark.slow
@both_methods
def test_the_cutoff_ends_rays_where_hardly_anything_is_seen(renderer, method):
    scene = scene_of(CLOUD.with_density_scale(12.0), FOG.replace(density=1.0), BALL.replace(density=20.0))
    exact = renderer.render(scene, method=method)
    for cutoff, bound in ((1e-4, 2e-4), (1e-2, 2e-2)):
        cut = renderer.render(scene.replace(march=scene.march.replace(cutoff=cutoff)), method=method)
        assert_close(cut.image, exact.image, bound)
        assert cut.stats.samples["view_pass"] < exact.stats.samples["view_pass"]


@pytest.mark.slow
def test_map_error_of_a_mixture(renderer):
    scene = scene_of(CLOUD.with_medium(WHITE), OTHER.with_medium(BROWN), FOG)
    coarse, fine = (
        renderer.render(scene.replace(map=scene.map.replace(coeffs=coeffs)), aovs=("map_error",))
        for coeffs in (2, 16)
    )
    seen = fine.aovs["light_transmittance"].max(axis=-1) > 0
    for result in (coarse, fine):
        assert (result.aovs["map_error"] >= 0).all()
        assert result.aovs["map_error"].shape == result.image.shape[:2]
    assert coarse.aovs["map_error"][seen].mean() > 3 * fine.aovs["map_error"][seen].mean() > 0


@pytest.mark.slow
def test_media_of_one_colour_have_the_map_error_of_one_medium(renderer):
    """Twice the extinction of half the density is the same field."""
    double = SCENE.medium.replace(
        sigma_s=np.multiply(SCENE.medium.sigma_s, 2), sigma_a=np.multiply(SCENE.medium.sigma_a, 2)
    )
    half = OTHER.with_density_scale(OTHER.density_scale / 2).with_medium(double)
    # Optical depths are linear in the density: such a map does not care where a factor stands.
    settings = SCENE.map.replace(target="optical-depth")
    one, two = (
        renderer.render(scene_of(CLOUD, other, map=settings), aovs=("map_error",)) for other in (OTHER, half)
    )
    assert_close(two.image, one.image, MAP_PASS)
    assert_close(two.aovs["map_error"], one.aovs["map_error"], MAP_PASS)


@pytest.mark.slow
def test_without_maps_there_is_no_map_error(renderer):
    result = renderer.render(scene_of(BOX, FOG), aovs=("map_error",))
    assert (result.aovs["map_error"] == 0).all()
    assert result.stats.map_bytes == 0


@pytest.mark.slow
def test_max_error_of_a_mixture(renderer):
    scene = scene_of(CLOUD.with_medium(WHITE), OTHER.with_medium(BROWN), FOG)
    settings = tfm.MapSettings(basis="dct", max_error=0.02, res="auto", steps="auto")
    scene = scene.replace(map=settings, march=tfm.MarchSettings(steps="auto"))
    result = renderer.render(scene)
    assert result.stats.error_estimate < 0.02
    truth = scene.replace(map=tfm.MapSettings(steps=400), march=tfm.MarchSettings(steps=400, cutoff=0))
    exact = renderer.render(truth, method="dual").image
    lit = exact[..., 3] > 1e-3
    error = (result.image - exact)[lit][:, :3]
    assert np.sqrt((error**2).mean()) < 1.5 * 0.02 * exact[lit][:, :3].mean()


# --- no light at all ---------------------------------------------------------------------------------------


@pytest.mark.quick("a grid of a medium of its own-tfm", "two boxes-dual")
@both_methods
@pytest.mark.parametrize(
    "mixture", ["a grid of a medium of its own", "two boxes", "coloured in fog", "all kinds"]
)
def test_without_lights_there_is_the_ambient_and_what_is_seen_through(renderer, mixture, method):
    ambient = Ambient(radiance=(0.5, 0.7, 0.9))
    lit = renderer.render(scene_of(*MIXTURES[mixture]), method=method)
    dark = renderer.render(scene_of(*MIXTURES[mixture], lights=[]), method=method)
    alone = renderer.render(scene_of(*MIXTURES[mixture], lights=[], ambient=ambient), method=method)
    both = renderer.render(scene_of(*MIXTURES[mixture], ambient=ambient), method=method)

    assert (dark.image[..., :3] == 0).all()
    assert_close(dark.image[..., 3], lit.image[..., 3], PASS)
    for name in ("transmittance", "depth"):
        assert_close(dark.aovs[name], lit.aovs[name], PASS)
    assert (dark.aovs["light_transmittance"] == 0).all()
    assert alone.image[..., :3].max() > 0.05
    assert_close(alone.image[..., :3] + lit.image[..., :3], both.image[..., :3], LIGHTS)
    assert dark.stats.map_bytes == 0


@pytest.mark.parametrize("mixture", ["a grid in fog", "two boxes"])
def test_without_lights_there_are_no_maps(renderer, mixture):
    scene = scene_of(*MIXTURES[mixture], lights=[])
    assert renderer.build_maps(scene) == []
    assert renderer.render(scene, maps=[]).image[..., 3].max() > 0.1


def test_solids_without_lights(renderer):
    scene = scene_of(BOX, lights=[], solids=SOLIDS, ambient=Ambient(radiance=0.5))
    result = renderer.render(scene)
    assert (result.image[..., 3] == 1).any()
    expected = reference.render(scene)
    assert_close(result.image, expected, MAP_PASS)


@pytest.mark.parametrize("kind", FROM_INFINITY)
@pytest.mark.parametrize("bodies", [(CLOUD, FOG), (FOG, BOX), (FOG, FOG)], ids=["grid", "box", "twice"])
def test_light_from_infinity_cannot_cross_fog_everywhere(renderer, bodies, kind):
    scene = scene_of(*bodies, lights=[LIGHT, LIGHT_KINDS[kind]])
    with pytest.raises(SceneError) as caught:
        renderer.render(scene)
    (line,) = caught.value.args
    assert re.match(
        r"light 2 \(\w+\) comes from infinitely far away: nothing of it is left in a medium", line
    )


# --- maps --------------------------------------------------------------------------------------------------

FIELDS = {
    "a grid in fog": 1,
    "white beside brown": 2,
    "three tints": 3,
    "coloured beside plain": 3,
    "two boxes": 0,
}


@pytest.mark.slow
@pytest.mark.parametrize("mixture", FIELDS)
def test_maps_come_light_by_light_field_by_field(renderer, mixture):
    lights = [LIGHT, PointLight(from_=(-1.5, 1.0, 1.5))]
    scene = scene_of(*MIXTURES[mixture], lights=lights)
    maps = renderer.build_maps(scene)
    assert [light_map.light.type for light_map in maps] == ["spot"] * FIELDS[mixture] + ["point"] * FIELDS[
        mixture
    ]
    again = renderer.render(scene, method="tfm", maps=maps)
    assert (again.image == renderer.render(scene, method="tfm").image).all()
    assert again.stats.seconds["light_pass"] == 0
    with pytest.raises(SceneError, match=rf"{len(maps) + 1} maps for 2 lights"):
        renderer.render(scene, method="tfm", maps=[*maps, *renderer.build_maps(scene_of(CLOUD))])


def times(medium, factor):
    return medium.replace(
        sigma_s=np.multiply(medium.sigma_s, factor), sigma_a=np.multiply(medium.sigma_a, factor)
    )


OF_MAPS = (OTHER.with_medium(BROWN), CLOUD.with_medium(WHITE), SMALL.with_medium(times(WHITE, 2)), FOG)
"""A grid that is the only one of its colour, two of one colour that share a field, and fog."""
SERVED = {
    "another albedo": (0, BROWN.replace(sigma_s=BROWN.sigma_a, sigma_a=BROWN.sigma_s)),
    "another phase": (0, BROWN.replace(phase=tfm.Isotropic())),
    "half as much of the same colour": (0, times(BROWN, 0.5)),
    "another tint of the only one of its field": (0, BLUE),
    "another albedo of one of two": (1, WHITE.replace(sigma_s=0.6, sigma_a=0.4)),
    "fog of another colour": (3, BLUE),
}
REFUSED = {
    "a tint that the other of its field has not": (2, BLUE),
    "a strength that the other of its field has not": (1, times(WHITE, 3)),
    "the tint of another field": (0, WHITE),
}


def recoloured(number, medium):
    bodies = list(OF_MAPS)
    bodies[number] = bodies[number].with_medium(medium)
    return scene_of(*bodies)


@pytest.mark.slow
@pytest.mark.parametrize("change", SERVED)
def test_maps_serve_while_the_fields_stay(renderer, change):
    maps = renderer.build_maps(scene_of(*OF_MAPS))
    scene = recoloured(*SERVED[change])
    reused = renderer.render(scene, method="tfm", maps=maps).image
    assert_close(reused, renderer.render(scene, method="tfm").image, MAP_PASS)
    assert np.abs(reused - renderer.render(scene_of(*OF_MAPS), method="tfm", maps=maps).image).max() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("change", REFUSED)
def test_maps_of_other_fields_are_refused_by_the_body_s_name(renderer, change):
    maps = renderer.build_maps(scene_of(*OF_MAPS))
    number, medium = REFUSED[change]
    with pytest.raises(SceneError) as caught:
        renderer.render(recoloured(number, medium), method="tfm", maps=maps)
    (line,) = caught.value.args
    assert f"volume.{number}" in line
    assert "build the maps again" in line
    # The dual march looks at none.
    assert renderer.render(recoloured(number, medium), method="dual", maps=maps).image.max() > 0


@pytest.mark.slow
def test_one_medium_for_all_grids_may_take_any_colour(renderer):
    maps = renderer.build_maps(scene_of(CLOUD, OTHER, FOG))
    scene = scene_of(CLOUD, OTHER, FOG, medium=BLUE)
    reused = renderer.render(scene, method="tfm", maps=maps).image
    assert_close(reused, renderer.render(scene, method="tfm").image, MAP_PASS)


def test_maps_of_other_bodies_are_refused(renderer):
    maps = renderer.build_maps(scene_of(CLOUD, OTHER, FOG))
    for bodies in ((CLOUD, SMALL, FOG), (CLOUD, FOG), (OTHER, CLOUD, FOG)):
        with pytest.raises(SceneError, match="build the maps again"):
            renderer.render(scene_of(*bodies), method="tfm", maps=maps)


# --- how a scene is made of bodies -------------------------------------------------------------------------


def test_a_medium_is_given_to_a_body_in_any_form():
    table = {"sigma_s": [0.8, 0.5, 0.25], "sigma_a": [0.2, 0.4, 0.6], "phase": "hg:-0.3"}
    data = blobs()
    for body in (
        tfm.Volume(data, medium=BROWN),
        tfm.Volume(data, medium=table),
        tfm.Volume(data).with_medium(BROWN),
        tfm.Volume(data).with_medium(table),
        tfm.BoxVolume(medium=BROWN),
        tfm.BoxVolume(medium=table),
        tfm.BoxVolume().with_medium(BROWN),
        tfm.SphereVolume(medium=table),
        tfm.EverywhereVolume(medium=table),
    ):
        assert body.own_medium == BROWN, body
        assert body.with_medium(None).own_medium is None


@pytest.mark.parametrize(
    "make", [tfm.BoxVolume, lambda **given: tfm.Volume(blobs(), **given)], ids=["box", "grid"]
)
@pytest.mark.parametrize(
    ("medium", "fault"),
    [
        ({"sigma_q": 1}, r"unknown key 'sigma_q' in \[volume.medium\]"),
        ({"sigma_s": -1}, "volume.medium.sigma_s = -1: should be ≥ 0"),
        (3, "volume.medium = 3: should be a table like"),
    ],
)
def test_what_is_no_medium_is_refused_in_one_line(make, medium, fault):
    with pytest.raises(SceneError, match=f"^{fault}.*$") as caught:
        make(medium=medium)
    assert len(caught.value.args) == 1


def test_bodies_keep_their_order_and_media():
    scene = scene_of(FOG, CLOUD, BALL, COLOURED)
    assert scene.bodies == (FOG, CLOUD, BALL, COLOURED)
    assert scene.grids == (CLOUD, COLOURED)
    assert scene.homogeneous == (FOG, BALL)
    assert [scene.medium_of(body) for body in scene.bodies] == [HAZE, SCENE.medium, BROWN, SCENE.medium]
    assert not np.isfinite(scene.bounds).any()
    corners = np.stack([body.bounds for body in (CLOUD, BALL)])
    both = scene_of(CLOUD, BALL).bounds
    assert (both == [corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)]).all()


def test_one_body_alone_or_in_a_list_is_the_same_scene():
    assert tfm.Scene(CLOUD).bodies == tfm.Scene([CLOUD]).bodies == tfm.Scene((CLOUD,)).bodies == (CLOUD,)


@pytest.mark.parametrize("count", [0, 17])
def test_as_many_bodies_as_there_may_be(count):
    with pytest.raises(VolumeError, match=f"a scene has 1 to 16 volumes; got {count}"):
        tfm.Scene([BOX] * count)


@pytest.mark.slow
def test_sixteen_bodies(renderer):
    thin = BOX.replace(density=BOX.density / 16)
    march = tfm.MarchSettings(steps=200, cutoff=0)
    many = renderer.render(scene_of(*[thin] * 16, march=march)).image
    one = renderer.render(scene_of(BOX, march=march)).image
    assert np.abs(many - one).max() < QUADRATURE * one.max()


def test_no_body_stands_for_all():
    assert scene_of(BOX).volume is BOX
    with pytest.raises(SceneError, match="one volume only; the scene has 2"):
        _ = scene_of(BOX, SMALL).volume
