"""Scenes with solids: against the float64 reference, and against closed forms that share none of its code."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs, make_scene, turned
from tolerances import PASS
from trimesh.creation import icosphere

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.ambient import Ambient
from tfm_cl.scene.lights import EnvironmentLight, PointLight, SunLight
from tfm_cl.scene.settings import ShadowSettings
from tfm_cl.scene.solids import BoxSolid, MeshSolid, PlaneSolid, SphereSolid

pytestmark = pytest.mark.lanes

MAP_PASS = 20 * PASS
"""Of the brightest, with a map: the power α amplifies its rounding, as in the view pass's own tests."""
LAMBERT = 1e-5
"""Of the light at a pixel: place and normal are rounded to float32, and the square of a distance to them."""
SHADOW_EDGES = 3.0
"""An eightfold shadow.res makes the mean error at the shadows' edges at least this much smaller."""
SURFACE_ERROR = 0.025
"""RMS on solids over that of the picture, for maps of 96 texels a side: 0.018 was seen of a point light."""
MAP_ERROR = 4.0
"""Errors of single points over the map's mean one: the series is worst at the ends of its range."""

VOLUMES = Path(__file__).resolve().parents[2] / "volumes"
LIGHT = make_scene().lights[0]
BRIGHT = {"intensity": (3, 2.5, 2)}
LIGHTS = {
    "spot": LIGHT,
    "soft": LIGHT.replace(cone=12, blend=0.5, falloff="inverse-square", intensity=(40, 30, 20)),
    "sun": SunLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), **BRIGHT),
    "point": PointLight(from_=(2.2, 3.0, 1.2), **BRIGHT),
    "point inside": PointLight(from_=(0.1, 0.65, 0.2), **BRIGHT),
    "spot inside": LIGHT.replace(from_=(0.1, 0.65, 0.2), to=(0, -1, 0.2), cone=50),
}
INSIDE = tfm.Camera(from_=(0.1, 0.1, 0.6), to=(-1, -0.3, -0.4), fov=80, res=(24, 18))
BALL = SphereSolid(centre=(0.1, 0.1, 0.2), radius=0.4, albedo=(0.9, 0.5, 0.2))
FLOOR = PlaneSolid(point=(0, -0.2, 0), normal=(0.1, 1, 0.2))


def ball_of_triangles(**options):
    mesh = icosphere(subdivisions=2)
    vertices = 0.35 * mesh.vertices + (0.1, 0.1, 0.2)
    return MeshSolid.from_arrays(vertices, mesh.faces, albedo=(0.9, 0.5, 0.3), **options)


SOLIDS = {
    "sphere before": [BALL.replace(centre=(0.3, 0.4, 1.6), radius=0.3)],
    "sphere inside": [BALL],
    "plane behind": [PlaneSolid(point=(0, 0, -1.6), normal=(0.1, 0.2, 1))],
    "plane through": [FLOOR],
    "box inside": [BoxSolid(from_=(-0.4, -0.5, -0.3), to=(0.2, 0.1, 0.4))],
    "mesh inside": [ball_of_triangles()],
    "seen and unseen": [
        ball_of_triangles(normals=icosphere(subdivisions=2).vertices),
        BALL.replace(centre=(-0.6, 0.5, 0.3), radius=0.3, holdout=True),
        BALL.replace(centre=(0.9, 0.9, 0.3), radius=0.2, visible=False),
        PlaneSolid(point=(0, -0.8, 0), albedo=str(VOLUMES / "window.png"), texture_scale=1.5),
    ],
    "several": [PlaneSolid(point=(0, -0.8, 0)), BALL.replace(centre=(0.4, 0.5, 0.2)), ball_of_triangles()],
}
CASES = [
    *itertools.product(["several"], LIGHTS),
    ("sphere inside", "point"),
    ("plane through", "sun"),
    ("sphere before", "spot"),
    ("sphere before", "sun"),
    ("plane behind", "soft"),
    ("plane behind", "point inside"),
    ("box inside", "spot inside"),
    ("box inside", "sun"),
    ("mesh inside", "point"),
    ("mesh inside", "spot"),
    ("seen and unseen", "spot"),
]


def solid_scene(solids, light, **changes):
    settings = {"shadow": ShadowSettings(res=48), "ambient": Ambient(radiance=(0.1, 0.2, 0.3))} | changes
    return make_scene(solids=SOLIDS[solids], lights=[LIGHTS[light]], **settings)


def check_equal(renderer, save_on_failure, scene, method):
    """Compare picture and layers with the reference's through the very shadow map."""
    result = renderer.render(scene, method=method)
    expected, layers = reference.render_with_aovs(scene, method, shadows="map")
    brightest = max(1.0, float(expected[..., :3].max()))
    wrong = np.abs(result.image - expected) / brightest
    assert expected[..., :3].max() > 0.1
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert wrong.max() < (4 * PASS if method == "dual" else MAP_PASS)
    for name in ("transmittance", "depth"):
        assert np.abs(result.aovs[name] - layers[name]).max() < 4 * PASS
    seen = layers["transmittance"].mean(axis=-1) < 0.99
    difference = np.abs(result.aovs["light_transmittance"] - layers["light_transmittance"])[seen]
    assert difference.max(initial=0) < 10 * MAP_PASS


