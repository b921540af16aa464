"""Solids: opaque, diffuse surfaces that block rays and receive light; one module per kind.

To add a shape, write a module with an `AnalyticSolid` subclass and list the class here.
"""

from tfm_cl.plugins import register_class, register_installed
from tfm_cl.scene.solids.base import MESHES, SOLIDS, AnalyticSolid, Solid, parse_solid
from tfm_cl.scene.solids.box import BoxSolid
from tfm_cl.scene.solids.ground import GroundSolid
from tfm_cl.scene.solids.mesh import MeshSolid
from tfm_cl.scene.solids.plane import PlaneSolid
from tfm_cl.scene.solids.sphere import SphereSolid

SOLIDS.update(
    {cls.model_fields["shape"].default: cls for cls in (PlaneSolid, SphereSolid, BoxSolid, GroundSolid)}
)
MESHES["mesh"] = MeshSolid

__all__ = [
    "MESHES",
    "SOLIDS",
    "AnalyticSolid",
    "BoxSolid",
    "GroundSolid",
    "MeshSolid",
    "PlaneSolid",
    "Solid",
    "SphereSolid",
    "parse_solid",
    "register_solid",
]


def register_solid(cls: type[AnalyticSolid]) -> None:
    """Add a kind of solid, which scene files then take by its ``shape``.

    Parameters
    ----------
    cls
        A class of `AnalyticSolid` whose ``shape`` has its name as default.

    Raises
    ------
    InputError
        It is no such class, or its name is taken.
    """
    register_class("solid", cls, AnalyticSolid, "shape", SOLIDS)


register_installed("solids", lambda _name, cls: register_solid(cls))
