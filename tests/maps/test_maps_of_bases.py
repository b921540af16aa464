"""Every basis that is a sum of functions, with its options, against the float64 model of light pass and
look-up."""

import numpy as np
import pytest
from scenes import make_scene
from tolerances import PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.errors import SceneError
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.light_pass import map_bytes
from tfm_cl.maps.planned import MapPlan
from tfm_cl.maps.resolved import resolve

FITTED = 2e-4
"""Of T: normal equations of condition up to 1e4 in float32, and the ridge in another order of sums."""

CASES = {
    "hcos": {"basis": "hcos"},
    "hcos, 5 numbers": {"basis": "hcos", "coeffs": 5},
    "hcos of the visible": {"basis": "hcos", "range": "visible", "fit": "visibility"},
    "dct, trimmed": {"basis": "dct", "range": "trimmed", "density_weighting": 4.0},
    "dct, visibility": {"basis": "dct", "range": "trimmed", "fit": "visibility", "density_weighting": 4.0},
    "dct of tau, global": {"basis": "dct", "target": "optical-depth", "range": "global"},
    "klt": {"basis": "klt"},
    "klt, 3 numbers": {"basis": "klt", "coeffs": 3},
    "klt, 13 numbers, plain": {"basis": "klt", "coeffs": 13, "fit": "l2"},
    "klt of T": {"basis": "klt", "target": "transmittance", "fit": "l2", "density_weighting": 3.0},
    "klt in the bounds": {"basis": "klt", "range": "box", "coeffs": 4},
    "klt, reconstructed": {"basis": "klt", "lookup": "reconstruct"},
}
QUICK = ("hcos", "dct, visibility", "klt", "klt of T")
"""Meets every target, fit and kind of range; compiling is what takes the time."""
PICTURED = ("klt",)
"""Pictures take longer than maps to compile."""


def cases(quick):
    """All, of which some are left to the slow step."""
    return [case if case in quick else pytest.param(case, marks=pytest.mark.slow) for case in CASES]


def scene_with(**settings):
    return make_scene(map=tfm.MapSettings(**{"res": 24, "steps": 24, **settings}))


@pytest.mark.quick("klt", "dct, visibility")
@pytest.mark.lanes
@pytest.mark.parametrize("case", cases(QUICK))
def test_map_equals_the_model(renderer, case):
    scene = scene_with(**CASES[case])
    light = scene.lights[0]
    (light_map,) = renderer.build_maps(scene)

    numbers = reference.build_map(scene, light, light_map)

    fitted = light_map.settings.fit == "visibility"
    assert light_map.coefficients.shape == numbers.shape
    # What the numbers mean is compared, not the numbers: functions may nearly cancel.
    rng = np.random.default_rng(5)
    points = rng.uniform(-1.2, 1.2, (500, 3))
    depth = reference.map_optical_depth(scene, light, numbers, points, light_map)
    reached = reference.unshadowed(scene.volume, light, points)[:, 0] > 0
    found = light_map.evaluate(points)
    assert reached.any()
    inside = reached & (found > 0)
    assert np.abs(found - np.exp(-depth))[inside].max() < (FITTED if fitted else 20 * PASS)
    assert found[inside].min() < 0.2


@pytest.mark.lanes
def test_what_lay_where_texels_have_no_range_changes_nothing(renderer, rng, monkeypatch):
    wide = tfm.SpotLight(from_=(2.2, 3, 1.2), to=(0, 0, 0), cone=70)
    scene = scene_with(basis="klt", res=192).replace(lights=[wide])
    launcher = renderer._launcher
    settings = renderer.build_maps(scene)[0].settings
    # Memory that the next map gets, most of which it leaves as it is.
    for nbytes in (map_bytes(settings), 8 * 192**2):
        launcher.write(launcher.empty("what lay there", nbytes, reuse=True), np.full(nbytes, 99, np.uint8))

    (light_map,) = renderer.build_maps(scene)
    x0, y0, x1, y1 = light_map.plan.window
    monkeypatch.setattr(MapPlan, "window", (0, 0, 192, 192))
    (whole,) = renderer.build_maps(scene)

    assert 32 < x0 < x1 < 160  # launches begin and end at multiples of 32
    assert (light_map.coefficients == whole.coefficients).all()
    assert (light_map.occupied == whole.occupied).all()
    assert (light_map.coefficients[:y0] == 0).all()
    assert (light_map.occupied[y1:] == 0).all()
    assert light_map.coefficients.any()
    assert light_map.buffers.window != whole.buffers.window == (0, 0, 192, 192)
    assert (light_map.buffers.samples, light_map.buffers.hits) == (whole.buffers.samples, whole.buffers.hits)
    points = rng.uniform(-4, 4, (4000, 3))
    assert np.array_equal(light_map.evaluate(points), whole.evaluate(points))


