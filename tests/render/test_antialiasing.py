"""Samples of pixels: as finer frames have them, taken where edges are, and filtered."""

import math

import numpy as np
import pytest
from scenes import make_scene
from scipy import ndimage
from tolerances import LIGHTS, PASS, ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.render import antialiasing
from tfm_cl.render.raster import BLOCK, block_order, pack, pattern
from tfm_cl.scene.pixel_filters import FILTERS, SIGMA

pytestmark = pytest.mark.lanes

SUMMED_UP = 1e-4
"""Of a filter over a pixel, from as many points as there are, against its integral."""
FOOTPRINT = 2e-4
"""Points are as soft as rays are wide apart: of a pixel a quarter in the finer frame, and a half here."""
SHARE = 3 * 0.5 / 21 + 4 * PASS
"""Of a pixel that an upright edge cuts: half a sample each of one, four and sixteen that are even."""
AS_UNIFORM = 1.1
"""RMS error of samples where they are needed over that of sixteen everywhere: 0.98 was seen."""
NEARLY = 1.2
"""Likewise in a small picture, of which edges take much: 1.15 was seen, and 1.32 if none is followed."""

SPOT = make_scene().lights[0]
SOLIDS = [tfm.PlaneSolid(point=(0, -0.8, 0)), tfm.SphereSolid(centre=(0.4, 0.5, 0.2), radius=0.4)]
SCENE = make_scene(solids=SOLIDS, shadow=tfm.ShadowSettings(res=64))
GREY = tfm.Medium(sigma_s=0.8, sigma_a=0.2)
SUN = tfm.SunLight(from_=(1, 2, 1), to=(0, 0, 0))
CASES = {
    "solids": SCENE,
    "dual": SCENE.replace(march=SCENE.march.replace(method="dual")),
    "two kinds of light": SCENE.replace(lights=[SPOT, SUN, SPOT.replace(from_=(-2, 1, 2.5))]),
    "lattice": make_scene(
        medium=GREY, lights=[SUN, SPOT.replace(cone=60)], map=SCENE.map.replace(lookup="lattice", res=64)
    ),
    "orders": make_scene(medium=GREY.replace(orders=3, phase="hg:0.3")),
    # The plane hides from the camera what it shades, but for the lattice there are shadows.
    "orders above a plane": make_scene(
        medium=GREY.replace(orders=2),
        lights=[SUN, SUN.replace(from_=(-1, 2, 0))],
        solids=SOLIDS[:1],
        shadow=SCENE.shadow,
    ),
    "fog that emits": SCENE.replace(
        volume=tfm.BoxVolume(from_=(-0.9, -0.5, -0.6), to=(0.4, 0.7, 0.3), density=0.7),
        medium=GREY.replace(emission=(0.2, 0.1, 0.0)),
    ),
    "fire and solids": SCENE.replace(medium=GREY.replace(emission=(3, 2, 1), emission_lights=3)),
    "points": make_scene(
        volume=tfm.Points([(0, 0, 0), (0.5, 0.3, 0.2)], radius=0.4, density=1.5), lights=[SPOT]
    ),
}


@pytest.fixture
def everywhere(monkeypatch):
    """Sample all pixels again, at all levels."""
    monkeypatch.setattr(antialiasing, "BEND", -1)
    monkeypatch.setattr(antialiasing, "SPREAD", -1)


def finer(scene, times):
    width, height = scene.camera.res
    return scene.replace(camera=scene.camera.replace(res=(times * width, times * height)))


@pytest.mark.usefixtures("everywhere")
@pytest.mark.quick("solids")
@pytest.mark.parametrize("case", CASES)
def test_samples_are_those_of_a_finer_frame(renderer, case):
    scene, aovs = CASES[case], () if case == "solids" else ("map_error", "lattice_error")
    result = renderer.render(scene, samples=4, aovs=aovs)
    whole = renderer.render(finer(scene, 4))
    single = renderer.render(scene)
    x, y = (4 * pattern(2)).astype(int).T

    def mean(of_single, of_samples):
        return np.mean([of_single, *(of_samples[b::4, a::4] for a, b in zip(x, y, strict=True))], axis=0)

    expected = mean(single.image, whole.image)
    error = FOOTPRINT if case == "points" else LIGHTS
    np.testing.assert_allclose(result.image, expected, rtol=0, atol=error * max(1, expected.max()))
    assert result.stats.refined_pixels == math.prod(scene.camera.res)
    assert np.isfinite([layer.sum() for layer in result.aovs.values()]).all()
    through = mean(single.aovs["transmittance"], whole.aovs["transmittance"])
    np.testing.assert_allclose(result.aovs["transmittance"], through, rtol=0, atol=error)


def test_a_crop_is_the_whole_frames_part(renderer):
    scene = SCENE.replace(camera=SCENE.camera.replace(res=(112, 64)))
    whole = renderer.render(scene, samples=16, filter="gaussian")
    part = renderer.render(scene, samples=16, filter="gaussian", crop=(41, 18, 63, 45))
    np.testing.assert_array_equal(part.image, whole.image[18:45, 41:63])
    for name, layer in part.aovs.items():
        np.testing.assert_array_equal(layer, whole.aovs[name][18:45, 41:63], err_msg=name)
    assert 0 < whole.stats.refined_pixels < 0.3 * whole.image[..., 0].size


