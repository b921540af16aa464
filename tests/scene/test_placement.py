"""The camera, light and density scale that a bare volume gets: do they show the volume?"""

import itertools

import numpy as np
import pytest
from scenes import blobs, turned

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.limits import LARGEST_COLOUR
from tfm_cl.scene.optical_depth import OPTICAL_DEPTH, density_scale_for
from tfm_cl.scene.placement import (
    INTENSITY,
    TOWARDS_CAMERA,
    camera_for,
    light_for,
)


def corner_blob():
    """Occupied only in one corner of the array."""
    density = np.zeros((20, 30, 40), np.float32)
    density[1:6, 2:9, 30:39] = 1
    return density


VOLUMES = {
    "bare": tfm.Volume(blobs()),
    "turned": tfm.Volume(blobs(), world_from_index=turned(35, (1, 2, 3), (0.1, 0.3, 0.2), (5, -9, 2))),
    "corner": tfm.Volume(corner_blob(), voxel_size=(0.2, 0.1, 0.3)),
    "tiny": tfm.Volume(blobs(), voxel_size=1e-6),
    "huge": tfm.Volume(blobs(), voxel_size=1e6),
    "far": tfm.Volume(blobs(), voxel_size=0.01, origin=(1e6, -2e6, 3e5)),
    "one voxel": tfm.Volume(np.ones((1, 1, 1))),
    "empty": tfm.Volume(np.zeros((3, 4, 5))),
    "needle": tfm.Volume(np.ones((1, 1, 200))),
}

volumes = pytest.mark.parametrize("volume", VOLUMES.values(), ids=VOLUMES.keys())


def corners(volume):
    return np.array(list(itertools.product(*volume.occupied_bounds.T)))


def in_image(camera, points):
    """Normalised image coordinates x, y in [-1, 1], and the depth, of world points."""
    local = np.linalg.inv(camera.world_from_camera) @ np.column_stack([points, np.ones(len(points))]).T
    x, y, depth, _ = local
    tangent = np.tan(np.radians(camera.fov) / 2)
    width, height = camera.res
    return x / (depth * tangent * width / height), y / (depth * tangent), depth


@volumes
@pytest.mark.parametrize(
    "given", [{}, {"fov": 15.0}, {"focal_length": 35.0}, {"res": (400, 900)}, {"up": (1, 0, 0)}], ids=str
)
def test_the_volume_fills_the_frame(volume, given):
    camera = camera_for([volume], **given)
    x, y, depth = in_image(camera, corners(volume))
    assert depth.min() > 0
    reach = max(np.abs(x).max(), np.abs(y).max())
    # The place is rounded to four digits of the volume's extent.
    assert reach == pytest.approx(1, abs=0.005)


TURNS = {
    "z up": (90, (1, 0, 0)),
    "x up": (-90, (0, 0, 1)),
    "-z up": (-90, (1, 0, 0)),
    "y down": (180, (0, 0, 1)),
    "tilted": (35, (1, 0, 0.5)),
    "nearly y down": (180 - 1e-4, (0, 0, 1)),
}
"""The smallest rotation from y to another up: degrees and axis, which is across y."""


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS.keys())
@pytest.mark.parametrize("length", [1.0, 1e-9, 1e9])
def test_camera_and_light_stand_in_the_frame_of_up(turn, length):
    """Turn everything from y up to another up, and the picture stays the same."""
    rotation = turned(*turn)[:3, :3]
    cube = tfm.Volume(np.ones((6, 6, 6)), origin=(-3, -3, -3))  # around 0, of the same radius all around
    upright, camera = camera_for([cube]), camera_for([cube], up=tuple(length * rotation[:, 1]))
    directions = [np.array(each.from_) / np.linalg.norm(each.from_) for each in (upright, camera)]
    np.testing.assert_allclose(directions[1], rotation @ directions[0], atol=1e-4)  # four digits
    lights = [np.array(light_for([cube], each).from_) for each in (upright, camera)]
    np.testing.assert_allclose(lights[1], rotation @ lights[0], atol=1e-2)