@pytest.mark.lanes
@pytest.mark.parametrize("case", cases(PICTURED))
def test_picture_equals_the_model(renderer, save_on_failure, case):
    scene = scene_with(**CASES[case])
    maps = renderer.build_maps(scene)

    image = renderer.render(scene, maps=maps).image
    expected = reference.render(scene, "tfm", maps=maps)

    fitted = maps[0].settings.fit == "visibility"
    with save_on_failure(image, expected.astype(np.float32)):
        assert np.abs(image - expected).max() < (FITTED if fitted else 20 * PASS)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dct", "hcos", "klt"])  # others: tests/maps/bases
def test_more_numbers_are_nearer(renderer, name):
    counts = [n for n in BASES[name].counts if n in (2, 3, 8, 9)]
    errors = [renderer.build_maps(scene_with(basis=name, coeffs=n, range="trimmed"))[0].error for n in counts]

    assert errors[-1] < errors[0] / 2


@pytest.mark.slow
def test_auto_is_the_most_accurate_of_its_size(renderer):
    errors = {
        name: renderer.build_maps(scene_with(basis=name, coeffs=8))[0].error
        for name in ("auto", "dct", "hcos", "legendre", "nodes")
    }

    assert errors["auto"] == min(errors.values())
    assert errors["auto"] < errors["dct"] / 2


@pytest.mark.slow
def test_the_residual_is_the_error_along_the_texel_s_ray(renderer):
    scene = scene_with(basis="dct", coeffs=3, density_weighting=2.0)
    (light_map,) = renderer.build_maps(scene)

    y, x = np.unravel_index(light_map.residual.argmax(), light_map.residual.shape)
    _, exact, found = light_map.curve((x + 0.5) / 24, (y + 0.5) / 24, count=24)

    weight = -np.diff(np.log(np.append(exact, exact[-1])))
    error = np.sqrt((weight * (found - exact) ** 2).sum() / (weight * exact**2).sum())
    assert light_map.residual[y, x] == pytest.approx(
        error, rel=0.25
    )  # the weights are differences of middles
    assert 0 < light_map.error < light_map.residual.max()


@pytest.mark.slow
def test_map_error_shows_the_residual(renderer):
    # Of one basis and size, so that one program serves: it is the steps of the map that err.
    coarse_scene, fine_scene = scene_with(basis="klt", steps=16), scene_with(basis="klt", steps=96)
    residuals = [renderer.build_maps(scene)[0].residual for scene in (coarse_scene, fine_scene)]

    coarse, fine = (renderer.render(scene, aovs=("map_error",)) for scene in (coarse_scene, fine_scene))

    assert "map_error" not in renderer.render(fine_scene).aovs
    seen = coarse.image[..., 3] > 0.1
    for result, residual in zip((coarse, fine), residuals, strict=True):
        shown = result.aovs["map_error"]
        assert (shown >= 0).all()
        # What pixels show lies between what the map's texels have.
        assert 0 < shown[seen].mean() <= shown.max() <= residual.max() * (1 + PASS)
    assert coarse.aovs["map_error"][seen].mean() > 1.5 * fine.aovs["map_error"][seen].mean()


