"""The plan: what is left open is decided once, with a reason, for every mixture of bodies."""

import itertools

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.maps.bases import BASES
from tfm_cl.plan import resolution
from tfm_cl.plan.plan import Decision, plan

CAMERA = tfm.Camera(from_=(0, 0, 6), to=(0, 0, 0), res=(64, 48))
SPOT = tfm.SpotLight(from_=(0, 5, 0), to=(0, 0, 0), cone=20)
COARSE = tfm.Volume(blobs((10, 10, 10)), voxel_size=0.2, origin=(-1,) * 3)
FINE = tfm.Volume(blobs((40, 40, 40)), voxel_size=0.05, origin=(-1,) * 3)
RED = tfm.Medium(sigma_s=(9.0, 1.0, 1.0))
BODIES = {
    "coarse": COARSE,
    "fine": FINE,
    "red": COARSE.with_medium(RED),
    "box": tfm.BoxVolume(),
    "ball": tfm.SphereVolume(medium=RED),
    "fog": tfm.EverywhereVolume(density=0.01),
}
MIXTURES = [list(names) for count in (1, 2, 3) for names in itertools.combinations(BODIES, count)]
ALL_AUTO = tfm.MapSettings(res="auto", steps="auto")


def scene_of(names, lights=(SPOT,), settings=ALL_AUTO, **march):
    bodies = [BODIES[name] for name in names]
    march = tfm.MarchSettings(**{"steps": "auto"} | march)
    return tfm.Scene(bodies, camera=CAMERA, lights=lights, map=settings, march=march)


def is_open(value):
    return value == "auto"


@pytest.mark.parametrize("names", MIXTURES, ids="+".join)
def test_every_mixture_has_a_plan(names):
    scene = scene_of(names)
    planned = plan(scene)

    assert type(planned.scene.march.steps) is int
    assert all(decision.why for decision in planned.decisions.values())
    if scene.grids:
        assert planned.map is not None
        assert not any(is_open(getattr(planned.map, name)) for name in type(planned.map).model_fields)
        assert (planned.scene.map.res, planned.scene.map.steps) == (planned.map.res, planned.map.steps)
    else:
        assert planned.map is None
        assert planned.decisions == {"march.steps": Decision(100, planned.decisions["march.steps"].why)}
    assert plan(planned.scene).scene is planned.scene  # it decides nothing twice


@pytest.mark.parametrize("names", [["coarse"], ["coarse", "box"], ["box"]], ids="+".join)
def test_a_scene_without_lights_takes_no_map(names):
    planned = plan(scene_of(names, lights=()))
    assert planned.map is None
    assert not any(key.startswith("map.") for key in planned.decisions)
    assert type(planned.scene.march.steps) is int


def test_the_dual_march_takes_no_map():
    planned = plan(scene_of(["coarse"], method="dual"))
    assert planned.map is None
    assert plan(scene_of(["coarse"]), method="dual").map is None
    assert "map.basis" not in planned.decisions
    assert type(planned.scene.map.steps) is int


def test_what_is_homogeneous_changes_no_number():
    alone = plan(scene_of(["coarse"])).scene
    beside = plan(scene_of(["coarse", "box", "ball", "fog"])).scene
    assert (beside.map, beside.march) == (alone.map, alone.march)


def test_numbers_follow_the_finest_grid_and_each_grids_own_medium():
    coarse, fine, both = (plan(scene_of(names)).scene for names in (["coarse"], ["fine"], ["coarse", "fine"]))
    assert coarse.march.steps < fine.march.steps <= both.march.steps
    assert coarse.map.res < fine.map.res <= both.map.res
    # The scene's medium is not that of a body with its own.
    own = plan(scene_of(["red"])).scene
    same = plan(scene_of(["coarse"]).replace(medium=RED)).scene
    assert (own.map, own.march) == (same.map, same.march)
    assert own.march.steps > coarse.march.steps


def test_every_choice_says_why():
    decisions = plan(scene_of(["coarse"])).decisions
    best = BASES["klt"]
    for key, value in {
        "map.basis": best.name,
        "map.target": best.defaults.target,
        "map.fit": best.defaults.fit,
        "map.range": best.defaults.range,
        "map.lookup": best.defaults.lookup,
        "map.coeffs": 8,
    }.items():
        assert decisions[key].value == value
    numbers = resolution.resolved(scene_of(["coarse"]))
    assert decisions["map.res"].value == numbers.map.res
    assert decisions["map.steps"].value == numbers.map.steps
    assert decisions["march.steps"].value == numbers.march.steps
    assert "0.1" in decisions["map.res"].why  # half a voxel
    assert "0.3" in decisions["march.steps"].why  # one and a half


