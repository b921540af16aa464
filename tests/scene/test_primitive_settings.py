"""Scene files with points, curves and meshes: what they say of them, and what they leave open."""

import struct
import tomllib

import numpy as np
import pytest
from primitive_files import HAIR, PLY_LEAVES, PLY_POINTS, POSITIONS, write_bgeo, write_files
from scenes import turned

import tfm_cl as tfm
from tfm_cl.errors import SceneError, TfmError, VolumeError
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.scene.scene_file_writer import to_toml

POINTS = {"points": "plume.npz"}
CURVES = {"curves": "tuft.npz"}
MESH = {"mesh": "leaves.ply"}
TABLES = {"points": POINTS, "curves": CURVES, "mesh": MESH}


@pytest.fixture
def folder(tmp_path):
    write_files(tmp_path)
    return tmp_path


@pytest.fixture
def load(folder):
    """``load({"points": …}, …)`` is the scene of a file with such [[volume]] tables."""

    def run(*tables, **sections):
        path = folder / "scene.toml"
        path.write_text(to_toml({"volume": list(tables), **sections}))
        return tfm.Scene.load(path)

    return run


# --- what a table says -----------------------------------------------------------------------------------


def test_a_file_says_all(load):
    (points,) = load(POINTS).primitives
    np.testing.assert_array_equal(points.positions, [[0, 0, 0], [1, 0, 0], [0, 2, 0]])
    np.testing.assert_array_equal(points.radii, [0.5, 0.25, 1])
    assert "radius" not in points.chosen
    (curves,) = load(CURVES).primitives
    np.testing.assert_allclose(curves.widths, [[0.1, 0.2], [0.2, 0.3], [0.4, 0.5]], rtol=1e-6)
    np.testing.assert_allclose(-np.expm1(-curves.densities), [0.5, 0.5, 0.5], rtol=1e-6)
    assert curves.chosen == {}
    (mesh,) = load(MESH).primitives
    np.testing.assert_array_equal(mesh.corners[0], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert len(mesh.corners) == 2
    assert mesh.opacity > 0.999999
    assert mesh.colour is None


@pytest.mark.parametrize("density", ["auto", None])
def test_a_density_is_chosen(load, density):
    (points,) = load(POINTS | ({} if density is None else {"density": density})).primitives
    scale, why = points.chosen["density"]
    np.testing.assert_allclose(points.densities, scale)
    assert why.startswith("an optical depth of 7 along")
    (again,) = load(POINTS | {"density": scale}).primitives
    np.testing.assert_array_equal(again.densities, points.densities)


def test_a_density_is_given(load):
    (points,) = load(POINTS | {"density": 2.5}).primitives
    np.testing.assert_array_equal(points.densities, [2.5] * 3)
    assert points.chosen == {}
    (curves,) = load(CURVES | {"density": 2.0}).primitives
    np.testing.assert_allclose(curves.densities, 2 * curves.widths.mean(axis=1))


@pytest.mark.parametrize("kind", TABLES)
def test_an_opacity_is_given(load, kind):
    (body,) = load(TABLES[kind] | {"opacity": 0.4}).primitives
    depths = 32 / 35 * body.radii * body.densities if kind == "points" else body.densities
    # Of curves it multiplies the file's own, 1/2.
    np.testing.assert_allclose(-np.expm1(-depths), 0.2 if kind == "curves" else 0.4, rtol=1e-6)
    assert body.chosen == {}


def test_a_radius_is_given_or_chosen(load):
    (points,) = load(POINTS | {"radius": 0.3, "density": 1.0}).primitives
    np.testing.assert_array_equal(points.radii, [0.3] * 3)
    (points,) = load(POINTS | {"radius": "auto", "density": 1.0}).primitives
    radius, why = points.chosen["radius"]
    assert radius == 2.0  # nearest neighbours at 1, 1 and 2
    assert why == "2 median distances to the nearest neighbour"
    np.testing.assert_array_equal(points.radii, [2.0] * 3)


def test_a_width_is_given_or_chosen(load):
    (curves,) = load(CURVES | {"width": 0.07}).primitives
    np.testing.assert_array_equal(curves.widths, np.full((3, 2), 0.07))
    (curves,) = load(CURVES | {"width": "auto"}).primitives
    width, why = curves.chosen["width"]
    assert width == pytest.approx(0.001 * np.linalg.norm([1, 1, 3]), rel=0.02)
    assert why == "0.001 of the diagonal of their bounds"
    np.testing.assert_array_equal(curves.widths, np.full((3, 2), width))


@pytest.mark.parametrize("profile", ["ball", "gaussian", "smooth"])
def test_a_profile_is_given(load, profile):
    (points,) = load(POINTS | {"profile": profile, "density": 1.0}).primitives
    assert points.profile == profile


@pytest.mark.parametrize("kind", TABLES)
def test_colour_transform_and_medium(load, kind):
    matrix = turned(30, (1, 2, 3), (2, 2, 2), (1, -1, 0.5))
    more = {
        "colour": [1.0, 0.5, 0.25],
        "transform": matrix.ravel().tolist(),
        "medium": {"sigma_s": 0.5},
        "opacity": 0.5,
    }
    (before,) = load(TABLES[kind] | {"opacity": 0.5}).primitives
    (after,) = load(TABLES[kind] | more, medium={"sigma_a": 0.25}).primitives
    np.testing.assert_allclose(after.positions, before.positions @ matrix[:3, :3].T + matrix[:3, 3])
    np.testing.assert_allclose(after.radii, 2 * before.radii)
    np.testing.assert_array_equal(after.colour, [[1, 0.5, 0.25]] * len(after.positions))
    assert after.own_medium == tfm.Medium(sigma_s=0.5, sigma_a=0.25)


def test_several_kinds_in_one_scene(load):
    box = {"shape": "box", "from": [0, 0, 0], "to": [1, 1, 1], "density": 1.0}
    scene = load(MESH, POINTS, box, CURVES)
    assert [type(body) for body in scene.primitives] == [tfm.Polygons, tfm.Points, tfm.Curves]
    assert len(scene.homogeneous) == 1


def test_files_are_listed(folder):
    path = folder / "scene.toml"
    path.write_text(to_toml({"volume": list(TABLES.values())}))
    assert SceneFile.read(path).files() == [folder / name for name in ("plume.npz", "tuft.npz", "leaves.ply")]


# --- what cannot be --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (POINTS | {"density": 1.0, "opacity": 0.5}, "both density and opacity are given; keep one"),
        (POINTS | {"density": "auto", "opacity": 0.5}, "both density and opacity are given; keep one"),
        (CURVES | {"density": 1.0, "opacity": 0.5}, "both density and opacity are given; keep one"),
        (POINTS | CURVES, "points and curves are two kinds of bodies; keep one"),
        (MESH | {"file": "cloud.npy"}, "are two kinds of bodies; keep one"),
        (POINTS | {"shape": "box"}, "are two kinds of bodies; keep one"),
        (POINTS | {"raduis": 1.0}, "unknown key 'raduis' in [volume]; did you mean 'radius'"),
        (POINTS | {"width": 1.0}, "unknown key 'width'"),
        (CURVES | {"radius": 1.0}, "unknown key 'radius'"),
        (MESH | {"density": 1.0}, "unknown key 'density'"),
        (MESH | {"width": 1.0}, "unknown key 'width'"),
        (CURVES | {"density": "auto"}, "density"),
        (POINTS | {"radius": 0.0}, "radius = 0: should be above 0"),
        (POINTS | {"radius": -1.0}, "radius"),
        (CURVES | {"width": -1.0}, "width"),
        (POINTS | {"profile": "bal"}, "profile"),
        (MESH | {"opacity": 1.5}, "opacity"),
        (MESH | {"colour": [1.0, 1.0]}, "colour"),
        (POINTS | {"transform": np.diag([1.0, 2, 1, 1]).ravel().tolist()}, "transform should be a rotation"),
        (CURVES | {"medium": {"sigma": 1.0}}, "sigma"),
        ({"points": "none.npz"}, "none.npz"),
        ({"curves": "none.hair"}, "none.hair"),
        ({"mesh": "none.ply"}, "none.ply"),
        ({"points": 3}, "volume.points = 3: should be the name of a file of points"),
        ({"curves": ["a"]}, "volume.curves = ['a']: should be the name of a file of curves"),
        ({"mesh": ""}, "mesh"),
        ({"points": "tuft.hair"}, "tuft.hair"),
        ({"curves": "plume.npz"}, "plume.npz"),
        ({"mesh": "points.ply"}, "points.ply"),
    ],
    ids=str,
)
def test_what_cannot_be_is_one_line(load, table, message):
    with pytest.raises(TfmError) as error:
        load(table)
    assert isinstance(error.value, SceneError | VolumeError)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


