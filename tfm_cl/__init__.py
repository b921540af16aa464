"""tfm_cl: single scattering in voxel volumes through transmittance function maps, on OpenCL.

>>> import tfm_cl as tfm
>>> scene = tfm.Scene.load("volumes/cumulus.toml")          # doctest: +SKIP
>>> with tfm.Renderer() as renderer:                         # doctest: +SKIP
...     renderer.render(scene).save("cumulus.exr")
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tfm_cl._version import __version__
    from tfm_cl.ambient import Ambient
    from tfm_cl.camera import Camera
    from tfm_cl.errors import DeviceError, InputError, TfmError
    from tfm_cl.homogeneous import BoxVolume, EverywhereVolume, SphereVolume
    from tfm_cl.lights import EnvironmentLight, PointLight, SpotLight, SunLight
    from tfm_cl.medium import Medium
    from tfm_cl.metrics import Comparison, compare
    from tfm_cl.phases import HenyeyGreenstein, Isotropic
    from tfm_cl.renderer import Renderer
    from tfm_cl.result import RenderResult
    from tfm_cl.scene import Scene
    from tfm_cl.settings import MapSettings, MarchSettings, ShadowSettings
    from tfm_cl.solids import BoxSolid, MeshSolid, PlaneSolid, SphereSolid
    from tfm_cl.transmittance_map import TransmittanceMap
    from tfm_cl.volume import Volume

_HOME = {
    "Ambient": "ambient",
    "BoxSolid": "solids",
    "BoxVolume": "homogeneous",
    "Camera": "camera",
    "Comparison": "metrics",
    "DeviceError": "errors",
    "EnvironmentLight": "lights",
    "EverywhereVolume": "homogeneous",
    "HenyeyGreenstein": "phases",
    "InputError": "errors",
    "Isotropic": "phases",
    "MapSettings": "settings",
    "MarchSettings": "settings",
    "Medium": "medium",
    "MeshSolid": "solids",
    "PlaneSolid": "solids",
    "PointLight": "lights",
    "RenderResult": "result",
    "Renderer": "renderer",
    "Scene": "scene",
    "ShadowSettings": "settings",
    "SphereSolid": "solids",
    "SphereVolume": "homogeneous",
    "SpotLight": "lights",
    "SunLight": "lights",
    "TfmError": "errors",
    "TransmittanceMap": "transmittance_map",
    "Volume": "volume",
    "__version__": "_version",
    "compare": "metrics",
}
"""Public name -> module. Imported on first use: a program pays only for what it touches."""

__all__ = [
    "Ambient",
    "BoxSolid",
    "BoxVolume",
    "Camera",
    "Comparison",
    "DeviceError",
    "EnvironmentLight",
    "EverywhereVolume",
    "HenyeyGreenstein",
    "InputError",
    "Isotropic",
    "MapSettings",
    "MarchSettings",
    "Medium",
    "MeshSolid",
    "PlaneSolid",
    "PointLight",
    "RenderResult",
    "Renderer",
    "Scene",
    "ShadowSettings",
    "SphereSolid",
    "SphereVolume",
    "SpotLight",
    "SunLight",
    "TfmError",
    "TransmittanceMap",
    "Volume",
    "__version__",
    "compare",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tfm_cl' has no attribute '{name}'")
    return getattr(importlib.import_module(f"tfm_cl.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
