"""The view pass against the float64 reference."""

import numpy as np
import pytest
from scenes import blobs, make_scene, turned
from tolerances import PASS

import tfm_cl as tfm
from tfm_cl import reference

pytestmark = pytest.mark.lanes

LIGHT = make_scene().lights[0]
MIXED = tfm.PhaseMixture(phases=("mie", "rayleigh"), weights=(1, 2))
VARIANTS = {
    "plain": {},
    "world sampling": {"march": tfm.MarchSettings(steps=30, sampling="world")},
    "paper's projective sampling": {"march": tfm.MarchSettings(steps=30, max_stretch=1e9)},
    "isotropic, grey": {"medium": tfm.Medium(sigma_s=1.3)},
    "absorbs only": {"medium": tfm.Medium(sigma_s=0.0, sigma_a=1.0)},
    "one channel is clear": {"medium": tfm.Medium(sigma_s=(1, 0, 0.5), sigma_a=(0, 0, 0.5))},
    "backward": {"medium": tfm.Medium(phase=tfm.HenyeyGreenstein(-0.6))},
    "tables of two media": {
        "medium": tfm.Medium(phase=tfm.TabulatedPhase(values=(3, 1, 2, 9))),
        "volume": [
            make_scene().volume,
            tfm.SphereVolume(density=0.5, medium=tfm.Medium(phase=MIXED)),
            tfm.BoxVolume(density=0.2, medium=tfm.Medium(phase="fournier-forand")),
        ],
    },
    "inverse-square": {"lights": [LIGHT.replace(falloff="inverse-square", intensity=(40, 30, 20))]},
    "soft narrow cone": {"lights": [LIGHT.replace(cone=9, blend=0.5)]},
    "hard narrow cone": {"lights": [LIGHT.replace(cone=6)]},
    "light inside": {"lights": [LIGHT.replace(from_=(0.1, 0.3, 0.1), to=(0, -1, 0.2), cone=50)]},
    "camera inside": {"camera": tfm.Camera(from_=(0.1, 0.1, 0.2), to=(-1, 0, -0.4), fov=80, res=(24, 18))},
    "camera in the cone": {"camera": tfm.Camera(from_=(1.2, 1.7, 0.7), to=(0, 0, 0), fov=60, res=(24, 18))},
    "along the light": {"camera": tfm.Camera(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), fov=40, res=(24, 18))},
    "two lights": {"lights": [LIGHT, LIGHT.replace(from_=(-3, 1, 2), cone=12, intensity=(0, 1, 4))]},
    "one coefficient": {
        "map": tfm.MapSettings(basis="dct", density_weighting=10.0, res=24, steps=24, coeffs=1)
    },
    "32 coefficients": {
        "map": tfm.MapSettings(basis="dct", res=24, steps=32, coeffs=32, density_weighting=1.0)
    },
    "portrait": {"camera": tfm.Camera(from_=(0.6, 0.8, 4.2), to=(0, 0, 0), fov=38, res=(11, 29))},
    "far from the origin": {
        "volume": tfm.Volume(
            blobs(), world_from_index=turned(0, (0, 1, 0), (0.15,) * 3, (1e5, 0, 0)), density_scale=4
        ),
        "camera": tfm.Camera(from_=(1e5 + 1, 1, 5), to=(1e5 + 1, 1, 1), fov=38, res=(24, 18)),
        "lights": [LIGHT.replace(from_=(1e5 + 3, 4, 3), to=(1e5 + 1, 1, 1))],
    },
}


@pytest.mark.quick(
    "plain-tfm",
    "plain-dual",
    "world sampling-tfm",
    "paper's projective sampling-tfm",
    "hard narrow cone-tfm",
    "light inside-tfm",
    "camera inside-tfm",
    "camera in the cone-dual",
    "two lights-tfm",
    "portrait-tfm",
    "far from the origin-tfm",
)
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_picture_and_layers_equal_the_reference(renderer, save_on_failure, variant, method):
    scene = make_scene(**VARIANTS[variant])

    result = renderer.render(scene, method=method)

    expected, layers = reference.render_with_aovs(scene, method)
    assert expected[..., 3].max() > 0.1  # the medium is in the picture
    # The power α amplifies the map's rounding; float32 grazing hits of a narrow cone move single samples.
    scale = max(1.0, float(expected[..., :3].max()))
    with save_on_failure(result.image, expected.astype(np.float32)):
        assert np.abs(result.image - expected).max() < 20 * PASS * scale
        for name in ("transmittance", "depth"):
            assert np.abs(result.aovs[name] - layers[name]).max() < 20 * PASS
    # A ratio of sums: its error is that of the sums over the opacity.
    seen = expected[..., 3] > 0.01
    lit = np.abs(result.aovs["light_transmittance"] - layers["light_transmittance"])[seen]
    assert lit.max(initial=0) < 1e-3


def test_lights_add_up(renderer):
    lights = [LIGHT, LIGHT.replace(from_=(-3, 1, 2), cone=12, intensity=(0, 1, 4))]
    both = renderer.render(make_scene(lights=lights))
    single = [renderer.render(make_scene(lights=[light])) for light in lights]

    rgb = sum(result.image[..., :3] for result in single)

    assert np.abs(both.image[..., :3] - rgb).max() < PASS
    assert (both.image[..., 3] == single[0].image[..., 3]).all()


def test_intensity_is_linear(renderer, small_scene):
    twice = small_scene.replace(lights=[LIGHT.replace(intensity=tuple(2 * np.array(LIGHT.intensity)))])

    assert np.allclose(
        renderer.render(twice).image[..., :3], 2 * renderer.render(small_scene).image[..., :3], rtol=1e-6
    )


def test_samples_are_counted(renderer, small_scene):
    small_scene = small_scene.replace(march=small_scene.march.replace(skip_empty=False))
    tfm_result = renderer.render(small_scene)
    dual_result = renderer.render(small_scene, method="dual")

    per_pixel = tfm_result.aovs["samples"]
    assert per_pixel.min() == 0  # rays that miss the medium
    # One march of the medium, one of the lit part, and at most one step count before it.
    assert 60 <= per_pixel.max() <= 91
    assert tfm_result.stats.samples["view_pass"] == per_pixel.sum()
    assert dual_result.aovs["samples"].max() > 5 * per_pixel.max()
    assert tfm_result.stats.samples["light_pass"] % small_scene.map.steps == 0
    assert dual_result.stats.samples["light_pass"] == 0
    assert dual_result.stats.seconds["light_pass"] == 0


@pytest.mark.quick("projective")
@pytest.mark.parametrize("sampling", ["projective", "world"])
def test_steps_converge_at_second_order(renderer, sampling):
    # Midpoints: four times the steps, a sixteenth of the error, until float32 stops it. Asked: a fifth.
    def image(steps):
        scene = make_scene(
            march=tfm.MarchSettings(steps=steps, sampling=sampling),
            map=tfm.MapSettings(basis="dct", density_weighting=10.0, steps=steps),
        )
        return renderer.render(scene, method="dual").image[..., :3]

    converged = image(1024)
    coarse, fine = (np.abs(image(steps) - converged).mean() for steps in (32, 128))

    assert fine < coarse / 5
    assert fine < 1e-3 * converged.mean() * 5
