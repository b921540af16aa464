"""Scenes far from the origin, and cameras and lights far from the medium: right, or refused by name."""

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.device.frame import FARTHEST, check_distances
from tfm_cl.errors import SceneError

SIZE = 3.0
FAR = 2e9
AT_ORIGIN = tfm.Camera(from_=(0, 0, 5), to=(0, 0, 0))


def volume(origin=0.0):
    """A cloud of about 3 units around a point on the diagonal."""
    data = blobs()
    voxel = SIZE / max(data.shape)
    half = voxel * np.array(data.shape[::-1]) / 2
    return tfm.Volume(data, voxel_size=voxel, origin=tuple(origin - half))


def spot(*position, **changes):
    return tfm.SpotLight(from_=position, to=(0, 0, 0), cone=10, **changes)


def test_a_camera_that_is_too_far_away_is_told_why(renderer):
    message = (
        r"^camera\.from = \[0\.0, 0\.0, 2000000000\.0\]: is 2e\+09 world units from the medium, "
        r"whose size is [\d.]+; float32 .* up to 30000 sizes away: come nearer, with a larger fov$"
    )
    scene = tfm.Scene(volume(), camera=AT_ORIGIN.replace(from_=(0, 0, FAR)))
    for use in (check_distances, renderer.render, renderer.build_maps):
        with pytest.raises(SceneError, match=message):
            use(scene)


@pytest.mark.parametrize("light", [spot(0, FAR, 0), tfm.PointLight(from_=(FAR, 0, 0))])
def test_a_light_that_is_too_far_away_is_told_why(light):
    scene = tfm.Scene(volume(), camera=AT_ORIGIN, lights=[spot(0, 9, 0), light])
    with pytest.raises(SceneError, match=r"^light 1: light\.from = .* or use a light of the type sun$"):
        check_distances(scene)


@pytest.mark.parametrize(
    "light",
    [
        tfm.SunLight(from_=(0, FAR, 0), to=(0, 0, 0)),
        tfm.EnvironmentLight(),
        spot(0, FAR, 0, reach=100.0),  # does not arrive
    ],
)
def test_lights_whose_place_does_not_matter_may_be_anywhere(light):
    check_distances(tfm.Scene(volume(), camera=AT_ORIGIN, lights=[light]))


def test_a_medium_everywhere_has_no_size():
    camera = AT_ORIGIN.replace(from_=(0, 0, FAR))
    check_distances(tfm.Scene(tfm.EverywhereVolume(), camera=camera, lights=[spot(0, 9, 0)]))


def test_what_is_looked_at_may_be_far_away():
    check_distances(tfm.Scene(volume(), camera=AT_ORIGIN.replace(to=(0, 0, -FAR))))


def test_the_limit_is_where_it_is_said_to_be():
    cloud = volume()
    size = float(np.linalg.norm(np.diff(cloud.bounds, axis=0)))
    near, far = (
        tfm.Scene(cloud, camera=AT_ORIGIN.replace(from_=(0, 0, part * FARTHEST * size)))
        for part in (0.99, 1.01)
    )
    check_distances(near)
    with pytest.raises(SceneError, match="float32"):
        check_distances(far)


def test_from_the_limit_the_picture_is_that_of_a_nearer_camera(one_lane_renderer):
    """Parallel rays both times; beyond the limit it would be another picture."""
    cloud = volume()
    size = float(np.linalg.norm(np.diff(cloud.bounds, axis=0)))
    settings = {"map": tfm.MapSettings(res=32, steps=48, basis="dct"), "march": tfm.MarchSettings(steps=48)}

    def picture(sizes):
        distance = sizes * size
        fov = float(np.degrees(2 * np.arctan(0.5 * SIZE / distance)))
        camera = tfm.Camera(from_=(0, 0, distance), to=(0, 0, 0), fov=fov, res=(32, 24))
        return one_lane_renderer.render(
            tfm.Scene(cloud, camera=camera, lights=[spot(-4, 6, 5)], **settings)
        ).image

    near, far = picture(1e3), picture(0.99 * FARTHEST)
    lit = near[..., 3] > 0.001
    assert lit.mean() > 0.2
    error = np.sqrt(np.square(near[lit, :3] - far[lit, :3]).mean()) / near[lit, :3].mean()
    assert error < 0.02  # `FARTHEST` says a hundredth or so


@pytest.mark.parametrize("make", [tfm.Camera, tfm.SpotLight, tfm.SunLight])
def test_points_that_are_close_far_from_the_origin_give_a_direction(make):
    """Half a unit apart at 2e9 is 2.5e-10 of the coordinates, of which float64 has 2e-16."""
    thing = make(from_=(FAR, FAR, FAR + 0.5), to=(FAR, FAR, FAR))
    assert thing.from_[2] - thing.to[2] == 0.5


@pytest.mark.parametrize("make", [tfm.Camera, tfm.SpotLight, tfm.SunLight])
def test_points_without_a_direction_are_told_why(make):
    with pytest.raises(
        SceneError, match=r"from and to are the same point \[1\.0, 2\.0, 3\.0\]: no direction"
    ):
        make(from_=(1, 2, 3), to=(1, 2, 3))
    with pytest.raises(SceneError, match=r"from and to are 0\.5 apart, too little for a direction at"):
        make(from_=(1e13, 0, 0.5), to=(1e13, 0, 0))


def test_a_scene_far_from_the_origin_is_the_same_picture(renderer):
    def picture(origin):
        camera = tfm.Camera(
            from_=(origin, origin, origin + 1.9), to=(origin, origin, origin + 1.4), fov=90, res=(32, 24)
        )
        light = tfm.SpotLight(from_=(origin - 4, origin + 6, origin + 5), to=(origin,) * 3, cone=15)
        return renderer.render(tfm.Scene(volume(origin), camera=camera, lights=[light])).image

    here, there = picture(0.0), picture(FAR)
    assert here[..., 3].max() > 0.5
    np.testing.assert_allclose(there, here, atol=1e-4 * here.max())
