"""Motion blur: against means of sharp pictures, whose scenes are made otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import BLURRED, FLOAT32, MOVED_STEPS

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.render import motion
from tfm_cl.render.motion import NOTHING_MOVES, moments_of

SHUTTER = (-0.5, 0.5)
STEP = 0.3
"""World units a frame."""


def moved(scene, x):
    """The scene with its volume elsewhere."""
    matrix = np.eye(4)
    matrix[0, 3] = x
    return scene.replace(volume=scene.volume.transformed(matrix))


def moving_camera(scene):
    def at(frames):
        change = np.array([frames, 0, 0])
        camera = scene.camera
        return scene.replace(camera=camera.replace(from_=camera.from_ + change, to=camera.to + change))

    return at


@pytest.fixture(scope="module")
def scene():
    """One whose marches are fine enough for boxes of other sizes to make no difference."""
    volume = tfm.Volume(blobs(), voxel_size=0.15, origin=(-1.2, -0.9, -1.05), density_scale=4.0)
    scene = make_scene(volume=volume)
    march = scene.march.replace(steps=640, cutoff=0.0)
    return scene.replace(march=march, map=scene.map.replace(steps=200))


@pytest.fixture(scope="module")
def flowing(scene):
    """The same, and all of it moves along x."""
    speed = np.broadcast_to(np.float32((24 * STEP, 0, 0)), (*scene.volume.shape, 3))
    return scene.replace(volume=scene.volume.with_velocity(speed.copy()))


def mean(results, name=None):
    return np.mean([result.image if name is None else result.aovs[name] for result in results], axis=0)


def test_moments_are_the_middles_of_equal_parts():
    assert moments_of((-1.0, 1.0), 4) == pytest.approx([-0.75, -0.25, 0.25, 0.75])
    assert moments_of((0.0, 0.5), 1) == [0.25]


def test_what_is_still_is_the_sharp_picture_and_costs_one(renderer, scene):
    sharp = renderer.render(scene)
    with pytest.warns(tfm.TfmWarning, match="nothing moves while it is open"):
        blurred = renderer.render_blurred(scene, SHUTTER, motion_samples=5)
    assert blurred.image == pytest.approx(sharp.image, abs=FLOAT32)
    assert blurred.warnings == (NOTHING_MOVES,)
    assert blurred.stats.samples == sharp.stats.samples
    assert blurred.stats.made == {}


def test_a_camera_that_moves_takes_no_further_map(renderer, scene):
    at = moving_camera(scene)
    renderer.render(scene)
    blurred = renderer.render_blurred(at, SHUTTER, motion_samples=3)
    results = [renderer.render(at(frames)) for frames in moments_of(SHUTTER, 3)]
    assert not {"map", "bricks"} & blurred.stats.made.keys()
    assert np.abs(blurred.image - mean(results)).max() < BLURRED
    assert np.abs(blurred.aovs["transmittance"] - mean(results, "transmittance")).max() < BLURRED
    assert np.array_equal(blurred.aovs["depth"], results[1].aovs["depth"])
    assert blurred.aovs["samples"] == pytest.approx(3 * mean(results, "samples"))
    assert blurred.warnings == ()


def test_an_even_number_of_moments_has_a_sharp_middle_too(renderer, scene):
    at = moving_camera(scene)
    blurred = renderer.render_blurred(at, (0.0, 1.0), motion_samples=2)
    results = [renderer.render(at(frames)) for frames in (0.25, 0.5, 0.75)]
    assert np.abs(blurred.image - mean([results[0], results[2]])).max() < BLURRED
    assert np.array_equal(blurred.aovs["depth"], results[1].aovs["depth"])
    assert blurred.scene.camera == at(0.5).camera


def test_a_volume_that_flows_is_that_volume_elsewhere(renderer, scene, flowing):
    """By whole voxels, which no interpolation softens."""
    blurred = renderer.render_blurred(flowing, (-1.5, 1.5), motion_samples=3, method="dual")
    expected = mean([renderer.render(moved(scene, frames * STEP), method="dual") for frames in (-1, 0, 1)])
    assert np.abs(blurred.image - expected).max() < MOVED_STEPS * expected.max()
    sharp = renderer.render(scene, method="dual").image
    assert np.abs(blurred.image - sharp).max() > 100 * MOVED_STEPS * expected.max()


def test_velocities_turn_with_their_volume(renderer, scene, flowing):
    quarter = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    shifted = np.eye(4)
    shifted[1, 3] = STEP  # what was along x is along y
    turned = flowing.volume.transformed(quarter)
    flowing, still = flowing.replace(volume=turned), scene.volume.transformed(shifted @ quarter)
    later = renderer.render_blurred(flowing, (1.0, 1.0), motion_samples=1, method="dual").image
    expected = renderer.render(scene.replace(volume=still), method="dual").image
    assert np.abs(later - expected).max() < MOVED_STEPS * expected.max()


def test_a_background_shows_as_in_each_picture(renderer, scene):
    at = moving_camera(scene)
    background = (0.2, 0.5, 1.0)
    blurred = renderer.render_blurred(at, SHUTTER, motion_samples=3, background=background)
    results = [renderer.render(at(frames), background=background) for frames in moments_of(SHUTTER, 3)]
    assert np.abs(blurred.image - mean(results)).max() < BLURRED
    bare = renderer.render_blurred(at, SHUTTER, motion_samples=3)
    assert np.abs(bare.over(background).image - blurred.image).max() < BLURRED
    assert np.abs(blurred.picture(transparent=True) - bare.image).max() < BLURRED


@pytest.mark.slow
def test_points_move_by_their_velocities(renderer, scene):
    positions, velocity = np.array([[0.0, 0, 0], [0.6, 0.3, 0]]), np.array([[24.0, 0, 0], [0, -12.0, 0]])
    points = tfm.Points(positions, 0.4, 3.0, velocity=velocity).with_velocity(scale=0.5)
    blurred = renderer.render_blurred(scene.replace(volume=points), SHUTTER, motion_samples=3)
    places = [positions + velocity / 48 * frames for frames in moments_of(SHUTTER, 3)]
    results = [renderer.render(scene.replace(volume=tfm.Points(some, 0.4, 3.0))) for some in places]
    assert np.abs(blurred.image - mean(results)).max() < BLURRED
    assert not np.allclose(results[0].image, results[2].image)


@pytest.mark.slow
def test_a_flame_moves_with_its_smoke(renderer, scene, tmp_path):
    data, heat = blobs(), np.roll(blobs(seed=11), 2, axis=1)
    velocity = np.broadcast_to(np.float32((24 * STEP, 0, 0)), (*data.shape, 3))
    np.savez(tmp_path / "fire.npz", density=data, heat=heat, vel=velocity, voxel_size=0.15)
    volume = tfm.Volume.load(tmp_path / "fire.npz", density_scale=4.0)
    medium = scene.medium.replace(temperature="heat", temperature_scale=2000, Le_scale=3)
    fire = scene.replace(volume=volume, medium=medium)
    result = renderer.render_blurred(fire, (1.0, 1.0), motion_samples=1, method="dual")
    expected = renderer.render(moved(fire, STEP), method="dual")
    assert expected.aovs["emission"].max() > 0.2
    for name in ("emission", "transmittance"):
        change = np.abs(result.aovs[name] - expected.aovs[name]).max()
        assert change < MOVED_STEPS * expected.aovs[name].max()


@pytest.mark.slow
def test_nine_moments_are_near_the_mean_of_64(renderer, flowing):
    blurred = renderer.render_blurred(flowing, SHUTTER)
    many = renderer.render_blurred(flowing, SHUTTER, motion_samples=64)
    sharp = renderer.render(flowing).image
    error = np.sqrt(np.mean((blurred.image - many.image) ** 2))
    assert error < 0.02 * np.sqrt(np.mean((sharp - many.image) ** 2))


def test_a_shutter_that_closes_before_it_opens_is_refused(renderer, scene):
    with pytest.raises(SceneError, match=r"shutter = .*should be two numbers \[open, close\] of frames"):
        renderer.render_blurred(scene, (0.5, 0.0))
    with pytest.raises(SceneError, match="motion_samples"):
        renderer.render_blurred(scene, motion_samples=0)


def test_moments_of_other_sizes_are_refused(renderer, scene):
    small = scene.replace(camera=scene.camera.replace(res=(8, 4)))
    with pytest.raises(SceneError, match=r"the picture is .* half-way and 8×4 at another moment"):
        renderer.render_blurred(lambda frames: small if frames else scene, motion_samples=3)


def test_moments_with_other_layers_are_refused(renderer, scene):
    result = renderer.render(scene)
    mean = motion._Mean(result)
    with pytest.raises(SceneError, match=r"a layer light\.b at some moments only; keep the names of lights"):
        mean.add(replace(result, aovs={**result.aovs, "light.b": result.image}))
