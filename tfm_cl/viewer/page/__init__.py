"""The viewer's page: its scripts, joined into one, its style and the document around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from tfm_cl import page
from tfm_cl.files.image_io.false_colour import COLOURS, Name
from tfm_cl.page import asset, filled, inside_element, source_hash

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
    "maps.js",
    "files.js",
    "status.js",
    "keys.js",
    "app.js",
)
"""In this order they become one, after those that pages share."""
_DEFINED = "{ mount, randomKey }"
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
    """Return the scripts as one statement; it defines ``mount(element, transport)`` and ``randomKey()``."""
    parts = [*map(asset, page.SCRIPTS), *map(_asset, SCRIPTS)]
    return "\n".join(
        [f"const {_DEFINED} = (() => {{", '"use strict";', *parts, f"return {_DEFINED};", "})();", ""]
    )


@cache
def style() -> str:
    """Return the style, all of it of elements within one of the class ``tfm-viewer``."""
    return "".join([asset("theme.css"), _asset("viewer.css"), *map(_colour_bar, COLOURS)])


@cache
def document() -> Document:
    """Return the page, which loads nothing else."""
    parts = {"STYLE": style(), "SCRIPT": inside_element(script() + _asset("start.js"))}
    text = filled(_asset("index.html"), parts)
    return Document(text, source_hash(parts["SCRIPT"]), source_hash(parts["STYLE"]))


def _colour_bar(name: Name) -> str:
    """Return the look of the bar that tells what a colour map's colours mean."""
    colours = ", ".join(f"rgb{colour}" for colour in COLOURS[name])
    return f".tfm-viewer .scale-bar .{name} {{ background: linear-gradient(to right, {colours}); }}\n"


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")
