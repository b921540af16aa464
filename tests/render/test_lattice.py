"""Light on a lattice, looked up once a voxel: nearly the picture of light looked up at every sample."""

import numpy as np
import pytest
from scenes import blobs, turned
from tolerances import LANES, LIGHTS, PASS

import tfm_cl as tfm
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.maps.bases import BASES
from tfm_cl.plan import lattice, resolution
from tfm_cl.plan.plan import plan
from tfm_cl.render import batches
from tfm_cl.render import lattice as module

pytestmark = pytest.mark.lanes

SETTLED = tfm.MapSettings(basis="dct", coeffs=8, density_weighting=10.0, res=96, steps=120)
LIGHT = (2.2, 3.0, 1.2)
SUN = tfm.SunLight(from_=LIGHT, to=(0, 0, 0))
SPOT = tfm.SpotLight(from_=(-1.5, 3.0, -2.0), to=(0, 0, 0), cone=40)
POINT = tfm.PointLight(from_=(-2, 2.5, 1.5), falloff="inverse-square", intensity=8.0)
WHITE = [SUN, SPOT, POINT]
COLOURS = [
    SUN.replace(intensity=(1, 0.2, 0.1)),
    SPOT.replace(intensity=(0.1, 0.4, 1)),
    POINT.replace(intensity=(0.2, 3, 0.1)),
]
COLOURED_SUNS = [SUN.replace(from_=light.from_, intensity=light.intensity) for light in COLOURS]
CAMERA = tfm.Camera(from_=(0.6, 0.8, 5), to=(0, 0, 0), fov=32, res=(32, 28))
TOWARDS_THE_SUN = CAMERA.replace(from_=(-2.2, -3.0, -1.2), up=(0, 0, 1), fov=40)
INSIDE = CAMERA.replace(from_=(-0.3, -0.2, 0.1), to=LIGHT, up=(0, 0, 1), fov=70)
RGB = tfm.Medium(sigma_s=(1.0, 0.8, 0.5), sigma_a=(0.1, 0.3, 0.2), phase=tfm.HenyeyGreenstein(0.4))
GREY = tfm.Medium(sigma_s=0.8, sigma_a=0.2)
HAZY = tfm.Medium(phase=tfm.HenyeyGreenstein(0.4))
LASER = tfm.Medium(phase=tfm.HenyeyGreenstein(0.99))
WARNS = 'map.lookup = "lattice" cannot hold all light; the rest is looked up at every sample: '


def a_blob(shape=(30, 28, 32), seed=7, **changes):
    """Smooth, 2.4 wide; a typical voxel has an optical depth of 0.1."""
    place = {"voxel_size": 2.4 / 32, "origin": (-1.2, -1.1, -1.2)}
    if "world_from_index" in changes:
        place = {}
    return tfm.Volume(blobs(shape, seed), **{"density_scale": 2.0, **place, **changes})


def scene_of(lights=WHITE, volume=None, medium=GREY, camera=CAMERA, settings=SETTLED, **march):
    return tfm.Scene(
        a_blob() if volume is None else volume,
        medium=medium,
        camera=camera,
        lights=lights,
        map=settings,
        march=tfm.MarchSettings(**{"steps": 120, **march}),
    )


def looked_up(scene, how):
    return scene.replace(map=scene.map.replace(lookup=how))


def on_lattice(scene):
    return looked_up(scene, "lattice")


def per_sample(scene):
    """As a lattice looks maps up, but at every sample."""
    basis = BASES["klt" if scene.map.basis == "auto" else scene.map.basis]
    return looked_up(scene, basis.defaults.lookup)


def error_of(image, truth):
    """RMSE over the lit pixels, relative to their mean."""
    lit = truth[..., 3] > 1e-3
    difference = (image - truth)[lit, :3].astype(np.float64)
    return np.sqrt((difference**2).mean()) / truth[lit, :3].mean()


def estimate(scene):
    """What the plan expects of it."""
    return lattice.ERROR_PER_DEPTH * lattice.depth_of_voxels(scene)