@pytest.mark.parametrize("name", ["turned", "corner", "bare"])
def test_z_up_data_is_seen_as_the_same_data_with_y_up(name, one_lane_renderer):
    """Same voxels, with their y axis along z: same camera, light and picture in the other frame."""
    volume, quarter = VOLUMES[name], np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    z_up = volume.transformed(quarter)
    camera, turned_camera = camera_for([volume], res=(32, 24)), camera_for([z_up], up=(0, 0, 1), res=(32, 24))
    light, turned_light = light_for([volume], camera), light_for([z_up], turned_camera)

    for one, other in ((camera, turned_camera), (light, turned_light)):
        np.testing.assert_allclose(other.from_, quarter[:3, :3] @ one.from_, rtol=1e-12)
        np.testing.assert_allclose(other.to, quarter[:3, :3] @ one.to, rtol=1e-12)
    maps = tfm.MapSettings(basis="dct", density_weighting=10.0, res=32)
    pictures = [
        one_lane_renderer.render(tfm.Scene(each, camera=seen, lights=[lit], map=maps), method="dual").image
        for each, seen, lit in ((volume, camera, light), (z_up, turned_camera, turned_light))
    ]
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("name", "camera_from", "light_from"),
    [
        ("turned", (9.0847, -6.042, 11.9425), (-1.3262, 3.2907, 8.3091)),
        ("corner", (7.7867, 1.006, 3.5834), (3.9443, 4.8933, 3.0298)),
    ],
)
def test_with_y_up_places_stay_as_they_were(name, camera_from, light_from):
    for up in ({}, {"up": (0, 1, 0)}, {"up": (0, 30, 0)}):
        camera = camera_for([VOLUMES[name]], **up)
        assert camera.from_ == camera_from
        assert light_for([VOLUMES[name]], camera).from_ == light_from


def test_up_along_the_usual_view_is_no_error():
    camera = camera_for([VOLUMES["bare"]], up=TOWARDS_CAMERA)
    upwards = np.subtract(camera.from_, camera.to) @ TOWARDS_CAMERA
    assert 0 < upwards / np.linalg.norm(np.subtract(camera.from_, camera.to)) < 0.3


def test_keys_that_are_given_stay():
    volume = VOLUMES["bare"]
    camera = camera_for([volume], **{"from": (0.0, 0.0, 99.0), "to": (1.0, 1.0, 1.0), "fov": 33.0})
    assert (camera.from_, camera.to, camera.fov) == ((0, 0, 99), (1, 1, 1), 33)
    light = light_for([volume], camera, **{"from": (9.0, 9.0, 9.0), "cone": 7.0, "intensity": 2})
    assert (light.from_, light.cone, light.intensity) == ((9, 9, 9), 7, (2, 2, 2))


@volumes
def test_the_cone_holds_the_volume(volume):
    light = light_for([volume], camera_for([volume]))
    axis = np.subtract(light.to, light.from_)
    towards = corners(volume) - light.from_
    cosine = towards @ axis / np.linalg.norm(towards, axis=1) / np.linalg.norm(axis)
    assert np.degrees(np.arccos(cosine.min())) < light.cone
    assert light.cone < 20


@volumes
def test_light_comes_from_above_on_the_left(volume):
    camera = camera_for([volume])
    right, up, forward, _ = camera.world_from_camera.T
    from_centre = np.subtract(light_for([volume], camera).from_, camera.to)
    assert from_centre @ right[:3] < 0
    assert from_centre @ up[:3] > 0
    assert from_centre @ forward[:3] < 0  # not behind the volume


TYPES = pytest.mark.parametrize("kind", ["spot", "sun", "point", "environment"])


@volumes
@TYPES
@pytest.mark.parametrize("falloff", ["none", "inverse-square"])
def test_lights_of_every_type_are_as_bright(volume, kind, falloff):
    centre = volume.occupied_bounds.mean(axis=0)[None]
    if falloff != "none" and kind in {"sun", "environment"}:
        with pytest.raises(SceneError, match=r"light\.falloff"):
            light_for([volume], camera_for([volume]), type=kind, falloff=falloff)
        return

    light = light_for([volume], camera_for([volume]), type=kind, falloff=falloff)

    assert light.type == kind
    parts = [part.fitted(volume.bounds) for part in light.parts()]
    arriving = sum(part.arrival(centre).strength[0] * part.intensity[0] for part in parts)
    # As far as the numbers' digits go: three, and of 1.19 (a sky) three.
    assert arriving == pytest.approx(INTENSITY, rel=0.006) or light.intensity[0] == LARGEST_COLOUR


@volumes
def test_other_lights_come_from_where_the_spot_does(volume):
    spot, sun, point = (
        light_for([volume], camera_for([volume]), type=kind) for kind in ("spot", "sun", "point")
    )
    assert spot.from_ == sun.from_ == point.from_
    assert spot.to == sun.to


