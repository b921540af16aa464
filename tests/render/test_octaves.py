"""Octaves of scattering: all powers of one look-up, in every medium by itself."""

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import OCTAVES_MEAN, OCTAVES_MEAN_DEEP, OCTAVES_PSNR, OCTAVES_PSNR_DEEP, PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.constants import OCTAVE_GROWTH
from tfm_cl.errors import SceneError

MAP_PASS = 20 * PASS
"""Maps are looked up at other places in float32: as `PASS`, and what the density weighting multiplies."""

FEW = {"octaves": 3, "attenuation": 0.4, "contribution": 0.7, "eccentricity": 0.6}
LOBE = tfm.HenyeyGreenstein(0.7)
WHITE = tfm.Medium(sigma_s=(1.2, 1.0, 0.8), phase=LOBE, **FEW)
BROWN = tfm.Medium(sigma_s=(0.8, 0.5, 0.3), sigma_a=(0.2, 0.5, 0.7), octaves=5)
CLOUD = tfm.Volume(6 * blobs((14, 12, 10)), voxel_size=0.15, origin=(-1, -0.9, -0.7))
BALL = tfm.SphereVolume(centre=(0.5, 0.3, 0.4), radius=0.6, density=0.9, medium=BROWN)
SUNS = [
    tfm.SunLight(from_=direction, to=(0, 0, 0), intensity=2)
    for direction in ((2, 3, 1), (-2, 3, 0), (0, 3, -2))
]


def single(medium):
    return medium.replace(octaves=1)


@pytest.mark.lanes
@pytest.mark.quick("one medium-tfm")
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("bodies", [(CLOUD,), (CLOUD, BALL)], ids=["one medium", "a grid and a ball"])
def test_picture_and_layers_equal_the_reference(renderer, save_on_failure, bodies, method):
    scene = make_scene(volume=bodies, medium=WHITE)
    result = renderer.render(scene, method=method)
    expected, layers = reference.render_with_aovs(scene, method)

    tolerance = MAP_PASS * max(1.0, float(expected[..., :3].max()))
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < tolerance
    # Of the light itself, whatever is made of it.
    seen = expected[..., 3] > 0.05
    difference = result.aovs["light_transmittance"] - layers["light_transmittance"]
    assert np.abs(difference[seen]).max() < 5 * MAP_PASS
    # They are seen at all.
    assert (
        expected[..., :3].mean()
        > 1.2 * reference.render(scene.replace(medium=single(WHITE)), method)[..., :3].mean()
    )


@pytest.mark.slow
def test_a_lattice_holds_them(renderer):
    scene = make_scene(volume=CLOUD, medium=WHITE, lights=SUNS)
    images = [
        renderer.render(scene.replace(map=scene.map.replace(lookup=lookup))).image[..., :3]
        for lookup in ("interpolate", "lattice")
    ]
    plain = renderer.render(scene.replace(medium=single(WHITE))).image[..., :3]
    assert np.abs(images[1] - images[0]).mean() < 0.1 * np.abs(images[0] - plain).mean()


@pytest.mark.slow
def test_without_extinction_on_the_way_they_add_up(renderer):
    """Of what light meets at once, each octave is a lobe in closed form, by the depth of the camera's ray."""
    thin = tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1), density=1e-4)
    scene = make_scene(volume=thin, medium=tfm.Medium(phase=LOBE))

    def image(medium):
        result = renderer.render(scene.replace(medium=medium))
        return result.image[..., :3].astype(float), result.aovs["transmittance"].astype(float)

    found, through = image(scene.medium.replace(**FEW))
    expected, _ = image(scene.medium)
    for i in (1, 2):
        lobe, _ = image(scene.medium.replace(phase=tfm.HenyeyGreenstein(0.7 * (0.7 * 0.6) ** i)))
        expected += 0.7**i * (-np.log(through)) ** OCTAVE_GROWTH * lobe
    # Of the transmittance float32 leaves 6e-8, beside an optical depth of 2e-4.
    assert np.abs(found - expected).max() < 1e-3 * expected.max()


@pytest.mark.slow
@pytest.mark.parametrize("cutoff", [0.0, 1e-2])
def test_of_rays_that_end_where_nothing_is_left_all_are_alike(renderer, cutoff):
    scene = make_scene(volume=CLOUD, medium=WHITE)
    march = scene.march.replace(cutoff=cutoff)
    dense = [scene.replace(volume=CLOUD.with_density_scale(scale), march=march) for scale in (100, 101)]
    images = [renderer.render(one).image[..., :3] for one in dense]
    assert np.abs(images[1] - images[0]).max() < 0.05 * images[0].max()


@pytest.mark.slow
def test_what_absorbs_all_scatters_nothing_again(renderer):
    black = tfm.Medium(sigma_s=0.0, sigma_a=1.0, phase=LOBE)
    scene = make_scene(volume=CLOUD, medium=black)
    changed = scene.replace(medium=black.replace(octaves=3))
    assert np.array_equal(renderer.render(changed).image, renderer.render(scene).image)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("density", "mean_cosine", "mean", "psnr"),
    [
        (6, 0.0, OCTAVES_MEAN, OCTAVES_PSNR),
        (6, 0.85, OCTAVES_MEAN, OCTAVES_PSNR),
        (24, 0.85, OCTAVES_MEAN_DEEP, OCTAVES_PSNR_DEEP),
    ],
)
def test_they_are_like_the_orders_of_scattering(renderer, density, mean_cosine, mean, psnr):
    """A cloud that nothing was fitted to, from the front, the side and behind."""
    cloud = tfm.Volume(density * blobs((24, 20, 16)), voxel_size=0.09, origin=(-1, -0.9, -0.7))
    phase = tfm.HenyeyGreenstein(mean_cosine) if mean_cosine else tfm.Isotropic()
    for direction in ((0.3, 0.5, 1), (1, 1, 0), (0.3, 0.5, -1)):
        sun = tfm.SunLight(from_=direction, to=(0, 0, 0), intensity=2)
        scene = make_scene(volume=cloud, medium=tfm.Medium(phase=phase), lights=[sun])
        found, truth = (
            renderer.render(scene.replace(medium=scene.medium.replace(**scattered))).image
            for scattered in ({"octaves": 4}, {"orders": 64})
        )
        assert abs(found[..., :3].mean() / truth[..., :3].mean() - 1) < mean
        assert tfm.compare(found, truth).psnr > psnr


@pytest.mark.slow
def test_no_map_knows_of_them(renderer):
    scene = make_scene(volume=CLOUD)
    maps = renderer.build_maps(scene)
    changed = scene.replace(medium=scene.medium.replace(octaves=4))
    assert np.array_equal(renderer.render(changed, maps=maps).image, renderer.render(changed).image)


@pytest.mark.slow
def test_the_error_of_maps_is_that_of_light(renderer):
    scene = make_scene(volume=CLOUD)
    changed = scene.replace(medium=scene.medium.replace(octaves=4))
    errors = [renderer.render(one, aovs=["map_error"]).aovs["map_error"] for one in (scene, changed)]
    assert np.array_equal(*errors)


@pytest.mark.parametrize(
    ("key", "value"),
    [("octaves", 0), ("octaves", 9), ("attenuation", -1), ("contribution", 1.1), ("eccentricity", "much")],
)
def test_what_are_no_octaves(key, value):
    with pytest.raises(SceneError, match=rf"medium\.{key} = .*: should be"):
        tfm.Medium(**{key: value})


def test_octaves_and_orders_are_one_or_the_other():
    with pytest.raises(SceneError, match=r"octaves = 2 and orders = 3: both"):
        tfm.Medium(octaves=2, orders=3)