@pytest.mark.quick("mesh inside-spot-tfm", "seen and unseen-spot-tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize(("solids", "light"), CASES)
def test_picture_and_layers_equal_the_reference(renderer, save_on_failure, solids, light, method):
    check_equal(renderer, save_on_failure, solid_scene(solids, light), method)


@pytest.mark.quick("paper's attenuation-tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize(
    "changes",
    [
        {"camera": INSIDE},
        {"shadow": ShadowSettings(res=48, filter="nearest")},
        {"shadow": ShadowSettings(res=1)},
        {"march": tfm.MarchSettings(steps=30, attenuation="paper")},
        {"map": tfm.MapSettings(basis="dct", coeffs=8, density_weighting="auto", res=24, steps=24)},
    ],
    ids=[
        "camera inside",
        "nearest texel",
        "shadow map of one texel",
        "paper's attenuation",
        "auto weighting",
    ],
)
def test_settings_equal_the_reference(renderer, save_on_failure, changes, method):
    check_equal(renderer, save_on_failure, solid_scene("several", "spot", **changes), method)


def test_a_holdout_is_a_hole_and_what_is_invisible_a_shadow(renderer):
    scene = solid_scene("seen and unseen", "spot")  # a picture of the tests above
    smooth, hole, hidden, floor = scene.solids
    result = renderer.render(scene, background=1.0)
    rays = scene.camera.rays()
    shape = result.image.shape[:2]
    hits = Tracer([hole]).nearest(*rays), Tracer([smooth, floor]).nearest(*rays)
    holes = (hits[0].distance < hits[1].distance).reshape(shape)
    through = result.aovs["transmittance"][holes]
    without = result.foreground[holes]
    assert 10 < holes.sum() < holes.size / 2
    # Alpha is of the media in front, and of all light only what they scatter is there.
    assert np.abs(without[:, 3] - (1 - through.mean(axis=-1))).max() < PASS
    black = renderer.render(
        scene.replace(solids=[hole.replace(holdout=False, albedo=0), smooth, hidden, floor])
    )
    assert (without[:, :3] == black.image[holes][:, :3]).all()
    assert np.abs(result.image[holes][:, :3] - without[:, :3] - through).max() < PASS
    for name in ("solid_distance", "normal", "albedo"):
        assert not result.aovs[name][holes].any()
    # What only casts a shadow darkens, and is seen nowhere.
    lighter = renderer.render(scene.replace(solids=[smooth, hole, floor]))
    assert (result.aovs["solid_distance"] == lighter.aovs["solid_distance"]).all()
    change = lighter.image[..., :3] - result.foreground[..., :3]
    assert change.min() > -MAP_PASS
    assert change.max() > 0.02


def test_haze_leaves_of_solids_what_it_says_and_shows_the_background_for_the_rest(renderer):
    scene, background, haze = solid_scene("seen and unseen", "spot"), np.array((1, 2, 4)), 5.0
    clear = renderer.render(scene)
    hazy = scene.replace(camera=scene.camera.replace(haze=haze))
    found = renderer.render(hazy, background=background)
    distance = clear.aovs["solid_distance"]
    lone = (distance > 0) & (clear.aovs["transmittance"] == 1).all(axis=-1)
    left = np.exp(-distance[lone] / haze)[:, None]
    bare = found.foreground[lone]
    assert lone.sum() > 10
    assert np.abs(bare - left * clear.image[lone]).max() < PASS
    assert np.abs(found.image[lone][:, :3] - bare[:, :3] - (1 - left) * background).max() < 4 * PASS
    solid = distance > 0
    assert (found.foreground[~solid] == clear.image[~solid]).all()
    assert (found.aovs["albedo"] == clear.aovs["albedo"]).all()
    expected, _ = reference.render_with_aovs(hazy, "tfm", shadows="map")
    assert np.abs(found.foreground - expected).max() < MAP_PASS * max(1, expected.max())
    # Where several samples were asked for, and one is enough, the background is what it was.
    finer = renderer.render(hazy, background=background, samples=4)
    same = solid & (finer.foreground == found.foreground).all(axis=-1)
    assert same.sum() > 10
    assert np.abs(finer.image[same] - found.image[same]).max() < 4 * PASS


def test_a_background_is_seen_as_far_as_the_reference_lets_it_through(renderer):
    scene, background = solid_scene("mesh inside", "spot"), (1, 2, 4)  # a picture of the tests above
    result = renderer.render(scene, background=background)
    _, layers = reference.render_with_aovs(scene.replace(lights=()), "dual")
    hidden = result.image[..., 3] == 1  # on solids
    expected = np.where(hidden[..., None], 0, background * layers["transmittance"])
    behind = result.image - renderer.render(scene).image
    assert 0 < hidden.mean() < 1
    assert np.abs(behind[..., :3] - expected).max() < 4 * PASS * max(background)
    assert not behind[..., 3].any()


@pytest.mark.slow
@pytest.mark.parametrize("solids", ["sphere inside", "plane behind", "several"])
def test_the_papers_attenuation_forgets_what_is_before_the_cone(renderer, save_on_failure, solids):
    scene = solid_scene(solids, "spot", ambient=None)
    narrow = scene.replace(lights=[LIGHT.replace(cone=6)])
    papers = narrow.replace(march=narrow.march.replace(attenuation="paper"))

    check_equal(renderer, save_on_failure, papers, "dual")

    difference = renderer.render(papers).image - renderer.render(narrow).image
    assert difference[..., :3].min() > -MAP_PASS
    assert difference[..., :3].max() > 0.02


@pytest.mark.slow
@pytest.mark.parametrize("filtering", ["pcf", "nearest"])
@pytest.mark.parametrize("solids", ["sphere inside", "box inside", "several"])
def test_shadow_maps_tend_to_exact_visibility(renderer, solids, filtering):
    # Only what the medium scatters: solids are shaded exactly.
    scene = solid_scene(solids, "spot", ambient=None)
    black = [solid.replace(albedo=0) for solid in scene.solids]
    scene = scene.replace(solids=black, march=scene.march.replace(steps=60))
    exact = reference.render(scene, "dual")[..., :3]
    errors = []
    for res in (8, 64, 512):
        shadow = ShadowSettings(res=res, filter=filtering)
        image = renderer.render(scene.replace(shadow=shadow), method="dual").image[..., :3]
        errors.append(np.abs(image - exact).mean() / exact.mean())

    assert errors[0] > SHADOW_EDGES * errors[1] > SHADOW_EDGES**2 * errors[2]
    assert errors[2] < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("light", ["spot", "sun", "point"])
def test_a_plane_that_camera_and_light_are_above_needs_no_shadow_map(renderer, light):
    scene = solid_scene("plane through", light, ambient=None, shadow=ShadowSettings(res=4))
    exact = reference.render(scene, "dual", shadows="exact")
    assert np.abs(renderer.render(scene, method="dual").image - exact).max() < 4 * PASS * exact.max()

    # From below nothing is seen that the light reaches.
    below = scene.camera.replace(from_=(0.5, -3, 2), to=(0, -0.4, 0))
    dark = renderer.render(scene.replace(camera=below, shadow=ShadowSettings(res=512)), method="dual").image
    assert dark[..., 3].max() > 0.5
    assert dark[..., :3].max() < 1e-2 * exact.max()


# --- surfaces in clear air -------------------------------------------------------------------------------

CAMERA = tfm.Camera(from_=(0.5, 1.2, 4.0), to=(0, 0, 0), fov=50, res=(40, 30))
CENTRE, RADIUS, ALBEDO = np.array([0.2, 0.1, -0.1]), 0.7, np.array([0.9, 0.5, 0.2])
PLACE = np.array([1.5, 2.5, 1.0])
INVERSE = {"falloff": "inverse-square", "intensity": (30, 20, 10)}
CLEAR_LIGHTS = {
    "spot": tfm.SpotLight(from_=tuple(PLACE), to=(0, 0, 0), cone=40, **INVERSE),
    "point": PointLight(from_=tuple(PLACE), **INVERSE),
    "sun": SunLight(from_=tuple(PLACE), to=(0, 0, 0), intensity=(3, 2, 1)),
}


def clear_air():
    return tfm.Volume(np.zeros((4, 4, 4)), voxel_size=0.5, origin=(-1, -1, -1))


def clear_scene(light, solids, camera=CAMERA, **changes):
    return tfm.Scene(clear_air(), camera=camera, lights=[light], solids=solids, **changes)


def camera_directions(camera):
    """Directions through the pixels' centres, [height, width, 3], from the camera's definition."""
    width, height = camera.res
    forward = np.subtract(camera.to, camera.from_) / np.linalg.norm(np.subtract(camera.to, camera.from_))
    right = np.cross(forward, (0, 1, 0)) / np.linalg.norm(np.cross(forward, (0, 1, 0)))
    tangent = np.tan(np.radians(camera.fov / 2))
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * tangent * width / height
    y = (1 - (np.arange(height) + 0.5) / height * 2) * tangent
    ray = forward + x[None, :, None] * right + y[:, None, None] * np.cross(right, forward)
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)