def test_a_light_within_the_volume_is_not_too_faint():
    volume = VOLUMES["bare"]
    centre = tuple(volume.occupied_bounds.mean(axis=0))
    light = light_for(
        [volume], camera_for([volume]), **{"type": "point", "from": centre, "falloff": "inverse-square"}
    )
    radius = np.linalg.norm(np.diff(volume.occupied_bounds, axis=0)) / 2
    assert light.intensity[0] == pytest.approx(INTENSITY * radius**2, rel=0.006)


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1)], ids=str)
def test_a_sky_has_its_sun_over_where_the_spot_is(up):
    camera = camera_for([VOLUMES["bare"]], up=up)
    spot, sky = (light_for([VOLUMES["bare"]], camera, type=kind) for kind in ("spot", "sky"))
    parts = sky.parts()
    sun = np.array(parts[-1].from_)  # the last one is the sun itself
    across = [np.cross(way, up) for way in (np.subtract(spot.from_, spot.to), sun)]
    cosine = across[0] @ across[1] / np.linalg.norm(across[0]) / np.linalg.norm(across[1])
    assert cosine == pytest.approx(1, abs=1e-4)
    assert sun @ up == pytest.approx(np.sin(np.radians(sky.elevation)))
    luminance = np.sum([part.intensity for part in parts], axis=0) @ (0.2126, 0.7152, 0.0722)
    assert luminance == pytest.approx(INTENSITY, rel=0.05)
    assert light_for([VOLUMES["bare"]], camera, type="sky", azimuth=7, up=(1, 0, 0)).azimuth == 7


@TYPES
def test_keys_that_a_type_does_not_have_are_refused(kind):
    known = {"spot": {"to", "cone"}, "sun": {"to"}, "point": set(), "environment": set()}[kind]
    for key, value in (("to", (1.0, 2.0, 3.0)), ("cone", 9.0)):
        given = {"type": kind, key: value}
        if key in known:
            assert light_for([VOLUMES["bare"]], camera_for([VOLUMES["bare"]]), **given).type == kind
        else:
            with pytest.raises(SceneError, match=f"unknown key '{key}' in \\[light\\]"):
                light_for([VOLUMES["bare"]], camera_for([VOLUMES["bare"]]), **given)


@pytest.mark.parametrize("kind", ["disco", 3, ["spot"], None])
def test_an_unknown_type_is_refused(kind):
    with pytest.raises(
        SceneError, match=r"light\.type: unknown light .*known: spot, sun, point, environment, sky"
    ):
        light_for([VOLUMES["bare"]], camera_for([VOLUMES["bare"]]), type=kind)


def test_a_light_inside_the_volume_gets_a_wide_cone():
    volume = VOLUMES["bare"]
    centre = volume.occupied_bounds.mean(axis=0)
    light = light_for([volume], camera_for([volume]), **{"from": tuple(centre), "to": (0.0, 0.0, 0.0)})
    assert light.cone == 60


def test_numbers_are_short_enough_to_type():
    for volume in (VOLUMES["bare"], VOLUMES["turned"], VOLUMES["tiny"]):
        camera = camera_for([volume])
        for number in (*camera.from_, *camera.to, *light_for([volume], camera).from_):
            digits = f"{abs(number):e}".split("e")[0].replace(".", "").rstrip("0")
            assert len(digits) <= 6


@pytest.mark.parametrize("name", ["bare", "turned", "corner", "tiny", "huge", "far", "one voxel", "needle"])
def test_the_optical_depth_is_sensible(name):
    volume = VOLUMES[name]
    scale = density_scale_for(volume)
    columns = [volume.data.sum(axis=2 - axis, dtype=float) * volume.voxel_size[axis] for axis in range(3)]
    depths = scale * np.concatenate([column.ravel() for column in columns])
    assert np.average(depths, weights=depths) == pytest.approx(OPTICAL_DEPTH, rel=0.06)  # two digits


@volumes
def test_leaves_are_placed_as_their_dense_array(volume):
    sparse = tfm.Volume(volume.leaves, world_from_index=volume.world_from_index)
    assert density_scale_for(sparse) == density_scale_for(volume)
    assert camera_for([sparse]).from_ == camera_for([volume]).from_
    assert light_for([sparse], camera_for([sparse])).from_ == light_for([volume], camera_for([volume])).from_


def test_empty_borders_do_not_change_the_optical_depth():
    bare = density_scale_for(tfm.Volume(blobs()))
    assert density_scale_for(tfm.Volume(np.pad(blobs(), 20))) == bare


def test_volumes_that_have_no_sensible_optical_depth():
    assert density_scale_for(VOLUMES["empty"]) == 1
    for faint in (1e-38, 1e-44):
        assert 0 < density_scale_for(tfm.Volume(np.full((2, 2, 2), faint))) <= 1e25


