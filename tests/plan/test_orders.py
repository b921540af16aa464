"""What later orders of scattering are found with, and which scenes have none."""

import numpy as np
import pytest
from scenes import blobs, make_scene
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.plan import orders
from tfm_cl.plan.lobes import lobe_of
from tfm_cl.plan.plan import plan

MANY = tfm.Medium(orders=8)
GRID = make_scene().volume
BOX = tfm.BoxVolume(from_=(0, 0, 0), to=(1, 2, 3))
REFUSED = {
    "points": (
        {"volume": tfm.Points(np.zeros((1, 3)), 1.0)},
        "points, curves and polygons scatter once only",
    ),
    "two media": (
        {"volume": [GRID, BOX.with_medium(tfm.Medium(sigma_s=0.5))]},
        "bodies of several media scatter once only",
    ),
    "orders of one body": (
        {"volume": [GRID, BOX.with_medium(MANY.replace(orders=2))]},
        "bodies of several media scatter once only",
    ),
    "everywhere": ({"volume": tfm.EverywhereVolume()}, "a medium that is everywhere scatters once only"),
    "paper": (
        {"march": tfm.MarchSettings(attenuation="paper")},
        'march.attenuation = "paper" is for single scattering',
    ),
    "max_error": (
        {"map": tfm.MapSettings(max_error=0.01)},
        "map.max_error = 0.01 measures single scattering",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_scatters_once_only_is_refused(what):
    changes, why = REFUSED[what]
    scene = make_scene(medium=MANY, **changes)
    with pytest.raises(SceneError) as error:
        plan(scene)
    assert str(error.value) == f"medium.orders = 8: {why}; use medium.orders = 1"
    if what != "orders of one body":
        plan(scene.replace(medium=tfm.Medium()))


@pytest.mark.parametrize("count", [0, -1, 1001, 1.5, "auto", True])
def test_orders_are_a_number(count):
    with pytest.raises(SceneError, match=r"medium\.orders"):
        tfm.Medium(orders=count)


def test_the_plan_tells_of_the_lattice():
    decisions = plan(make_scene(medium=MANY)).decisions
    assert decisions["orders.points"] == ("26x24x24", "as far apart as voxels")
    assert decisions["orders.directions"].value == orders.DIRECTIONS
    assert "orders.points" not in plan(make_scene(medium=MANY)).told
    for scene in (make_scene(), make_scene(medium=MANY, lights=[])):
        assert not [key for key in plan(scene).decisions if key.startswith("orders")]


@pytest.mark.parametrize("body", [GRID, BOX, [GRID, BOX]], ids=["grid", "box", "both"])
def test_the_outermost_points_are_outside(body):
    scene = make_scene(volume=body, medium=MANY)
    lattice = orders.lattice_of(scene)
    low, high = scene.occupied_bounds
    last = np.array(lattice.origin) + lattice.spacing * (np.array(lattice.size) - 1)
    half = lattice.spacing / 2
    assert (np.array(lattice.origin) + half <= low).all()
    assert (last - half >= high).all()
    assert (last - high < 2 * lattice.spacing).all()


def test_points_are_further_apart_the_more_orders_there_are():
    grid = tfm.Volume(np.ones((128, 128, 128), np.float32))
    found = [
        orders.lattice_of(make_scene(volume=grid, medium=tfm.Medium(orders=count))) for count in (2, 8, 64)
    ]
    assert [one.samples for one in found] == [1, 2, 2]
    assert found[0].spacing == 1
    assert 1 < found[1].spacing < found[2].spacing == orders.VOXELS_APART
    assert found[1].points * 7 == pytest.approx(orders.WORK, rel=0.1)


def test_points_are_never_too_many():
    one = tfm.Volume(blobs()).transformed(np.diag([1e-3, 1e-3, 1e-3, 1]))
    far = one.transformed(np.array([[1, 0, 0, 9], [0, 1, 0, 9], [0, 0, 1, 9], [0, 0, 0, 1.0]]))
    lattice = orders.lattice_of(make_scene(volume=[one, far], medium=MANY))
    assert orders.MOST_POINTS / 2 < lattice.points <= orders.MOST_POINTS
    assert lattice.samples == orders.MOST_SAMPLES
    assert lattice.why == f"as near as {orders.MOST_POINTS:,} points allow"


def test_points_of_a_lobe_are_fewer():
    """They have more numbers, whose memory is bounded."""
    grid = tfm.Volume(np.ones((64, 64, 64), np.float32)).transformed(np.diag([1e-3, 1e-3, 1e-3, 1]))
    far = grid.transformed(np.array([[1, 0, 0, 9], [0, 1, 0, 9], [0, 0, 1, 9], [0, 0, 0, 1.0]]))
    scene = make_scene(volume=[grid, far], medium=MANY.replace(phase="hg:0.85"))
    lattice, numbers = orders.lattice_of(scene), orders.numbers_of(lobe_of(scene.medium.phase))
    assert numbers == 2 * 25 + 3 * orders.DIRECTIONS
    assert (
        orders.MOST_BYTES / 2
        < orders.bytes_of(lattice.size, lobe_of(scene.medium.phase))
        <= orders.MOST_BYTES
    )
    assert lattice.why == "as near as 1.5 GiB allow, at 146 numbers a point"


def test_the_plan_tells_of_the_lobe():
    decisions = plan(make_scene(medium=MANY.replace(phase="hg:0.85"))).decisions
    assert decisions["orders.degree"] == (4, "of the moments; 0.44 of the light goes straight on")
    assert "orders.degree" not in plan(make_scene(medium=MANY)).decisions


def test_directions_are_spread_evenly():
    """Their first moments are small, and their second those of the whole sphere, to a few hundredths."""
    first, second = orders.directions(32, 1), orders.directions(32, 2)
    for found in (first, second):
        assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < ROUNDED
        assert np.abs(found.mean(axis=0)).max() < 0.01
        assert np.abs(found.T @ found / 32 - np.eye(3) / 3).max() < 0.02
    assert np.abs(first - second).max() > 0.1  # turned