def sphere_hit(origin, direction, centre=CENTRE, radius=RADIUS):
    """Distance to a sphere, inf without, and by how much the line passes inside of it."""
    offset = origin - centre
    b = (offset * direction).sum(axis=-1)
    square = radius**2 - ((offset - b[..., None] * direction) ** 2).sum(axis=-1)
    near = -b - np.sqrt(np.maximum(square, 0))
    return np.where((square > 0) & (near > 1e-6), near, np.inf), square


def plane_hit(origin, direction, point, normal):
    slope = direction @ normal
    t = np.divide((point - origin) @ normal, slope, out=np.full(slope.shape, np.inf), where=slope != 0)
    return np.where(t > 0, t, np.inf)


def lambert(light, points, normals, albedo):
    """Radiance of lit surfaces [..., RGB]; ≤ 0 where they face away."""
    if isinstance(light, SunLight):
        towards, gain = np.broadcast_to(PLACE / np.linalg.norm(PLACE), points.shape), 1.0
    else:
        offset = PLACE - points
        distance = np.linalg.norm(offset, axis=-1, keepdims=True)
        towards, gain = offset / distance, 1 / distance**2
    cosine = (towards * normals).sum(axis=-1, keepdims=True)
    inside = np.ones(cosine.shape, bool)
    if isinstance(light, tfm.SpotLight):
        inside = (-towards) @ (-PLACE / np.linalg.norm(PLACE)) > np.cos(np.radians(light.cone))
        inside = inside[..., None]
    return np.where(inside, albedo / np.pi * np.array(light.intensity) * gain * cosine, 0)