BOX = tfm.BoxVolume(from_=(-1, 0.5, -2), to=(1, 3, 2))
BALL = tfm.SphereSolid(centre=(0, 0, 1), radius=0.75)


@pytest.mark.parametrize(
    ("solids", "camera", "height", "up"),
    [
        ([], {}, 0.5, "y"),
        ([BALL, tfm.PlaneSolid(point=(0, -9, 0))], {}, -0.75, "y"),
        ([BALL.replace(visible=False)], {}, -0.75, "y"),
        ([], {"up": (0.1, 0, 1)}, -2, "z"),
        ([], {"up": (-3, 0, 1)}, -1, "-x"),
    ],
    ids=str,
)
def test_the_ground_is_under_everything(solids, camera, height, up):
    camera = camera_for([BOX], res=(8, 6), **camera)
    ground = tfm.GroundSolid(albedo=0.3)
    placed = tfm.Scene(BOX, camera=camera, lights=[], solids=[*solids, ground]).solids[-1]
    assert placed == ground.replace(up=up, height=float(height))
    point, normal = placed.world_plane()
    assert point @ normal == height


def test_the_ground_knows_no_up_from_a_matrix_and_none_from_nothing():
    matrix = (1, 0, 0, 0, 0, 0, 1, 9, 0, -1, 0, 0, 0, 0, 0, 1)  # looks down along -y
    camera = tfm.Camera(matrix=matrix, res=(8, 6))
    scene = tfm.Scene(BOX, camera=camera, lights=[], solids=[tfm.GroundSolid()])
    assert scene.solids[0] == tfm.GroundSolid(up="y", height=0.5)
    assert scene.replace(solids=[tfm.GroundSolid(up="x")]).solids[0].height == -1
    with pytest.raises(SceneError, match="nothing in the scene has a lowest point"):
        tfm.Scene(tfm.EverywhereVolume(), camera=camera, lights=[], solids=[tfm.GroundSolid()])


def test_a_view_of_no_angle_is_from_as_far_as_can_be():
    assert np.linalg.norm(camera_for([VOLUMES["bare"]], fov=1e-300).from_) == pytest.approx(1e15)


@pytest.mark.parametrize(
    "given",
    [
        {"from": "there"},
        {"to": (1, 2)},
        {"to": (1, 2, 10**400)},
        {"to": {}},
        {"from": (1, 2, 1e300)},
        {"fov": "wide"},
        {"up": 3},
        {"volume": 3},
        {"camera": 3},
        {"self": 3},
    ],
    ids=str,
)
def test_impossible_keys_are_refused_by_name(given):
    (key,) = given
    with pytest.raises(SceneError, match=rf"camera\.({key}|from)|unknown key '{key}'|from and to"):
        camera_for([VOLUMES["bare"]], **given)
    if key not in {"fov", "up"}:
        with pytest.raises(SceneError, match=rf"light\.{key}|unknown key '{key}'"):
            light_for([VOLUMES["bare"]], camera_for([VOLUMES["bare"]]), **given)


def test_a_scene_of_a_volume_alone_is_lit(renderer):
    camera = camera_for([VOLUMES["bare"]], res=(32, 18))
    scale = density_scale_for(VOLUMES["bare"])
    scene = tfm.Scene(
        VOLUMES["bare"].with_density_scale(scale),
        camera=camera,
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=32),
    )
    image = renderer.render(scene).image
    luminance = image[..., :3] @ [0.2126, 0.7152, 0.0722]
    assert 0.25 < luminance.max() < 1.5  # bright, hardly burnt out
    assert 0.1 < (image[..., 3] > 0.5).mean() < 0.9  # body and background


@pytest.mark.parametrize(("word", "up"), [("z", (0, 0, 1)), ("-Y", (0, -1, 0)), ("+x", (1, 0, 0))])
def test_an_axis_is_a_direction_that_sky_and_ground_follow(word, up):
    volume = VOLUMES["bare"]
    camera = camera_for([volume], up=word)
    assert camera == camera_for([volume], up=up)
    assert camera.up == up
    scene = tfm.Scene(volume, camera=camera, lights=[tfm.SkyLight()], solids=[tfm.GroundSolid()])
    assert scene.lights[0].up == up
    assert scene.solids[0].up == word.lower().removeprefix("+")
    # What has a zenith of its own keeps it.
    assert tfm.Scene(volume, camera=camera, lights=[tfm.SkyLight(up="y")]).lights[0].up == (0, 1, 0)
    with pytest.raises(SceneError, match=r"camera.up = 'w': should be three numbers .*, or an axis: y, z, x"):
        camera_for([volume], up="w")
