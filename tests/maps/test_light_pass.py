"""The light pass against the float64 reference, and what a map promises."""

import itertools

import numpy as np
import pytest
from scenes import make_scene
from tolerances import PASS, RECURRENCE

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError

pytestmark = pytest.mark.lanes


def a_map(renderer, scene):
    return renderer.build_maps(scene)[0]


def slow(*values):
    """Programs of their own, whose reads and sums tests/kernels has in the quick step too."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


@pytest.mark.parametrize("coeffs", [3, 8, *slow(1, 2, 4, 16, 32)])
@pytest.mark.parametrize("alpha", [1.0, 10.0])
def test_map_equals_the_reference(renderer, coeffs, alpha):
    scene = make_scene()
    scene = scene.replace(map=scene.map.replace(coeffs=coeffs, steps=32, density_weighting=alpha))

    coefficients = a_map(renderer, scene).coefficients

    expected = reference.build_map(scene, scene.lights[0])
    assert expected[..., 0].min() < 0.9  # the medium is in the map
    assert coefficients.shape == (24, 24, coeffs)
    assert np.abs(coefficients - expected).max() < PASS + RECURRENCE


def test_texels_that_miss_are_clear(renderer):
    scene = make_scene(lights=[tfm.SpotLight(from_=(2.2, 3, 1.2), to=(0, 0, 0), cone=70)])

    coefficients = a_map(renderer, scene).coefficients

    assert (coefficients[0, 0] == [1, 0, 0, 0, 0, 0, 0, 0]).all()
    assert coefficients[12, 12, 0] < 1


@pytest.mark.slow
def test_colours_need_no_new_map(renderer):
    scene = make_scene()
    maps = renderer.build_maps(scene)
    recoloured = scene.replace(medium=tfm.Medium(sigma_s=(0.3, 1.5, 0.9), sigma_a=(0, 0.2, 0.7)))

    rebuilt = renderer.build_maps(recoloured)
    reused = renderer.render(recoloured, maps=maps)

    assert rebuilt[0].coefficients.tobytes() == maps[0].coefficients.tobytes()
    assert (reused.image == renderer.render(recoloured).image).all()
    assert not (reused.image == renderer.render(scene, maps=maps).image).all()


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("volume", lambda scene: scene.replace(volume=scene.volume.with_density_scale(2))),
        ("light", lambda scene: scene.replace(lights=[scene.lights[0].replace(cone=30)])),
        ("map settings", lambda scene: scene.replace(map=scene.map.replace(coeffs=4))),
    ],
)
def test_a_map_of_another_scene_is_refused(renderer, small_scene, what, change):
    maps = renderer.build_maps(small_scene)

    with pytest.raises(SceneError, match=f"another {what}"):
        renderer.render(change(small_scene), maps=maps)


def test_maps_serve_other_intensity_camera_and_phase(renderer, small_scene):
    maps = renderer.build_maps(small_scene)
    changed = small_scene.replace(
        lights=[small_scene.lights[0].replace(intensity=(1, 2, 3))],
        camera=small_scene.camera.replace(fov=50),
        medium=small_scene.medium.replace(phase=tfm.Isotropic()),
    )

    assert (renderer.render(changed, maps=maps).image == renderer.render(changed).image).all()


def test_too_few_maps_are_refused(renderer, small_scene):
    with pytest.raises(SceneError, match="0 maps for 1 lights"):
        renderer.render(small_scene, maps=[])


def test_evaluate_is_what_the_reference_looks_up(renderer, small_scene, rng):
    light = small_scene.lights[0]
    matrix, tangent = light.frame().world_from_light, np.tan(np.radians(light.cone))
    z = rng.uniform(2.5, 5.5, (400, 1))
    angle, radius = rng.uniform(0, 2 * np.pi, 400), np.sqrt(rng.uniform(0, 0.99, 400)) * tangent
    local = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(400)]) * z
    points = local @ matrix[:3, :3].T + matrix[:3, 3]

    light_map = a_map(renderer, small_scene)
    grey = light_map.evaluate(points.reshape(20, 20, 3))
    coloured = light_map.evaluate(points, sigma_t=(1.0, 0.5, 2.0))

    depth = reference.map_optical_depth(small_scene, light, reference.build_map(small_scene, light), points)
    assert grey.shape == (20, 20)
    assert np.abs(grey.ravel() - np.exp(-depth)).max() < 10 * PASS
    assert np.abs(coloured - np.exp(-depth[:, None] * [1, 0.5, 2])).max() < 20 * PASS
    assert 0 < grey.min() < 0.5 < grey.max() <= 1


def test_evaluate_is_0_where_the_light_does_not_reach(renderer, small_scene):
    light_map = a_map(renderer, small_scene)
    light = small_scene.lights[0]
    behind = 2 * np.asarray(light.from_) - np.asarray(light.to)

    assert light_map.evaluate([behind, (50, 0, 0)]).tolist() == [0, 0]
    assert light_map.evaluate(np.zeros((0, 3))).shape == (0,)
    with pytest.raises(SceneError, match="finite positions"):
        light_map.evaluate([[np.nan, 0, 0]])


@pytest.mark.slow
def test_more_coefficients_come_nearer_to_the_march(renderer):
    # The L2 error of a projection cannot grow with n; here it must fall by orders of magnitude.
    scene = make_scene()
    scene = scene.replace(map=scene.map.replace(res=96, steps=64, density_weighting=1.0))
    reference_image = renderer.render(scene, method="dual").image
    errors = []
    for coeffs in (1, 2, 4, 8, 16, 32):
        image = renderer.render(scene.replace(map=scene.map.replace(coeffs=coeffs))).image
        errors.append(float(np.sqrt(np.mean((image - reference_image)[..., :3] ** 2))))

    assert all(after < before for before, after in itertools.pairwise(errors))
    assert errors[-1] < errors[0] / 50


@pytest.mark.slow
@pytest.mark.parametrize(
    ("storage", "nbytes", "error"),
    [("f32", 4, 0.0), pytest.param("f16", 2, 0.01, marks=pytest.mark.slow), ("u8", 1, 0.05)],
)
def test_storage_trades_bytes_for_a_bounded_error(renderer, small_scene, storage, nbytes, error):
    # The power α = 10 multiplies the rounding of f (2^-11, or 1/510 of each coefficient's extent) by α T.
    stored = small_scene.replace(map=small_scene.map.replace(storage=storage))
    exact = renderer.render(small_scene).image

    result = renderer.render(stored)

    assert result.stats.map_bytes == nbytes * 24 * 24 * 8
    assert np.abs(result.image - exact).max() <= error * exact[..., :3].max()
    assert storage == "f32" or not (result.image == exact).all()
    assert a_map(renderer, stored).coefficients.dtype == np.float32


@pytest.mark.parametrize("coeffs", [8, *slow(1, 3, 32)])
def test_8_bits_span_each_coefficient(renderer, coeffs):
    scene = make_scene()
    for res in (1, 5, 70):  # of 70² texels the last part that limits are found of is shorter
        settings = scene.map.replace(coeffs=coeffs, steps=32, res=res)
        exact = a_map(renderer, scene.replace(map=settings)).coefficients.reshape(-1, coeffs)

        found = a_map(renderer, scene.replace(map=settings.replace(storage="u8")))

        lowest, highest = exact.min(axis=0), exact.max(axis=0)
        assert np.array_equal(found.buffers.limits, np.stack([lowest, highest - lowest], axis=1))
        assert res == 1 or (lowest < highest).all()
        extremes = np.sort(found.coefficients.reshape(-1, coeffs), axis=0)[[0, -1]]
        assert np.allclose(extremes, [lowest, highest], rtol=0, atol=1e-6)


def test_auto_weighting_follows_the_optical_depth(renderer, small_scene):
    def alpha(scale, **sigma):
        scene = small_scene.replace(
            volume=small_scene.volume.with_density_scale(scale),
            map=small_scene.map.replace(density_weighting="auto"),
            medium=tfm.Medium(**sigma),
        )
        found = a_map(renderer, scene).density_weighting
        assert found == pytest.approx(reference.density_weighting(scene), rel=1e-4)
        return found

    assert alpha(0.01) == 1
    assert 1 < alpha(4.0) < 16
    assert alpha(1000.0) == 16
    assert alpha(1000.0, sigma_s=0.01) > 16  # so that float32 holds e^{-τ/α} where it is still seen


@pytest.mark.slow
def test_a_weighting_that_float32_cannot_hold_is_reported(renderer, small_scene):
    scene = small_scene.replace(
        volume=small_scene.volume.with_density_scale(4000),
        medium=small_scene.medium.replace(sigma_s=(1e-3, 8e-4, 5e-4), sigma_a=0),
    )
    automatic = scene.replace(map=scene.map.replace(density_weighting="auto"))

    assert "density_weighting = 10 cannot carry" in renderer.render(scene).warnings[0]
    assert renderer.render(automatic).warnings == ()
    assert renderer.render(small_scene).warnings == ()