@pytest.mark.slow
@pytest.mark.parametrize("light", CLEAR_LIGHTS)
def test_a_convex_sphere_in_clear_air_has_no_acne(renderer, light):
    light = CLEAR_LIGHTS[light]
    sphere = SphereSolid(centre=tuple(CENTRE), radius=RADIUS, albedo=tuple(ALBEDO))
    eye, rays = np.array(CAMERA.from_), camera_directions(CAMERA)

    image = renderer.render(clear_scene(light, [sphere])).image

    distance, inside = sphere_hit(eye, rays)
    hit = np.isfinite(distance)
    points = eye + np.where(hit, distance, 0)[..., None] * rays
    expected = np.where(hit[..., None], lambert(light, points, (points - CENTRE) / RADIUS, ALBEDO), 0)
    lit = expected[..., 0] > 0
    assert lit.sum() > 60
    clear = np.abs(inside) > 1e-5
    limit = LAMBERT * expected.max()  # near the terminator the cosine is a difference of large numbers
    assert np.abs(image[..., :3] - np.maximum(expected, 0))[clear].max() < limit
    assert (image[..., 3] == hit)[clear].all()


@pytest.mark.slow
@pytest.mark.parametrize("light", CLEAR_LIGHTS)
@pytest.mark.parametrize("normal", [(0.3, 1, 0.2), (1, 0.1, 0), (0, 0.05, 1)])
def test_a_tilted_plane_in_clear_air_has_no_acne(renderer, light, normal):
    light, point = CLEAR_LIGHTS[light], np.array([0, -0.6, 0])
    unit = np.array(normal) / np.linalg.norm(normal)
    eye, rays = np.array(CAMERA.from_), camera_directions(CAMERA)

    solids = [PlaneSolid(point=tuple(point), normal=normal, albedo=tuple(ALBEDO))]
    image = renderer.render(clear_scene(light, solids)).image

    distance = plane_hit(eye, rays, point, unit)
    hit = distance < 100  # beyond, float32 places rays 1e-5 wrong
    points = eye + np.where(hit, distance, 0)[..., None] * rays
    towards_eye = unit * np.sign((eye - point) @ unit)
    expected = np.maximum(lambert(light, points, np.broadcast_to(towards_eye, points.shape), ALBEDO), 0)
    if isinstance(light, tfm.SpotLight):  # its rim, where rounding decides
        towards = (points - PLACE) / np.linalg.norm(points - PLACE, axis=-1, keepdims=True)
        rim = towards @ (-PLACE / np.linalg.norm(PLACE)) - np.cos(np.radians(light.cone))
        hit &= np.abs(rim) > 1e-5
    assert (expected[hit] > 0).any()
    difference = np.abs(image[..., :3] - expected)[hit]
    assert (difference <= LAMBERT * (expected[hit] + expected[hit].max() / 10)).all()


@pytest.mark.slow
@pytest.mark.parametrize("light", CLEAR_LIGHTS)
def test_shadows_on_a_plane_end_where_the_silhouette_does(renderer, light):
    light, floor = CLEAR_LIGHTS[light], np.array([0, -0.8, 0])
    sphere = SphereSolid(centre=tuple(CENTRE), radius=RADIUS)
    eye, rays = np.array(CAMERA.from_), camera_directions(CAMERA)
    camera = CAMERA

    solids = [sphere, PlaneSolid(point=tuple(floor))]
    as_elsewhere = {"map": make_scene().map, "medium": make_scene().medium}  # of no effect in clear air
    image = renderer.render(clear_scene(light, solids, camera, **as_elsewhere)).image[..., :3].mean(axis=-1)

    distance = plane_hit(eye, rays, floor, np.array([0.0, 1, 0]))
    seen = (distance < 30) & (distance < sphere_hit(eye, rays)[0])
    points = eye + np.where(seen, distance, 0)[..., None] * rays
    towards = np.broadcast_to(PLACE, points.shape) if isinstance(light, SunLight) else PLACE - points
    towards = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    reached = np.ones(seen.shape, bool)
    if isinstance(light, tfm.SpotLight):
        reached = towards @ (PLACE / np.linalg.norm(PLACE)) > np.cos(np.radians(light.cone)) + 1e-5
    shadowed, inside = sphere_hit(points, towards)
    judged = seen & reached & (np.abs(inside) > 1e-5)
    dark = np.isfinite(shadowed) & judged
    assert dark.sum() > 20
    assert (judged & ~dark).sum() > 100
    assert (image[dark] == 0).all()  # not a pixel off
    assert (image[judged & ~dark] > 0).all()


