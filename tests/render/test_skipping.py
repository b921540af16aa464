"""Jumping over what is empty and stopping where nothing is seen: neither may change what a ray meets.

Thin things are what a jump misses: sheets and voxels by themselves, in every direction, dense enough that one
sample more or less is seen.
"""

import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import blobs, make_scene, turned
from tolerances import LANES, PASS, SKIPPING

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.files.volume_io.leaves import Leaves

pytestmark = pytest.mark.lanes

METHODS = ["tfm", "dual"]
SAMPLINGS = ["projective", "world"]
STORED = list(itertools.product(("f32", "f16", "u8"), (1, 2, 3, 5, 8, 13, 32)))


# ---------------------------------------------------------------------------------------------- volumes


def balls(shape, count, radius, seed=3):
    """Balls that lie apart, each with a density of its own."""
    rng = np.random.default_rng(seed)
    index = np.moveaxis(np.indices(shape), 0, -1)
    data = np.zeros(shape, np.float32)
    for centre in rng.uniform(radius, np.array(shape) - radius - 1, (count, 3)):
        data[np.linalg.norm(index - centre, axis=-1) < radius] = rng.uniform(0.2, 1)
    return data


def sheet(normal, shape=(40, 37, 43)):
    """A plane of voxels, one voxel thick, through a point beside the middle."""
    normal = np.array(normal, float) / np.linalg.norm(normal)
    index = np.moveaxis(np.indices(shape), 0, -1)
    distance = (index - np.array(shape) / 2 + 1.3) @ normal
    return (np.abs(distance) <= 0.5 * np.abs(normal).max()).astype(np.float32)


def lone_voxels(shape, count, seed=4):
    rng = np.random.default_rng(seed)
    data = np.zeros(shape, np.float32)
    data[tuple(rng.integers(0, n, count) for n in shape)] = rng.uniform(0.3, 1, count)
    return data


def touching(shape=(35, 30, 41)):
    """Density on every face, edge and corner, and nowhere else."""
    data = np.zeros(shape, np.float32)
    for place in itertools.product((0, 0.4, 1), repeat=3):
        if set(place) != {0.4}:
            data[tuple(round(part * (n - 1)) for part, n in zip(place, shape, strict=True))] = 1
    data[0, 3:9, 3:9] = data[5:9, -1, 5:9] = data[20:28, 20:28, 0] = 0.5
    return data


SHEETS = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 1, 1), (1, -2, 3), (5, 1, -0.3)]
GAPPY = {
    "balls": balls((44, 40, 48), 12, 2.6),
    "far apart": np.pad(balls((12, 11, 13), 2, 3), ((0, 90), (5, 70), (80, 3))),
    **{f"a sheet across {normal}": sheet(normal) for normal in SHEETS},
    "lone voxels": lone_voxels((44, 40, 48), 40),
    "touching the bounds": touching(),
}

LIGHT = make_scene().lights[0]
INSIDE = {
    "from_": (0.3, 0.15, 0.25),
    "to": (-1, -0.4, -0.6),
    "res": (24, 18),
}
VIEWS = {
    "outside": {},
    "camera inside": {"camera": tfm.Camera(**INSIDE, fov=85)},
    "light inside": {"lights": [LIGHT.replace(from_=(0.1, 0.3, 0.1), to=(0.4, -1, 0.2), cone=55)]},
    "both inside": {
        "camera": tfm.Camera(**INSIDE, fov=85),
        "lights": [LIGHT.replace(from_=(0.2, 0.1, 0.2), to=(-1, -0.5, -0.4), cone=70)],
    },
    "three lights": {
        "lights": [
            LIGHT,
            LIGHT.replace(from_=(-3, 1, 2), cone=14, intensity=(0, 1, 4)),
            LIGHT.replace(from_=(0.5, -0.6, 0.7), to=(0, 0.2, 0), cone=60, intensity=(1, 0, 0.5)),
        ]
    },
    "a wide lens close by": {
        "camera": tfm.Camera(from_=(0.9, 0.5, 1.3), to=(-0.1, 0, -0.2), fov=110, res=(24, 18))
    },
}


def placed(data, density_scale, **options):
    """Turned, anisotropic voxels around the origin, as large as the test scenes' volume."""
    shape = np.array(data.shape[::-1])
    scale = np.array([0.15, 0.2, 0.14]) * 14 / shape.mean()
    matrix = turned(25, (1, 2, 0.5), scale)
    matrix[:3, 3] = -matrix[:3, :3] @ ((shape - 1) / 2)
    volume = options.pop("voxels", data)
    return tfm.Volume(volume, world_from_index=matrix, density_scale=density_scale, **options)


