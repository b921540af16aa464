"""When light is looked up once a voxel: what a lattice can hold, and when "auto" takes one."""

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.plan import lattice, resolution
from tfm_cl.plan.lattice import choice, depth_of_voxels, is_taken, left_out, smooth_lights
from tfm_cl.plan.plan import plan, with_lookup

CAMERA = tfm.Camera(from_=(0, 0, 6), to=(0, 0, 0), res=(640, 480))
SUN = tfm.SunLight(from_=(1, 3, 0.5), to=(0, 0, 0))
SUNS = [SUN, SUN.replace(from_=(-1, 2, 3)), SUN.replace(from_=(2, 1, -1))]
NARROW = tfm.SpotLight(from_=(0, 5, 0), to=(0, 0, 0), cone=4)
SHARP = tfm.Medium(phase=tfm.HenyeyGreenstein(0.99))
VOXEL = 0.05


def a_grid(depth=0.1, stretched=1.0):
    """Whose typical voxel has an optical depth along its shortest edges; z may be longer."""
    grid = tfm.Volume(blobs((40, 40, 40)), voxel_size=(VOXEL, VOXEL, stretched * VOXEL), origin=(-1, -1, -1))
    return grid.with_density_scale(depth / VOXEL / grid.typical_density)


def scene_of(lights=SUNS, volume=None, medium=None, camera=CAMERA, **of_map):
    return tfm.Scene(
        a_grid() if volume is None else volume,
        medium=medium or tfm.Medium(),
        camera=camera,
        lights=lights,
        map=tfm.MapSettings(**{"res": "auto", "steps": "auto"} | of_map),
        march=tfm.MarchSettings(steps="auto"),
    )


def test_three_lights_in_a_thin_medium_take_a_lattice():
    assert [choice(scene_of(SUNS[:n])).is_lattice for n in (1, 2, 3)] == [False, False, True]
    assert choice(scene_of(SUNS)).why == "3 lights once a voxel; its error in the picture is about 0.008"


@pytest.mark.parametrize(("lights", "widest"), [(1, 0.5), (2, 0.5), (3, 0.75)])
def test_wide_pixels_take_fewer_samples_than_there_are_voxels(lights, widest):
    middle = np.linalg.norm(np.mean(scene_of().occupied_bounds, axis=0) - CAMERA.from_)
    height = 2 * np.tan(np.radians(CAMERA.fov / 2)) * middle
    chosen = []
    for width in (0.9 * widest, 1.1 * widest):
        camera = CAMERA.replace(res=(64, round(height / (width * VOXEL))))
        chosen.append(choice(scene_of(SUNS[:lights], camera=camera, max_error=0.1)))

    assert [one.is_lattice for one in chosen] == [True, False]
    assert chosen[1].why == "the picture has fewer samples than the grids have voxels"


def test_few_lights_are_on_a_lattice_where_an_error_is_asked_for():
    errors = (0.01, 0.023, 0.025, 0.1)  # twice 0.12 times the optical depth of a voxel
    for lights in (1, 2):
        found = [choice(scene_of(SUNS[:lights], max_error=error)).is_lattice for error in errors]
        assert found == [False, False, True, True]
    assert not choice(scene_of([NARROW], max_error=0.1)).is_lattice


def test_points_of_a_light_count():
    assert choice(scene_of([tfm.EnvironmentLight(samples=8)])).is_lattice
    wide = NARROW.replace(cone=40, radius=0.2, samples=3)
    assert choice(scene_of([wide])).is_lattice
    assert not choice(scene_of([wide.replace(samples=2)])).is_lattice


def test_lights_with_edges_do_not_count():
    assert choice(scene_of([*SUNS[:2], NARROW])) == (False, "only 2 lights are smooth in the grids")
    assert smooth_lights(scene_of([NARROW, *SUNS])) == [1, 2, 3]
    assert choice(scene_of([NARROW, *SUNS])).is_lattice


@pytest.mark.parametrize(
    ("volume", "medium"),
    [
        (a_grid(0.3), None),
        (a_grid(), tfm.Medium(sigma_s=(0.1, 3.0, 0.1))),
        (a_grid(stretched=3.0), None),
        # In the shadow of the dense grid lie long voxels of the thin one.
        ([a_grid(), tfm.Volume(np.full((4, 4, 4), 1e-6), voxel_size=3 * VOXEL, origin=(0, 0, 0))], None),
    ],
    ids=["density", "extinction", "long voxels", "long voxels of another grid"],
)
def test_a_medium_of_thick_voxels_takes_none(volume, medium):
    chosen = choice(scene_of(volume=volume, medium=medium))

    assert not chosen.is_lattice
    assert (
        chosen.why
        == "a lattice of 3 lights once a voxel; its error in the picture is about 0.02, more than 0.02"
    )


def test_what_voxels_hold_is_along_their_longest_edge():
    depths = [depth_of_voxels(scene_of(volume=a_grid(stretched=s))) for s in (1, 3)]

    assert depths == pytest.approx([0.1, 0.3])


@pytest.mark.parametrize(("asked", "expected"), [(0.001, False), (0.012, False), (0.02, True), (0.5, True)])
def test_half_of_max_error_is_the_lattice_s(asked, expected):
    scene = scene_of(max_error=asked)

    assert choice(scene).is_lattice == expected
    assert with_lookup(scene).map.lookup == ("lattice" if expected else "interpolate")
    assert plan(scene).decisions["map.lookup"].value == with_lookup(scene).map.lookup


