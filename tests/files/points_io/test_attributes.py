"""From a file's names to what they mean, and what no file may say."""

from pathlib import Path

import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.files.points_io import read_points
from tfm_cl.files.points_io.attributes import is_known, points_of
from tfm_cl.files.points_io.stored import MAX_POINTS

FILE = Path("plume.bgeo")
POSITIONS = np.arange(12.0).reshape(4, 3)
LEVELS = np.array([0, 51, 102, 255], np.uint8)


def points(**attributes):
    return points_of(FILE, POSITIONS, attributes)


@pytest.mark.parametrize("name", ["radius", "Radius", "radii", "pscale"])
def test_radius(name):
    np.testing.assert_array_equal(points(**{name: np.arange(4)}).radii, [0, 1, 2, 3])


@pytest.mark.parametrize("name", ["width", "widths", "diameter"])
def test_a_width_is_two_radii(name):
    np.testing.assert_array_equal(points(**{name: np.arange(4)}).radii, [0, 0.5, 1, 1.5])


def test_a_radius_is_preferred_to_a_width():
    np.testing.assert_array_equal(points(width=np.ones(4), pscale=np.full(4, 3.0)).radii, [3, 3, 3, 3])


def test_a_size_is_left_alone():
    assert points(size=np.ones(4)).radii is None
    assert not is_known("size")


@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("density", "densities"),
        ("opacity", "opacities"),
        ("alpha", "opacities"),
        ("Alpha", "opacities"),
        ("displayOpacity", "opacities"),
    ],
)
def test_one_number_a_point(name, field):
    stored = points(**{name: np.array([[0.25], [0.5], [0.75], [1]])})
    np.testing.assert_array_equal(getattr(stored, field), np.float32([0.25, 0.5, 0.75, 1]))
    assert getattr(stored, field).dtype == np.float32


@pytest.mark.parametrize(
    ("name", "field"),
    [
        *((name, "colours") for name in ("Cd", "color", "colour", "displayColor", "primvars:displayColor")),
        *((name, "velocities") for name in ("v", "velocity", "velocities", "vel")),
    ],
)
def test_three_numbers_a_point(name, field):
    values = np.random.default_rng(0).random((4, 3), np.float32)
    np.testing.assert_array_equal(getattr(points(**{name: values}), field), values)


@pytest.mark.parametrize("names", [("r", "g", "b"), ("red", "green", "blue"), ("Red", "Green", "Blue")])
def test_colours_of_separate_levels(names):
    stored = points(**dict(zip(names, (LEVELS, LEVELS[::-1], LEVELS), strict=True)))
    np.testing.assert_allclose(stored.colours[:, 0], [0, 0.2, 0.4, 1], rtol=1e-6)
    np.testing.assert_allclose(stored.colours[:, 1], [1, 0.4, 0.2, 0], rtol=1e-6)


def test_levels_of_16_bits_and_of_an_opacity():
    stored = points(Cd=np.full((4, 3), 65535, np.uint16), alpha=LEVELS)
    np.testing.assert_array_equal(stored.colours, np.ones((4, 3)))
    np.testing.assert_allclose(stored.opacities, [0, 0.2, 0.4, 1], rtol=1e-6)


def test_velocities_of_separate_numbers():
    stored = points(vx=np.ones(4), vy=np.zeros(4), vz=np.arange(4))
    np.testing.assert_array_equal(stored.velocities, [[1, 0, 0], [1, 0, 1], [1, 0, 2], [1, 0, 3]])


def test_places_in_a_texture_are_no_velocities():
    assert points(u=np.ones(4), v=np.ones(4)).velocities is None


def test_what_is_not_said_is_none():
    stored = points(mass=np.ones(4), r=LEVELS, g=LEVELS)
    assert stored.positions.shape == (4, 3)
    assert stored.positions.dtype == np.float32
    unsaid = (stored.radii, stored.densities, stored.opacities, stored.colours, stored.velocities)
    assert unsaid == (None,) * 5


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("name", ["radius", "width", "density", "alpha", "Cd", "v", "red"])
def test_values_that_are_not_finite(name, value):
    values = np.ones((4, 3) if name in {"Cd", "v"} else 4)
    values[2:] = value
    attributes = {name: values} | ({"green": LEVELS, "blue": LEVELS} if name == "red" else {})
    with pytest.raises(VolumeError, match=rf"plume\.bgeo: '{name}' of point 2 is .*finite"):
        points(**attributes)


def test_positions_that_are_not_finite():
    positions = POSITIONS.copy()
    positions[3, 1] = np.nan
    with pytest.raises(VolumeError, match=r"plume\.bgeo: 'positions' of point 3 is nan; expected a finite"):
        points_of(FILE, positions, {})


@pytest.mark.parametrize("name", ["pscale", "width"])
def test_negative_radii(name):
    with pytest.raises(VolumeError, match=rf"'{name}' of point 1 is -0\.5; expected 0 or more"):
        points(**{name: np.array([0, -0.5, 1, -1])})


@pytest.mark.parametrize(
    ("name", "shape", "message"),
    [
        ("Cd", (4, 2), "'Cd' is 4×2; expected 4×3"),
        ("Cd", (4, 4), "'Cd' is 4×4; expected 4×3"),
        ("Cd", (4,), "'Cd' is 4; expected 4×3"),
        ("radius", (4, 3), "'radius' is 4×3; expected 4"),
        ("radius", (5,), "'radius' is 5; expected 4"),
        ("radius", (), "'radius' is one number; expected 4"),
    ],
)
def test_attributes_of_another_shape(name, shape, message):
    with pytest.raises(VolumeError, match=message):
        points(**{name: np.ones(shape)})


def test_positions_of_a_plane():
    with pytest.raises(VolumeError, match="'positions' is 4×2; expected 4×3"):
        points_of(FILE, np.ones((4, 2)), {})


def test_text_is_no_radius():
    with pytest.raises(VolumeError, match="'radius' holds no real numbers"):
        points(radius=np.array(["a", "b", "c", "d"]))


def test_too_many_points():
    with pytest.raises(VolumeError, match="points; from 0 to"):
        points_of(FILE, np.broadcast_to(np.float32(0), (MAX_POINTS + 1, 3)), {})


@pytest.mark.parametrize("name", ["a.abc", "a", "a.vdb"])
def test_unknown_formats(tmp_path, name):
    with pytest.raises(VolumeError, match=r"not a known format of points '.*'; known: \.bgeo "):
        read_points(tmp_path / name)


@pytest.mark.parametrize("name", ["a.bgeo", "a.npz", "a.ply", "a.vtk", "a.vtu", "a.vtp"])
def test_files_that_cannot_be_read(tmp_path, name):
    with pytest.raises(VolumeError, match="no such file"):
        read_points(tmp_path / name)
    (tmp_path / name).mkdir()
    with pytest.raises(VolumeError, match="is not a file but a directory"):
        read_points(tmp_path / name)
    (tmp_path / name).rmdir()
    (tmp_path / name).touch()
    with pytest.raises(VolumeError, match=name):
        read_points(tmp_path / name)