def scene_of(data, *, density_scale=12.0, skip_empty=True, steps=45, light_steps=40, march=None, **changes):
    """The test scenes' light, camera and medium around voxels; every ray to its end."""
    march = {"steps": steps, "cutoff": 0.0, "skip_empty": skip_empty} | (march or {})
    return make_scene(
        volume=placed(data, density_scale),
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=24, steps=light_steps),
        march=tfm.MarchSettings(**march),
    ).replace(**changes)


def without_skipping(scene):
    return scene.replace(march=scene.march.replace(skip_empty=False))


def check_equal(result, expected, tolerance):
    """Pictures and layers, by the brightest pixel; a mean distance by that of the farthest."""
    scale = max(float(expected.image[..., :3].max()), 1e-3)
    assert np.abs(result.image - expected.image)[..., :3].max() <= tolerance * scale
    assert np.abs(result.image - expected.image)[..., 3].max() <= tolerance
    for name in ("transmittance", "depth", "light_transmittance"):
        layer, other = result.aovs[name], expected.aovs[name]
        # Ratios of sums: as accurate as the sums are over what divides them.
        weight = expected.image[..., 3].reshape(other.shape[:2] + (1,) * (other.ndim - 2))
        if name == "transmittance":
            weight = 1.0
        most = max(1.0, float(other.max()))
        assert (np.abs(layer - other) * weight).max() <= 4 * tolerance * most, name


# --------------------------------------------------------------------------------------------- skipping


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sampling", SAMPLINGS)
@pytest.mark.parametrize("gappy", GAPPY)
def test_skipping_does_not_show(renderer, gappy, sampling, method):
    scene = scene_of(GAPPY[gappy], march={"method": method, "sampling": sampling})

    skipped, every = renderer.render(scene), renderer.render(without_skipping(scene))

    assert every.image[..., 3].max() > 0.02
    assert every.image[..., :3].max() > 1e-3
    check_equal(skipped, every, SKIPPING)
    assert skipped.stats.samples["view_pass"] < every.stats.samples["view_pass"]


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("steps", [7, 300])
def test_skipping_does_not_show_from_anywhere(renderer, view, steps, method):
    for gappy in ("balls", "a sheet across (1, -2, 3)", "touching the bounds"):
        scene = scene_of(GAPPY[gappy], steps=steps, light_steps=steps, march={"method": method})
        scene = scene.replace(**VIEWS[view])

        skipped, every = renderer.render(scene), renderer.render(without_skipping(scene))

        assert every.image[..., 3].max() > 0.01
        check_equal(skipped, every, SKIPPING)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "along", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (1, 0.6, 0), (0, 1, -0.7), (-1, 0.01, 0.4)]
)
def test_rays_beside_the_borders_of_bricks(renderer, along, method):
    # Through a narrow lens the rays of a tile lie within a voxel or two and keep their places between the
    # borders of bricks, on both sides of one or not; sheets come in their way, one by one.
    along = np.array(along) / np.linalg.norm(along)
    index = np.moveaxis(np.indices((48, 48, 48)), 0, -1)[..., ::-1]
    depth = (index - 23.7) @ along
    data = np.isin(np.rint(depth), (-17, -3, 11, 20)).astype(np.float32)
    camera = tfm.Camera(
        from_=tuple(23.6 - 120 * along), to=(23.6, 23.7, 23.4), up=(0.1, 0.8, 0.3), fov=7, res=(41, 38)
    )
    side = np.cross(along, (0.3, 0.5, 0.8))
    for away in (-35, 40):
        light = LIGHT.replace(from_=tuple(23.6 + away * along + 15 * side), to=(23, 24, 23), cone=65)
        scene = make_scene(
            volume=tfm.Volume(data, world_from_index=np.eye(4), density_scale=0.6),
            camera=camera,
            lights=[light],
            map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=40, steps=90),
            march=tfm.MarchSettings(steps=90, cutoff=0.0, method=method),
        )

        skipped, every = renderer.render(scene), renderer.render(without_skipping(scene))

        assert every.image[..., 3].min() > 0.1
        check_equal(skipped, every, SKIPPING)