def test_what_is_asked_for_stays():
    for lookup in ("lattice", "reconstruct", "stochastic"):
        scene = scene_of(lookup=lookup, max_error=0.5)
        assert with_lookup(scene) is scene
        assert "map.lookup" not in plan(scene).decisions


@pytest.mark.parametrize("where", [(0, 0, 0), (0, 0, 1.1)])
def test_near_the_camera_a_phase_function_changes_within_a_voxel(where):
    near = CAMERA.replace(from_=where, to=(0, 0, -5))
    for g, expected in ((0.0, 3), (0.01, 3), (0.9, 0)):
        medium = tfm.Medium(phase=tfm.HenyeyGreenstein(g))
        assert len(smooth_lights(scene_of(medium=medium, camera=near))) == expected


def test_a_sharp_phase_function_needs_small_voxels_from_afar():
    far = CAMERA.replace(from_=(0, 0, 600))

    assert smooth_lights(scene_of(medium=SHARP)) == []
    assert smooth_lights(scene_of(medium=SHARP, camera=far)) == [0, 1, 2]
    assert left_out(scene_of(medium=SHARP, lookup="lattice")).endswith(
        ": the camera or lights are so near that what is scattered changes within a voxel"
    )
    assert left_out(scene_of(medium=SHARP, lookup="lattice", camera=far)) == ""


def test_near_a_light_its_falloff_changes_within_a_voxel():
    point = tfm.PointLight(from_=(0, 1.5, 0), falloff="inverse-square")
    coarse = tfm.Volume(np.ones((5, 5, 5)), voxel_size=0.4, origin=(-1, -1, -1))

    assert smooth_lights(scene_of([point.replace(from_=(0, 2.2, 0))], coarse)) == [0]
    assert smooth_lights(scene_of([point.replace(from_=(0, 2.2, 0), falloff="none")], coarse)) == [0]
    assert smooth_lights(scene_of([point], a_grid())) == [0]
    assert smooth_lights(scene_of([point.replace(from_=(0, 1.8, 0))], coarse)) == []


@pytest.mark.parametrize("g", [0.5, -0.9, 0.9])
@pytest.mark.parametrize("angle", [0.01, 0.1, 0.5])
def test_the_error_of_a_phase_function_is_that_of_its_logarithm_interpolated(g, angle):
    phase = tfm.HenyeyGreenstein(g)
    middle = np.linspace(0, np.pi, 2001)
    ends = [phase.evaluate(np.cos(middle + side * angle / 2)) for side in (-1, 1)]
    ratio = phase.evaluate(np.cos(middle)) / np.sqrt(ends[0] * ends[1])

    assert lattice.turned_error(phase, angle) == pytest.approx(
        max(ratio.max(), 1 / ratio.min()) - 1, rel=0.01
    )
    assert lattice.turned_error(tfm.Isotropic(), angle) == 0


def test_bodies_that_have_no_voxels_take_none():
    scene = scene_of(volume=[a_grid(), tfm.BoxVolume()])

    assert choice(scene) == (False, "bodies of constant density have no voxels")
    assert not is_taken(scene.replace(map=scene.map.replace(lookup="lattice"))) or smooth_lights(scene) == []


def test_the_plan_tells_of_it():
    planned = plan(scene_of())

    assert (
        planned.scene.map.lookup == planned.map.lookup == planned.decisions["map.lookup"].value == "lattice"
    )
    assert planned.decisions["map.lookup"].why == choice(scene_of()).why
    assert planned.decisions["map.res"].why.startswith("texels of 1 voxels, 0.05, ")
    assert plan(scene_of(), method="dual").scene.map.lookup == "auto"
    assert plan(planned.scene).scene is planned.scene


def test_maps_that_are_there_decide():
    there = scene_of(res=77, steps=33).map
    for lookup in ("auto", "lattice"):
        planned = plan(scene_of(), maps=there.replace(lookup=lookup))
        assert planned.scene.map.lookup == lookup


def test_texels_are_as_fine_as_the_light_that_is_not_on_the_lattice_needs():
    camera = CAMERA.replace(res=(1280, 960))  # whose pixels set no limit
    alone, both = ([NARROW.replace(cone=12)], [NARROW.replace(cone=12), *SUNS])
    numbers = {
        how: [
            plan(scene_of(lights, lookup=how, camera=camera)).scene.map.res for lights in (SUNS, alone, both)
        ]
        for how in ("lattice", "interpolate")
    }

    assert numbers["lattice"][0] < numbers["interpolate"][0]
    assert numbers["lattice"][1] == numbers["interpolate"][1]
    assert numbers["lattice"][2] >= numbers["lattice"][1]
    boxed = scene_of(volume=[a_grid(), tfm.BoxVolume()], lookup="lattice", camera=camera)
    assert plan(boxed).scene.map.res == numbers["interpolate"][0]


def test_the_limit_of_auto_is_that_of_the_lattice():
    # Of 0.5 voxels more than 2048 texels would be wanted, of 1 voxel fewer.
    camera = CAMERA.replace(res=(12000, 9000))
    wide = tfm.Volume(np.ones((1, 1, 1200)), voxel_size=0.002, origin=(-1.2, 0, 0), density_scale=50.0)
    suns = [SUN, SUN.replace(from_=(0, 3, 1)), SUN.replace(from_=(0.2, 3, 0))]

    assert resolution.limited(scene_of(suns, wide, camera=camera, lookup="lattice")) == ()
    assert resolution.limited(scene_of(suns, wide, camera=camera)) == ()
    assert len(resolution.limited(scene_of(suns, wide, camera=camera, lookup="interpolate"))) == 1
