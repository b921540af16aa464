"""The library's classes for autodoc: models show their fields, and not what pydantic brings along."""

from typing import Any

import keys
from entries import sentence
from sphinx.application import Sphinx

from tfm_cl.model import Model

OF_THE_CLASS = ("model_config", "SECTION", "HEADER", "KEY", "KIND", "WHOLE", "DENSITY_KEY")
"""What is for those who write further classes."""


def _fields(_app: Sphinx, what: str, _name: str, obj: Any, _options: Any, lines: list[str]) -> None:
    """Append the fields of a model to its description, as numpy's docstrings list parameters."""
    if what != "class" or not issubclass(obj, Model) or ":param" in "\n".join(lines):
        return
    for key, name in obj.keys().items():
        takes, default, meaning = keys.facts_of(obj, key)
        shown = f"Default ``{default}``." if default else "Required." * obj.model_fields[name].is_required()
        text = f"{sentence(meaning)} Takes {takes}. {shown}".strip().replace("*", r"\*").replace("|", r"\|")
        lines.append(f":param {name}: {text}")
    lines.append("")


def _skip(*event: Any) -> bool | None:
    name = event[2]
    return True if name in OF_THE_CLASS or name.startswith("model_") else None


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx."""
    app.connect("autodoc-process-docstring", _fields)
    app.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True}
