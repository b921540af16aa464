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
from tfm_cl.scene.fields import fields_of

MANY = tfm.Medium(orders=8)
GRID = make_scene().volume
BOX = tfm.BoxVolume(from_=(0, 0, 0), to=(1, 2, 3))
REFUSED = {
    "octaves of one body": (
        {"volume": [GRID, BOX.with_medium(tfm.Medium(octaves=3))]},
        "another body has medium.octaves = 3, and both are multiple scattering",
    ),
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
    plan(scene.replace(medium=tfm.Medium()))


def test_the_most_orders_of_any_body_count():
    two = [GRID.with_medium(MANY.replace(orders=3)), BOX.with_medium(tfm.Medium(sigma_s=0.5))]
    assert orders.orders_of(make_scene(volume=two)) == 3


def test_one_degree_for_all_media():
    bodies = [GRID.with_medium(MANY), BOX.with_medium(MANY.replace(phase="hg:0.85"))]
    even, narrow = orders.lobes(make_scene(volume=bodies))
    assert even == (4, (1, 0, 0, 0, 0), 0)
    assert narrow == lobe_of(tfm.HenyeyGreenstein(0.85))


def test_what_is_scattered_on_the_way_is_known_of_each_field():
    """Two fields are of one medium each; in a third body, of the first one's colour, their mean counts."""
    red, blue = tfm.Medium(sigma_s=(1, 0.5, 0.5)), tfm.Medium(sigma_s=(0.2, 0.4, 0.8), sigma_a=0.1)
    scene = make_scene(volume=[GRID.with_medium(red), GRID.with_medium(blue), BOX])
    scattered = [np.asarray(medium.sigma_s) for medium in orders.media_of(scene)]
    fields = fields_of(scene)
    found = orders.of_fields(scene, fields.rgb_from_field, fields.weights, scattered)
    shares = np.divide(found, fields.rgb_from_field)
    np.testing.assert_allclose(shares.T, [scattered[0] / red.sigma_t, scattered[1] / blue.sigma_t])
    black = red.replace(sigma_s=0.0, sigma_a=red.sigma_s)
    scene = make_scene(volume=[GRID.with_medium(red), GRID.with_medium(black)])
    fields = fields_of(scene)
    found = orders.of_fields(scene, fields.rgb_from_field, fields.weights, [np.ones(3), np.zeros(3)])
    np.testing.assert_allclose(found, [[0.5], [0.5], [0.5]])


def test_a_medium_everywhere_is_bounded_by_what_is_in_it():
    """Bodies, solids, and what a spot is aimed at; and by free paths where these are near."""
    fog = tfm.EverywhereVolume(density=1e-3)
    spot = tfm.SpotLight(from_=(0, 0, 8), to=(0, 0, 0), cone=45)
    ball = tfm.SphereSolid(centre=(0, 20, 0), radius=2)
    scene = tfm.Scene([BOX, fog], MANY, make_scene().camera, [spot], solids=[ball, tfm.PlaneSolid()])
    within = orders.region_of(scene)
    np.testing.assert_allclose(within, [[-8 - 15, -8 - 15, -2 - 15], [8 + 15, 22 + 15, 8 + 15]], atol=1e-6)
    alone = tfm.Scene([fog], MANY, make_scene().camera, [tfm.PointLight(from_=(1, 2, 3))])
    np.testing.assert_allclose(orders.region_of(alone) - (1, 2, 3), [[-2000] * 3, [2000] * 3])
    assert "beyond a box of 46 x 60 x 40 what is everywhere" in orders.lattice_of(scene).why


def test_thin_bodies_have_few_points_across():
    slab = tfm.BoxVolume(from_=(0, 0, 0), to=(10, 10, 0.1))
    lattice = orders.lattice_of(make_scene(volume=slab, medium=MANY))
    assert orders.FEWEST_ACROSS <= 0.1 / lattice.spacing < 8
    assert lattice.points * 7 <= orders.OF_BODIES * orders.WORK
    assert lattice.points * lattice.samples**3 <= orders.SAMPLES
    assert "along the thinnest body: every order takes its time" in lattice.why
    cube = tfm.BoxVolume(from_=(0, 0, 0), to=(1, 1, 1))
    assert orders.lattice_of(make_scene(volume=cube, medium=MANY)).spacing == orders.OF_SMALLEST_BODY


TURNED = 3e-3
"""Of what walls along the axes reflect into a lobe's directions: 1.8e-3 measured; 4e-2 with some in them."""


def test_no_direction_of_a_lobe_lies_in_a_wall_along_the_axes():
    scene = make_scene(medium=MANY.replace(phase="hg:0.5"), solids=[tfm.PlaneSolid()])
    ways, weights = orders.ways_of(scene)[0]
    assert np.abs(ways).min() > 0.05
    for normal in np.eye(3):
        reflected = (weights * np.maximum(ways @ normal, 0)).sum() / np.pi
        assert abs(reflected - 1) < TURNED


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


def test_small_flames_are_swept_in_more_directions():
    fog = tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1))
    glow = tfm.Medium(sigma_s=0.1, emission=1.0)

    def directions(radius, medium=glow):
        flame = tfm.SphereVolume(radius=radius, medium=medium)
        scene = tfm.Scene([fog, flame], tfm.Medium(orders=2), lights=[tfm.PointLight(from_=(0, 3, 0))])
        return orders.emission_directions(scene)

    fewest, most = orders.DIRECTIONS_OF_EMISSION
    assert directions(1.0) == fewest
    assert directions(0.1) == pytest.approx(orders.OF_SMALL_FLAMES * 3 / 0.1**2, rel=0.02)
    assert directions(0.01) == most
    assert directions(0.1, glow.replace(emission_lights=8)) == fewest
    assert directions(0.1, glow.replace(emission=0.0)) == fewest
