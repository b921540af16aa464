"""Values that change from frame to frame."""

import math

import numpy as np
import pytest

from tfm_cl.errors import SceneError
from tfm_cl.scene.keyframes import at_frame

ROUNDING = 1e-12
"""Of sums of a few products of numbers near 1, in float64."""


def value(keyframes, frame):
    return at_frame({"camera": {"fov": keyframes}}, frame)["camera"]["fov"]


def keys(*pairs, **more):
    return [{"frame": frame, "value": value, **more} for frame, value in pairs]


@pytest.mark.parametrize(
    ("frame", "expected"), [(-9, 20), (1, 20), (3, 25.0), (5, 30), (5.5, 31.25), (9, 40), (99, 40)]
)
def test_numbers_lie_on_lines(frame, expected):
    assert value(keys((1, 20), (9, 40)), frame) == expected


def test_whole_numbers_stay_whole_where_they_are():
    assert value(keys((1, 2), (3, 6)), 2) == 4
    assert isinstance(value(keys((1, 2), (3, 6)), 2), int)
    assert value(keys((1, 2), (3, 5)), 2) == 3.5
    assert isinstance(value(keys((1, 2.0), (3, 6)), 2), float)


def test_vectors_go_number_by_number():
    assert value(keys((0, [0, 1, 2]), (4, [4, 1, -2])), 1) == [1, 1, 1]
    assert value(keys((0, [[1, 0], [0, 1]]), (2, [[3, 0], [0, 3]])), 1) == [[2, 0], [0, 2]]


@pytest.mark.parametrize(("one", "other"), [("a", "b"), (True, False), ({"type": "hg"}, {"type": "mie"})])
def test_all_else_keeps_the_value_of_the_key_before(one, other):
    found = [value(keys((1, one), (5, other)), frame) for frame in (0, 1, 4.9, 5, 6)]

    assert found == [one, one, one, other, other]


def test_a_step_keeps_the_value_of_the_key_before():
    found = [value(keys((1, 2.0), (5, 4.0), interpolation="step"), frame) for frame in (1, 4.9, 5)]

    assert found == [2, 2, 4]


def test_each_key_says_how_it_goes_on():
    keyframes = keys((0, 0.0), (2, 2.0), (4, 0.0))
    keyframes[1]["interpolation"] = "step"

    assert [value(keyframes, frame) for frame in (1, 2, 3, 4)] == [1, 2, 2, 0]


def smooth(frame):
    return value(keys((0, 0.0), (2, 1.0), (3, 5.0), (7, 5.0), (9, 2.0), interpolation="smooth"), frame)


def test_a_smooth_curve_goes_through_its_keys_without_overshoot():
    for frame, expected in ((0, 0), (2, 1), (3, 5), (7, 5), (9, 2)):
        assert smooth(frame) == expected
    steps = [smooth(i / 50) for i in range(451)]
    for begin, end, sign in ((0, 150, 1), (150, 350, 0), (350, 450, -1)):
        differences = [steps[i + 1] - steps[i] for i in range(begin, end)]
        assert all(sign * difference >= 0 if sign else difference == 0 for difference in differences)


def test_a_smooth_curve_is_flat_at_ends_and_extremes_and_has_no_corners():
    close = 1e-6
    for frame in (0, 3, 7, 9):
        for side in (-close, close):
            assert abs(smooth(frame + side) - smooth(frame)) < 1e-9
    left, right = smooth(2) - smooth(2 - close), smooth(2 + close) - smooth(2)
    assert left == pytest.approx(right, rel=1e-4)  # both are the slope there, but for the curvature
    assert left > 0


def test_the_order_of_the_keys_does_not_matter():
    assert value(keys((9, 40), (1, 20)), 5) == 30


def test_one_key_is_a_constant():
    assert value(keys((5, 3)), 1) == value(keys((5, 3)), 9) == 3


def test_everything_else_stays_as_it_is():
    values = {"light": [{"type": "sun"}, {"intensity": keys((0, 1), (2, 3))}], "map": {"res": 64}, "a": []}

    assert at_frame(values, 1) == {"light": [{"type": "sun"}, {"intensity": 2}], "map": {"res": 64}, "a": []}
    assert values["light"][1]["intensity"] == keys((0, 1), (2, 3))


