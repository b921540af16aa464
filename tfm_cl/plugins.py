"""Bases, phase functions, lights, solids and formats from elsewhere.

A package names them in its metadata: an entry point of the group ``tfm_cl.bases``, ``tfm_cl.phases``,
``tfm_cl.lights``, ``tfm_cl.solids``, ``tfm_cl.volume_formats`` or ``tfm_cl.image_formats``. A single file
registers them itself, with `tfm_cl.register_basis` and its like; `load_plugin` runs it. Each registry asks
for what is there when it is imported.
"""

import importlib.util
import os
import sys
from collections.abc import Callable, Mapping
from importlib.abc import Loader
from pathlib import Path
from types import ModuleType
from typing import Any

from tfm_cl.errors import InputError

VARIABLE = "TFM_CL_PLUGINS"
"""Environment variable with the plugin files of a process and those that it starts, as PATH has folders."""
PREFIX = "tfm_cl."
"""Of the groups of entry points."""


def load_plugin(path: str | os.PathLike[str]) -> None:
    """Run a plugin, a Python file that registers what it brings; a file that was run before is left alone.

    Parameters
    ----------
    path
        The file. Its headers are beside it: `register_basis` says how they are named.

    Raises
    ------
    InputError
        It is no file, or it fails; the line says why.
    """
    path = Path(path).absolute()
    if path in _loaded:
        return
    if not path.is_file():
        raise InputError(f"plugin {path}: no such file")
    name = f"tfm_cl_plugin_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if path.suffix != ".py" or spec is None or spec.loader is None:
        raise InputError(f"plugin {path}: should be a Python file, NAME.py")
    if name in sys.modules:
        raise InputError(f"plugin {path}: another plugin has that name; rename the file")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    _loaded.add(path)  # before it runs: registries that it imports ask for it
    try:
        _run(spec.loader, module)
    except BaseException as error:
        del sys.modules[name]
        _loaded.discard(path)
        if not isinstance(error, Exception):
            raise
        raise InputError(f"plugin {path}: {_told(error)}") from error


def _run(loader: Loader, module: ModuleType) -> None:
    before = len(_claimed)
    loader.exec_module(module)
    if len(_claimed) == before:
        raise InputError("registers nothing; it should call tfm_cl.register_basis or its like")


_loaded: set[Path] = set()
"""Files that were run, or are being run."""


def register_installed(group: str, register: Callable[[str, Any], None]) -> None:
    """Call ``register(name, value)`` for each entry point of ``tfm_cl.GROUP``; run the files of `VARIABLE`.

    Raises
    ------
    InputError
        What an entry point names cannot be had, or is refused; the line names its package.
    """
    from importlib.metadata import entry_points  # noqa: PLC0415 - slow to import

    for point in entry_points(group=PREFIX + group):
        package = point.dist.name if point.dist else point.value
        try:
            register(point.name, point.load())
        except InputError as error:
            raise InputError(f"plugin {package}: {error}; pip uninstall {package}") from None
        except Exception as error:  # noqa: BLE001 - whatever the code of others raises
            raise InputError(f"plugin {package}: {_told(error)}; pip uninstall {package}") from None
    for name in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        load_plugin(name)


def claim(kind: str, name: str, known: Mapping[str, Any]) -> None:
    """Take a name for what is registered.

    Raises
    ------
    InputError
        If something of that kind has it already.
    """
    if name in known:
        raise InputError(f"there is a {kind} '{name}' already; give yours another name")
    _claimed.append(name)


def register_class(kind: str, cls: object, base: type[Any], key: str, known: dict[str, Any]) -> None:
    """Add a class of models to those that are known, by the name that is the default of a key.

    Raises
    ------
    InputError
        It is no class of ``base``, has no name, or one that is taken, or its kernel header is not there.
    """
    if not isinstance(cls, type) or not issubclass(cls, base):
        raise InputError(f"a {kind} should be a class of tfm_cl.{base.__name__}; got {cls!r:.80}")
    model: Any = cls
    name = model.model_fields[key].default
    if not isinstance(name, str):
        raise InputError(f"{cls.__name__}: {key} should be Literal[NAME] with that name as default")
    claim(kind, name, known)
    if hasattr(model, "HEADER"):
        check_header(model.HEADER)
    known[name] = cls


def register_format(kind: str, extension: str, module: str, known: dict[str, str]) -> None:
    """Add the name of a module to those that know a format, by the extension of its files.

    Raises
    ------
    InputError
        The extension is none, or known already.
    """
    if not extension.startswith(".") or extension != extension.lower() or not extension[1:].isalnum():
        raise InputError(f"the extension of {kind} should be like '.abc'; got {extension!r}")
    claim("format", extension, known)
    known[extension] = module


_claimed: list[str] = []
"""Names of all that was registered."""


def check_header(header: str) -> None:
    """Refuse a plugin's kernel header that is not there.

    Raises
    ------
    InputError
        If its path is not absolute, or no file.
    """
    path = Path(header)
    if not path.is_absolute() or not path.is_file():
        raise InputError(
            f"header {header!r}: should be the whole path of a file, as "
            f"str(Path(__file__).with_name({path.name!r}))"
        )


def _told(error: Exception) -> str:
    return str(error) if isinstance(error, InputError) else f"fails: {type(error).__name__}: {error}"