@pytest.mark.parametrize("gappy", GAPPY)
@pytest.mark.parametrize("steps", [9, 100])
def test_maps_do_not_show_skipping(renderer, gappy, steps):
    scene = scene_of(GAPPY[gappy], light_steps=steps, lights=VIEWS["three lights"]["lights"])
    every = without_skipping(scene)

    for skipped, whole in zip(renderer.build_maps(scene), renderer.build_maps(every), strict=True):
        assert np.abs(skipped.coefficients - whole.coefficients).max() <= SKIPPING
        assert (skipped.occupied == whole.occupied).all()
        assert skipped.buffers.samples < whole.buffers.samples
    assert max(1 - m.coefficients[..., 0].min() for m in renderer.build_maps(scene)) > 1e-3


@pytest.mark.quick("tfm")
@pytest.mark.parametrize("method", METHODS)
def test_a_volume_with_gaps_is_the_reference_s(renderer, save_on_failure, method):
    data = balls((30, 26, 32), 9, 2.6)
    scene = scene_of(data, steps=30, light_steps=24, march={"method": method}).replace(
        lights=[LIGHT, LIGHT.replace(from_=(-3, 1, 2), cone=25, intensity=(0, 1, 4))]
    )

    result = renderer.render(scene)

    expected = reference.render(scene)
    assert expected[..., 3].max() > 0.2
    scale = max(1.0, float(expected[..., :3].max()))
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < 20 * PASS * scale


@pytest.mark.parametrize("method", METHODS)
def test_a_nearly_empty_volume_takes_few_samples(renderer, method):
    data = np.zeros((64, 64, 64), np.float32)
    data[10:24, 30:44, 12:26], data[40:60, 20:36, 36:52] = 1, 1
    assert 0.02 < np.count_nonzero(data) / data.size < 0.05
    scene = scene_of(data, steps=100, light_steps=100, march={"method": method})

    skipped, every = (renderer.render(s).stats.samples for s in (scene, without_skipping(scene)))

    assert 0 < skipped["view_pass"] < 0.5 * every["view_pass"]
    if method == "tfm":  # its maps are the same, and would be kept from one to the other
        skipped, every = (renderer.build_maps(s)[0].buffers.samples for s in (scene, without_skipping(scene)))
        assert 0 < skipped < 0.5 * every


@pytest.mark.parametrize("method", METHODS)
def test_an_empty_volume_takes_none(renderer, method):
    scene = scene_of(np.zeros((40, 50, 33), np.float32), march={"method": method})

    result = renderer.render(scene)

    assert result.stats.samples == {"light_pass": 0, "view_pass": 0}
    assert result.aovs["samples"].max() == 0
    assert result.image.max() == 0
    assert result.aovs["transmittance"].min() == 1
    if method == "tfm":
        (light_map,) = renderer.build_maps(scene)
        assert (light_map.coefficients == [1, 0, 0, 0, 0, 0, 0, 0]).all()
        assert (light_map.occupied == 0).all()


def test_every_sample_of_a_full_volume_is_counted(renderer):
    scene = scene_of(np.ones((20, 20, 20), np.float32), density_scale=0.1)

    skipped, every = renderer.render(scene), renderer.render(without_skipping(scene))

    assert skipped.stats.samples["view_pass"] == every.stats.samples["view_pass"]
    assert (skipped.image == every.image).all()


# ----------------------------------------------------------------------------------------------- cutoff


def brightest(scene):
    """The most that all lights together can add to a pixel that sees nothing but lit medium."""
    albedo = (np.array(scene.medium.sigma_s) / scene.medium.sigma_t).max()
    phase = float(scene.medium.phase.evaluate(np.linspace(-1, 1, 1001)).max())
    assert all(light.falloff == "none" for light in scene.lights)
    return albedo * phase * sum(float(np.max(light.intensity)) for light in scene.lights)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cutoff", [1e-4, 0.01, 0.4])