# --- light through the medium ----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_lights_add_up(renderer, method):
    lights = [LIGHTS["spot"], LIGHTS["sun"], LIGHTS["point inside"]]
    whole = renderer.render(make_scene(solids=SOLIDS["several"], lights=lights), method=method).image
    each = [
        renderer.render(make_scene(solids=SOLIDS["several"], lights=[light]), method=method).image
        for light in lights
    ]

    if method == "dual":  # maps of several lights share one α
        assert np.abs(whole[..., :3] - sum(image[..., :3] for image in each)).max() < 2 * PASS
    assert (whole[..., 3] == each[0][..., 3]).all()
    assert whole[..., :3].max() > max(image[..., :3].max() for image in each)


@pytest.mark.slow
@pytest.mark.parametrize("light", LIGHTS)
def test_the_map_is_as_right_as_it_says(renderer, light):
    scene = solid_scene("several", light, ambient=None, shadow=ShadowSettings(res=256))
    scene = scene.replace(map=tfm.MapSettings(coeffs=8, res=96, steps=64))
    maps = renderer.build_maps(scene)
    found, expected = (renderer.render(scene, maps=maps, method=m) for m in ("tfm", "dual"))
    squares = ((found.image - expected.image)[..., :3] ** 2).sum(axis=-1)
    whole = (expected.image[..., :3] ** 2).sum()
    on_solids = expected.aovs["albedo"].max(axis=-1) > 0

    assert maps[0].error < 0.05
    assert squares[~on_solids].sum() <= (MAP_ERROR * maps[0].error) ** 2 * whole
    # A map is fitted where density is lit; on solids its resolution counts too, most of all a point light's.
    assert squares[on_solids].sum() <= SURFACE_ERROR**2 * whole


def slab(scale=1.0):
    """2 × 2 × 2, constant but for its border voxels."""
    return tfm.Volume(np.ones((32, 32, 32)), voxel_size=2 / 32, origin=(-1, -1, -1), density_scale=scale)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("basis", "range_", "error"),
    [
        ("klt", "box", 5e-3),
        ("klt", "trimmed", 5e-3),
        ("klt", "visible", 5e-3),
        ("klt", "global", 5e-3),
        ("dct", "auto", 0.01),
        ("slices", "auto", 5e-3),
        ("moments", "auto", 0.05),
    ],
)
def test_behind_the_last_density_light_does_not_go_on_falling(renderer, basis, range_, error):
    sigma, images = 0.7, []
    for z in (-1.2, -5.0, -100.0):
        scene = tfm.Scene(
            slab(),
            tfm.Medium(sigma_s=sigma),
            tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(1, 1), fov=1),
            [tfm.SpotLight(from_=(0, 0, 4), to=(0, 0, 0), cone=30, intensity=1000 * np.pi)],
            tfm.MapSettings(basis=basis, res=32, range=range_),
            tfm.MarchSettings(steps=300),
            solids=[PlaneSolid(point=(0, 0, z), normal=(0, 0, 1), albedo=1)],
        )
        empty = renderer.render(scene.replace(solids=())).image
        images.append((renderer.render(scene).image - empty)[0, 0, 0])

    # There and back; each border voxel holds half a voxel more than nothing.
    assert images[0] == pytest.approx(1000 * np.exp(-2 * sigma * 2.0), rel=2 * error)
    # One range for all rays ends behind this ray's last density: the first plane is within it.
    behind = images[1:] if range_ == "global" else images
    assert np.ptp(behind) < 1e-5 * images[0]


