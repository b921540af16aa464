"""What pages for a browser share: looks, elements, pictures that lie on each other."""

import base64
import hashlib
from collections.abc import Mapping
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


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Put parts where a template says ``@NAME@``; elsewhere it has no ``@``, and parts may have any."""
    head, *rest = template.split("@")
    # The odd ones are names; inserted text is not expanded again.
    return head + "".join(parts[part] if index % 2 == 0 else part for index, part in enumerate(rest))


def source_hash(text: str) -> str:
    """Return what a content security policy calls a script or a style that it allows."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
