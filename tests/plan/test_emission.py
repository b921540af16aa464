"""How what media emit lights their surroundings: maps, and the lattice or what keeps lights from it."""

import numpy as np
import pytest
from scenes import make_scene, turned

import tfm_cl as tfm
from tfm_cl.plan import emission
from tfm_cl.plan.plan import plan

GLOWING = tfm.Medium(sigma_s=0.5, emission=1, emission_lights=20)
GRID = make_scene().volume


def test_the_plan_tells_of_lights_maps_and_points():
    decisions = plan(make_scene(medium=GLOWING)).decisions
    assert decisions["emission.lights"] == (20, "clusters of what media emit, all of its energy")
    assert decisions["emission.res"].value == 64
    assert decisions["emission.res"].why.startswith("shadows are as soft as the clusters, whose radius is 0.")
    assert decisions["emission.points"] == (
        "14x13x13",
        "0.28 apart, as near as 2 voxels, or as bodies are thin",
    )
    assert not any(key.startswith("emission") for key in plan(make_scene(medium=tfm.Medium())).decisions)


def test_maps_of_other_lights_stay_and_alone_there_are_none():
    scene = make_scene(medium=GLOWING, map=tfm.MapSettings(res="auto"))
    assert "what media emit" not in plan(scene).decisions["map.res"].why
    alone = plan(scene.replace(lights=[]))
    assert alone.decisions["map.res"].why.startswith("of lights of what media emit: shadows")
    assert alone.map is not None


KEPT = {
    "points": (
        {"volume": [GRID, tfm.Points(np.zeros((1, 3)), 1.0, medium=tfm.Medium())]},
        "finer than a lattice",
    ),
    "everywhere": (
        {"volume": [GRID, tfm.EverywhereVolume(density=0.1, medium=tfm.Medium())]},
        "a medium that is everywhere has no lattice",
    ),
    "paper": ({"march": tfm.MarchSettings(attenuation="paper")}, "knows samples only"),
    "vast": (
        {"volume": [GRID, tfm.BoxVolume(from_=(-900,) * 3, to=(900,) * 3, density=0, medium=tfm.Medium())]},
        "apart would lose lights of a radius of",
    ),
}


@pytest.mark.parametrize("what", KEPT)
def test_what_keeps_them_from_a_lattice_is_told(what):
    changes, why = KEPT[what]
    found = plan(make_scene(medium=GLOWING, **changes)).decisions["emission.points"]
    assert found.value == "every sample"
    assert why in found.why


def test_many_lights_have_fewer_points(monkeypatch):
    scene = make_scene(medium=GLOWING)
    fine, _ = emission.lattice_of(scene)
    monkeypatch.setattr(emission, "LOOK_UPS", 20 * fine.points // 4)
    coarse, why = emission.lattice_of(scene)
    assert coarse.points <= fine.points // 4
    assert why.endswith("points allow")
    # No light is so small that it is lost between them.
    assert min(light.core for light in emission.lights_of(scene)) >= coarse.spacing


@pytest.mark.parametrize("sparse", [False, True])
def test_where_a_grid_grows_points_stay(sparse):
    """A dense grid, wherever it lies; leaves of cubes along the world's axes, which come and go."""
    place = turned(0 if sparse else 20, (1, 2, 0.5), (0.15, 0.15 if sparse else 0.2, 0.15), (1, 2, 3))
    voxels = np.zeros((24, 24, 24), np.float32)
    lattices = []
    for low, high in ((9, 15), (8, 15), (7, 16), (1, 22)):
        voxels[low:high, low:high, low:high] = 1
        start, matrix = (low // 8 * 8 if sparse else 0), place.copy()
        matrix[:3, 3] += matrix[:3, :3] @ np.full(3, start)
        volume = tfm.Volume(voxels[start:, start:, start:], world_from_index=matrix)
        if sparse:
            volume = tfm.Volume(volume.leaves, world_from_index=matrix)
        lattice, _ = emission.lattice_of(make_scene(volume=volume, medium=GLOWING))
        box = np.array([lattice.origin, lattice.origin + lattice.spacing * (np.array(lattice.size) - 1)])
        occupied = volume.occupied_bounds
        assert (box[0] < occupied[0] + 1e-9).all()
        assert (box[1] > occupied[1] - 1e-9).all()
        lattices.append(lattice)
    first = lattices[0]
    assert len({lattice.size for lattice in lattices}) == 4
    for lattice in lattices:
        assert lattice.spacing == first.spacing
        apart = np.subtract(lattice.origin, first.origin) / first.spacing
        assert np.abs(apart - np.round(apart)).max() < 1e-9
