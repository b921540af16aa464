"""What fills space with density: one module each.

To add a shape of constant density, write a module with a `Homogeneous` subclass and its kernel header, and
list the class here.
"""

from tfm_cl.scene.bodies.base import MOST_BODIES, Body, MarchedBody
from tfm_cl.scene.bodies.box import BoxVolume
from tfm_cl.scene.bodies.curves import Curves
from tfm_cl.scene.bodies.everywhere import EverywhereVolume
from tfm_cl.scene.bodies.homogeneous import SHAPES, Homogeneous, parse_homogeneous
from tfm_cl.scene.bodies.points import Points
from tfm_cl.scene.bodies.polygons import Polygons
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.sphere import SphereVolume
from tfm_cl.scene.bodies.volume import Volume

__all__ = [
    "MOST_BODIES",
    "SHAPES",
    "Body",
    "BoxVolume",
    "Curves",
    "EverywhereVolume",
    "Homogeneous",
    "MarchedBody",
    "Points",
    "Polygons",
    "Primitives",
    "SphereVolume",
    "Volume",
    "parse_homogeneous",
]

SHAPES.update({cls.model_fields["shape"].default: cls for cls in (BoxVolume, SphereVolume, EverywhereVolume)})
