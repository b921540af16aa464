"""What media emit as lights: all of its energy, from where it comes from."""

import itertools

import numpy as np
import pytest
from scenes import blobs, turned
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.scene.emission_lights import EmissionLight, emission_lights_of

EMISSION = (3.0, 2.0, 0.5)
PLACE = turned(25, (1, 2, 0.5), (0.15, 0.2, 0.14), (-1.1, -1.0, -0.9))
BALL = 0.04
"""Relative, of a ball's falloff as a polynomial: at the surface, where the closed form is steepest."""
SUMMED = 1e-6
"""Relative, of float32 voxels summed in another order."""

STEADY = 0.008
"""RMS of how far light is from halfway between the frames before and after, of its mean: of all voxels it is
0.1 %, and of the best clusters of each frame 1.5 and 4.5 %, since they jump."""


def medium(count, **changes):
    return tfm.Medium(**{"emission": EMISSION, "emission_lights": count, **changes})


def lights_of(body, of):
    return emission_lights_of(body, of, None)


def fluence(lights, points):
    """RGB [n, 3] of all lights at points, whatever direction it comes from."""
    total = np.zeros((len(points), 3))
    for light in lights:
        total += light.arrival(points).strength[:, None] * light.intensity
    return total


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize("count", [1, 7, 1024])
def test_no_energy_is_lost(coloured, count):
    colour = np.stack([blobs(seed=seed) for seed in (1, 2, 3)], axis=-1) if coloured else None
    volume = tfm.Volume(blobs(), colour=colour, world_from_index=PLACE, density_scale=4.0)
    lights = lights_of(volume, medium(count))
    assert 0 < len(lights) <= count
    voxels = blobs()[..., None] * (np.ones(3) if colour is None else colour.astype(float))
    expected = 4.0 * np.linalg.det(PLACE[:3, :3]) * voxels.sum(axis=(0, 1, 2), dtype=float) * EMISSION
    total = np.sum([light.intensity for light in lights], axis=0)
    assert np.abs(total / expected - 1).max() < SUMMED
    # And it comes from where it came from.
    z, y, x = np.indices(blobs().shape)
    power = (voxels * EMISSION).sum(axis=-1)
    middle = PLACE @ [*((power * axis).sum() / power.sum() for axis in (x, y, z)), 1]
    found = np.average(
        [light.from_ for light in lights], axis=0, weights=[sum(light.intensity) for light in lights]
    )
    assert np.abs(found - middle[:3]).max() < SUMMED


def test_leaves_and_many_voxels_lose_none(monkeypatch):
    monkeypatch.setattr("tfm_cl.scene.emission_lights.MOST_CELLS", 50)
    dense = tfm.Volume(np.pad(blobs(), 9), world_from_index=PLACE)
    sparse = tfm.Volume(dense.leaves, world_from_index=PLACE)
    ((one,), (other,)) = (lights_of(volume, medium(1)) for volume in (dense, sparse))
    assert one == other
    monkeypatch.undo()
    (fine,) = lights_of(tfm.Volume(dense.data, world_from_index=PLACE), medium(1))
    assert np.abs(np.subtract(one.from_, fine.from_)).max() < SUMMED
    assert np.abs(np.divide(one.intensity, fine.intensity) - 1).max() < SUMMED
    # Cubes of voxels count as full, which is a little more than they are.
    assert fine.core < one.core < 1.2 * fine.core


@pytest.mark.parametrize(
    "body",
    [
        tfm.BoxVolume(from_=(0, 0, 0), to=(1, 2, 3), density=0.7),
        tfm.BoxVolume(from_=(0, 0, 0), to=(1e-9, 2e9, 3), density=0.7),
        tfm.SphereVolume(radius=1.5, density=0.7),
    ],
    ids=["box", "sheet", "ball"],
)
def test_a_body_of_constant_density_is_its_volume(body):
    lights = lights_of(body, medium(16))
    content = 6 if body.shape == "box" else 4 / 3 * np.pi * 1.5**3
    assert len(lights) == 16
    total = np.sum([light.intensity for light in lights], axis=0)
    assert np.abs(total / (0.7 * content * np.array(EMISSION)) - 1).max() < ROUNDED


def test_one_light_is_the_ball_that_it_stands_for():
    """Inside and outside, the closed form of a ball that emits evenly (`Light.falloff_at`)."""
    (light,) = lights_of(tfm.SphereVolume(radius=0.5), medium(1))
    assert abs(light.core / 0.5 - 1) < 0.01
    ball = EmissionLight(from_=(0, 0, 0), core_radius=0.5)
    x = np.array([1e-6, 0.2, 0.5, 0.8, 0.95, 1.05, 1.3, 2, 5, 50])
    exact = 1.5 * (1 + (1 - x**2) / (2 * x) * np.log(np.abs((1 + x) / (1 - x)))) / 0.5**2
    found = ball.arrival(0.5 * x[:, None] * [0, 0, 1]).strength
    assert np.abs(found / exact - 1).max() < BALL


