"""Deep samples: the transmittance along rays, the picture's opacity, and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_scene
from tolerances import FLOAT32, PASS

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.reference import deep as reference
from tfm_cl.render import deep

WHOLE = 2e-4
"""Opacity of a whole ray: 1e-4 where a line ends, and e^-10 that opaque samples leave."""
ROUNDED = 4e-5
"""Transmittance inside a sample whose opacity is near 1, of which float32 keeps 6e-8: e^10 of that by the
slope, at most e^-1 of a tenth."""

SUMS = 20 * FLOAT32
"""Of the brightest: what each step adds goes to the picture and to samples in another order."""
EVEN = 0.02
"""Of the brightest: what is cut in the middle of a sample, whose light is not as even as its extinction."""

SMALL = make_scene()
GREY = SMALL.replace(medium=tfm.Medium(sigma_s=1.8, sigma_a=0.2))
BOX = tfm.BoxVolume(from_=(-0.9, -0.5, -0.6), to=(0.4, 0.7, 0.3), density=0.7)
BALL = tfm.SphereVolume(centre=(0, 0, 0), radius=0.7, density=3.0)
FOG = tfm.EverywhereVolume(density=0.05)
SOLIDS = [tfm.SphereSolid(centre=(0.5, 0.6, 0.3), radius=0.3), tfm.PlaneSolid(point=(0, -0.8, 0))]
HELD_OUT = [solid.replace(holdout=True) for solid in SOLIDS]
BROWN = tfm.Medium(sigma_s=(0.8, 0.5, 0.25), sigma_a=(0.2, 0.4, 0.6))
POINTS = tfm.Points([[0.3, 0.2, 0.1], [-0.4, 0.1, -0.3]], [0.5, 0.4], 1.5)
CASES = {
    "colours": SMALL,
    "dense": GREY.replace(medium=tfm.Medium(sigma_s=40.0)),
    "all kinds, solids": SMALL.replace(
        volume=[SMALL.volume, BALL.with_medium(BROWN), FOG],
        solids=SOLIDS,
        camera=SMALL.camera.replace(haze=10.0),
    ),
    "holdouts": GREY.replace(solids=HELD_OUT),
    "a grid in a box": GREY.replace(volume=[GREY.volume, BOX]),
    "two bodies apart": GREY.replace(volume=[BALL, BOX.replace(from_=(-0.9, -0.5, -2), to=(0.4, 0.7, -1.7))]),
    "fog": GREY.replace(volume=[FOG]),
    "points": GREY.replace(volume=[POINTS]),
}


def of_pixel(samples, pixel):
    end = samples.ends[pixel]
    part = slice(end - samples.counts.ravel()[pixel], end)
    return [array[part].astype(np.float64) for array in (samples.z, samples.z_back, samples.alpha)]


def transmittance(samples, pixel, z):
    """As "Interpreting OpenEXR Deep Pixels" has it."""
    left = np.ones_like(z)
    for front, back, alpha in zip(*of_pixel(samples, pixel), strict=True):
        part = np.clip((z - front) / (back - front), 0, 1) if back > front else (z >= front).astype(float)
        left *= (1 - alpha) ** part
    return left


def assert_tidy(samples):
    """In order, without overlap, none empty."""
    for pixel in range(samples.counts.size):
        front, back, alpha = of_pixel(samples, pixel)
        assert (front <= back).all()
        assert (front[1:] >= back[:-1]).all()
        assert ((alpha > 0) & (alpha <= 1)).all()


@pytest.mark.quick("colours")
@pytest.mark.parametrize("case", CASES)
def test_samples_follow_the_transmittance_to_the_tolerance(renderer, case):
    scene, tolerance = CASES[case], 0.01
    result = renderer.render(scene, deep=tolerance)
    samples = result.deep
    assert_tidy(samples)
    alpha = result.image[..., 3]
    assert alpha.max() > 0.3
    assert np.abs(samples.flattened()[..., 0] - alpha).max() < WHOLE
    for pixel, curve in enumerate(reference.curves(scene)):
        last = curve.distance[-1] if len(curve.distance) else 1.0
        z = np.linspace(0, min(last, curve.solid) * (1 - PASS), 500)
        off = np.abs(transmittance(samples, pixel, z) - curve.transmittance(z)).max()
        assert off < tolerance + ROUNDED, pixel
    of_reference = reference.deep_samples(scene, tolerance)
    assert np.abs(of_reference.flattened()[..., 0] - alpha).max() < WHOLE
    assert len(samples.z) == pytest.approx(len(of_reference.z), rel=0.02)  # ties are broken by rounding


def test_a_ball_is_one_sample(renderer):
    """Its chord, of constant extinction; Z is the distance along the viewing direction."""
    scene = GREY.replace(volume=[BALL])
    samples = renderer.render(scene, deep=0.01).deep
    origins, directions = scene.camera.rays(None)
    along = directions @ scene.camera.world_from_camera[:3, 2]
    middle = -(origins * directions).sum(axis=1)
    square = 0.7**2 - ((origins + middle[:, None] * directions) ** 2).sum(axis=1)
    half = np.sqrt(np.maximum(square, 0))
    hit = half > 0.1  # beyond, float32 tells chords less exactly
    counts = samples.counts.ravel()
    np.testing.assert_array_equal(counts[hit], 1)
    np.testing.assert_array_equal(counts[square < -0.01], 0)
    for pixel in np.flatnonzero(hit):
        front, back, alpha = of_pixel(samples, pixel)
        ends = (middle[pixel] + half[pixel] * np.array([-1, 1])) * along[pixel]
        np.testing.assert_allclose([front[0], back[0]], ends, rtol=20 * FLOAT32)
        assert alpha[0] == pytest.approx(-np.expm1(-2 * 3.0 * 2 * half[pixel]), rel=PASS)


@pytest.mark.slow
def test_a_solid_is_the_last_sample_and_a_holdout_none(renderer):
    shown = renderer.render(GREY.replace(solids=SOLIDS), deep=0.01)
    held_out = renderer.render(GREY.replace(solids=HELD_OUT), deep=0.01)
    hit = shown.aovs["solid_distance"] > 0
    np.testing.assert_array_equal(shown.deep.counts - held_out.deep.counts, hit)
    origins, directions = GREY.camera.rays(None)
    del origins
    along = directions @ GREY.camera.world_from_camera[:3, 2]
    last = shown.deep.ends[hit.ravel()] - 1
    z = shown.aovs["solid_distance"][hit] * along[hit.ravel()]
    np.testing.assert_allclose(shown.deep.z[last], z, rtol=4 * FLOAT32)
    np.testing.assert_array_equal(shown.deep.z[last], shown.deep.z_back[last])
    np.testing.assert_array_equal(shown.deep.alpha[last], 1)


def test_a_crop_has_the_samples_of_the_frame_and_pixels_of_many_rays_those_of_one(renderer):
    whole = renderer.render(SMALL, deep=0.01).deep
    crop = renderer.render(SMALL, deep=0.01, crop=(5, 3, 19, 14), samples=4, filter="gaussian").deep
    np.testing.assert_array_equal(crop.counts, whole.counts[3:14, 5:19])
    inside = np.zeros(whole.counts.shape, bool)
    inside[3:14, 5:19] = True
    of_crop = np.repeat(inside.ravel(), whole.counts.ravel())
    for name in ("z", "z_back", "alpha"):
        np.testing.assert_array_equal(getattr(crop, name), getattr(whole, name)[of_crop])


def test_a_finer_tolerance_has_more_samples(renderer):
    counts = [len(renderer.render(SMALL, deep=tolerance).deep.z) for tolerance in (0.1, 0.01, 1e-3, 0)]
    assert counts == sorted(counts)
    assert counts[0] < 0.3 * counts[-1]


GLOWING = SMALL.medium.replace(emission=(0.5, 1.0, 2.0))
SUN = tfm.SunLight(from_=(1, 2, 1), to=(0, 0, 0))
SKY = tfm.EnvironmentLight(samples=3, intensity=0.3)
AMBIENT = tfm.Ambient(radiance=(0.1, 0.2, 0.3))
COLOURS = {
    "a spot": SMALL,
    "solids, ambient light and emission": SMALL.replace(medium=GLOWING, ambient=AMBIENT, solids=SOLIDS),
    "lights that share samples": SMALL.replace(
        lights=[SUN, SUN.replace(from_=(-1, 2, 3)), SKY], march=SMALL.march.replace(sampling="world")
    ),
    "all kinds": SMALL.replace(volume=[SMALL.volume, BALL.with_medium(BROWN), FOG], ambient=AMBIENT),
    "a ball": GREY.replace(volume=[BALL]),
    "a lattice": SMALL.replace(lights=[SUN, SKY], map=SMALL.map.replace(lookup="lattice")),
    "later orders": SMALL.replace(medium=SMALL.medium.replace(orders=3)),
    "emission lights": SMALL.replace(medium=GLOWING.replace(emission_lights=3)),
    "what only glows": SMALL.replace(
        medium=GLOWING.replace(sigma_s=0, sigma_a=0), lights=[], ambient=AMBIENT
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", COLOURS)
def test_colours_of_samples_flatten_to_the_picture(renderer, case):
    scene = COLOURS[case]
    result = renderer.render(scene, deep=0.01, deep_colour=True)
    np.testing.assert_array_equal(result.image, renderer.render(scene).image)
    flat, image = result.deep.flattened(), result.image
    assert image[..., :3].max() > 0.05
    assert np.abs(flat - image)[..., :3].max() < SUMS * image[..., :3].max()
    assert np.abs(flat - image)[..., 3].max() < WHOLE
    assert result.deep.rgb.min() >= -SUMS * image[..., :3].max()


@pytest.mark.slow
@pytest.mark.parametrize("depth", [3.6, 4.2, 4.8])
def test_samples_cut_at_a_depth_are_the_picture_with_a_holdout_there(renderer, depth):
    """A part s of a sample has the opacity 1 - (1 - α)^s, and as much of its colour as of its opacity."""
    scene = SMALL.replace(
        lights=[SMALL.lights[0].replace(from_=SMALL.camera.from_, cone=40)],
        medium=GLOWING,
        ambient=AMBIENT,
        march=SMALL.march.replace(steps=200),
    )
    samples = renderer.render(scene, deep=0.002, deep_colour=True).deep
    share = np.clip((depth - samples.z) / np.maximum(samples.z_back - samples.z, 1e-9), 0, 1)
    alpha = -np.expm1(share * np.log1p(-np.minimum(samples.alpha.astype(np.float64), 1 - 1e-7)))
    kept = np.divide(alpha, samples.alpha, out=np.zeros_like(alpha), where=samples.alpha > 0)
    cut = replace(
        samples, alpha=alpha.astype(np.float32), rgb=(samples.rgb * kept[:, None]).astype(np.float32)
    )
    *_, forward, position = scene.camera.world_from_camera[:3].T
    wall = tfm.PlaneSolid(point=position + depth * forward, normal=-forward, holdout=True)
    expected = renderer.render(scene.replace(solids=[wall])).image
    flat = cut.flattened()
    assert np.abs(flat - expected)[..., 3].max() < 0.004
    assert np.abs(flat - expected)[..., :3].max() < EVEN * expected[..., :3].max()


def test_nothing_is_made_unless_it_is_asked_for(renderer, tmp_path):
    result = renderer.render(SMALL)
    assert result.deep is None
    with pytest.raises(tfm.InputError, match=r"a\.deep\.exr: has no deep samples"):
        result.save(tmp_path / "a.deep.exr")
    assert not [*tmp_path.iterdir()]


def test_what_cannot_be_is_refused(renderer, monkeypatch):
    with pytest.raises(SceneError, match=r"deep_tolerance"):
        renderer.render(SMALL, deep=0.7)
    monkeypatch.setattr(deep, "MOST_SAMPLES", 100)
    with pytest.raises(SceneError, match=r"deep_tolerance = 0\.01: asks for 1,388 .*than 100; take a larger"):
        renderer.render(SMALL, deep=0.01)


def test_colours_of_octaves_are_refused_before_anything_is_rendered(renderer):
    scene = make_scene(medium=tfm.Medium(octaves=2))
    with pytest.raises(SceneError, match="deep_colour: octaves are as bright"):
        renderer.render(scene, deep=0.01, deep_colour=True)