def both(renderer, scene, **named):
    """The picture on a lattice, and that of light looked up at every sample."""
    return renderer.render(on_lattice(scene), **named), renderer.render(per_sample(scene), **named)


def check_close(renderer, scene, bound=None):
    """Compare with the picture of light looked up at every sample; the lattice has to be in use."""
    found, truth = both(renderer, scene)
    assert found.warnings == ()
    assert np.isfinite(found.image).all()
    assert 0 < error_of(found.image, truth.image) <= (estimate(scene) if bound is None else bound)
    return found, truth


# ------------------------------------------------------------------------------------ as every sample's

COLOURED = a_blob(colour=np.random.default_rng(1).uniform(0.3, 1, (30, 1, 32, 3)) * np.ones((30, 28, 32, 3)))
OVERLAPPING = [
    a_blob(),
    a_blob((20, 22, 18), 3, voxel_size=0.1, origin=(-0.6, -1.2, -1.0), density_scale=1.5),
]
CASES = {
    "sun, spot, point": {},
    "sun": {"lights": [SUN]},
    "spot": {"lights": [SPOT]},
    "point": {"lights": [POINT]},
    "points of an area": {"lights": [SPOT.replace(radius=0.5, samples=7)]},
    "environment": {"lights": [tfm.EnvironmentLight(samples=16)]},
    "coloured lights": {"lights": COLOURS},
    "coloured medium": {"medium": RGB},
    "coloured lights in a coloured medium": {"lights": COLOURS, "medium": RGB},
    "coloured suns in a coloured medium": {"lights": COLOURED_SUNS, "medium": RGB},
    "coloured voxels": {"lights": COLOURS, "volume": COLOURED},
    "phase function": {"medium": HAZY},
    "phase function towards the sun": {"medium": HAZY, "camera": TOWARDS_THE_SUN},
    "16 bits": {"voxels": "f16"},
    "8 bits": {"voxels": "u8"},
    "overlapping grids": {"volume": OVERLAPPING},
    "overlapping grids, the other way round": {"volume": OVERLAPPING[::-1]},
    "turned voxels of unequal edges": {
        "volume": a_blob(
            world_from_index=turned(25, (1, 2, 0.5), (0.06, 0.08, 0.056), (-0.8, -1.0, -0.9)),
            density_scale=1.5,
        )
    },
    "camera inside": {"camera": INSIDE},
    "camera far away": {"camera": TOWARDS_THE_SUN.replace(from_=(-2200, -3000, -1200), fov=0.06)},
    # Rays of a tile lie too far apart to be walked together.
    "camera of wide tiles": {"camera": CAMERA.replace(from_=(0.3, 0.3, 1.4), fov=150, res=(24, 20))},
    "best basis": {"settings": tfm.MapSettings(res=96, steps=120)},
    "no skipping": {"skip_empty": False},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_is_as_close_as_the_plan_says(renderer, case):
    found, truth = check_close(renderer, scene_of(**CASES[case]))

    for layer in ("transmittance", "depth"):
        assert np.abs(found.aovs[layer] - truth.aovs[layer]).max() <= PASS * truth.aovs[layer].max()
    seen = truth.image[..., 3] > 0.01
    light = "light_transmittance"
    assert np.abs(found.aovs[light] - truth.aovs[light])[seen].max() <= 0.01  # of 1


OF_A_STEP = 1e-4
"""Where one of several grids ends another's lattice begins: a sample on the border, which rounding puts in
the one or the other, is 1 % off at an optical depth of less than 0.02 of 120 steps."""


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [4, 16])
@pytest.mark.parametrize("case", ["sun, spot, point", "coloured voxels", "overlapping grids"])
def test_lanes_do_not_show(device_name, new_renderer, renderer, lanes, case):
    if lanes not in Launcher(choose_device(device_name)).lanes_possible:
        pytest.skip(f"the device has not {lanes} lanes")
    scene = on_lattice(scene_of(**CASES[case]))
    expected = renderer.render(scene).image
    with new_renderer(lanes=lanes) as other:
        found = other.render(scene).image

    tolerance = 4 * LANES + (OF_A_STEP if len(scene.grids) > 1 else 0)
    assert np.abs(found - expected).max() <= tolerance * expected.max()


