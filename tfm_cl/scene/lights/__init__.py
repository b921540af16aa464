"""Lights, one module per kind.

To add one, write a module with a `Light` subclass and its kernel header, and add the class to
``LIGHTS``.
"""

from typing import Any

from tfm_cl.errors import SceneError
from tfm_cl.model import unknown_key
from tfm_cl.scene.lights.base import Arrival, Light, LightFrame
from tfm_cl.scene.lights.environment import EnvironmentLight
from tfm_cl.scene.lights.point import PointLight
from tfm_cl.scene.lights.spot import SpotLight
from tfm_cl.scene.lights.sun import SunLight

LIGHTS: dict[str, type[Light]] = {
    cls.model_fields["type"].default: cls for cls in (SpotLight, SunLight, PointLight, EnvironmentLight)
}
"""The light classes by their names in scene files."""

__all__ = [
    "LIGHTS",
    "Arrival",
    "EnvironmentLight",
    "Light",
    "LightFrame",
    "PointLight",
    "SpotLight",
    "SunLight",
    "parse_light",
]


def parse_light(values: dict[str, Any]) -> Light:
    """Make a light from a scene file's table; ``type`` defaults to ``spot``.

    Raises
    ------
    SceneError
        Unknown type, unknown key or impossible value.
    """
    name = values.get("type", "spot")
    if not isinstance(name, str) or name not in LIGHTS:
        raise SceneError(f"light.type: {unknown_key(str(name), list(LIGHTS)).replace('key', 'light')}")
    return LIGHTS[name].from_table(values)
