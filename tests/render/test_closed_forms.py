"""Whole renders against integrals known on paper."""

import numpy as np
import pytest
from scipy import integrate

import tfm_cl as tfm

pytestmark = pytest.mark.lanes

STEPS = 400
QUADRATURE = 2e-3
"""Relative error of 400 midpoints on one ray: the box's faces fall inside a step, not on its edge."""


def box(sigma=1.0):
    """A homogeneous box of about 2 × 2 × 2: constant voxels; its border voxel is 1/64 of a side."""
    return tfm.Volume(np.ones((64, 64, 64)), voxel_size=2 / 64, origin=(-1, -1, -1), density_scale=sigma)


def centre_pixel(renderer, scene, method):
    result = renderer.render(scene.replace(camera=scene.camera.replace(res=(1, 1))), method=method)
    return result.image[0, 0], result.aovs


def density_along(t):
    """Density of `box` on its axis at coordinate t: 1, falling to 0 from the last voxel centre on."""
    voxel = 2 / 64
    return float(np.clip((1 + voxel / 2 - abs(t)) / voxel, 0, 1))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("sampling", ["projective", "world"])
@pytest.mark.parametrize("falloff", ["none", "inverse-square"])
def test_homogeneous_box_light_beside_the_camera(renderer, method, sampling, falloff):
    sigma_s, sigma_a, distance = 0.7, 0.4, 4.0
    light = tfm.SpotLight(from_=(0, 0, distance), to=(0, 0, 0), cone=30, falloff=falloff, intensity=5)
    scene = tfm.Scene(
        box(),
        tfm.Medium(sigma_s=sigma_s, sigma_a=sigma_a, phase=tfm.HenyeyGreenstein(0.5)),
        tfm.Camera(from_=(0, 0, distance), to=(0, 0, 0)),
        [light],
        tfm.MapSettings(basis="dct", res=32, steps=STEPS, coeffs=32, density_weighting=1.0),
        tfm.MarchSettings(steps=STEPS, sampling=sampling),
    )

    pixel, _ = centre_pixel(renderer, scene, method)

    # Light and view travel the same path: L = ∫ σ_s p(-1) I/d² e^{-2 σ_t x} dt, back scattering.
    def optical_depth(t):
        return integrate.quad(density_along, t, 1.1, points=[1 - 1 / 64, 1 + 1 / 64], limit=200)[0]

    def radiance(t):
        gain = 1 if falloff == "none" else 1 / (distance - t) ** 2
        phase = (1 - 0.25) / (4 * np.pi * (1 + 0.25 + 1.0) ** 1.5)
        decay = np.exp(-2 * (sigma_s + sigma_a) * optical_depth(t))
        return sigma_s * density_along(t) * phase * 5 * gain * decay

    t = np.linspace(-1.05, 1.05, 4001)
    expected = integrate.simpson([radiance(x) for x in t], x=t)
    # 32 cosines cannot bend at the faces: the map's own error, on a smooth function, is below 0.5 %.
    assert pixel[0] == pytest.approx(expected, rel=QUADRATURE if method == "dual" else 5e-3)


def test_beer_lambert(renderer):
    scene = tfm.Scene(
        box(1.5),
        tfm.Medium(sigma_s=(0.5, 1.0, 2.0)),
        tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0)),
        lights=(),
        march=tfm.MarchSettings(steps=STEPS),
    )

    pixel, aovs = centre_pixel(renderer, scene, "tfm")

    # The border voxels on both sides together hold one half voxel more than the 2 units of the array.
    expected = np.exp(-1.5 * np.array([0.5, 1.0, 2.0]) * 2.0)
    assert np.allclose(aovs["transmittance"][0, 0], expected, rtol=QUADRATURE)
    assert pixel[3] == pytest.approx(1 - expected.mean(), rel=QUADRATURE)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_an_opaque_white_medium_returns_albedo_over_2_of_collimated_light(renderer, method):
    # Half space lit and seen along its normal: L = albedo p I / 2 for any density (TFM eq. 4 integrated).
    for albedo in (1.0, 0.25):
        scene = tfm.Scene(
            box(40.0),
            tfm.Medium(sigma_s=albedo, sigma_a=1 - albedo),
            tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0)),
            [tfm.SpotLight(from_=(0, 0, 4), to=(0, 0, 0), cone=30, intensity=4 * np.pi)],
            tfm.MapSettings(basis="dct", density_weighting=10.0, res=16, steps=2000, coeffs=32),
            tfm.MarchSettings(steps=2000),
        )

        pixel, _ = centre_pixel(renderer, scene, method)

        # All of the light's decay lies in the first fortieth of the map's range: 32 cosines smear it.
        assert pixel[0] == pytest.approx(albedo / 2, rel=QUADRATURE if method == "dual" else 0.02)
        assert pixel[3] == 1


def test_depth_is_the_mean_distance_of_what_is_seen(renderer):
    sigma = 1.5
    camera = tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0))
    scene = tfm.Scene(box(sigma), camera=camera, lights=(), march=tfm.MarchSettings(steps=STEPS))

    _, aovs = centre_pixel(renderer, scene, "tfm")

    # Exponential opacity over a slab of length 2 that begins at distance 3.
    decay = np.exp(-2 * sigma)
    mean = 3 + 1 / sigma - 2 * decay / (1 - decay)
    assert aovs["depth"][0, 0] == pytest.approx(mean, rel=QUADRATURE)


@pytest.mark.slow
def test_the_medium_outside_the_cone_dims_what_is_behind(renderer):
    # A narrow beam crosses the box at right angles to the view: what is seen of it is attenuated by the
    # unlit half of the box before it.
    sigma, half_width = 0.9, 0.05
    light = tfm.SpotLight(
        from_=(0, 500, 0), to=(0, 0, 0), cone=float(np.degrees(np.arctan(half_width / 500))), intensity=1000
    )
    scene = tfm.Scene(
        box(sigma),
        camera=tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0)),
        lights=[light],
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=8, steps=200),
        march=tfm.MarchSettings(steps=200),
    )

    pixel, aovs = centre_pixel(renderer, scene, "dual")

    # Optical depth 1 × sigma above the axis for the light, (1 - w) sigma in front for the camera.
    beam = np.exp(-sigma * (1 - half_width)) * (1 - np.exp(-sigma * 2 * half_width))
    assert pixel[0] == pytest.approx(beam * np.exp(-sigma) * 1000 / (4 * np.pi), rel=5e-3)
    assert aovs["light_transmittance"][0, 0, 0] == pytest.approx(np.exp(-sigma), rel=5e-3)