@pytest.mark.slow
def test_halving_the_voxels_quarters_the_error(renderer):
    coarse, fine = (
        scene_of([SUN], a_blob(shape, voxel_size=2.4 / shape[2]), steps=200)
        for shape in ((15, 14, 16), (30, 28, 32))
    )
    errors = [error_of(*(result.image for result in both(renderer, scene))) for scene in (coarse, fine)]

    assert 3 < errors[0] / errors[1] < 5


def test_constant_density_is_exact(renderer):
    # Behind the first voxel the optical depth of parallel light is linear. From the middle of a deep slab no
    # border is seen: L = ∫ p D e^{-D s} e^{-D (h - y s)} ds, y the rise of the ray, h the medium above.
    density, above = 0.4, 6.0
    slab = tfm.Volume(np.full((64, 12, 24), density), voxel_size=1.0, origin=(-12, -6, -60))
    sun = tfm.SunLight(from_=(0, 9, 0), to=(0, 0, 0))
    camera = tfm.Camera(from_=(0, 0, 0), to=(0, 0, -1), fov=24, res=(1, 24))
    settings = tfm.MapSettings(res=128, steps=400)
    scene = scene_of([sun], slab, tfm.Medium(), camera, settings, steps=600)

    found = renderer.render(on_lattice(scene)).image[:, 0, 0].astype(np.float64)

    slope = np.tan(np.radians(12)) * (1 - (2 * np.arange(24) + 1) / 24)
    rise = slope / np.hypot(slope, 1)
    expected = np.exp(-density * above) / (4 * np.pi * (1 - rise))
    # What 8 coefficients and the march leave; linear transmittance would be D² / 8 = 2 % off.
    assert np.abs(found / expected - 1).max() <= 1e-3


# --------------------------------------------------------------------------------- sums over the lights


def test_two_equal_lights_give_twice_one(renderer):
    one, two = (renderer.render(on_lattice(scene_of([POINT] * n))) for n in (1, 2))

    assert np.abs(two.image[..., :3] - 2 * one.image[..., :3]).max() <= PASS * two.image.max()
    assert np.abs(two.aovs["light_transmittance"] - one.aovs["light_transmittance"]).max() <= PASS


@pytest.mark.slow
def test_a_light_without_intensity_adds_nothing(renderer):
    dark = [light.replace(intensity=0.0) for light in WHITE]
    lit = renderer.render(on_lattice(scene_of()))

    assert np.abs(renderer.render(on_lattice(scene_of([*WHITE, *dark]))).image - lit.image).max() <= (
        PASS * lit.image.max()
    )
    assert renderer.render(on_lattice(scene_of(dark))).image[..., :3].max() == 0


def test_a_colour_that_no_light_has_stays_black(renderer):
    # Of red and blue lights, which are not multiples of one colour.
    red, blue, none = (1, 0, 0), (0, 0, 1), 0
    lights = [
        sun.replace(intensity=colour) for sun, colour in zip(COLOURED_SUNS, (red, blue, none), strict=True)
    ]
    image = renderer.render(on_lattice(scene_of(lights, medium=RGB))).image

    assert image[..., 1].max() == 0
    assert image[..., [0, 2]].max(axis=(0, 1)).min() > 0.01


@pytest.mark.parametrize("factor", [1e-30, 1e-6, 1e20])
def test_colours_of_very_dim_and_very_bright_lights(renderer, factor):
    scene = scene_of(COLOURED_SUNS, medium=RGB)
    scaled = scene.replace(
        lights=[light.replace(intensity=factor * np.array(light.intensity)) for light in COLOURED_SUNS]
    )
    expected, found = (renderer.render(on_lattice(one)).image[..., :3] for one in (scene, scaled))

    assert np.abs(found / factor - expected).max() <= 4 * PASS * expected.max()


