"""What is installed on request: ``pip install 'tfm_cl[NAME]'``."""

import contextlib
import importlib.util
from collections.abc import Iterator

EXTRAS = {
    "dask": {"distributed": "distributed"},
    "figures": {"matplotlib": "matplotlib"},
    "flip": {"flip_evaluator": "flip-evaluator"},
    "movie": {"imageio_ffmpeg": "imageio-ffmpeg"},
    "notebook": {"anywidget": "anywidget", "scipy": "SciPy", "skimage": "scikit-image"},
    "points": {"scipy": "SciPy"},
    "solids": {"embreex": "embreex", "scipy": "SciPy", "trimesh": "trimesh"},
    "sweep": {"plotly": "plotly", "skimage": "scikit-image"},
    "usd": {"pxr": "usd-core"},
    "view": {"skimage": "scikit-image", "tornado": "tornado"},
}
"""Name -> the modules that it brings, and what their packages are called. See pyproject.toml."""


def missing(extra: str) -> str | None:
    """Return what to install for an extra, as the end of a message; None if all of it is there."""
    for module, package in EXTRAS[extra].items():
        if importlib.util.find_spec(module) is None:
            return f"needs {package}: pip install 'tfm_cl[{extra}]'"
    return None


@contextlib.contextmanager
def needs(extra: str, who: str, error: type[Exception]) -> Iterator[None]:
    """Say in one line what to install where an import inside the block fails for want of an extra.

    Parameters
    ----------
    extra
        One of `EXTRAS`.
    who
        What needs it: the line's beginning.
    error
        What is raised.
    """
    try:
        yield
    except ModuleNotFoundError as absent:
        package = EXTRAS[extra].get((absent.name or "").partition(".")[0])
        if package is None:
            raise
        raise error(f"{who} needs {package}: pip install 'tfm_cl[{extra}]'") from None