# --- bare files ------------------------------------------------------------------------------------------

BARE = {
    "plume.npz": tfm.Points,
    "tuft.npz": tfm.Curves,
    "tuft.hair": tfm.Curves,
    "points.ply": tfm.Points,
    "plume.bgeo": tfm.Points,
    "cloud.npz": tfm.Volume,
}


@pytest.mark.parametrize("name", BARE)
def test_bare_files(folder, name):
    scene = tfm.Scene.load(folder / name)
    assert type(scene.volume) is BARE[name]
    assert scene.volume.source == folder / name


def test_a_bare_file_is_told_by_its_content_not_by_its_name(folder):
    (folder / "plume.npz").rename(folder / "hair.npz")
    assert isinstance(tfm.Scene.load(folder / "hair.npz").volume, tfm.Points)


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", HAIR[:50], PLY_POINTS[:40], PLY_LEAVES[:60]], ids=len)
@pytest.mark.parametrize("name", ["a.npz", "a.hair", "a.ply", "a.bgeo"])
def test_damaged_bare_files_are_one_line(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(TfmError, match=name) as error:
        tfm.Scene.load(tmp_path / name)
    assert "\n" not in str(error.value)


def test_a_number_of_points_that_no_file_holds(tmp_path):
    write_bgeo(tmp_path / "a.bgeo")
    data = (tmp_path / "a.bgeo").read_bytes()
    (tmp_path / "a.bgeo").write_bytes(data[:9] + struct.pack(">i", 2**31 - 1) + data[13:])
    with pytest.raises(VolumeError, match=r"a\.bgeo"):
        tfm.Scene.load(tmp_path / "a.bgeo")


# --- written again ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "table",
    [
        POINTS,
        POINTS | {"density": "auto", "radius": "auto", "profile": "ball"},
        POINTS | {"opacity": 0.3, "colour": [1.0, 0.5, 0.25]},
        CURVES,
        CURVES | {"width": "auto", "density": 3.0, "medium": {"phase": "kajiya-kay:0.5:20"}},
        MESH | {"opacity": 0.3, "transform": turned(30, (1, 2, 3), (2, 2, 2), (1, -1, 0.5)).ravel().tolist()},
    ],
    ids=str,
)
def test_what_is_written_is_the_same_body(load, table):
    (body,) = load(table).primitives
    written = body.to_table()
    assert "auto" not in written.values()
    again = tomllib.loads(to_toml({"volume": [written]}))["volume"][0]
    (other,) = load(again).primitives
    np.testing.assert_array_equal(other.positions, body.positions)
    np.testing.assert_array_equal(other.radii, body.radii)
    np.testing.assert_array_equal(other.densities, body.densities)
    assert (other.colour is None) == (body.colour is None)
    assert other.own_medium == body.own_medium
    assert getattr(other, "profile", None) == getattr(body, "profile", None)


