"""Where lights are smooth: no edge, source or texture of theirs in a box, or near it."""

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.scene.lights import parse_light
from tfm_cl.scene.lights.placed import NEAR

BOX = np.array([[-1.0, -2.0, -0.5], [3.0, 1.0, 2.0]])
DIAGONAL = float(np.linalg.norm(BOX[1] - BOX[0]))
MIDDLE = BOX.mean(axis=0)


def spot(away=8.0, cone=30.0, **changes):
    """Above the middle, looking at it."""
    return tfm.SpotLight(from_=np.add(MIDDLE, (0, away, 0)), to=MIDDLE, cone=cone, **changes)


def slope_to_corners(away):
    """The largest tangent of the angle from the axis of `spot` to a corner: an upper one."""
    half = (BOX[1] - BOX[0]) / 2
    return np.hypot(half[0], half[2]) / (away - half[1])


def test_suns_and_skies_are_smooth_everywhere(tmp_path):
    assert tfm.SunLight(from_=MIDDLE, to=(9, 9, 9)).is_smooth_in(BOX)
    assert all(part.is_smooth_in(BOX) for part in tfm.EnvironmentLight(samples=9).parts())
    # The points of an image's sky are suns of its colours.
    np.save(tmp_path / "sky.npy", np.random.default_rng(2).random((8, 16, 3)).astype(np.float32))
    sky = tfm.EnvironmentLight(samples=9, texture=str(tmp_path / "sky.npy"))
    assert all(part.is_smooth_in(BOX) for part in sky.parts())


def test_a_cone_around_the_box_is_smooth_in_it():
    just = np.degrees(np.arctan(slope_to_corners(8)))

    assert spot(cone=just + 0.01).is_smooth_in(BOX)
    assert not spot(cone=just - 0.01).is_smooth_in(BOX)
    assert not spot(cone=just + 30).replace(to=np.add(MIDDLE, (99, 8, 0))).is_smooth_in(BOX)
    assert not spot(cone=89.9).replace(to=np.add(MIDDLE, (0, 99, 0))).is_smooth_in(BOX)  # it looks away
    assert spot().fitted(BOX).is_smooth_in(BOX)


def test_a_soft_edge_begins_within_the_cone():
    just = np.degrees(np.arctan(slope_to_corners(8)))

    assert spot(cone=2 * just + 0.01, blend=0.5).is_smooth_in(BOX)
    assert not spot(cone=2 * just - 0.01, blend=0.5).is_smooth_in(BOX)
    assert not spot(cone=80, blend=1.0).is_smooth_in(BOX)


@pytest.mark.parametrize("kind", ["spot", "point"])
def test_reach_and_textures_are_edges(kind, tmp_path):
    light = spot() if kind == "spot" else tfm.PointLight(from_=np.add(MIDDLE, (0, 8, 0)))
    np.save(tmp_path / "image.npy", np.ones((2, 2, 3), np.float32))

    assert light.is_smooth_in(BOX)
    assert not light.replace(reach=100.0).is_smooth_in(BOX)
    if kind == "spot":
        assert not light.replace(texture=str(tmp_path / "image.npy")).is_smooth_in(BOX)


@pytest.mark.parametrize("direction", [(0, 1, 0), (1, 0, 0), (-1, 1, 1)])
def test_a_source_in_the_box_or_near_it_is_none(direction):
    beside = np.where(np.array(direction) > 0, BOX[1], np.where(np.array(direction) < 0, BOX[0], MIDDLE))
    unit = np.array(direction) / np.linalg.norm(direction)
    for part, expected in ((0.0, False), (0.99, False), (1.01, True), (50, True)):
        light = tfm.PointLight(from_=beside + part * NEAR * DIAGONAL * unit)
        assert light.is_smooth_in(BOX) == expected
        assert light.nearest(BOX) == pytest.approx(part * NEAR * DIAGONAL)
    assert not tfm.PointLight(from_=MIDDLE).is_smooth_in(BOX)
    assert tfm.PointLight(from_=MIDDLE).nearest(BOX) == 0


def test_parallel_light_is_infinitely_far_away():
    assert parse_light({"type": "sun", "from": (1, 2, 3), "to": (0, 0, 0)}).nearest(BOX) == np.inf