@pytest.mark.slow
@pytest.mark.parametrize("light", ["sun", "spot", "point"])
@pytest.mark.parametrize("basis", ["klt", "dct"])
def test_brightness_is_continuous_across_the_silhouette(renderer, light, basis):
    # Density falls smoothly to 0 before its box ends: what the box's silhouette shows is an error.
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, 24)] * 3, indexing="ij")
    volume = tfm.Volume(
        np.clip(1 - np.sqrt(x**2 + y**2 + z**2) / 0.9, 0, 1), voxel_size=2 / 24, origin=(-1, -1, -1)
    )
    lights = {
        "sun": SunLight(from_=(0, 0, 4), to=(0, 0, 0), intensity=np.pi),
        "spot": tfm.SpotLight(from_=(0, 0, 4), to=(0, 0, 0), cone=50, intensity=np.pi),
        "point": PointLight(from_=(0, 0, 4), intensity=np.pi),
    }
    scene = tfm.Scene(
        volume,
        tfm.Medium(sigma_s=0.0, sigma_a=3.0),
        tfm.Camera(from_=(0, 0, 8), to=(0, 0, 0), res=(160, 1), fov=0.05),
        [lights[light]],
        tfm.MapSettings(basis=basis, res=256, steps=64),
        tfm.MarchSettings(steps=64),
        solids=[PlaneSolid(point=(0, 0, -2), normal=(0, 0, 1), albedo=1)],
    )
    scene = scene.replace(camera=scene.camera.replace(res=(160, 2), fov=1.0, from_=(0, 0.02, 8)))
    image, dual = (renderer.render(scene, method=method).image[..., 0] for method in ("tfm", "dual"))

    distance = 10.0
    pixel = 2 * np.tan(np.radians(0.5)) / 2 * distance
    at = (np.arange(160) + 0.5 - 80) * pixel
    offset = np.hypot(at, 0.0)
    cosine = 1.0 if light == "sun" else 6 / np.hypot(6, offset)
    clear = (offset > 2.2) & (offset < 6.5)  # outside of the silhouette, on the way in or out; lit
    assert clear.sum() > 20
    np.testing.assert_allclose((image / cosine)[:, clear], 1, rtol=5e-5)
    assert image.min() < 0.9 * image.max()
    lit = offset < 6.5
    assert np.abs(image - dual)[:, lit].max() < 0.02  # the map's error; no jump at the silhouette


@pytest.mark.slow
@pytest.mark.parametrize("light", ["spot", "sun"])
def test_lit_samples_beside_a_shadow_see_the_march(renderer, light):
    # The map keeps the T that reaches a solid, so that texels across its edge may be interpolated (E6).
    scene = solid_scene("sphere inside", light, shadow=ShadowSettings(res=512))
    scene = scene.replace(map=tfm.MapSettings(coeffs=8, res=96, steps=96))
    light_map = renderer.build_maps(scene)[0]
    without = renderer.build_maps(scene.replace(solids=()))[0]
    placed = light_map.light
    axis = placed.frame().world_from_light[:3, 2]
    across = placed.frame().world_from_light[:3, 0]
    at = np.array(BALL.centre) + 0.3 * axis + np.linspace(-0.7, 0.7, 401)[:, None] * across

    lit = reference.solid_visibility(scene, placed, at) == 1
    exact = np.exp(-reference.light_optical_depth(scene, placed, at))

    edge = np.flatnonzero(np.diff(lit.astype(int)))
    assert len(edge) == 2
    near = lit & (np.abs(np.subtract.outer(np.arange(401), edge)).min(axis=1) < 12)
    error, usual = (np.abs(m.evaluate(at) - exact) for m in (light_map, without))
    assert error[near].max() < MAP_ERROR * max(usual[near].max(), without.error)
    assert error[lit].max() < 0.03


def test_maps_serve_the_same_solids_only(renderer):
    scene = solid_scene("sphere inside", "spot")
    maps = renderer.build_maps(scene)

    renderer.render(scene.replace(camera=INSIDE), maps=maps)
    for solids in ((), [BALL.replace(radius=0.3)], [BALL, FLOOR]):
        with pytest.raises(SceneError, match="another set of solids"):
            renderer.render(scene.replace(solids=tuple(solids)), maps=maps)


@pytest.mark.slow
def test_equal_solids_made_twice_are_the_same(renderer):
    # What they keep of their transforms, arrays, has no part in it.
    first, again = ([PlaneSolid(point=(0, -0.8, 0)), BALL.replace(radius=0.3)] for _ in range(2))
    first = make_scene(solids=first)
    second = first.replace(solids=tuple(again))
    image = renderer.render(first).image
    renderer.render(make_scene(solids=[FLOOR]))
    renderer.render(second)  # both have been traced now

    assert first.solids == second.solids
    assert (renderer.render(first).image == image).all()


def test_maps_serve_the_same_shadow_map_only(renderer):
    # Where a coarse shadow map misses a slit, a light ray ends there: behind it T would be that of the slit.
    sides = [
        BoxSolid(from_=(-3, 1.05, -3), to=(-0.02, 1.1, 3)),
        BoxSolid(from_=(0.02, 1.05, -3), to=(3, 1.1, 3)),
    ]
    scene = make_scene(
        volume=make_scene().volume.with_density_scale(12),
        lights=[tfm.SpotLight(from_=(0, 4, 0), to=(0, 0, 0), cone=25, intensity=3)],
        solids=sides,
    )
    maps = renderer.build_maps(scene.replace(shadow=ShadowSettings(res=16)))

    with pytest.raises(SceneError, match="shadow"):
        renderer.render(scene, maps=maps)


