"""What primitives leave at the points of the lattice of later orders."""

import numpy as np
import pytest
from scenes import make_scene
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.plan.deposits import deposited
from tfm_cl.plan.orders import lattice_of

MEDIUM = tfm.Medium(sigma_s=2.0, orders=2)
CORNERS = [[0, 0, 0], [1, 0, 0.2], [0.3, 1, 0.1], [1.2, 0.8, -0.4]]
BODIES = {
    "ball": tfm.Points(CORNERS, [0.01, 0.3, 0.5, 0.02], [3, 0.5, 1, 7], profile="ball"),
    "smooth": tfm.Points(CORNERS, 0.4, 2.0, profile="smooth"),
    "strands": tfm.Curves(CORNERS, [4], 0.05, opacity=0.7),
    "leaves": tfm.Polygons(CORNERS, [[0, 1, 2], [1, 2, 3]], 0.9),
}


@pytest.mark.parametrize("name", BODIES)
def test_all_of_it_is_there(name):
    """Wherever points are, the density that light from all sides meets adds up, about where its middle is."""
    body = BODIES[name]
    scene = make_scene(volume=body, medium=MEDIUM)
    lattice = lattice_of(scene)
    (found,) = deposited(scene, lattice, is_grey=True)
    held = body.held(2.0)
    assert found.shape == (1, *lattice.size[::-1])
    assert found.sum() * lattice.spacing**3 == pytest.approx(held.sum(), rel=ROUNDED)
    places = [
        low + lattice.spacing * np.arange(n) for low, n in zip(lattice.origin, lattice.size, strict=True)
    ]
    middle = [
        (found[0].sum(axis=tuple({0, 1, 2} - {2 - axis})) @ places[axis]) / found.sum() for axis in range(3)
    ]
    np.testing.assert_allclose(middle, held @ body.positions / held.sum(), atol=1e-9)


def test_colours_and_media_are_apart():
    points = tfm.Points(CORNERS[:2], 0.1, 1.0, colour=[[1, 0.5, 0], [0, 0.5, 1]])
    other = tfm.Points(CORNERS[2:3], 0.1, 2.0, medium=tfm.Medium(sigma_s=0.1))
    scene = make_scene(volume=[points, other], medium=MEDIUM)
    lattice = lattice_of(scene)
    found = deposited(scene, lattice, is_grey=False).sum(axis=(2, 3, 4)) * lattice.spacing**3
    np.testing.assert_allclose(found[0], points.held(2.0) @ points.colour)
    np.testing.assert_allclose(found[1], np.repeat(other.held(0.1), 3))


def test_what_is_opaque_takes_no_more_than_it_covers():
    leaf = BODIES["leaves"]
    opaque = tfm.Polygons(CORNERS, [[0, 1, 2], [1, 2, 3]], 1.0)
    covers = leaf.areas.sum() / 2
    assert leaf.held(2.0).sum() * 2.0 == pytest.approx(0.9 * covers)
    assert opaque.held(2.0).sum() * 2.0 == pytest.approx(covers, rel=1e-3)
    thin, thick = (tfm.Points([[0, 0, 0]], 0.5, density, profile="ball").held(1.0) for density in (1e-6, 1e6))
    assert thin / 1e-6 == pytest.approx(4 / 3 * np.pi * 0.5**3, rel=1e-5)
    assert thick == pytest.approx(np.pi * 0.5**2)