@pytest.mark.parametrize(
    ("keyframes", "said"),
    [
        ([{"value": 1}], "camera.fov: keyframe 1 has no frame"),
        ([{"frame": 1, "value": 1}, {"frame": 2}], "camera.fov: keyframe 2 has no value"),
        (keys((1, 2), (1, 3)), "camera.fov: two keyframes at frame 1"),
        (keys((1, 2), (3, [1, 2])), "camera.fov: keyframe 2 is 2 numbers, keyframe 1 a number"),
        (keys((1, [1, 2]), (3, [1, 2, 3])), "keyframe 2 is 3 numbers, keyframe 1 2 numbers"),
        (keys((1, 1), (3, "auto")), "keyframe 2 is a text, keyframe 1 a number"),
        (keys((1, 1), (3, True)), "keyframe 2 is true or false"),
        (
            keys((1, 1), interpolation="cubic"),
            "interpolation = 'cubic', which should be one of linear, smooth, step",
        ),
        (keys((1, 1), interpolation=["linear"]), "interpolation = …"),
        (keys((1, math.nan)), "keyframe 1 has a value that is not finite"),
        (keys((1, [0.0, math.inf])), "keyframe 1 has a value that is not finite"),
        (keys((1, 10**400)), "keyframe 1 has a value that is not finite"),
        (keys((math.nan, 1)), "keyframe 1 has frame = nan"),
        (keys((10**400, 1)), "keyframe 1 has frame = 1000"),
        (keys(("1", 1)), "keyframe 1 has frame = '1'"),
        (keys((True, 1)), "keyframe 1 has frame = True"),
        (keys((1, 1), ease=1), "keyframe 1 has an unknown key 'ease'; known: frame, value, interpolation"),
        ([{"frame": 1, "value": 1}, {}], "keyframe 2 has no frame"),
        ({"frame": 1, "value": 1}, "camera.fov: keyframes are a list, even of one"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(keyframes, said):
    with pytest.raises(SceneError) as error:
        value(keyframes, 1)

    assert said in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 200


def test_faults_know_their_keys():
    with pytest.raises(SceneError) as error:
        at_frame({"light": [{}, {"intensity": [{"frame": 1, "value": 1}, {"frame": 2}]}]}, 1)

    assert error.value.faults[0].key == ("light", 1, "intensity", 1)


def test_thousands_of_keys_and_deep_files_are_read():
    many = keys(*((frame, frame % 7) for frame in range(20_000)))
    deep = {"frame": 1, "value": 1}
    for _ in range(5000):
        deep = [deep]

    assert value(many, 10_000.5) == (10_000 % 7 + 10_001 % 7) / 2
    assert at_frame({"camera": {"from": deep}}, 1)["camera"]["from"]


def turned(degrees, *, axis=2, shift=(0, 0, 0), scale=1.0):
    matrix = np.eye(4)
    one, other = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    matrix[[one, other], [one, other]] = cosine
    matrix[other, one], matrix[one, other] = sine, -sine
    matrix[:3, :3] *= scale
    matrix[:3, 3] = shift
    return matrix


def matrix_at(frame, *matrices, key="matrix", **more):
    keyframes = [{"frame": 2 * i, "value": matrix.tolist(), **more} for i, matrix in enumerate(matrices)]
    return np.array(at_frame({"camera": {key: keyframes}}, frame)["camera"][key])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_matrices_turn_the_shorter_way_and_keep_their_size(axis):
    found = matrix_at(1, turned(170, axis=axis, shift=(1, 2, 3)), turned(-150, axis=axis, shift=(3, 2, 1)))

    assert found == pytest.approx(turned(190, axis=axis, shift=(2, 2, 2)), abs=ROUNDING)


def test_half_turns_mirrors_and_scales_go_from_one_to_the_other():
    mirrored = turned(40, scale=3) @ np.diag([1, -1, 1, 1])

    assert np.linalg.det(matrix_at(1, turned(0), turned(180))[:3, :3]) == pytest.approx(1)
    assert matrix_at(1, turned(0, scale=2), turned(40, scale=4), key="transform") == pytest.approx(
        turned(20, scale=3), abs=ROUNDING
    )
    halfway = matrix_at(1, np.diag([1.0, -1, 1, 1]), mirrored)
    assert np.linalg.svd(halfway[:3, :3])[1] == pytest.approx([2, 2, 2])
    assert np.linalg.det(halfway[:3, :3]) == pytest.approx(-8)


def test_a_smooth_turn_has_no_corners():
    matrices = [turned(degrees) for degrees in (0, 30, 90, 100)]
    close = 1e-5

    def angle(frame):
        found = matrix_at(frame, *matrices, interpolation="smooth")
        return math.degrees(math.atan2(found[1, 0], found[0, 0]))

    assert angle(2) == pytest.approx(30)
    assert (angle(2) - angle(2 - close)) / (angle(2 + close) - angle(2)) == pytest.approx(1, rel=1e-3)
    assert abs(angle(close)) < 1e-7


def test_matrices_that_are_none_stay_numbers():
    projective = np.ones((4, 4))

    assert matrix_at(1, np.eye(4), projective).tolist() == ((np.eye(4) + 1) / 2).tolist()
    assert np.array(
        at_frame({"a": {"matrix": keys((0, [1, 2]), (2, [3, 4]))}}, 1)["a"]["matrix"]
    ).tolist() == [2, 3]
