"""Cameras as other programs tell them: by a lens and a matrix."""

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError

PLACE = {"from_": (1, 2, 3), "to": (0, 0.5, 0)}
ROUNDED = 1e-12
"""Of float64, after an angle and its tangent."""
FOUR_DIGITS = 2e-4
"""Of directions, where a matrix was printed with four digits after the point."""


def pasted(camera):
    """The matrix that Blender, Maya, USD or glTF has of a camera: z to the back."""
    return camera.world_from_camera @ np.diag([1.0, 1, -1, 1])


@pytest.mark.parametrize("res", [(320, 180), (90, 160)])
def test_a_lens_is_as_wide_as_the_sensor(res):
    camera = tfm.Camera(**PLACE, focal_length=35, sensor_width=24, res=res)
    _, directions = camera.rays()
    local = (directions @ camera.world_from_camera[:3, :3]).reshape(*res[::-1], 3)
    slopes = local[0, :, 0] / local[0, :, 2]
    # From the middle of the first pixel to that of the last.
    assert slopes[-1] - slopes[0] == pytest.approx(24 / 35 * (1 - 1 / res[0]), rel=ROUNDED)
    assert camera.ndc_from_camera[0, 0] == pytest.approx(2 * 35 / 24, rel=ROUNDED)
    assert camera.replace(res=(100, 100)).ndc_from_camera[0, 0] == pytest.approx(2 * 35 / 24, rel=ROUNDED)


def test_a_full_frame_of_50_mm():
    camera = tfm.Camera(**PLACE, focal_length=50, res=(1500, 1000))
    assert camera.sensor_width == 36
    assert camera.fov == pytest.approx(26.99, abs=0.005)  # as tables of lenses have it, of 24 mm


def test_a_matrix_is_where_it_was_pasted_from():
    camera = tfm.Camera(**PLACE)
    matrix = pasted(camera)
    same = tfm.Camera(matrix=matrix)
    np.testing.assert_allclose(same.world_from_camera, camera.world_from_camera, atol=ROUNDED)
    assert same.from_ == camera.from_
    printed = tfm.Camera(matrix=np.round(matrix, 4).ravel().tolist()).world_from_camera
    np.testing.assert_allclose(printed, camera.world_from_camera, atol=FOUR_DIGITS)
    np.testing.assert_allclose(printed[:3, :3].T @ printed[:3, :3], np.eye(3), atol=ROUNDED)
    at_rest = tfm.Camera(matrix=np.eye(4))
    assert (at_rest.from_, at_rest.to, at_rest.up) == ((0, 0, 0), (0, 0, -1), (0, 1, 0))


def test_a_matrix_far_away_keeps_its_direction():
    matrix = pasted(tfm.Camera(**PLACE))
    far = matrix.copy()
    far[:3, 3] = 1e12, -1e12, 1e12
    there, here = (tfm.Camera(matrix=each).world_from_camera[:3, :3] for each in (far, matrix))
    np.testing.assert_array_equal(there, here)


@pytest.mark.parametrize(
    "camera",
    [
        tfm.Camera(**PLACE, fov=30),
        tfm.Camera(**PLACE, focal_length=35),
        tfm.Camera(matrix=pasted(tfm.Camera(**PLACE)), focal_length=50, sensor_width=23.5, res=(7, 5)),
    ],
    ids=["fov", "lens", "matrix"],
)
def test_a_table_says_it_once_and_makes_it_again(camera):
    table = camera.to_dict()
    assert (table["fov"] is None) is (table["focal_length"] is not None)
    assert (table["from"] is None) is (table["matrix"] is not None)
    for same in (table, {key: value for key, value in table.items() if value is not None}):
        assert tfm.Camera.from_table(same) == camera
    assert camera.replace(res=(9, 9)).to_dict() == table | {"res": [9, 9]}


def test_replace_gives_up_what_said_it_before():
    camera = tfm.Camera(matrix=np.eye(4), focal_length=35, sensor_width=24)
    assert camera.replace(fov=30).to_dict()["focal_length"] is None
    moved = camera.replace(**PLACE)
    assert (moved.from_, moved.matrix, moved.focal_length) == ((1, 2, 3), None, 35)
    assert moved.replace(matrix=np.eye(4)) == camera


SHEARED = np.eye(4)
SHEARED[0, 1] = 0.1
SHEARED[:3, 1] /= np.linalg.norm(SHEARED[:3, 1])
MOVED = np.eye(4)
MOVED[:3, 3] = 1, 2, 3


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({**PLACE, "fov": 40, "focal_length": 35}, r"camera\.fov and camera\.focal_length both .*; keep one"),
        ({**PLACE, "fov": 40, "sensor_width": 36}, r"camera\.fov and camera\.sensor_width both "),
        ({**PLACE, "sensor_width": 36}, r"camera\.sensor_width needs camera\.focal_length"),
        ({**PLACE, "focal_length": 0}, r"camera\.focal_length = 0: should be greater than 0"),
        ({**PLACE, "focal_length": 1e-300}, r"camera\.focal_length = 1e-300: .* 180 degrees"),
        ({**PLACE, "focal_length": 1e300, "sensor_width": 1e-300}, r"camera\.focal_length = .* is 0 degrees"),
        ({**PLACE, "matrix": np.eye(4)}, r"camera\.from and camera\.matrix both .*; keep one"),
        ({"up": (0, 0, 1), "matrix": np.eye(4)}, r"camera\.up and camera\.matrix both "),
        ({"matrix": 2 * MOVED}, r"camera\.matrix = .*: should be affine"),
        ({"matrix": MOVED.T}, r"camera\.matrix = .*; transpose it"),
        ({"matrix": np.diag([2, 2, 2, 1.0])}, r"camera\.matrix = .* has no scale: .* lengths 2, 2, 2$"),
        ({"matrix": np.diag([-1, 1, 1, 1.0])}, r"camera\.matrix = .*: it mirrors"),
        ({"matrix": SHEARED}, r"camera\.matrix = .* right angles"),
        ({"matrix": [1, 2, 3]}, r"camera\.matrix = .*should be 16 numbers"),
        ({"fov": 30}, r"camera\.from is missing"),
    ],
)
def test_what_is_no_camera_is_one_line(keys, message):
    with pytest.raises(SceneError, match=f"^{message}") as raised:
        tfm.Camera(**keys)
    assert "\n" not in raised.value.args[0]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("haze", "seen"), [(None, 1), (5e-324, 0), (1e-42, 0), (2.0, np.exp(-1)), (1e300, 1)]
)
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_any_haze_leaves_a_part(haze, seen, kind):
    found = tfm.Camera(**PLACE, haze=haze).seen_of(np.array([2.0], kind))
    assert found.dtype == kind
    assert found == pytest.approx(seen, rel=1e-6)  # float32
