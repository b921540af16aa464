"""Scenes and their parts: equal by content, pickled, and shown on one line."""

import pickle

import numpy as np
import pytest

import tfm_cl as tfm

BOUNDS = np.array([[-1.0, -1, -1], [1, 1, 1]])
POSITIONS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def make_volume(**changes):
    voxels = np.zeros((4, 5, 6), np.float32)
    voxels[1:3, 1:3, 1:3] = 1
    return tfm.Volume(voxels, **{"voxel_size": 0.1, **changes})


def make_scene(**changes):
    bodies = [
        make_volume(colour=np.full((4, 5, 6, 3), 0.5)),
        tfm.Points(POSITIONS, 0.1, profile="ball"),
        tfm.Curves(POSITIONS, [3], 0.1),
        tfm.Polygons(POSITIONS, [[0, 1, 2]]),
        tfm.BoxVolume(medium=tfm.Medium(phase="hg:0.3")),
    ]
    phase = tfm.PhaseMixture(phases=["mie", tfm.TabulatedPhase(values=[1, 2, 1])], weights=[1, 2])
    solids = [
        tfm.MeshSolid.from_arrays(POSITIONS, [[0, 1, 2]], normals=POSITIONS + 1, uv=POSITIONS[:, :2]),
        tfm.SphereSolid(),
    ]
    parts = {
        "volume": bodies,
        "medium": tfm.Medium(phase=phase),
        "camera": tfm.Camera(from_=(0, 0, 9), to=(0, 0, 0)),
        "lights": [tfm.SpotLight(from_=(0, 5, 0), to=(0, 0, 0)), tfm.SunLight(from_=(1, 1, 0), to=(0, 0, 0))],
        "solids": solids,
    }
    return tfm.Scene(**parts | changes)


def used(scene):
    """Return a scene that has made of its parts what is made once and kept."""
    scene.read_files()
    for body in scene.bodies:
        _ = body.bounds, body.occupied_bounds, body.largest_density
    for solid in scene.solids:
        _ = solid.world_from_object, solid.bounds()
    return scene


def test_scenes_are_equal_by_content():
    assert make_scene() == make_scene()
    assert hash(make_scene()) == hash(make_scene())
    assert used(make_scene()) == make_scene()


@pytest.mark.parametrize(
    "changes",
    [
        {"medium": tfm.Medium()},
        {"volume": make_volume()},
        {"volume": [make_volume(density_scale=2.0)]},
        {"volume": [make_volume(medium=tfm.Medium())]},
        {"volume": tfm.Points(POSITIONS, 0.2)},
        {"solids": []},
        {"solids": [tfm.MeshSolid.from_arrays(2 * POSITIONS, [[0, 1, 2]])]},
        {"lights": [tfm.SunLight(from_=(1, 2, 0), to=(0, 0, 0))]},
        {"map": tfm.MapSettings(res=64)},
    ],
)
def test_scenes_that_differ_in_a_part_are_not_equal(changes):
    assert make_scene(**changes) != make_scene()
    assert make_scene(**changes) == make_scene(**changes)


def test_lights_whose_maps_are_fitted_elsewhere_are_not_equal():
    sun, spot = make_scene().lights[::-1]

    for light in (sun, spot):
        assert light.fitted(BOUNDS) == light.fitted(BOUNDS.copy())
        assert light.fitted(BOUNDS) != light.fitted(2 * BOUNDS)


@pytest.mark.parametrize("make", [make_scene, lambda: used(make_scene())], ids=["new", "used"])
def test_pickled_scenes_are_equal_and_read_only(make):
    scene = make()
    again = pickle.loads(pickle.dumps(scene))

    assert again == scene
    volume, points, *_ = again.bodies
    assert not any(array.flags.writeable for array in (volume.data, volume.colour, points.positions))
    assert volume.channels[0].data.shape == volume.data.shape


def test_bodies_equal_by_content():
    bodies, others = make_scene().bodies, make_scene().bodies
    for body, other, another in zip(bodies, others, others[1:] + others[:1], strict=True):
        assert body.equals(other)
        assert not body.equals(another)
        assert not body.equals(other.with_medium(tfm.Medium(sigma_s=0.5)))


def test_pickled_bodies_are_told_from_others_of_the_process():
    scene = used(make_scene())
    again = pickle.loads(pickle.dumps(scene))

    for body, other in zip(scene.marched, again.marched, strict=True):
        assert body.density_key != other.density_key


def test_what_is_shown_is_one_short_line():
    values = np.linspace(-1, 1, 1000)
    scene = make_scene(volume=[*make_scene().bodies, tfm.EverywhereVolume()], lights=())

    shown = [repr(part) for part in (scene, *scene.bodies, *scene.solids, scene.medium)]
    shown.append(repr(tfm.TabulatedPhase(cosines=values, values=values + 2)))

    assert [line for line in shown if len(line) > 400 or "\n" in line] == []
    assert repr(tfm.Medium(phase="hg:0.3")) == "Medium(phase=HenyeyGreenstein(g=0.3))"
    assert str(tfm.SphereSolid(radius=2)) == "SphereSolid(radius=2.0)"
    assert repr(tfm.Scene(make_volume(), camera=scene.camera, lights=())) == (
        "Scene(Volume(array, 6×5×4 voxels, density_scale=1), 1280×720 pixels)"
    )