def test_a_smooth_picture_takes_no_further_samples(renderer):
    scene = make_scene(camera=tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0.05, 0.1, 0), fov=2, res=(24, 18)))
    one, many = (renderer.render(scene, samples=samples, aovs=("lights",)) for samples in (1, 256))
    assert many.stats.refined_pixels == 0
    np.testing.assert_array_equal(many.image, one.image)
    assert many.stats.samples == one.stats.samples


def test_an_edge_covers_its_share_of_a_pixel(renderer):
    camera = tfm.Camera(from_=(0, 0, 20), to=(0, 0, 30), fov=30, res=(40, 24))
    at = np.array([17.3, 24.55])  # pixels from the left, of the edges of a box right before the camera
    x = (at - 20) * camera.pixel_width * 5
    box = tfm.BoxSolid(from_=(-x[1], -9, 25), to=(-x[0], 9, 26), albedo=0.5)
    lit = make_scene(camera=camera, lights=[], solids=[box])
    result = renderer.render(lit, samples=16, background=1.0)
    alpha, layers = result.image[..., 3], result.aovs
    pixels = np.arange(40)
    share = np.clip(pixels + 1 - at[0], 0, 1) - np.clip(pixels + 1 - at[1], 0, 1)
    assert np.abs(alpha - share).max() < SHARE
    assert result.stats.refined_pixels == 24 * 4
    np.testing.assert_allclose(result.image[..., 0], 1 - alpha, rtol=0, atol=PASS)
    np.testing.assert_allclose(layers["albedo"][..., 1], 0.5 * alpha, rtol=0, atol=PASS)
    np.testing.assert_array_equal(layers["solid_distance"] > 0, alpha > 0)
    np.testing.assert_array_equal(layers["normal"][..., 2], -1.0 * (alpha > 0))  # unit, and not blended


def test_an_edge_is_followed_to_where_no_single_sample_sees_it(renderer):
    camera = tfm.Camera(from_=(0, 0, 20), to=(0, 0, 30), fov=30, res=(40, 24))
    slope, unit = 0.1, camera.pixel_width * 6  # of the far edge on top of a box, which leans
    length = math.hypot(1, slope)
    turn = [[1 / length, slope / length, 0], [-slope / length, 1 / length, 0], [0, 0, 1]]
    at = (-(20.25 - 20) * unit, (12 - 23.5) * unit, 0)
    transform = np.vstack([np.column_stack([turn, at]), [0, 0, 0, 1]])
    box = tfm.BoxSolid(from_=(-9, -9, 25), to=(9, 0, 26), transform=transform)
    result = renderer.render(make_scene(camera=camera, lights=[], solids=[box]), samples=16, background=1.0)
    share = 0.5 + slope * (np.arange(40) + 0.5 - 20.25)  # below the edge, of the lowest pixels
    inside = (share > 0.1) & (share < 0.9)
    alpha = result.image[-1, :, 3]
    assert np.abs(alpha - share)[inside].max() < SHARE
    assert alpha[inside & (share < 0.5)].min() > 0
    assert result.stats.refined_pixels < 2 * 40  # it passes through each column


@pytest.mark.parametrize("name", ["gaussian", "blackman-harris"])
def test_single_samples_are_filtered_as_a_convolution(renderer, name):
    plain, filtered = (renderer.render(SCENE, filter=filter_) for filter_ in ("box", name))
    shares = np.array(
        [FILTERS[name](offset + np.linspace(-0.495, 0.495, 100)).mean() for offset in (-1, 0, 1)]
    )
    shares /= shares.sum()
    kernel = (shares[:, None] * shares)[..., None]
    expected = ndimage.convolve(plain.image, kernel, mode="constant")
    expected /= ndimage.convolve(np.ones_like(plain.image), kernel, mode="constant")
    np.testing.assert_allclose(filtered.image, expected, rtol=0, atol=SUMMED_UP)


def test_a_gaussian_weighs_pixels_by_its_integral():
    weights = antialiasing._Weights("gaussian")
    end = math.exp(-(1.5**2) / (2 * SIGMA**2))

    def integral(low, high):
        scale = SIGMA * math.sqrt(math.pi / 2)
        to = [math.erf(x / (SIGMA * math.sqrt(2))) for x in (low, high)]
        return scale * (to[1] - to[0]) - end * (high - low)

    sides, middle = integral(0.5, 1.5), integral(-0.5, 0.5)
    of_pixels = np.array([sides, middle, sides]) / (2 * sides + middle)
    together = weights.of_samples(4).sum(axis=0)
    np.testing.assert_allclose(together, of_pixels[:, None] * of_pixels, rtol=0, atol=SUMMED_UP)


