"""A key or a flag with what is to be known of it, as Markdown."""

import re
from collections.abc import Iterable
from typing import NamedTuple


class Entry(NamedTuple):
    """One key or flag; what is empty is left out."""

    name: str
    anchor: str
    """By which other pages link to it, unique on the site."""
    takes: str
    """Type and range in words."""
    default: str
    """As it is written."""
    meaning: str
    unit: str = ""
    example: str = ""
    required: bool = False


def definition_list(entries: Iterable[Entry]) -> str:
    """Return the entries as a definition list of MyST."""
    return "\n\n".join(map(_definition, entries))


def _definition(entry: Entry) -> str:
    facts = [("takes", _escaped(entry.takes)), ("unit", entry.unit)]
    facts += [("default", f"`{entry.default}`" if entry.default else "")]
    shown = [f"{what} {fact}" for what, fact in facts if fact] + ["required"] * entry.required
    term = f"[`{entry.name}`]{{#{entry.anchor}}} " + " ".join(f"[{fact}]{{.fact}}" for fact in shown)
    lines = [term, f": {sentence(_escaped(entry.meaning))}"]
    if entry.example:
        lines += ["", f"  ```toml\n  {entry.example}\n  ```"]
    return "\n".join(lines)


def _escaped(text: str) -> str:
    """Return plain text such that Markdown shows it as it is."""
    return "".join(f"\\{letter}" if letter in "\\`*_[]{}<>$" else letter for letter in text)


def sentence(text: str) -> str:
    """Return a description with a capital letter, where it does not begin with a name, and a full stop."""
    begin = text[:1] if re.match(r"\w+(\\_\w+)*(,| =|:)", text) else text[:1].upper()
    return f"{begin}{text[1:].rstrip('.')}." if text else ""
