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
    from tfm_cl.errors import DeviceError, InputError, TfmError, TfmWarning
    from tfm_cl.files.image_io import register_image_format
    from tfm_cl.files.volume_io import register_volume_format
    from tfm_cl.maps.bases import Basis, register_basis
    from tfm_cl.maps.transmittance_map import TransmittanceMap
    from tfm_cl.metrics import Comparison
    from tfm_cl.plugins import load_plugin
    from tfm_cl.render.comparison import compare
    from tfm_cl.render.renderer import Renderer
    from tfm_cl.render.result import RenderResult
    from tfm_cl.scene.ambient import Ambient
    from tfm_cl.scene.bodies import (
        BoxVolume,
        Curves,
        EverywhereVolume,
        Points,
        Polygons,
        SphereVolume,
        Volume,
    )
    from tfm_cl.scene.camera import Camera
    from tfm_cl.scene.lights import (
        EnvironmentLight,
        Light,
        PointLight,
        SkyLight,
        SpotLight,
        SunLight,
        register_light,
    )
    from tfm_cl.scene.medium import Medium
    from tfm_cl.scene.phases import (
        DoubleHenyeyGreenstein,
        Draine,
        FournierForand,
        HenyeyGreenstein,
        Isotropic,
        KajiyaKay,
        Mie,
        Phase,
        PhaseMixture,
        Rayleigh,
        TabulatedPhase,
        register_phase,
    )
    from tfm_cl.scene.scene import Scene
    from tfm_cl.scene.settings import MapSettings, MarchSettings, ShadowSettings
    from tfm_cl.scene.solids import (
        AnalyticSolid,
        BoxSolid,
        GroundSolid,
        MeshSolid,
        PlaneSolid,
        SphereSolid,
        register_solid,
    )
    from tfm_cl.sequence.shot import Shot
    from tfm_cl.viewer.widget import view

_HOME = {
    "Ambient": "scene.ambient",
    "AnalyticSolid": "scene.solids",
    "Basis": "maps.bases",
    "BoxSolid": "scene.solids",
    "BoxVolume": "scene.bodies",
    "Camera": "scene.camera",
    "Comparison": "metrics",
    "Curves": "scene.bodies",
    "DeviceError": "errors",
    "DoubleHenyeyGreenstein": "scene.phases",
    "Draine": "scene.phases",
    "EnvironmentLight": "scene.lights",
    "EverywhereVolume": "scene.bodies",
    "FournierForand": "scene.phases",
    "GroundSolid": "scene.solids",
    "HenyeyGreenstein": "scene.phases",
    "InputError": "errors",
    "Isotropic": "scene.phases",
    "KajiyaKay": "scene.phases",
    "Light": "scene.lights",
    "MapSettings": "scene.settings",
    "MarchSettings": "scene.settings",
    "Medium": "scene.medium",
    "MeshSolid": "scene.solids",
    "Mie": "scene.phases",
    "Phase": "scene.phases",
    "PhaseMixture": "scene.phases",
    "PlaneSolid": "scene.solids",
    "PointLight": "scene.lights",
    "Points": "scene.bodies",
    "Polygons": "scene.bodies",
    "Rayleigh": "scene.phases",
    "RenderResult": "render.result",
    "Renderer": "render.renderer",
    "Scene": "scene.scene",
    "ShadowSettings": "scene.settings",
    "Shot": "sequence.shot",
    "SkyLight": "scene.lights",
    "SphereSolid": "scene.solids",
    "SphereVolume": "scene.bodies",
    "SpotLight": "scene.lights",
    "SunLight": "scene.lights",
    "TabulatedPhase": "scene.phases",
    "TfmError": "errors",
    "TfmWarning": "errors",
    "TransmittanceMap": "maps.transmittance_map",
    "Volume": "scene.bodies",
    "__version__": "_version",
    "compare": "render.comparison",
    "load_plugin": "plugins",
    "register_basis": "maps.bases",
    "register_image_format": "files.image_io",
    "register_light": "scene.lights",
    "register_phase": "scene.phases",
    "register_solid": "scene.solids",
    "register_volume_format": "files.volume_io",
    "view": "viewer.widget",
}
"""Public name -> module. Imported on first use: a program pays only for what it touches."""

__all__ = [
    "Ambient",
    "AnalyticSolid",
    "Basis",
    "BoxSolid",
    "BoxVolume",
    "Camera",
    "Comparison",
    "Curves",
    "DeviceError",
    "DoubleHenyeyGreenstein",
    "Draine",
    "EnvironmentLight",
    "EverywhereVolume",
    "FournierForand",
    "GroundSolid",
    "HenyeyGreenstein",
    "InputError",
    "Isotropic",
    "KajiyaKay",
    "Light",
    "MapSettings",
    "MarchSettings",
    "Medium",
    "MeshSolid",
    "Mie",
    "Phase",
    "PhaseMixture",
    "PlaneSolid",
    "PointLight",
    "Points",
    "Polygons",
    "Rayleigh",
    "RenderResult",
    "Renderer",
    "Scene",
    "ShadowSettings",
    "Shot",
    "SkyLight",
    "SphereSolid",
    "SphereVolume",
    "SpotLight",
    "SunLight",
    "TabulatedPhase",
    "TfmError",
    "TfmWarning",
    "TransmittanceMap",
    "Volume",
    "__version__",
    "compare",
    "load_plugin",
    "register_basis",
    "register_image_format",
    "register_light",
    "register_phase",
    "register_solid",
    "register_volume_format",
    "view",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tfm_cl' has no attribute '{name}'")
    return getattr(importlib.import_module(f"tfm_cl.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
