"""Lights, one module per kind.

To add one, write a module with a `Light` subclass and its kernel header, and list the class here.
"""

from tfm_cl.plugins import register_class, register_installed
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
    "register_light",
]


def register_light(cls: type[Light]) -> None:
    """Add a kind of light, which scene files then take by its ``type``.

    Parameters
    ----------
    cls
        A class of `Light` whose ``type`` has its name as default, and whose ``HEADER`` is the whole path of a
        file.

    Raises
    ------
    InputError
        It is no such class, its name is taken, or its header is not there.
    """
    register_class("light", cls, Light, "type", LIGHTS)


register_installed("lights", lambda _name, cls: register_light(cls))