def test_the_order_of_lights_does_not_show(renderer):
    lights = [*WHITE, SUN.replace(from_=(3, -1, 2), intensity=0.3)]
    one, other = (renderer.render(on_lattice(scene_of(order))).image for order in (lights, lights[::-1]))

    assert np.abs(one - other).max() <= LIGHTS * one.max()


def test_launches_and_batches_do_not_show(renderer, monkeypatch):
    scene = on_lattice(scene_of([*WHITE, SUN.replace(from_=(3, -1, 2)), POINT.replace(from_=(2, -3, 1))]))
    whole = renderer.render(scene).image
    monkeypatch.setattr(batches, "BATCH_BYTES", 1)
    monkeypatch.setattr(module, "LOOK_UPS", 1)

    assert renderer.render(scene).image.tobytes() == whole.tobytes()


def test_voxels_that_touch_no_density_are_not_seen(renderer, monkeypatch):
    # No light is looked up there; what lies in memory before is no number, and lanes read it in windows.
    specks = np.where(np.random.default_rng(5).random((30, 28, 32)) > 0.995, 20.0, 0.0)
    volume = tfm.Volume(specks, voxel_size=2.4 / 32, origin=(-1.2, -1.1, -1.2))
    scene = on_lattice(scene_of([SUN], volume, camera=CAMERA.replace(up=(1, 0, 0), res=(84, 96))))
    expected, empty = renderer.render(scene).image, Launcher.empty

    def no_numbers(self, what, nbytes, **how):
        buffer = empty(self, what, nbytes, **how)
        if "lattice" in what:
            self.write(buffer, np.full(nbytes, 255, np.uint8))
        return buffer

    monkeypatch.setattr(Launcher, "empty", no_numbers)

    assert renderer.render(scene).image.tobytes() == expected.tobytes()


def test_where_a_lattice_has_light_is_found_once(renderer):
    volume, changed = a_blob(seed=11), a_blob(seed=12)
    scene = on_lattice(scene_of(volume=volume))
    moved = scene.replace(lights=[SUN.replace(from_=(2.1, 3.1, 1.2)), SPOT, POINT])
    made = [
        {kind: count for kind, count in renderer.render(one).stats.made.items() if "lattice" in kind}
        for one in (scene, scene.replace(camera=CAMERA.replace(fov=40)), moved, scene.replace(volume=changed))
    ]

    assert made == [
        {"lattice": 1, "lattice order": 3},
        {},
        {"lattice order": 1},
        {"lattice": 1, "lattice order": 3},
    ]
    # What was kept is what would be made.
    kept = renderer.render(scene).image
    renderer._cache.clear()
    assert renderer.render(scene).image.tobytes() == kept.tobytes()


# -------------------------------------------------------------------- what is looked up at every sample

