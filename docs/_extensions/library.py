"""Classes for autodoc: without what pydantic brings along, and what is for writers of further classes."""

from typing import Any

from sphinx.application import Sphinx

OF_THE_CLASS = ("model_config", "SECTION", "HEADER", "KEY", "KIND", "WHOLE", "DENSITY_KEY")
"""What is for those who write further classes."""


def _skip(*event: Any) -> bool | None:
    name = event[2]
    return True if name in OF_THE_CLASS or name.startswith("model_") else None


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx."""
    app.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True}
