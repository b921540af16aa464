"""A shot: what each of its frames is of."""

import numpy as np
import pytest

from tfm_cl.errors import SceneError
from tfm_cl.sequence.shot import Shot
from tfm_cl.sequence.turntable import angle_of

SCENE = """
[volume]
shape = "sphere"
[camera]
from = [1, 2, 9]
to = [0, 0, 0]
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def test_a_turn_begins_at_frame_1_and_ends_where_it_begins():
    assert [angle_of(frame, 4) for frame in (1, 2, 2.5, 4, 5, 0)] == [0, 90, 135, 270, 0, 270]


def test_a_turntable_goes_once_around(scene):
    shot = Shot(scene, turntable=4)
    views = [shot.scene(frame).camera.from_ for frame in (1, 2, 3, 5)]

    assert views[0] == views[3] == (1, 2, 9)
    assert views[1] == pytest.approx((9, 2, -1))
    assert views[2] == pytest.approx((-1, 2, -9))


def test_the_light_that_is_placed_stays_where_it_is(scene):
    shot = Shot(scene, turntable=4)

    assert shot.scene(3).lights == shot.scene(1).lights


def test_what_changes_is_known(scene):
    assert Shot(scene, turntable=4).scene_file(1).is_animated
    assert not Shot(scene).scene_file(1).is_animated


def test_a_camera_of_a_matrix_is_not_turned(scene):
    shot = Shot(scene, [("camera.matrix", [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 9, 0, 0, 0, 1])], turntable=4)

    with pytest.raises(SceneError, match=r"camera.matrix: is not turned"):
        shot.scene(2)


def test_a_turn_has_frames(scene):
    with pytest.raises(SceneError, match="turntable = 0: should be a number of frames from 1"):
        Shot(scene, turntable=0)


@pytest.mark.parametrize("turn", [2.5, "4", float("nan"), 10**30])
def test_a_turn_has_whole_frames(scene, turn):
    with pytest.raises(SceneError, match=r"turntable = .*: should be a number of frames from 1"):
        Shot(scene, turntable=turn)


@pytest.mark.parametrize("frame", ["1", float("nan"), float("inf"), 10**400, True, [1]])
def test_a_frame_is_a_number(scene, frame):
    with pytest.raises(SceneError, match=r"frame = .*: should be a number up to 1,000,000,000"):
        Shot(scene).scene_file(frame)


def test_a_frame_may_be_a_number_of_numpy(scene):
    fov = [{"frame": 1, "value": 20}, {"frame": 3, "value": 30}]
    assert Shot(scene, [("camera.fov", fov)]).scene(np.float32(2)).camera.fov == 25


@pytest.mark.parametrize("pairs", [5, "camera.fov", [("camera.fov",)], [(1, 2)], {"camera.fov": 30}])
def test_overrides_are_pairs(scene, pairs):
    with pytest.raises(SceneError, match="overrides: should be pairs of a dotted key and a value"):
        Shot(scene, pairs)