@pytest.mark.slow
@pytest.mark.parametrize("reflects", [0.0, 0.6])
def test_ambient_closed_forms(renderer, reflects):
    sky, sigma_s, sigma_a = np.array([0.5, 1.0, 2.0]), np.array([0.3, 0.6, 0.9]), 0.2
    scene = tfm.Scene(
        slab(),
        tfm.Medium(sigma_s=tuple(sigma_s), sigma_a=sigma_a),
        tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(1, 1), fov=1),
        [tfm.SpotLight(from_=(0, 0, 4), to=(0, 0, 0), intensity=0)],
        march=tfm.MarchSettings(steps=400),
        ambient=Ambient(radiance=tuple(sky)),
    )
    for z, depth in ((-3.0, 2.0), (0.0, 1.0 + 1 / 64 - 1 / 64)):
        floor = PlaneSolid(point=(0, 0, z), normal=(0, 0, 1), albedo=reflects)
        pixel = renderer.render(scene.replace(solids=(floor,))).image[0, 0]
        through = np.exp(-(sigma_s + sigma_a) * depth)
        scattered = sigma_s / (sigma_s + sigma_a) * (1 - through)
        np.testing.assert_allclose(pixel[:3], sky * (scattered + through * reflects), rtol=2e-3)
        assert pixel[3] == 1
    np.testing.assert_allclose(
        renderer.render(scene).image[0, 0, :3],
        sky * sigma_s / (sigma_s + sigma_a) * (1 - np.exp(-(sigma_s + sigma_a) * 2)),
        rtol=2e-3,
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("solids", [(), (BALL,)], ids=["medium", "solid"])
def test_a_light_crosses_the_box_without_a_jump(renderer, solids, method):
    def brightness(steps):
        heights = np.linspace(0.75, 1.75, steps + 1)
        images = [
            renderer.render(
                make_scene(
                    lights=[PointLight(from_=(0.1, y, 0.2), **BRIGHT)],
                    solids=solids,
                    camera=make_scene().camera.replace(res=(5, 5)),
                    shadow=ShadowSettings(res=256),
                ),
                method=method,
            ).image[..., 0]
            for y in heights
        ]
        return np.array(images)

    coarse, fine = brightness(5), brightness(20)
    # Four times the steps, a quarter of each change; a jump would stay as it is.
    changes = [np.abs(np.diff(images, axis=0)).max() for images in (coarse, fine)]
    assert fine.max() > 0.01
    assert changes[1] < changes[0] / 2


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_far_spot_is_a_sun(renderer, method):
    sun = LIGHTS["sun"]
    direction = np.subtract(sun.from_, sun.to) / np.linalg.norm(np.subtract(sun.from_, sun.to))
    cone = float(np.degrees(np.arctan(3 / 3000)))
    spot = tfm.SpotLight(from_=tuple(3000 * direction), to=(0, 0, 0), cone=cone, intensity=sun.intensity)
    scene = make_scene(solids=[BALL, PlaneSolid(point=(0, -0.9, 0))], shadow=ShadowSettings(res=512))
    scene = scene.replace(map=tfm.MapSettings(coeffs=8, res=128, steps=64))
    near = scene.camera.replace(to=(0, 0.3, 0), fov=30)
    results = [
        renderer.render(scene.replace(lights=[light], camera=near), method=method) for light in (sun, spot)
    ]
    images = [result.image[..., :3] for result in results]
    # The spot lights a disk of radius 3 only; where the floor lies beyond it the two differ.
    rays = reference.camera_rays(near)
    points = rays.at(results[0].aovs["solid_distance"].ravel())
    off_axis = np.linalg.norm(np.cross(points, direction), axis=1).reshape(images[0].shape[:2])
    reached = (off_axis < 2.9) | (results[0].aovs["solid_distance"] == 0)

    # Rays differ by a thousandth, and so do the shadow's edges; float32 holds 3000 to 2e-4.
    difference = np.abs(images[0] - images[1])[reached]
    assert images[0].max() > 0.3
    assert np.median(difference) < 1e-3
    assert difference.mean() < 5e-3 * images[0].mean() + 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_an_endless_ceiling_keeps_the_sun_out(renderer, method):
    sun = SunLight(from_=(0, 1, 0), to=(0, 0, 0), **BRIGHT)
    for height in (1.6, 3.0, 50.0):
        scene = make_scene(lights=[sun], solids=[PlaneSolid(point=(0, height, 0))])
        assert renderer.render(scene, method=method).image[..., :3].max() == 0


@pytest.mark.slow
def test_the_sky_does_not_shine_through_the_ground(renderer):
    scene = make_scene(
        lights=[EnvironmentLight(intensity=1, samples=8)],
        solids=[PlaneSolid(point=(0, -3, 0))],
        shadow=ShadowSettings(res=256),
    )
    image, exact = renderer.render(scene, method="dual").image, reference.render(scene, "dual")

    assert image[..., :3].mean() == pytest.approx(exact[..., :3].mean(), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_large_ground_costs_no_digits(renderer, method):
    sun = SunLight(from_=(1, 1, 0.3), to=(0, 0, 0), **BRIGHT)
    size = 1e6
    grounds = [
        BoxSolid(from_=(-size, -2 - size, -size), to=(size, -2, size)),
        PlaneSolid(point=(0, -2, 0)),
    ]
    image, expected = (
        renderer.render(make_scene(lights=[sun], solids=[ground, BALL]), method=method).image
        for ground in grounds
    )

    assert np.abs(image - expected).max() < 20 * PASS


@pytest.mark.quick("tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_a_crop_shows_what_the_whole_frame_does(renderer, method):
    scene = solid_scene("several", "spot")
    whole = renderer.render(scene, method=method).image

    part = renderer.render(scene, method=method, crop=(5, 3, 14, 11)).image

    assert (part == whole[3:11, 5:14]).all()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_light_or_camera_within_a_solid(renderer, method):
    light = PointLight(from_=BALL.centre, **BRIGHT)
    hidden = renderer.render(make_scene(lights=[light], solids=[BALL]), method=method).image
    assert np.isfinite(hidden).all()
    assert hidden[..., :3].max() == 0

    around = BALL.replace(centre=make_scene().camera.from_)
    image = renderer.render(make_scene(solids=[around]), method=method).image
    assert (image == [0, 0, 0, 1]).all()


# --- textures --------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("side", ["behind the light", "from the side"])
def test_a_textured_spot_throws_its_image_upright(renderer, tmp_path, side):
    texture = np.random.default_rng(3).uniform(0.1, 1, size=(3, 4, 3)).astype(np.float32)
    np.save(tmp_path / "slide.npy", texture)
    cone, distance = 30.0, 5.0
    half = distance * np.tan(np.radians(cone))
    light = tfm.SpotLight(
        from_=(0, 0, distance), to=(0, 0, 0), cone=cone, intensity=np.pi, texture=tmp_path / "slide.npy"
    )
    eye = (0.0, 0.0, 6.0) if side == "behind the light" else (3.0, 1.0, 5.0)
    camera = tfm.Camera(from_=eye, to=(0, 0, 0), fov=60, res=(40, 30))
    wall = PlaneSolid(point=(0, 0, 0), normal=(0, 0, 1), albedo=1)

    image = renderer.render(clear_scene(light, [wall], camera)).image[..., :3]

    rays = camera_directions(camera)
    points = np.array(eye) - rays * (eye[2] / rays[..., 2:])
    radius = np.hypot(points[..., 0], points[..., 1])
    cosine = distance / np.hypot(distance, radius)
    # Who stands behind the light, looking along it, has x to the right and y up.
    column = np.clip((points[..., 0] / half + 1) / 2 * 4 - 0.5, 0, 3)
    row = np.clip((1 - points[..., 1] / half) / 2 * 3 - 0.5, 0, 2)
    low_x, low_y = np.minimum(column.astype(int), 2), np.minimum(row.astype(int), 1)
    fx, fy = (column - low_x)[..., None], (row - low_y)[..., None]
    upper = (1 - fx) * texture[low_y, low_x] + fx * texture[low_y, low_x + 1]
    lower = (1 - fx) * texture[low_y + 1, low_x] + fx * texture[low_y + 1, low_x + 1]
    expected = ((1 - fy) * upper + fy * lower) * cosine[..., None]
    lit, dark = radius < half * (1 - 1e-5), radius > half * (1 + 1e-5)
    assert lit.sum() > 200
    assert dark.sum() > 50
    np.testing.assert_allclose(image[lit], expected[lit], atol=4 * LAMBERT)
    assert (image[dark] == 0).all()


@pytest.mark.slow
def test_a_texture_colours_medium_and_solids_alike(renderer, tmp_path, save_on_failure):
    texture = np.random.default_rng(4).uniform(0, 1, size=(5, 7, 3)).astype(np.float32)
    np.save(tmp_path / "slide.npy", texture)
    light = LIGHT.replace(texture=str(tmp_path / "slide.npy"), intensity=6)
    scene = make_scene(lights=[light], solids=SOLIDS["several"], shadow=ShadowSettings(res=48))

    for method in ("tfm", "dual"):
        check_equal(renderer, save_on_failure, scene, method)


@pytest.mark.slow
def test_a_medium_far_from_the_origin_among_solids(renderer, save_on_failure):
    away = np.array([1e4, -2e4, 1e4])
    placed = turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), np.add(away, (-1.1, -1.0, -0.9)))
    near = make_scene()
    scene = make_scene(
        volume=tfm.Volume(blobs(), world_from_index=placed, density_scale=4.0),
        camera=near.camera.replace(from_=tuple(away + near.camera.from_), to=tuple(away + near.camera.to)),
        lights=[LIGHT.replace(from_=tuple(away + LIGHT.from_), to=tuple(away))],
        solids=[BALL.replace(centre=tuple(away + BALL.centre))],
        shadow=ShadowSettings(res=48),
    )

    check_equal(renderer, save_on_failure, scene, "dual")