def test_nothing_is_decided_where_nothing_is_open():
    settings = tfm.MapSettings(
        basis="dct",
        coeffs=4,
        target="transmittance",
        fit="l2",
        range="box",
        lookup="interpolate",
        density_weighting=2.0,
        res=64,
        steps=20,
    )
    planned = plan(scene_of(["coarse"], settings=settings, steps=9))
    assert planned.decisions == {}
    assert planned.map.request() == settings


def test_bytes_choose_the_coefficients():
    settings = tfm.MapSettings(basis="dct", bytes_=20, res=64, steps=20)
    coeffs = plan(scene_of(["coarse"], settings=settings)).decisions["map.coeffs"]
    assert coeffs.value == 5
    assert "20" in coeffs.why
    with pytest.raises(SceneError, match=r"map\.bytes = 2: basis 'dct' needs at least 4"):
        plan(scene_of(["coarse"], settings=settings.replace(bytes_=2)))


def test_numbers_of_maps_that_are_there_stay():
    there = ALL_AUTO.replace(res=77, steps=33)
    planned = plan(scene_of(["coarse"]), maps=there)
    assert (planned.map.res, planned.map.steps) == (77, 33)
    assert planned.decisions["map.res"] == Decision(77, "that of the maps that are there")


def test_the_weighting_is_decided_by_the_lights_rays(renderer):
    scene = scene_of(["coarse"], settings=ALL_AUTO.replace(basis="dct"))
    planned = plan(scene)
    assert planned.map.density_weighting is None
    assert planned.decisions["map.density_weighting"].value is None

    result = renderer.render(scene)
    after = planned.completed(result.scene, result.stats.map)
    found = after.decisions["map.density_weighting"].value
    assert found == result.stats.map.density_weighting
    assert 1 <= found <= 16
    assert after.map == result.stats.map


@pytest.mark.slow
def test_max_error_is_left_to_measuring(renderer):
    scene = scene_of(["coarse"], settings=tfm.MapSettings(max_error=0.2)).replace(
        camera=CAMERA.replace(res=(12, 9))
    )
    planned = plan(scene)
    measured = {"map.res", "map.steps", "map.coeffs", "march.steps"}
    assert {key for key, (value, _) in planned.decisions.items() if value is None} == measured
    assert planned.scene is scene

    result = renderer.render(scene)
    after = planned.completed(result.scene, result.stats.map, result.stats.error_estimate)
    assert after.decisions["map.res"].value == result.stats.map.res
    assert after.decisions["march.steps"].value == result.scene.march.steps
    for key in measured:
        assert f"map.max_error = 0.2; measured: {result.stats.error_estimate:.2g}" in after.decisions[key].why


def test_json_and_text_say_the_same():
    planned = plan(scene_of(["coarse"]))
    for line, (key, decision) in zip(planned.lines(), planned.to_dict().items(), strict=True):
        assert line == f"{key} = {decision['value']}: {decision['why']}"
    assert list(planned.told) == ["map.res", "map.steps", "march.steps"]


def test_numbers_are_found_far_from_the_origin():
    near = scene_of(["coarse"])
    moved = np.eye(4)
    moved[:3, 3] = (1e5, -2e5, 3e5)
    there = near.replace(
        volume=COARSE.transformed(moved),
        camera=CAMERA.replace(from_=moved[:3, 3] + (0, 0, 6), to=moved[:3, 3]),
        lights=[SPOT.replace(from_=moved[:3, 3] + (0, 5, 0), to=moved[:3, 3])],
    )
    assert plan(there).scene.march.steps == plan(near).scene.march.steps
    assert plan(there).scene.map.res == plan(near).scene.map.res


@pytest.mark.parametrize(
    ("opacity", "sigma_t", "decided"),
    [
        (1.0, 1.0, {"target": "transmittance", "density_weighting": 2.0, "fit": "l2"}),
        (0.9, 1.0, {"target": "transmittance", "density_weighting": 2.0, "fit": "visibility"}),
        (0.9, 4.0, {"target": "transmittance", "density_weighting": 1.0, "fit": "l2"}),
        (0.9, 0.5, {"target": "transmittance", "density_weighting": 4.0, "fit": "visibility"}),
    ],
)
def test_strands_have_choices_of_their_own(opacity, sigma_t, decided):
    strands = tfm.Curves([(0, 0, 0), (0, 1, 0)], [2], 0.01, opacity=opacity)
    medium = tfm.Medium(sigma_s=sigma_t)
    planned = plan(tfm.Scene(strands, medium=medium, camera=CAMERA, lights=[SPOT]))
    assert {key: planned.decisions[f"map.{key}"].value for key in decided} == decided
    assert {key: getattr(planned.map, key) for key in decided} == decided
    # What is asked for stays.
    asked = tfm.MapSettings(density_weighting=7.0, fit="visibility")
    kept = plan(tfm.Scene(strands, medium=medium, camera=CAMERA, lights=[SPOT], map=asked)).map
    assert (kept.density_weighting, kept.fit, kept.target) == (7.0, "visibility", "transmittance")
