"""Primitives that leave all they hold at their own depth, against closed forms and the reference."""

import numpy as np
import pytest
from scenes import blobs
from tolerances import PASS

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.constants import OWN_DEPTH_ROWS
from tfm_cl.device.structs.bodies import BOX_MARGIN
from tfm_cl.errors import SceneError
from tfm_cl.maps.resolved import resolve
from tfm_cl.plan.plan import plan
from tfm_cl.scene.solids import PlaneSolid

ROW = 1 / OWN_DEPTH_ROWS
"""Of a ray's range: between the rows of a basis's table functionals are interpolated. The error of one that
bends is at most its second derivative over 8 rows squared; that of one with a step, the step within a row."""
SPLIT = 2e-6
"""Sums of a hundred terms in another order."""
FINE = 5e-3
"""Of the mean of 1 - T: depths are told apart by 1/512 of the range, or by 1/1024."""

SUN = tfm.SunLight(from_=(0, 0, 9), to=(0, 0, 0))
WHITE = tfm.Medium(sigma_s=1.0)


def settings_of(basis="fourier", coeffs=7, **changes):
    given = {"res": 32, "steps": 40, "fit": "l2", "range": "box", "deposits": "depth"} | changes
    return tfm.MapSettings(basis=basis, coeffs=coeffs, **given)


def some_points(rng, count=100, **changes):
    """Of which none is widened."""
    return tfm.Points(
        rng.uniform(-1, 1, (count, 3)), rng.uniform(0.3, 0.5, count), rng.uniform(0.05, 0.3, count), **changes
    )


def in_order_of_depth(light_map, points):
    """Ranges of the texels' rays, and of every crossing: the ray, v, and the optical depth, in float64."""
    rays = reference.texel_rays(light_map.light, light_map.settings.res)
    begin, end = reference.march_bounds(points, *rays, margin=light_map.medium.margin)
    ray, distance, held = reference.primitives.meet(points, rays).whole()
    return ray, (distance - begin[ray]) / (end - begin)[ray], held[:, 0]


@pytest.mark.lanes
def test_fourier_numbers_are_sums_over_the_points(renderer, rng):
    points = some_points(rng)
    (light_map,) = renderer.build_maps(tfm.Scene(points, WHITE, lights=[SUN], map=settings_of()))
    ray, v, held = in_order_of_depth(light_map, points)

    for j in range(7):
        k = (j + 1) // 2
        at = np.ones_like(v) if j == 0 else 2 * (np.cos if j % 2 else np.sin)(2 * np.pi * k * v)
        expected = np.bincount(ray, held * at, 32 * 32).reshape(32, 32)
        total = np.bincount(ray, held, 32 * 32).reshape(32, 32)
        turn = 2 * np.pi * k
        # Steps' means are less than the values at their middles: by a third as much again.
        allowed = (PASS + 2 * turn * BOX_MARGIN + 2 * (turn * ROW) ** 2 / 6) * total
        assert total.max() > 0.3
        assert (np.abs(light_map.coefficients[..., j] - expected) <= allowed + PASS).all(), j


@pytest.mark.slow
@pytest.mark.parametrize(
    ("basis", "coeffs"),
    [
        ("hcos", 6),
        ("legendre", 6),
        ("slices", 8),
        ("wavelets", 8),
        ("piecewise", 8),
        ("moments", 7),
        ("trig-moments", 5),
    ],
)
def test_every_linear_basis_is_that_of_many_steps(renderer, rng, basis, coeffs):
    """Of leaves, which are crossed in one place."""
    leaves = tfm.Polygons(rng.uniform(-1, 1, (60, 3)), np.arange(60).reshape(-1, 3), 0.5)
    direct, marched = (
        renderer.build_maps(
            tfm.Scene(leaves, WHITE, lights=[SUN], map=settings_of(basis, coeffs, steps=512, deposits=kind))
        )[0]
        for kind in ("depth", "steps")
    )
    hits = direct.coefficients.any(axis=-1)

    assert hits.mean() > 0.2
    one, other = (transmittances(each, np.linspace(0.05, 1 - 1e-6, 20)) for each in (direct, marched))
    assert other.min() < 0.5
    assert np.abs(one - other).mean() < FINE * (1 - other).mean()