def test_cutoff_errs_by_that_part_of_the_brightest_light(renderer, cutoff, method):
    # Where a ray ends, each colour has at most the cutoff left: what it would still meet scatters at most
    # the brightest light times that, and is at most that opaque.
    scene = scene_of(blobs(), density_scale=20, march={"method": method})
    scene = scene.replace(lights=VIEWS["three lights"]["lights"])

    whole = renderer.render(scene)
    ended = renderer.render(scene.replace(march=scene.march.replace(cutoff=cutoff)))

    difference = np.abs(ended.image - whole.image)
    assert difference[..., :3].max() <= cutoff * brightest(scene) + PASS
    assert difference[..., 3].max() <= cutoff + PASS
    assert np.abs(ended.aovs["transmittance"] - whole.aovs["transmittance"]).max() <= cutoff + PASS
    assert difference.max() > 0
    # A tile goes on until its last ray has ended.
    assert ended.stats.samples["view_pass"] <= whole.stats.samples["view_pass"]
    assert cutoff < 0.1 or ended.stats.samples["view_pass"] < whole.stats.samples["view_pass"]


@pytest.mark.parametrize("method", METHODS)
def test_cutoff_0_is_the_reference_s(renderer, save_on_failure, method):
    scene = scene_of(blobs(), density_scale=15, march={"method": method}, steps=30, light_steps=24)

    result = renderer.render(scene)

    expected = reference.render(scene)
    assert expected[..., 3].max() > 0.999
    scale = max(1.0, float(expected[..., :3].max()))
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < 20 * PASS * scale


@pytest.mark.parametrize("cutoff", [0.0, 1e-4, 0.1])
def test_an_opaque_medium_is_opaque(renderer, cutoff):
    scene = scene_of(np.ones((12, 12, 12), np.float32), density_scale=1e4, march={"cutoff": cutoff})

    result = renderer.render(scene)

    centre = result.image[7:11, 10:14, 3]
    assert (centre == 1).all()
    assert result.image[..., 3].max() == 1
    assert result.aovs["transmittance"][7:11, 10:14].max() <= 1e-37


def test_the_cutoff_waits_for_the_clearest_colour(renderer):
    # Red is gone at the first voxel; blue, which goes through, has to be there to the end.
    scene = scene_of(np.ones((12, 12, 12), np.float32), density_scale=2.0)
    scene = scene.replace(medium=tfm.Medium(sigma_s=(200.0, 5.0, 0.05), phase=tfm.HenyeyGreenstein(0.4)))

    whole = renderer.render(scene)
    ended = renderer.render(scene.replace(march=scene.march.replace(cutoff=0.01)))

    assert whole.aovs["transmittance"][9, 12, 2] > 0.5
    assert (ended.image == whole.image).all()


# ------------------------------------------------------------------------------------------------ lanes


@pytest.fixture(scope="module")
def by_lanes(new_renderer):
    """``by_lanes(1)`` renders with so many rays a work-item; each is made once."""
    made = {}

    def of(lanes):
        if lanes not in made:
            made[lanes] = new_renderer(lanes=lanes)
        return made[lanes]

    yield of
    for renderer in made.values():
        renderer.close()


@pytest.fixture(scope="module")
def lanes_possible(device_name):
    return Launcher(choose_device(device_name)).lanes_possible


@pytest.fixture
def check_lanes(by_lanes, lanes_possible):
    """``check_lanes(scene)`` returns what one lane sees, once all others have seen the same."""

    def check(scene):
        expected = by_lanes(1).render(scene)
        assert expected.image[..., :3].max() > 1e-3
        for lanes in lanes_possible:
            check_equal(by_lanes(lanes).render(scene), expected, LANES)
        return expected

    return check


def test_lanes_that_the_device_does_not_have_are_refused(device_name, lanes_possible):
    with pytest.raises(tfm.DeviceError, match=r"lanes = 5: expected one of 1, "):
        tfm.Renderer(device_name, lanes=5)
    wider = {4, 8, 16}.difference(lanes_possible)
    for lanes in wider:
        with pytest.raises(tfm.DeviceError, match=rf"lanes = {lanes}: expected one of 1, "):
            tfm.Renderer(device_name, lanes=lanes)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_lanes_agree(check_lanes, method):
    camera = tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=38, res=(97, 61))
    scene = scene_of(GAPPY["balls"], steps=40, light_steps=30, march={"method": method})

    check_lanes(scene.replace(camera=camera))


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("fov", [4, 38])
def test_all_samples_are_taken_without_skipping(by_lanes, lanes_possible, fov, method):
    camera = tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=fov, res=(24, 18))
    scene = without_skipping(scene_of(GAPPY["balls"], march={"method": method}).replace(camera=camera))

    counts = [by_lanes(lanes).render(scene).aovs["samples"] for lanes in (1, lanes_possible[-1])]

    # Each part of a ray is marched in whole steps: rounding may add one; and a ray that grazes the cone
    # or the bounds may hit them with one rounding and miss with the other.
    steps = 1 if method == "tfm" else scene.map.steps
    assert (np.abs(counts[0] - counts[1]) <= steps).mean() > 0.99
    assert (counts[0] == counts[1]).mean() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize(("storage", "coeffs"), STORED)
