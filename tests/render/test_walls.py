"""What the rays that sweep a lattice meet: numbered alike however many surfaces are looked at at once."""

import numpy as np
from scenes import make_scene

from tfm_cl.plan.orders import Lattice
from tfm_cl.render import walls
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.solids import PlaneSolid, SphereSolid

SOLIDS = [
    PlaneSolid(point=(0, -0.7, 0), albedo=(0.2, 0.4, 0.6)),
    SphereSolid(centre=(0.1, 0, 0.2), radius=0.3),
]
LATTICE = Lattice((-0.5, -0.5, -0.5), 0.1, (11, 11, 11), 1, "a test")
WAYS = np.array([[1.0, 0, 0], [0, -1, 0], [0.6, 0, 0.8], [0.48, -0.64, -0.6]])


def test_patches_are_the_same_in_parts(monkeypatch):
    def found():
        scene = make_scene(solids=SOLIDS)
        return walls.walls_of(Tracer(SOLIDS), scene, LATTICE, {1: (WAYS, np.full(4, np.pi))})

    whole = found()
    monkeypatch.setattr(walls, "NAMED", 7)
    parts = found()
    assert len(whole.points) > 20
    for name in ("points", "normals", "albedo"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    for one, other in zip(parts.met[1], whole.met[1], strict=True):
        for values, expected in zip(one, other, strict=True):
            np.testing.assert_array_equal(values, expected)
    # Each patch has its own name, and each is met.
    met = np.concatenate([np.r_[one.arrives, one.departs] for one in whole.met[1]])
    assert set(met) == {walls.NO_PATCH, *range(len(whole.points))}