def transmittances(light_map, v):
    """T [texels, v] that a map tells along the rays through its texels."""
    res = light_map.settings.res
    rays = reference.texel_rays(light_map.light, res)
    (body,) = light_map.bodies
    begin, end = reference.march_bounds(body, *rays, margin=light_map.medium.margin)
    return np.stack([light_map.evaluate(rays.at(begin + (end - begin) * at)) for at in v], axis=-1)


@pytest.mark.slow
def test_a_mixture_of_grids_strands_and_solids_is_the_reference(renderer, rng):
    points = some_points(rng, 40, colour=rng.uniform(0.3, 1, (40, 3)))
    grid = tfm.Volume(blobs(), medium=tfm.Medium(sigma_s=(1, 0.6, 0.3)))
    leaves = tfm.Polygons(rng.uniform(-1, 1, (60, 3)), np.arange(60).reshape(-1, 3), 0.5)
    wall = PlaneSolid(point=(0, 0, -0.2), normal=(0.3, 0, 1))
    scene = tfm.Scene(
        [points, grid, leaves], WHITE, lights=[SUN], solids=[wall], map=settings_of("legendre", 6, res=64)
    )

    for light_map in renderer.build_maps(scene):
        expected = reference.build_map(scene, SUN, like=light_map)
        apart = np.abs(light_map.coefficients - expected)
        # The steepest of the polynomials changes by (2 j + 1) j (j + 1) at an end of the range; rays at edges
        # of leaves round to either side.
        assert np.quantile(apart, 0.99) <= 11 * 30 * ROW * np.abs(expected).max()
        assert np.median(apart) <= 1e-3 * np.abs(expected).max()
        assert (expected.reshape(-1, 6)[:, 0] > 0.1).mean() > 0.1


@pytest.mark.slow
def test_order_does_not_matter(renderer, rng):
    points = some_points(rng)
    mixed = rng.permutation(len(points.positions))
    shuffled = tfm.Points(points.positions[mixed], points.radii[mixed], points.densities[mixed])
    one, other = (
        renderer.build_maps(tfm.Scene(body, WHITE, lights=[SUN], map=settings_of()))[0].coefficients
        for body in (points, shuffled)
    )

    assert np.abs(one - other).max() <= SPLIT * np.abs(one).max()


def test_density_begins_and_ends_where_points_do(renderer):
    points = tfm.Points([(0.1, 0, 0.4), (0.1, 0, -0.5)], [0.3, 0.2], 1.0)
    (light_map,) = renderer.build_maps(tfm.Scene(points, WHITE, lights=[SUN], map=settings_of(res=64)))
    begin, end = light_map.occupied[..., 0], light_map.occupied[..., 1]
    origin = light_map.light.frame().world_from_light[2, 3]

    # The texel that is nearest passes the middles by at most half of its diagonal.
    assert origin - begin[begin > 0].min() == pytest.approx(0.7, abs=0.01)
    assert origin - end.max() == pytest.approx(-0.7, abs=0.01)


def test_opaque_points_stay_finite(renderer):
    points = tfm.Points(np.zeros((50, 3)), 0.5, 1e25)
    (light_map,) = renderer.build_maps(tfm.Scene(points, WHITE, lights=[SUN], map=settings_of()))

    assert np.isfinite(light_map.coefficients).all()
    assert light_map.coefficients[..., 0].max() > 1e20


@pytest.mark.parametrize(
    "settings", [{"basis": "klt"}, {"basis": "nodes"}, {"basis": "fourier", "fit": "visibility"}]
)
def test_needs_numbers_that_are_linear_in_density(settings):
    with pytest.raises(SceneError, match=r"map.deposits = 'depth': .*linear in the density"):
        resolve(tfm.MapSettings(deposits="depth", **settings))


def test_needs_primitives():
    scene = tfm.Scene(tfm.Volume(blobs()), WHITE, lights=[SUN], map=settings_of())

    with pytest.raises(SceneError, match=r"map.deposits = 'depth': .* has none; leave it out"):
        plan(scene)
    plan(scene, method="dual")  # without maps