def test_lanes_agree_whatever_the_map(by_lanes, check_lanes, storage, coeffs):
    camera = tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=38, res=(97, 61))
    scene = scene_of(GAPPY["balls"], steps=40).replace(
        camera=camera,
        map=tfm.MapSettings(
            basis="dct", density_weighting=10.0, res=37, steps=40, coeffs=coeffs, storage=storage
        ),
        medium=tfm.Medium(sigma_s=0.9, sigma_a=0.2),
    )

    expected = check_lanes(scene)

    # Storage in fewer bits, as in tests/maps: α times the rounding of f.
    exact = by_lanes(1).render(scene.replace(map=scene.map.replace(storage="f32"))).image
    error = {"f32": 0.0, "f16": 0.01, "u8": 0.05}[storage]
    assert np.abs(expected.image - exact)[..., :3].max() <= error * exact[..., :3].max()


# ------------------------------------------------------------------------------------- occupied, leaves


def occupied_by_hand(scene, light, slack):
    """First and last step with density of every texel's ray, [texels] each; 0 and 0 without.

    slack: how far, in voxels, the samples are moved to find density; < 0: density near all of it.
    """
    volume, steps = scene.volume, scene.map.steps
    rays = reference.texel_rays(light, scene.map.res)
    k_in, k_out = reference.march_bounds(volume, *rays)
    moves = [(0.0, 0.0, 0.0), *itertools.product((-abs(slack), abs(slack)), repeat=3)]
    first, end = np.zeros(len(k_in), int), np.zeros(len(k_in), int)
    for n in range(steps):
        points = rays.at(k_in + (n + 0.5) / steps * (k_out - k_in))
        near = [reference.density(volume, points + volume.world_from_index[:3, :3] @ m) for m in moves]
        dense = (np.max(near, axis=0) if slack > 0 else np.min(near, axis=0)) > 0
        first[dense & (end == 0)] = n
        end[dense] = n + 1
    return first, end


@pytest.mark.parametrize("gappy", ["balls", "lone voxels", "a sheet across (1, 1, 1)", "touching the bounds"])
def test_occupied_steps(renderer, gappy):
    scene = scene_of(GAPPY[gappy], light_steps=30)
    (light_map,) = renderer.build_maps(scene)

    # Distances from the light, to light steps between the medium's bounds.
    k_in, k_out = reference.march_bounds(scene.volume, *reference.texel_rays(light_map.light, scene.map.res))
    length = np.where(k_out > k_in, k_out - k_in, 1)
    occupied = light_map.occupied.reshape(-1, 2)
    steps = (occupied - k_in[:, None]) / length[:, None] * scene.map.steps
    first, end = np.rint(np.where(occupied[:, 1:] > 0, steps, 0)).astype(int).T

    # Rounding moves samples, by less than a thousandth of a voxel.
    sure = occupied_by_hand(scene, light_map.light, -1e-3)
    perhaps = occupied_by_hand(scene, light_map.light, 1e-3)
    has, may = sure[1] > 0, perhaps[1] > 0
    assert has.any()
    assert (~may).any()
    assert (end[~may] == 0).all()
    assert (first[~may] == 0).all()
    assert (end[has] > 0).all()
    assert (perhaps[0][has] <= first[has]).all()
    assert (first[has] <= sure[0][has]).all()
    assert (sure[1][has] <= end[has]).all()
    assert (end[has] <= perhaps[1][has]).all()
    assert np.count_nonzero((first == sure[0]) & (end == sure[1])) > 0.95 * len(first)


@pytest.mark.parametrize("first", [(0, 0, 0), (1, 0, 0), (3, 7, 5)], ids=str)
@pytest.mark.parametrize("gappy", ["balls", "touching the bounds"])
def test_leaves_render_as_the_same_array(renderer, gappy, first):
    data = GAPPY[gappy]
    padded = Leaves.from_dense(np.pad(data, [(offset, 0) for offset in first]))
    leaves = Leaves(data.shape, first, padded.coordinates, padded.values)
    scene = scene_of(data)

    dense = renderer.render(scene)
    sparse = renderer.render(scene.replace(volume=placed(data, 12.0, voxels=leaves)))

    assert (sparse.image == dense.image).all()
    assert sparse.stats.samples == dense.stats.samples