# --- what moves ------------------------------------------------------------------------------------------

SPEEDS = np.array([[24.0, 0, 0], [0, 48.0, 0], [0, 0, -12.0], [2.4, 0, 0], [0, 0, 0]])


def arrays_with_speeds(folder):
    """The same points and curves, with a velocity each."""
    for name, count in (("plume", 3), ("tuft", 5)):
        with np.load(folder / f"{name}.npz") as archive:
            arrays = dict(archive)
        np.savez(folder / f"{name}.npz", **arrays, velocity=SPEEDS[:count])
    lines = PLY_LEAVES.decode().replace("property float z\n", "property float z\n" + VELOCITY_PROPERTIES)
    for row, speed in zip(("0 0 0", "1 0 0", "0 1 0", "0 1 1"), SPEEDS, strict=False):
        lines = lines.replace(f"\n{row}\n", f"\n{row} {' '.join(map(str, speed))}\n")
    (folder / "leaves.ply").write_text(lines)


VELOCITY_PROPERTIES = "".join(f"property float v{axis}\n" for axis in "xyz")


def test_velocities_of_files_move_what_they_hold(folder, load):
    arrays_with_speeds(folder)
    quarter = {"rotate": [0, 0, 90], "scale": 2.0}  # (x, y, z) becomes 2 (-y, x, z)
    for keys, frames, factor in (({}, 2.0, 1.0), ({"velocity_scale": 0.5, "velocity_fps": 12}, -1.0, 1.0)):
        points, curves, mesh = load(*(table | keys | quarter for table in TABLES.values())).primitives
        steps = factor * frames / 24 * 2 * SPEEDS @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
        np.testing.assert_allclose(points.moved(frames).positions - points.positions, steps[:3], atol=1e-6)
        of_curves = curves.moved(frames).corners - curves.corners
        np.testing.assert_allclose(of_curves, steps[[[0, 1], [1, 2], [3, 4]]], atol=1e-6)
        of_mesh = mesh.moved(frames).corners - mesh.corners
        np.testing.assert_allclose(of_mesh, steps[[[0, 1, 2], [1, 3, 2]]], atol=1e-6)
        later = curves.moved(frames)
        np.testing.assert_array_equal(later.widths, curves.widths)
        np.testing.assert_array_equal(later.with_density(2.0).moved(1.0).velocity, curves.velocity)


def test_what_does_not_move_is_itself(folder, load):
    for table in TABLES.values():
        (body,) = load(table).primitives
        assert body.velocity is None
        assert body.moved(1.0) is body
    arrays_with_speeds(folder)
    for table in TABLES.values():
        (body,) = load(table | {"velocity": False}).primitives
        assert body.moved(1.0) is body


def test_velocities_of_primitives_are_files_or_none(load):
    with pytest.raises(SceneError, match=r"volume\.velocity = 'v': should be False"):
        load(POINTS | {"velocity": "v"})
    with pytest.raises(SceneError, match=r"volume\.velocity_fps = 0"):
        load(POINTS | {"velocity_fps": 0})


def test_what_moves_out_of_the_world_is_refused():
    points = tfm.Points(POSITIONS, 1.0, velocity=np.full((3, 3), 1e15))
    with pytest.raises(VolumeError, match=r"moves something by .* world units in 99 frames; lower volume"):
        points.moved(99.0)
    with pytest.raises(VolumeError, match="fps > 0"):
        points.with_velocity(fps=0.0)