def test_more_lights_come_nearer_to_all_voxels(rng):
    """What arrives around and inside, against the sum over all voxels, each a light."""
    volume = tfm.Volume(blobs(), world_from_index=PLACE)
    points = (rng.uniform(-3, 18, (400, 3)) @ PLACE[:3, :3].T) + PLACE[:3, 3]
    every = lights_of(volume, medium(1024))
    assert len(every) == 1024
    z, y, x = np.nonzero(blobs())
    voxels = np.column_stack([x, y, z]) @ PLACE[:3, :3].T + PLACE[:3, 3]
    away = np.linalg.norm(points[:, None] - voxels, axis=-1)
    # Each a ball of the spread of trilinear interpolation.
    ball = EmissionLight(from_=(0, 0, 0), core_radius=np.sqrt(5 / 3 * (PLACE[:3, :3] ** 2).sum() / 6))
    falloff = ball.falloff_at(away.reshape(-1), 0.0).reshape(away.shape)
    exact = falloff @ blobs()[z, y, x] * np.linalg.det(PLACE[:3, :3])
    errors = []
    for count in (1, 8, 64, 512):
        found = fluence(lights_of(volume, medium(count)), points)[:, 0] / EMISSION[0]
        errors.append(np.sqrt(np.mean((found / exact - 1) ** 2)))
    assert errors[0] < 0.5
    assert errors[2] < 0.01
    assert errors[-1] < 0.006
    assert all(fine < 0.7 * coarse for coarse, fine in itertools.pairwise(errors))


@pytest.mark.parametrize("count", [8, 32])
def test_light_is_as_steady_as_what_glows(rng, count):
    """Heaps that pass through the voxels, and grow and shrink, but no volume that moves as a whole."""
    z, y, x = np.indices((20, 24, 20))
    starts, speeds = rng.uniform(6, 14, (9, 3)), rng.normal(size=(9, 3)) / 16
    sizes = rng.uniform(1, 3, (9, 2))
    points = rng.uniform(2, 18, (300, 3))

    def light(frame):
        glow = np.zeros(z.shape)
        for start, speed, (size, grows) in zip(starts, speeds, sizes, strict=True):
            at = start + frame * speed
            squares = (x - at[0]) ** 2 + (y - at[1]) ** 2 + (z - at[2]) ** 2
            glow += np.maximum(1 - squares / (2 + size + 0.02 * frame * grows) ** 2, 0) ** 2
        return fluence(lights_of(tfm.Volume(glow, world_from_index=np.eye(4)), medium(count)), points)

    frames = np.array([light(frame) for frame in range(6)])
    jumps = frames[1:-1] - (frames[:-2] + frames[2:]) / 2
    assert np.sqrt((jumps**2).mean()) < STEADY * frames.mean()


def test_the_same_are_found_again_elsewhere():
    volume = tfm.Volume(blobs(), world_from_index=PLACE)
    first = lights_of(volume, medium(8))
    assert lights_of(volume, medium(8)) is first
    move = np.eye(4)
    move[:3, 3] = 5, 0, 0
    moved = lights_of(volume.transformed(move), medium(8))
    for one, other in zip(first, moved, strict=True):
        assert np.abs(np.subtract(other.from_, one.from_) - (5, 0, 0)).max() < SUMMED


@pytest.mark.parametrize("count", [-1, 1025, 1.5, True])
def test_how_many_is_a_number(count):
    with pytest.raises(SceneError, match=r"medium\.emission_lights"):
        medium(count)


def test_without_emission_they_are_refused():
    with pytest.raises(SceneError, match="does nothing where nothing is emitted"):
        medium(8, emission=0)


@pytest.mark.parametrize(
    ("body", "what"),
    [
        (tfm.EverywhereVolume(), "a medium everywhere"),
        (tfm.Points(np.zeros((1, 3)), 1.0), "points, curves or polygons"),
    ],
)
def test_what_lights_nothing_is_refused(body, what):
    camera = tfm.Camera(from_=(0, 0, 9), to=(0, 0, 0))
    with pytest.raises(SceneError) as error:
        tfm.Scene(body, medium(8, sigma_a=1.0), camera, [])
    assert str(error.value) == (
        f"medium.emission_lights = 8: the emission of {what} lights nothing; use volumes, boxes or spheres, "
        "or emission_lights = 0"
    )


def test_more_light_than_there_can_be_is_refused():
    with pytest.raises(SceneError, match=r"medium\.emission_lights = 2: a light of 2\.09e\+28 per steradian"):
        lights_of(tfm.SphereVolume(density=1e3), medium(2, emission=1e25))