# ----------------------------------------------------------------------------------------- random scenes


def sparse_volume(shape, seed, kind):
    """Voxels by themselves, rods, sheets or crumbs, at a few places of a small grid."""
    rng = np.random.default_rng(seed)
    data = np.zeros(shape, np.float32)
    if kind in {"0.1 %", "1 %", "20 %"}:
        share = float(kind.split()[0]) / 100
        data[:] = rng.random(shape) < share
        data[tuple(rng.integers(0, n) for n in shape)] = 1
    else:
        for _ in range(3):
            place = [slice(int(a), int(a) + 1) for a in rng.integers(0, shape)]
            axis = rng.integers(0, 3)
            if kind == "rods":
                place[axis] = slice(None)
            else:
                place = [slice(None) if i != axis else one for i, one in enumerate(place)]
            data[tuple(place)] = 1
    return data * rng.uniform(0.2, 1, shape).astype(np.float32)


@st.composite
def sparse_scenes(draw):
    """Random voxels, turned and of three lengths, seen and lit from anywhere, in any number of steps."""
    shape = tuple(draw(st.integers(1, 60)) for _ in range(3))
    kind = draw(st.sampled_from(["0.1 %", "1 %", "20 %", "rods", "sheets"]))
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    data = sparse_volume(shape, int(rng.integers(1 << 30)), kind)
    scale = 2.4 / max(shape) * rng.uniform(0.5, 1.5, 3)
    matrix = turned(rng.uniform(0, 180), rng.normal(size=3) + 1e-3, scale)
    matrix[:3, 3] = -matrix[:3, :3] @ ((np.array(shape[::-1]) - 1) / 2)
    away = draw(st.sampled_from([0.3, 1.5, 4.0, 12.0]))
    light_away = draw(st.sampled_from([0.2, 1.0, 4.0]))
    # Camera and light look at a voxel; through a narrow lens rays lie close together, but see little else.
    seen = rng.permutation(np.argwhere(data > 0))[0][::-1]
    to = matrix[:3, :3] @ seen + matrix[:3, 3]
    # Often along the grid's planes and lines, or nearly so.
    at, light_at = (
        matrix[:3, :3] @ (rng.normal(size=3) * rng.permuted([1.0, *rng.choice([1.0, 1.0, 1e-2, 0.0], 2)]))
        for _ in range(2)
    )
    extinction = rng.uniform(0.3, 1.5, 3)
    return make_scene(
        volume=tfm.Volume(data, world_from_index=matrix, density_scale=draw(st.sampled_from([1.0, 30.0]))),
        camera=tfm.Camera(
            from_=tuple(to + away * at / np.linalg.norm(at)),
            to=tuple(to),
            up=tuple(rng.normal(size=3)),
            fov=draw(st.sampled_from([1.0, 4.0, 12.0, 35.0, 100.0])),
            res=(31, 22),
        ),
        lights=[
            LIGHT.replace(
                from_=tuple(to + light_away * light_at / np.linalg.norm(light_at)),
                to=tuple(to + 0.1 * rng.normal(size=3)),
                cone=draw(st.sampled_from([12.0, 40.0, 75.0])),
            )
        ],
        medium=tfm.Medium(
            sigma_s=tuple(extinction), sigma_a=(0.1, 0.2, 0.0), phase=tfm.HenyeyGreenstein(0.4)
        ),
        map=tfm.MapSettings(
            basis="dct", density_weighting=10.0, res=12, steps=draw(st.sampled_from([1, 5, 33, 200]))
        ),
        march=tfm.MarchSettings(
            steps=draw(st.sampled_from([1, 6, 33, 250])),
            sampling=draw(st.sampled_from(SAMPLINGS)),
            max_stretch=draw(st.sampled_from([1.0, 4.0, 100.0])),
            cutoff=0.0,
            method=draw(st.sampled_from(METHODS)),
        ),
    )


@pytest.mark.slow
@given(scene=sparse_scenes())
@settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_most_lanes_that_skip_see_what_1_lane_sees_that_does_not(by_lanes, lanes_possible, scene):
    result, expected = by_lanes(lanes_possible[-1]).render(scene), by_lanes(1).render(without_skipping(scene))

    check_equal(result, expected, LANES)
