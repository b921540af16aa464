"""What pages for a browser share: looks, elements, pictures that lie on each other."""

import base64
import hashlib
from importlib.resources import files

SCRIPTS = ("elements.js", "flip.js")
"""In this order they are joined with those of a page, which come after them."""
_ASSETS = files("tfm_cl.page")


def asset(name: str) -> str:
    """Return the text of one of `SCRIPTS`, or of ``theme.css``, which applies inside the class ``tfm``."""
    return (_ASSETS / name).read_text(encoding="utf-8")


def inside_element(script: str) -> str:
    """Escape end tags, so that text stays inside its script element; in strings the meaning is the same."""
    return script.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def source_hash(text: str) -> str:
    """Return what a content security policy calls a script or a style that it allows."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
