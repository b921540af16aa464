"""Where light from all around is looked up, and how fine its maps are."""

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl.plan import resolution, surroundings
from tfm_cl.plan.plan import plan
from tfm_cl.plan.surroundings import ERROR_PER_DEPTH, TOLERATED, VOXELS_APART, lattice_of, share_of

CAMERA = tfm.Camera(from_=(0, 0, 6), to=(0, 0, 0), res=(640, 480))
SKY = tfm.EnvironmentLight(samples=16, intensity=0.05)
SUN = tfm.SunLight(from_=(1, 3, 0.5), to=(0, 0, 0))
VOXEL = 0.05


def a_grid(depth=0.3):
    """Whose typical voxel has an optical depth along its edges."""
    grid = tfm.Volume(blobs((40, 40, 40)), voxel_size=VOXEL, origin=(-1, -1, -1))
    return grid.with_density_scale(depth / VOXEL / grid.typical_density)


def scene_of(lights=(SKY, SUN), volume=None, camera=CAMERA, march=None, **of_map):
    return tfm.Scene(
        a_grid() if volume is None else volume,
        camera=camera,
        lights=lights,
        map=tfm.MapSettings(**{"res": "auto", "steps": "auto"} | of_map),
        march=march or tfm.MarchSettings(steps="auto"),
    )


def lookup_of(scene, **how):
    decision = plan(scene, **how).decisions["light.0.lookup"]
    return decision.value, decision.why


def test_a_dim_sky_of_many_parts_is_at_points():
    value, why = lookup_of(scene_of())
    assert value == "points"
    assert why.endswith("of the light is from all around")
    (sky, _) = plan(scene_of()).scene.lights
    assert sky.lookup == "points"
    assert all(part.is_at_points for part in sky.parts())
    assert lookup_of(scene_of(), method="dual") == ("samples", "light is marched there")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"res": 64}, 'map.res = 64: points are for maps where it is "auto"'),
        ({"lookup": "interpolate"}, 'map.lookup = interpolate: points are for maps where it is "auto"'),
        ({"max_error": 0.01}, "map.max_error = 0.01 is of maps that are looked up there"),
        ({"lights": [SKY.replace(samples=7), SUN]}, "only 7 parts"),
        (
            {"lights": [SKY, SUN.replace(intensity=0.01)]},
            "98% of the light is from all around: points would be nearer than voxels",
        ),
        ({"camera": CAMERA.replace(from_=(0, 0, 1.0))}, "the camera is as near as points"),
        (
            {"camera": CAMERA.replace(res=(32, 24))},
            "the picture has fewer samples",
        ),
        (
            {"march": tfm.MarchSettings(steps="auto", attenuation="paper")},
            'march.attenuation = "paper" knows samples only',
        ),
        (
            {"volume": [a_grid(), tfm.Points(np.zeros((1, 3)), radius=0.1)]},
            "points, curves and polygons are finer than a lattice",
        ),
        ({"volume": tfm.BoxVolume(from_=(-1, -1, -1), to=(1, 1, 1))}, "no grid scatters"),
    ],
)
def test_it_is_looked_up_at_every_sample(changes, why):
    found = lookup_of(scene_of(**changes))
    assert found[0] == "samples"
    assert found[1].startswith(why)


def with_a_sun_in_it(folder):
    """A grey image, and one pixel that brings as much as all others."""
    image = np.full((32, 64, 3), 0.01, np.float32)
    image[8, 20] = 40
    np.save(folder / "sun.npy", image)
    return SKY.replace(texture=str(folder / "sun.npy"), intensity=1)


@pytest.mark.parametrize(
    ("has_sun", "visible", "why"),
    [
        (False, True, ""),
        (True, True, "solids throw shadows"),
        (False, False, "of solids that the camera does not see"),
    ],
)
def test_shadows_of_solids_that_are_seen_keep_it_from_points(tmp_path, has_sun, visible, why):
    light = with_a_sun_in_it(tmp_path) if has_sun else SKY
    scene = scene_of([light, SUN.replace(intensity=9)])
    assert lookup_of(scene)[0] == "points"
    ball = tfm.SphereSolid(centre=(0, 0, 0), radius=0.2, visible=visible)
    value, found = lookup_of(scene.replace(solids=[ball]))
    assert value == ("samples" if why else "points")
    assert why in found