@pytest.mark.quick("17-4")
@pytest.mark.parametrize(("given", "numbers"), [(64, 8), (17, 4), (9, 2)])
def test_bytes_ask_for_numbers(renderer, given, numbers):
    scene = make_scene(map=tfm.MapSettings(basis="dct", bytes=given, storage="f32"))

    assert resolve(scene.map).coeffs == min(given // 4, 32)
    assert renderer.build_maps(scene_with(basis="hcos", bytes=4 * numbers))[0].bytes_per_texel <= given


@pytest.mark.slow
def test_half_precision_holds_any_units(renderer):
    """Densities of 1e7 with tiny coefficients: optical depths beyond what half precision can hold."""
    scene = scene_with(basis="klt")
    tiny = scene.replace(
        volume=scene.volume.with_density_scale(4e7),
        medium=tfm.Medium(sigma_s=1e-7),
        map=scene.map.replace(storage="f16"),
    )
    usual = tiny.replace(volume=scene.volume.with_density_scale(4), medium=tfm.Medium(sigma_s=1.0))

    points = np.random.default_rng(5).uniform(-1.2, 1.2, (500, 3))
    found, expected = (
        renderer.build_maps(scene)[0].evaluate(points, scene.medium.sigma_t) for scene in (tiny, usual)
    )

    assert np.abs(found - expected).max() < 1e-3
    assert 0 < expected[expected > 0].min() < 0.1


@pytest.mark.slow
def test_colours_reuse_a_map_that_was_fitted_for_others(renderer):
    """The fit and the range are made for one extinction; half of it still finds its shadows."""
    scene = scene_with(basis="klt", res=48, steps=48)
    maps = renderer.build_maps(scene)
    thinner = scene.replace(medium=scene.medium.replace(sigma_s=(0.45, 0.35, 0.25), sigma_a=(0.1, 0.2, 0.1)))

    dual = renderer.render(thinner, method="dual")

    assert tfm.compare(renderer.render(thinner, maps=maps).image, dual.image).lit.rmse < 0.02


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"basis": "klt", "target": "extinction"}, "basis 'klt' has transmittance, optical-depth"),
        ({"coeffs": 4, "bytes": 20}, "bytes chooses coeffs"),
        ({"max_error": 0.1, "bytes": 20}, "both choose coeffs"),
        ({"basis": "dtc"}, "did you mean 'dct'"),
        ({"max_error": 0}, "from 0.0001 to 1"),
    ],
)
def test_what_makes_no_sense_is_refused(settings, words):
    with pytest.raises(SceneError, match=words):
        tfm.MapSettings(**settings)


@pytest.mark.parametrize(
    "settings", [{"basis": "dct"}, {"basis": "klt"}, {"basis": "hcos", "range": "visible"}]
)
def test_blur_needs_numbers_that_are_linear_in_density(settings):
    with pytest.raises(SceneError, match="linear in the density"):
        resolve(tfm.MapSettings(blur=3.0, **settings))


@pytest.mark.slow
def test_blurred_numbers_are_those_of_blurred_density(renderer):
    """FOM section 6, in one range for all rays: the blur of the numbers is the number of the blurred
    density."""
    scene = scene_with(basis="hcos", range="global", coeffs=6, steps=96)
    (sharp,) = renderer.build_maps(scene)
    blurred = renderer.build_maps(scene.replace(map=scene.map.replace(blur=3.0, blur_kernel="box")))[0]

    inner = sharp.coefficients
    mean = sum(np.roll(inner, (dy, dx), axis=(0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)) / 9

    assert np.abs(blurred.coefficients - mean)[2:-2, 2:-2].max() < PASS * np.abs(inner).max()
    assert np.abs(blurred.coefficients - inner).max() > 0.01 * np.abs(inner).max()


def test_an_empty_volume_has_a_clear_map(renderer):
    scene = scene_with().replace(volume=tfm.Volume(np.zeros((4, 5, 6), np.float32)))

    (light_map,) = renderer.build_maps(scene)

    assert (light_map.evaluate([[0.1, 0.1, 0.1]]) == 1).all()
    assert light_map.error == 0


@pytest.mark.slow
def test_an_area_light_is_the_sum_of_its_points(renderer):
    light = make_scene().lights[0].replace(radius=1.5, samples=5)
    scene = make_scene(lights=[light])

    result = renderer.render(scene)
    maps = renderer.build_maps(scene)

    assert len(maps) == 5
    assert (renderer.render(scene, maps=maps).image == result.image).all()
    assert np.abs(result.image - renderer.render(scene, method="dual").image).max() < 0.01
    assert (
        np.abs(result.image - renderer.render(scene.replace(lights=[light.replace(radius=0)])).image).max()
        > 0.002
    )
