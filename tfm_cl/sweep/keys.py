"""Hashes of the contents of scenes, by which a sweep recognises its rows and images."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

from tfm_cl._version import __version__
from tfm_cl.errors import SceneError
from tfm_cl.scene.bodies.volume import Volume

if TYPE_CHECKING:
    from tfm_cl.scene.scene import Scene


def content_hash(*values: Any) -> str:
    """Hash the contents of values: 24 hexadecimal digits, the same in every process.

    Raises
    ------
    SceneError
        For an object whose contents cannot be hashed.
    """
    digest = hashlib.sha256()
    _feed(digest, values)
    return digest.hexdigest()[:24]


def reference_key(scene: Scene, device: str) -> str:
    """Hash everything the dual march depends on; of the map's settings that is only the steps."""
    content = {field.name: getattr(scene, field.name) for field in dataclasses.fields(scene)}
    content["map"] = scene.map.steps
    content["march"] = scene.march.replace(method="dual")
    return content_hash(content, device, __version__)


def _feed(digest: hashlib._Hash, value: Any) -> None:
    digest.update(f"\0{type(value).__qualname__} ".encode())
    if value is None or isinstance(value, bool | int | float | str):
        digest.update(repr(value).encode())
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, Volume):
        # In stored form: the dense array of a sparse volume may be far larger than memory.
        stored = value._voxels.stored  # noqa: SLF001 - accessing either form might create it
        _feed(digest, (stored, value.world_from_index, value.density_scale, value.colour, value.medium))
    elif isinstance(value, BaseModel):
        _feed(digest, {name: getattr(value, name) for name in type(value).model_fields})
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        _feed(digest, {field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    elif isinstance(value, dict | list | tuple):
        digest.update(str(len(value)).encode())
        for item in value.items() if isinstance(value, dict) else value:
            _feed(digest, item)
    elif isinstance(value, Path) and value.is_file():
        digest.update(value.read_bytes())
    else:
        raise SceneError(f"a sweep cannot tell whether a {type(value).__qualname__} of the scene has changed")
