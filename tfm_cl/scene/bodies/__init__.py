"""What fills space with density: one module each.

To add a shape of constant density, write a module with a `Homogeneous` subclass and its kernel header; for a
kind of primitives a `Primitives` subclass, its header, and `PrimitiveSettings`. List the classes here.
"""

from tfm_cl.scene.bodies.base import BODIES, MOST_BODIES, Body, MarchedBody
from tfm_cl.scene.bodies.box import BoxVolume
from tfm_cl.scene.bodies.curves import Curves
from tfm_cl.scene.bodies.everywhere import EverywhereVolume
from tfm_cl.scene.bodies.homogeneous import SHAPES, Homogeneous, parse_homogeneous
from tfm_cl.scene.bodies.points import Points
from tfm_cl.scene.bodies.polygons import Polygons
from tfm_cl.scene.bodies.primitive_settings import CurvesSettings, PointsSettings, PolygonsSettings
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.sphere import SphereVolume
from tfm_cl.scene.bodies.volume import Volume

__all__ = [
    "BODIES",
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
BODIES["shape"] = parse_homogeneous
BODIES.update({cls.KEY: cls.from_table for cls in (PointsSettings, CurvesSettings, PolygonsSettings)})