@pytest.mark.parametrize("name", FILTERS)
def test_an_even_picture_stays_even(name):
    weights = antialiasing._Weights(name)
    ones = np.ones((7, 9, 2), np.float32)
    np.testing.assert_allclose(weights.normalised(weights.spread(ones)), 1, rtol=0, atol=PASS)
    single = weights.spread(np.pad(np.ones((1, 1, 1), np.float32), ((3, 3), (3, 3), (0, 0))))[..., 0]
    reach = weights.reach
    around = single[3 - reach : 4 + reach, 3 - reach : 4 + reach]
    for per_pixel in (2, 4, 8):
        np.testing.assert_allclose(weights.of_samples(per_pixel).sum(axis=0), around, rtol=0, atol=PASS)


def test_differences_are_relative_to_the_brightest_around(rng):
    picture = rng.random((21, 40, 4), np.float32)
    expected = ndimage.maximum_filter(picture[..., :3].sum(axis=-1), size=2 * antialiasing.AROUND + 1)
    np.testing.assert_allclose(antialiasing._scale(picture), expected, rtol=PASS)


@pytest.mark.parametrize("per_pixel", [2, 4, 16])
def test_no_two_samples_share_a_row_or_column(per_pixel):
    at, count = pattern(per_pixel), per_pixel**2
    even = (np.arange(count) + 0.5) / count
    for axis in range(2):
        np.testing.assert_allclose(np.sort(at[:, axis]), even, rtol=0, atol=ROUNDED)
    cells = np.unique((at * per_pixel).astype(int), axis=0)
    assert len(cells) == count


@pytest.mark.parametrize("per_pixel", [2, 4, 16])
@pytest.mark.parametrize("lanes", [1, 4, 8, 16])
def test_samples_are_packed_into_blocks_of_their_own(rng, lanes, per_pixel):
    pixels = np.argwhere(rng.random((40, 50)) < 0.2)[:, ::-1] + (5, 3)
    pixels = pixels[block_order(pixels)]
    samples = pack(pixels, per_pixel, lanes)
    assert len(np.unique(samples.index)) == samples.index.size
    places = samples.places[samples.index]
    np.testing.assert_array_equal(np.floor(places), np.broadcast_to(pixels[:, None], places.shape))
    unused = np.setdiff1d(np.arange(len(samples.places)), samples.index)
    assert (samples.places[unused] < 0).all()
    block = samples.index // BLOCK**2
    np.testing.assert_array_equal(samples.blocks[block], np.floor(places) // BLOCK)
    # A tile has whole pixels beside each other, or a part of one.
    tile = {1: (1, 1), 4: (2, 2), 8: (4, 2), 16: (4, 4)}[lanes]
    y, x = np.divmod(samples.index, BLOCK)
    of_tile = y // tile[1] * BLOCK + x // tile[0]
    low, high = np.full((of_tile.max() + 1, 2), np.inf), np.full((of_tile.max() + 1, 2), -np.inf)
    np.minimum.at(low, of_tile, np.floor(places))
    np.maximum.at(high, of_tile, np.floor(places))
    assert (high - low).max() <= 1


def test_few_samples_serve_about_as_well_as_sixteen_everywhere(renderer, monkeypatch):
    scene = SCENE.replace(camera=SCENE.camera.replace(res=(48, 36)))
    found = renderer.render(scene, samples=16)
    monkeypatch.setattr(antialiasing, "BEND", -1)
    monkeypatch.setattr(antialiasing, "SPREAD", -1)
    uniform, reference = (renderer.render(scene, samples=samples) for samples in (16, 64))
    of_found, of_uniform = (np.sqrt(((r.image - reference.image) ** 2).mean()) for r in (found, uniform))
    assert of_found < NEARLY * of_uniform
    assert found.stats.samples["view_pass"] < 0.15 * uniform.stats.samples["view_pass"]


@pytest.mark.slow
def test_sixteen_samples_where_needed_serve_as_sixteen_everywhere(renderer, monkeypatch):
    scene = SCENE.replace(camera=SCENE.camera.replace(res=(96, 72)))
    width, height = scene.camera.res
    found = renderer.render(scene, samples=16)
    reference = renderer.render(finer(scene, 16)).image.reshape(height, 16, width, 16, 4).mean(axis=(1, 3))
    monkeypatch.setattr(antialiasing, "BEND", -1)
    monkeypatch.setattr(antialiasing, "SPREAD", -1)
    monkeypatch.setattr(antialiasing, "MOST_SAMPLES", 3000)  # in many parts
    uniform = renderer.render(scene, samples=16)
    of_found, of_uniform = (np.sqrt(((r.image - reference) ** 2).mean()) for r in (found, uniform))
    assert of_found < AS_UNIFORM * of_uniform
    assert found.stats.refined_pixels < 0.2 * width * height
    assert found.stats.samples["view_pass"] < 0.3 * uniform.stats.samples["view_pass"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"samples": 9}, r"^image\.samples = 9: should be 1, 4, 16, 64 or 256$"),
        ({"samples": True}, r"^image\.samples = True: should be 1, 4, 16, 64 or 256$"),
        ({"filter": "triangle"}, r"^image\.filter = 'triangle': unknown filter 'triangle'"),
    ],
)
def test_what_is_no_number_of_samples_or_no_filter_is_told(renderer, options, told):
    with pytest.raises(SceneError, match=told):
        renderer.render(SCENE, **options)
