"""Lights, one module per kind.

To add one, write a module with a `Light` subclass and its kernel header, and list the class here.
"""

from tfm_cl.scene.lights.base import LIGHTS, Arrival, Light, LightFrame, parse_light
from tfm_cl.scene.lights.environment import EnvironmentLight
from tfm_cl.scene.lights.point import PointLight
from tfm_cl.scene.lights.sky import SkyLight
from tfm_cl.scene.lights.spot import SpotLight
from tfm_cl.scene.lights.sun import SunLight

LIGHTS.update(
    {
        cls.model_fields["type"].default: cls
        for cls in (SpotLight, SunLight, PointLight, EnvironmentLight, SkyLight)
    }
)

__all__ = [
    "LIGHTS",
    "Arrival",
    "EnvironmentLight",
    "Light",
    "LightFrame",
    "PointLight",
    "SkyLight",
    "SpotLight",
    "SunLight",
    "parse_light",
]
