"""What fills space with density: one module each.

To add a shape of constant density, write a module with a `Homogeneous` subclass and its kernel header, and
list the class in ``SHAPES``.
"""

from typing import Any

from tfm_cl.errors import SceneError
from tfm_cl.model import unknown_key
from tfm_cl.scene.bodies.base import MOST_BODIES, Body
from tfm_cl.scene.bodies.box import BoxVolume
from tfm_cl.scene.bodies.everywhere import EverywhereVolume
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.sphere import SphereVolume
from tfm_cl.scene.bodies.volume import Volume

__all__ = [
    "MOST_BODIES",
    "SHAPES",
    "Body",
    "BoxVolume",
    "EverywhereVolume",
    "Homogeneous",
    "SphereVolume",
    "Volume",
    "parse_homogeneous",
]

SHAPES: dict[str, type[Homogeneous]] = {
    cls.model_fields["shape"].default: cls for cls in (BoxVolume, SphereVolume, EverywhereVolume)
}
"""Name in scene files -> class."""


def parse_homogeneous(values: dict[str, Any]) -> Homogeneous:
    """Make a homogeneous volume from a scene file's table with a ``shape``.

    Raises
    ------
    SceneError
        Unknown shape, unknown key or impossible value.
    """
    name = values.get("shape")
    if not isinstance(name, str) or name not in SHAPES:
        raise SceneError(f"volume.shape: {unknown_key(str(name), list(SHAPES)).replace('key', 'shape')}")
    return SHAPES[name].from_table(values)
