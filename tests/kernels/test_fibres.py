"""Scattering by strands: the device's functions against `KajiyaKay`, and the energy that leaves a strand."""

from pathlib import Path

import numpy as np
import pytest
from kernel_calls import Calls
from scipy import integrate
from tolerances import FLOAT32

import tfm_cl as tfm
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.device.structs.medium import medium_structs
from tfm_cl.scene.phases import KajiyaKay

PHASES = [
    KajiyaKay(specular=s, exponent=p)
    for s, p in [(0.0, 1.0), (0.3, 40.0), (0.7, 3.5), (1.0, 1.0), (1.0, 500)]
]
ANGLES = 10 * FLOAT32
"""Of sines squared and cosines: a dozen products of numbers below 1."""


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def moments(tangents, weights=1.0):
    """[..., 6] of unit vectors [..., 3], in the order of the device."""
    x, y, z = np.moveaxis(tangents, -1, 0)
    return weights * np.stack([x * x, y * y, z * z, x * y, x * z, y * z], axis=-1)


def call(launcher, sums, travel, to_camera):
    """Sine of the light, cosine of the mirror cone, and the value of each of `PHASES`."""
    media = [tfm.Medium(phase=phase) for phase in PHASES]
    calls = Calls(launcher, "fibre_functions.cl", arguments={"media": medium_structs(media)})
    ways = np.concatenate([sums, travel, to_camera], axis=-1)
    found = calls("call_fibres", ways, 2 + len(media), of_media=len(media))
    return found[:, 0], found[:, 1], found[:, 2:]


def random_ways(rng, count=2000):
    return unit(rng.normal(0, 1, (3, count, 3)))


@pytest.mark.lanes
def test_single_strands(launcher, rng):
    assert_single_strands(launcher, rng)


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [4, 8, 16])
def test_single_strands_in_lanes(device_name, rng, lanes):
    device = choose_device(device_name)
    if lanes not in Launcher(device).lanes_possible:
        pytest.skip("not on this device")
    assert_single_strands(Launcher(device, ("-Werror", "-I", str(Path(__file__).parent)), lanes=lanes), rng)


def assert_single_strands(launcher, rng):
    tangents, travel, to_camera = random_ways(rng)
    weights = 10 ** rng.uniform(-6, 6, (len(tangents), 1))
    light, cosine, values = call(launcher, moments(tangents, weights), travel, to_camera)
    along_light, along_view = (tangents * travel).sum(axis=-1), (tangents * to_camera).sum(axis=-1)
    sines = [np.sqrt(1 - along**2) for along in (along_light, along_view)]
    np.testing.assert_allclose(light**2, sines[0] ** 2, atol=ANGLES)
    # Of a sine, the rounding of its square over itself.
    worst = ANGLES * (1 + 1 / np.minimum(*sines))
    assert (np.abs(cosine - along_light * along_view - sines[0] * sines[1]) <= worst).all()
    for phase, found in zip(PHASES, values.T, strict=True):
        expected = phase.evaluate_strand(tangents, travel, to_camera)
        _, exponent, scale = phase.kernel_parameters()
        peak = 1 / np.pi**2 + phase.specular * scale * (1 + exponent)
        assert (np.abs(found - expected) <= worst * peak).all(), phase


@pytest.mark.lanes
def test_strands_in_all_directions(launcher, rng):
    """The same from everywhere, and of the light what all strands take on the mean."""
    _, travel, to_camera = random_ways(rng, 500)
    sums = np.tile([2.0, 2, 2, 0, 0, 0], (500, 1))
    light, cosine, _ = call(launcher, sums, travel, to_camera)
    np.testing.assert_allclose(light, np.pi / 4, rtol=1e-5)
    np.testing.assert_allclose(cosine, (travel * to_camera).sum(axis=-1) / 3 + 2 / 3, atol=ANGLES)


@pytest.mark.lanes
def test_where_no_strand_lies_it_is_isotropic(launcher, rng):
    _, travel, to_camera = random_ways(rng, 20)
    *_, values = call(launcher, np.zeros((20, 6)), travel, to_camera)
    np.testing.assert_allclose(values, 1 / (4 * np.pi), rtol=ANGLES)


# --- energy ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("specular", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("exponent", [1.0, 2.0, 7.5, 40.0, 1e3, 1e4])
def test_no_strand_sends_back_more_than_it_takes(specular, exponent):
    """Radiance times the width seen from each direction, over all of them: at most what the width takes."""
    phase = KajiyaKay(specular=specular, exponent=exponent)
    tangent = np.array([0.0, 0, 1])
    sent = []
    for angle in np.radians([1, 10, 30, 45, 60, 80, 90]):
        travel = np.array([np.sin(angle), 0, np.cos(angle)])

        def through_ring(view, travel=travel):
            to_camera = np.array([np.sin(view), 0, np.cos(view)])
            radiance = float(phase.evaluate_strand(tangent, travel, to_camera))
            # Of the ring of directions, and of the strand's width as seen from there.
            return radiance * 2 * np.pi * np.sin(view) * np.sin(view)

        energy, _ = integrate.quad(through_ring, 0, np.pi, points=[angle], limit=500)
        sent.append(energy / np.sin(angle))
    assert max(sent) <= 1 + 1e-6
    # Diffuse reflection gives back all, whatever the angle.
    assert min(sent) >= 1 - specular - 1e-6


def test_broadside_light_comes_back_whole_from_a_diffuse_strand():
    phase = KajiyaKay(specular=0.0)
    view = np.linspace(0, np.pi, 2001)
    to_camera = np.stack([np.sin(view), 0 * view, np.cos(view)], axis=-1)
    radiance = phase.evaluate_strand(np.array([0.0, 0, 1]), np.array([1.0, 0, 0]), to_camera)
    assert integrate.simpson(2 * np.pi * radiance * np.sin(view) ** 2, x=view) == pytest.approx(1, abs=1e-6)


@pytest.mark.lanes
def test_mixtures_of_strands_send_back_what_they_take_or_less(launcher, rng):
    """Second moments stand for them: the energy of diffuse reflection is kept to 3 % or better."""
    turn, height = np.pi * (1 + 5**0.5) * np.arange(2000), 1 - 2 * (np.arange(2000) + 0.5) / 2000
    ring = np.sqrt(1 - height**2)
    to_camera = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=-1)
    for count in (2, 2, 3, 3, 5, 20):
        tangents, (travel,) = unit(rng.normal(0, 1, (count, 3))), unit(rng.normal(0, 1, (1, 3)))
        sums = moments(tangents).sum(axis=0)
        *_, values = call(launcher, np.tile(sums, (2000, 1)), np.tile(travel, (2000, 1)), to_camera)
        seen = np.sqrt(1 - (to_camera @ tangents.T) ** 2).mean(axis=1, keepdims=True)
        taken = np.sqrt(1 - (tangents @ travel) ** 2).mean()
        sent = 4 * np.pi * (values * seen).mean(axis=0) / taken
        assert 0.97 < sent[0] < 1.03
        assert (sent[1:] < 1).all()
