"""What is moved in steps lies where the matrix of these steps puts it."""

import numpy as np
import pytest
from scenes import blobs
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.transform import IDENTITY

CORNER = (1.0, 2.0, 3.0)


def moved(point=CORNER, **steps):
    """Where a point of an object ends up."""
    return (np.array(tfm.SphereSolid(**steps).transform) @ [*point, 1])[:3]


def test_it_is_scaled_then_turned_then_shifted():
    found = moved(scale=(2, 3, 4), rotate=(0, 0, 90), translate=(10, 20, 30))
    assert found.tolist() == [10 - 6, 20 + 2, 30 + 12]  # a quarter turn is exact
    assert moved(scale=2).tolist() == [2, 4, 6]


def test_turns_are_about_x_then_y_then_z():
    """Blender's `Euler((30, 40, 50) degrees, "XYZ").to_matrix()`, Rz · Ry · Rx."""
    matrix = np.array(tfm.SphereSolid(rotate=(30, 40, 50)).transform)[:3, :3]
    sines, cosines = np.sin(np.radians((30, 40, 50))), np.cos(np.radians((30, 40, 50)))
    (a, b, c), (d, e, f) = sines, cosines
    expected = [
        [e * f, a * b * f - d * c, d * b * f + a * c],
        [e * c, a * b * c + d * f, d * b * c - a * f],
        [-b, a * e, d * e],
    ]
    np.testing.assert_allclose(matrix, expected, atol=ROUNDED)


def test_steps_are_kept_as_they_are_said():
    ball = tfm.SphereSolid(translate=(0, 1, 0), scale=2)
    assert {"translate", "scale", "rotate", "transform"} & ball.to_dict().keys() == {
        "translate",
        "rotate",
        "scale",
    }
    assert ball.replace(radius=3.0).transform == ball.transform
    assert ball.replace(rotate=(0, 90, 0)).translate == (0, 1, 0)
    by_matrix = ball.replace(transform=ball.transform)
    assert (by_matrix.transform, by_matrix.translate) == (ball.transform, (0, 0, 0))
    assert by_matrix.replace(scale=3).transform == tfm.SphereSolid(scale=3).transform
    assert tfm.SphereSolid().transform == IDENTITY


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"scale": 0}, "solid.scale = 0: should be at least 1e-15 along every axis: it makes all flat"),
        ({"rotate": 90}, "solid.rotate = 90: should be three numbers [x, y, z]"),
        ({"transform": IDENTITY, "scale": 2}, "solid: transform and scale both say where it is; keep one"),
    ],
)
def test_one_line_says_what_is_wrong(table, message):
    with pytest.raises(SceneError) as caught:
        tfm.SphereSolid(**table)
    assert str(caught.value) == message


def test_a_ground_is_not_moved():
    with pytest.raises(SceneError, match="a ground is not moved"):
        tfm.GroundSolid(translate=(0, 1, 0))


def test_volumes_are_moved_likewise(tmp_path):
    np.save(tmp_path / "cloud.npy", blobs())
    path = tmp_path / "scene.toml"
    steps = {"translate": (1.0, 2.0, 3.0), "rotate": (0.0, 0.0, 90.0), "scale": 2.0}
    path.write_text('[volume]\nfile = "cloud.npy"\n')
    still = tfm.Scene.load(path).volume
    path.write_text('[volume]\nfile = "cloud.npy"\ntranslate = [1, 2, 3]\nrotate = [0, 0, 90]\nscale = 2\n')
    volume = tfm.Scene.load(path).volume
    matrix = np.array(tfm.SphereSolid(**steps).transform)
    np.testing.assert_array_equal(volume.world_from_index, matrix @ still.world_from_index)

    (settings,) = SceneFile.read(path, [("volume.transform", np.eye(4).tolist())]).volumes
    assert (settings.transform, settings.scale) == (IDENTITY, (1, 1, 1))


def test_a_scale_is_one_number_or_three():
    with pytest.raises(
        SceneError, match=r"solid.scale = 'x': should be one number or three numbers \[x, y, z\]"
    ):
        tfm.BoxSolid(scale="x")
