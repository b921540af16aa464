"""Solids: opaque, diffuse surfaces that block rays and receive light; one module per kind.

To add a shape, write a module with an `AnalyticSolid` subclass and add the class to ``SOLIDS``.
"""

from typing import Any

from tfm_cl.errors import InputError, SceneError, unknown_key
from tfm_cl.plugins import claim, register_installed
from tfm_cl.scene.solids.base import AnalyticSolid, Solid
from tfm_cl.scene.solids.box import BoxSolid
from tfm_cl.scene.solids.ground import GroundSolid
from tfm_cl.scene.solids.mesh import MeshSolid
from tfm_cl.scene.solids.plane import PlaneSolid
from tfm_cl.scene.solids.sphere import SphereSolid

SOLIDS: dict[str, type[AnalyticSolid]] = {
    cls.model_fields["shape"].default: cls for cls in (PlaneSolid, SphereSolid, BoxSolid, GroundSolid)
}
"""The analytic shapes by their names in scene files; any other solid is a mesh."""

__all__ = [
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


def parse_solid(values: dict[str, Any]) -> Solid:
    """Make a solid from a scene file's table, which has either ``mesh`` or ``shape``.

    Raises
    ------
    SceneError
        Neither or both of the two, an unknown shape or key, or an impossible value.
    """
    if "mesh" in values and "shape" in values:
        raise SceneError("solid: has both mesh and shape; remove one of them")
    if "mesh" in values:
        return MeshSolid.from_table(values)
    if "shape" not in values:
        known = ["mesh", *(key for key in MeshSolid.keys() if key != "mesh"), "shape"]  # noqa: SIM118 - no dict
        known += [key for cls in SOLIDS.values() for key in cls.keys() if key not in known]  # noqa: SIM118
        strange = next((key for key in values if key not in known), None)
        if strange is not None:
            raise SceneError(unknown_key(str(strange), known, "solid"))
        raise SceneError(f"solid: should have mesh (a file) or shape ({', '.join(SOLIDS)})")
    shape = values["shape"]
    if not isinstance(shape, str) or shape not in SOLIDS:
        raise SceneError(f"solid.shape: {unknown_key(str(shape), list(SOLIDS)).replace('key', 'shape', 1)}")
    return SOLIDS[shape].from_table(values)


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
    found: object = cls
    if not isinstance(found, type) or not issubclass(found, AnalyticSolid):
        raise InputError(f"a solid should be a class of tfm_cl.AnalyticSolid; got {found!r:.80}")
    name = cls.model_fields["shape"].default
    if not isinstance(name, str):
        raise InputError(f"{cls.__name__}: shape should be Literal[NAME] with that name as default")
    claim("solid", name, SOLIDS)
    SOLIDS[name] = cls


def _register(_name: str, cls: Any) -> None:
    register_solid(cls)


register_installed("solids", _register)