def test_what_is_asked_for_stays():
    asked = [SKY.replace(lookup="points", map_res=96, points_apart=0.07), SUN]
    planned = plan(scene_of(asked, res=64, lookup="interpolate"))
    assert planned.scene.lights[0] == asked[0]
    assert not {f"light.0.{key}" for key in surroundings.KEYS} & planned.decisions.keys()


def test_points_are_as_far_apart_as_asked_for():
    """Also of the parts, which lights are when they are rendered; the least of several lights counts."""
    lights = [SKY.replace(points_apart=0.07), SKY.replace(points_apart=0.08, samples=9), SUN]
    scene = plan(scene_of(lights)).scene
    single = scene.replace(lights=[part for light in scene.lights for part in light.parts()])
    assert lattice_of(scene)[0].spacing == lattice_of(single)[0].spacing == 0.07
    assert single.lights[0].replace(intensity=2).asked_apart == 0.07


def test_how_far_points_are_apart_is_decided_where_there_are_any():
    planned = plan(scene_of())
    value, why = planned.decisions["light.0.points_apart"]
    assert value == planned.scene.lights[0].points_apart == lattice_of(scene_of())[0].spacing
    assert why == "1.75 voxels, as 39% of the light is from all around"
    assert "light.0.points_apart" not in plan(scene_of(max_error=0.01)).decisions


def test_maps_of_a_size_that_is_asked_for_have_parts_of_at_most_that_of_old():
    assert plan(scene_of(res=64)).scene.lights[0].map_res == 256


@pytest.mark.parametrize("intensity", [0.01, 0.05, 0.2])
def test_points_are_as_near_as_the_share_of_the_light_asks_for(intensity):
    scene = scene_of([SKY.replace(intensity=intensity), SUN])
    sky = 4 * np.pi * intensity
    assert share_of(scene) == pytest.approx(sky / (sky + 1))
    lattice, _ = lattice_of(scene)
    least, most = (voxels * VOXEL for voxels in VOXELS_APART)
    tolerated = TOLERATED / ERROR_PER_DEPTH / max(round(share_of(scene), 1), 0.1) * VOXEL / 0.3
    assert lattice.spacing <= max(min(tolerated, most), least) * (1 + 1e-9)
    assert lattice.spacing > max(min(tolerated, most), least) - VOXEL / 4


def test_points_lie_around_all_that_has_density_and_stay_where_they_are():
    """As far as a volume that changes reaches."""
    values = blobs((40, 40, 40))
    values[:, :, :13] = 0
    scale = a_grid().density_scale
    smaller = tfm.Volume(values, voxel_size=VOXEL, origin=(-1, -1, -1), density_scale=scale)
    (one, _), (other, _) = lattice_of(scene_of()), lattice_of(scene_of(volume=smaller))
    low, high = scene_of().occupied_bounds
    assert (np.array(one.origin) <= low).all()
    assert (np.array(one.origin) + one.spacing * (np.array(one.size) - 1) >= high).all()
    assert one.spacing == other.spacing
    assert other.size < one.size
    steps = (np.array(other.origin) - one.origin) / one.spacing
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_texels_are_as_wide_as_points_are_apart():
    scene = plan(scene_of()).scene
    lattice, _ = lattice_of(scene)
    bounds = scene.occupied_bounds
    widest = max(part.fitted(bounds).footprint(0) for part in scene.lights[0].parts())
    assert scene.lights[0].map_res == max(32 * np.ceil(widest / lattice.spacing / 32), 64)


def test_too_many_points_lie_further_apart(monkeypatch):
    monkeypatch.setattr(surroundings, "MOST_POINTS", 1000)
    lattice, why = lattice_of(scene_of())
    assert lattice.points <= 1000
    assert "as near as 1,000 points allow" in why


def test_lights_at_points_are_on_no_lattice_of_voxels():
    suns = [SUN, SUN.replace(from_=(-1, 2, 3)), SUN.replace(from_=(2, 1, -1))]
    planned = plan(scene_of([SKY, *suns], volume=a_grid(0.1)))
    assert planned.scene.lights[0].lookup == "points"
    assert planned.scene.map.lookup == "lattice"
    assert plan(planned.scene).scene.lights == planned.scene.lights


def test_numbers_are_decided_elsewhere_too():
    assert resolution.resolved(scene_of()).lights == plan(scene_of()).scene.lights


def test_points_that_are_too_far_apart_are_not_taken(monkeypatch):
    monkeypatch.setattr(surroundings, "MOST_POINTS", 1000)
    value, why = lookup_of(scene_of())
    assert (value, why.partition(", ")[2]) == ("samples", "as near as 1,000 points allow")