EDGES = {
    "cone": tfm.SpotLight(from_=LIGHT, to=(0, 0, 0), cone=8),
    "soft cone": tfm.SpotLight(from_=LIGHT, to=(0, 0, 0), cone=30, blend=0.8),
    "reach": tfm.PointLight(from_=(-2, 2.5, 1.5), reach=3.5),
    "source inside": tfm.PointLight(from_=(0, 0.2, 0.1), falloff="inverse-square"),
    "source near": tfm.PointLight(from_=(0, 1.3, 0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", EDGES)
def test_lights_with_edges_are_looked_up_at_every_sample(renderer, kind):
    alone, beside = scene_of([EDGES[kind]]), scene_of([SUN, EDGES[kind], SPOT, POINT])

    edge, expected = both(renderer, alone)
    assert (edge.image == expected.image).all()
    assert edge.warnings == (f"{WARNS}1 of 1 lights have an edge in the grids or are near them",)
    found, truth = both(renderer, beside)
    assert 0 < error_of(found.image, truth.image) <= estimate(beside)
    assert found.warnings == (f"{WARNS}1 of 4 lights have an edge in the grids or are near them",)


@pytest.mark.slow
def test_a_texture_is_looked_up_at_every_sample(renderer, tmp_path):
    np.save(tmp_path / "a.npy", np.random.default_rng(3).random((4, 4, 3)).astype(np.float32))
    scene = scene_of([SPOT.replace(texture=str(tmp_path / "a.npy"))])

    found, truth = both(renderer, scene)
    assert (found.image == truth.image).all()
    assert found.warnings == (f"{WARNS}1 of 1 lights have an edge in the grids or are near them",)


LUMP = tfm.Volume(np.pad(blobs((6, 6, 6)) + 0.1, 4), voxel_size=0.1, origin=(-0.7, -0.7, -0.7))
BESIDE = tfm.PointLight(from_=(0.05, 0.55, 0.05))
OTHERS = {
    "solids": (
        scene_of([SUN]).replace(solids=[tfm.SphereSolid(centre=(0, 0.5, 0), radius=0.3)]),
        "the shadows of solids have edges within a voxel",
    ),
    "a box": (
        scene_of([SUN], [a_blob(), tfm.BoxVolume(density=0.1)]),
        "bodies of constant density have no voxels",
    ),
    "a box alone": (scene_of([SUN], tfm.BoxVolume(density=0.3)), "no grid has voxels to look light up at"),
    "two media": (
        scene_of([SUN], [OVERLAPPING[0].with_medium(HAZY), OVERLAPPING[1]]),
        "several media scatter differently",
    ),
    "sharp phase function": (
        scene_of([SUN], medium=LASER, camera=TOWARDS_THE_SUN),
        "the camera or lights are so near that what is scattered changes within a voxel",
    ),
    "falloff from nearby": (
        scene_of([BESIDE.replace(falloff="inverse-square")], LUMP),
        "the camera or lights are so near that what is scattered changes within a voxel",
    ),
    "phase function from inside": (
        scene_of([SUN], medium=HAZY, camera=INSIDE),
        "the camera or lights are so near that what is scattered changes within a voxel",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", OTHERS)
def test_what_no_lattice_can_hold_is_looked_up_at_every_sample(renderer, what):
    scene, why = OTHERS[what]
    found, truth = both(renderer, scene)

    assert found.image.tobytes() == truth.image.tobytes()
    assert found.warnings == (WARNS + why,)
    assert truth.warnings == ()
    assert np.isfinite(found.image).all()


@pytest.mark.slow
def test_grids_of_equal_media_are_one_medium(renderer):
    check_close(renderer, scene_of([SUN], [grid.with_medium(GREY.replace()) for grid in OVERLAPPING], RGB))


def test_the_dual_march_takes_no_lattice(renderer):
    scene = scene_of([SPOT], camera=CAMERA.replace(res=(12, 10)))
    found, truth = (result.image for result in both(renderer, scene, method="dual"))

    assert (found == truth).all()
    assert renderer.render(on_lattice(scene_of([EDGES["cone"]])), method="dual").warnings == ()


@pytest.mark.lanes
def test_a_lattice_too_large_for_the_device_is_told(new_renderer, renderer):
    scene = scene_of([SUN], settings=SETTLED.replace(res=32))
    with new_renderer(lanes=renderer.lanes, largest_buffer=1 << 18) as small:
        found, truth = both(small, scene)

    assert (found.image == truth.image).all()
    (line,) = found.warnings
    assert line.startswith("light is looked up at every sample: a lattice needs ")
    assert line.endswith(" MiB in one buffer, more than the device allows")
    assert renderer.render(on_lattice(scene)).warnings == ()


# ----------------------------------------------------------------------------------------------- limits


def test_what_the_camera_does_not_see(renderer):
    away = scene_of(camera=CAMERA.replace(to=(0, 0, 99)))
    found, truth = both(renderer, away)
    assert found.image.max() == 0
    assert (found.image == truth.image).all()

    part = renderer.render(on_lattice(scene_of()), crop=(5, 3, 21, 19))
    assert (part.image == renderer.render(on_lattice(scene_of())).image[3:19, 5:21]).all()


@pytest.mark.slow
def test_an_empty_grid_is_black(renderer):
    found, truth = both(renderer, scene_of(volume=a_blob(density_scale=0.0)))
    assert (found.image == truth.image).all()
    empty = tfm.Volume(np.zeros((9, 8, 7)), voxel_size=0.3, origin=(-1, -1, -1))
    assert renderer.render(on_lattice(scene_of(volume=empty))).image.max() == 0


@pytest.mark.slow
def test_a_light_and_the_camera_at_a_voxel_beside_the_density(renderer):
    # A block's voxels reach beyond what has density: the light is as near as it may be, at the centre of one.
    scene = scene_of([BESIDE], LUMP, camera=CAMERA.replace(from_=BESIDE.from_, fov=80, res=(16, 16)))

    check_close(renderer, scene, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e4, 1e25])
def test_any_density_gives_finite_numbers(renderer, scale):
    scene = scene_of(COLOURS, a_blob(density_scale=scale), RGB)
    image = renderer.render(on_lattice(scene)).image

    assert np.isfinite(image).all()
    assert image.min() >= 0


def test_the_error_of_the_maps_is_that_of_every_sample(renderer):
    scene = scene_of([SUN])
    found, truth = both(renderer, scene, aovs=["map_error"])

    assert found.aovs["map_error"].max() > 1e-3
    assert (found.aovs["map_error"] == truth.aovs["map_error"]).all()


EDGE = tfm.SpotLight(from_=LIGHT, to=(0, 0, 0), cone=8)
HAS_AN_ERROR = {
    "sun, spot, point": {},
    "coloured lights in a coloured medium": {"lights": COLOURS, "medium": RGB},
    "overlapping grids": {"volume": OVERLAPPING},
    "beside a light with an edge": {"lights": [SUN, EDGE, POINT]},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", HAS_AN_ERROR)
def test_the_error_of_the_lattice_is_that_of_the_pixel(renderer, case):
    # All lights of a lattice share the samples of the camera, which lie evenly in the world.
    scene = scene_of(**HAS_AN_ERROR[case], sampling="world").replace(ambient=tfm.Ambient(radiance=0.02))
    found, truth = both(renderer, scene, aovs=["lattice_error"])
    pictures = np.stack([found.image[..., :3], truth.image[..., :3]]).astype(np.float64)

    brighter = np.maximum(pictures.max(axis=0).sum(axis=-1), 1e-30)
    expected = np.abs(pictures[0] - pictures[1]).sum(axis=-1) / brighter
    seen = truth.image[..., 3] > 0.01
    assert expected[seen].max() > 1e-3
    assert np.abs(found.aovs["lattice_error"] - expected)[seen].max() <= 2e-5
    assert (truth.aovs["lattice_error"] == 0).all()


def test_the_error_of_the_lattice_does_not_see_how_samples_lie(renderer):
    # Without it warped samples of the spot and the point would err by more than the lattice does.
    even, warped = (
        renderer.render(on_lattice(scene_of(steps=24, sampling=how)), aovs=["lattice_error"])
        for how in ("world", "projective")
    )

    assert even.aovs["lattice_error"].max() > 1e-3
    assert (warped.aovs["lattice_error"] == even.aovs["lattice_error"]).all()


def test_launches_batches_and_crops_do_not_show_in_the_error(renderer, monkeypatch):
    scene = on_lattice(scene_of([*WHITE, SUN.replace(from_=(3, -1, 2)), EDGE]))
    whole = renderer.render(scene, aovs=["lattice_error"])
    monkeypatch.setattr(batches, "BATCH_BYTES", 1)
    part = renderer.render(scene, aovs=["lattice_error"], crop=(5, 3, 21, 19))

    assert (part.image == whole.image[3:19, 5:21]).all()
    difference = part.aovs["lattice_error"] - whole.aovs["lattice_error"][3:19, 5:21]
    assert np.abs(difference).max() <= LIGHTS


@pytest.mark.slow
def test_the_picture_is_the_same_where_its_error_is_asked_for(renderer):
    scene = on_lattice(scene_of([*WHITE, EDGE]))
    plain, asked = renderer.render(scene), renderer.render(scene, aovs=["lattice_error", "map_error"])

    assert "lattice_error" not in plain.aovs
    assert asked.image.tobytes() == plain.image.tobytes()
    assert asked.stats.samples == plain.stats.samples


@pytest.mark.slow
@pytest.mark.parametrize("what", [*OTHERS, "dual march"])
def test_without_a_lattice_its_error_is_zero(renderer, what):
    scene, method = (scene_of([SUN]), "dual") if what == "dual march" else (OTHERS[what][0], "tfm")
    scene = scene.replace(camera=scene.camera.replace(res=(12, 10)))

    error = renderer.render(on_lattice(scene), method=method, aovs=["lattice_error"]).aovs["lattice_error"]
    assert error.shape == (10, 12)
    assert (error == 0).all()


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "brightness"), [(1.0, 0.0), (1e-30, 1e-30), (1e4, 1e24), (1e25, 1e-30)])
def test_the_error_of_the_lattice_is_a_part_of_one(renderer, scale, brightness):
    lights = [light.replace(intensity=brightness * np.array(light.intensity)) for light in COLOURS]
    scene = on_lattice(scene_of(lights, a_blob(density_scale=scale), RGB))
    error = renderer.render(scene, aovs=["lattice_error"]).aovs["lattice_error"]

    assert np.isfinite(error).all()
    assert error.min() >= 0
    assert error.max() <= 1


# ------------------------------------------------------------------------------------------------- auto

AUTO = SETTLED.replace(lookup="auto")
CLOSE = CAMERA.replace(fov=12)
"""Its pixels are half as wide as voxels."""


def test_one_light_is_looked_up_at_every_sample(renderer):
    scene = scene_of([SUN], camera=CLOSE)
    auto, expected = (renderer.render(one) for one in (scene, per_sample(scene)))

    assert auto.image.tobytes() == expected.image.tobytes()
    assert plan(scene).scene.map.lookup == "auto"


def test_several_lights_are_looked_up_once_a_voxel(renderer):
    scene = scene_of(camera=CLOSE)
    auto, expected = renderer.render(scene), renderer.render(on_lattice(scene))

    assert auto.image.tobytes() == expected.image.tobytes()
    assert auto.scene.map.lookup == "lattice"


@pytest.mark.parametrize("lookup", ["auto", "lattice"])
def test_maps_that_are_there_serve(renderer, lookup):
    scene = looked_up(scene_of(), lookup)
    built = renderer.build_maps(scene)
    found, expected = renderer.render(scene, maps=built), renderer.render(scene)

    assert found.image.tobytes() == expected.image.tobytes()
    assert {"map", "probe", "functions"}.isdisjoint(found.stats.made)


def test_another_camera_builds_no_maps(renderer):
    scene = on_lattice(scene_of())
    renderer.render(scene)
    moved = renderer.render(scene.replace(camera=CAMERA.replace(from_=(1, 2, 4))))

    assert moved.stats.made.get("map", 0) == 0
    assert moved.stats.made.get("bricks", 0) == 0


@pytest.mark.slow
def test_max_error_is_kept_on_a_lattice(renderer):
    settings = tfm.MapSettings(max_error=0.05)
    scene = scene_of(settings=settings, camera=CLOSE.replace(res=(24, 24)), steps="auto")
    result = renderer.render(scene)
    dual = renderer.render(
        scene.replace(map=SETTLED.replace(steps=400), march=tfm.MarchSettings(steps=600)), method="dual"
    )

    assert result.scene.map.lookup == "lattice"
    assert result.stats.error_estimate <= 0.05
    assert error_of(result.image, dual.image) <= 0.05
    # Of a twelfth of that a lattice takes too much.
    assert renderer.render(scene.replace(map=settings.replace(max_error=0.004))).scene.map.lookup != "lattice"


def test_limits_of_auto_follow_the_lattice():
    scene = scene_of(settings=tfm.MapSettings(res="auto", steps="auto"), camera=CLOSE, steps="auto")
    numbers = {
        how: resolution.resolved(looked_up(scene, how)).map.res for how in ("auto", "lattice", "reconstruct")
    }

    assert numbers["auto"] == numbers["lattice"] < numbers["reconstruct"]
