"""The viewer's page: its scripts, joined into one, its style and the document around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from tfm_cl import page
from tfm_cl.page import asset, inside_element, source_hash

SCRIPTS = (
    "base.js",
    "model.js",
    "schema.js",
    "camera.js",
    "stage.js",
    "compare.js",
    "shapes.js",
    "transforms.js",
    "gizmos.js",
    "fields.js",
    "panel.js",
    "curve.js",
    "files.js",
    "status.js",
    "keys.js",
    "app.js",
)
"""In this order they become one, after those that pages share."""
_ASSETS = files("tfm_cl.viewer.page")


@dataclass(frozen=True)
class Document:
    """The page, and what of it may run."""

    text: str
    script_hash: str
    """As a Content-Security-Policy names it: the only script that runs."""
    style_hash: str


@cache
def script() -> str:
    """Return the scripts as one statement, which defines ``mount(element, transport)`` and nothing else."""
    parts = [*map(asset, page.SCRIPTS), *map(_asset, SCRIPTS)]
    return "\n".join(
        ["const { mount } = (() => {", '"use strict";', *parts, "return { mount };", "})();", ""]
    )


@cache
def style() -> str:
    """Return the style, all of it of elements within one of the class ``tfm-viewer``."""
    return asset("theme.css") + _asset("viewer.css")


@cache
def document() -> Document:
    """Return the page, which loads nothing else.

    In ``index.html``, ``@STYLE@`` and ``@SCRIPT@`` stand for the contents of their elements.
    """
    parts = {"STYLE": style(), "SCRIPT": inside_element(script() + _asset("start.js"))}
    head, *rest = _asset("index.html").split("@")
    # The odd parts of the template are names; inserted text is not expanded again.
    text = head + "".join(parts[part] if index % 2 == 0 else part for index, part in enumerate(rest))
    return Document(text, source_hash(parts["SCRIPT"]), source_hash(parts["STYLE"]))


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")
