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
    from tfm_cl.camera import Camera
    from tfm_cl.errors import DeviceError, InputError, TfmError
    from tfm_cl.lights import SpotLight
    from tfm_cl.medium import Medium
    from tfm_cl.metrics import Comparison, compare
    from tfm_cl.phases import HenyeyGreenstein, Isotropic
    from tfm_cl.renderer import Renderer
    from tfm_cl.result import RenderResult
    from tfm_cl.scene import Scene
    from tfm_cl.settings import MapSettings, MarchSettings
    from tfm_cl.transmittance_map import TransmittanceMap
    from tfm_cl.volume import Volume

_HOME = {
    "Camera": "camera",
    "Comparison": "metrics",
    "DeviceError": "errors",
    "HenyeyGreenstein": "phases",
    "InputError": "errors",
    "Isotropic": "phases",
    "MapSettings": "settings",
    "MarchSettings": "settings",
    "Medium": "medium",
    "RenderResult": "result",
    "Renderer": "renderer",
    "Scene": "scene",
    "SpotLight": "lights",
    "TfmError": "errors",
    "TransmittanceMap": "transmittance_map",
    "Volume": "volume",
    "__version__": "_version",
    "compare": "metrics",
}
"""Public name -> module. Imported on first use: a program pays only for what it touches."""

__all__ = [
    "Camera",
    "Comparison",
    "DeviceError",
    "HenyeyGreenstein",
    "InputError",
    "Isotropic",
    "MapSettings",
    "MarchSettings",
    "Medium",
    "RenderResult",
    "Renderer",
    "Scene",
    "SpotLight",
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
