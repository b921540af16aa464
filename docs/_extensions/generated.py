"""Fills pages with what the package knows of itself: a line ``<!-- NAME: ARGUMENT -->`` becomes Markdown.

``keys`` lists the keys of a section of the scene file from its model, ``commands`` the commands and their
options from click's parameters. Nothing of either is written twice, so neither can be out of date.
"""

import re
from collections.abc import Callable
from typing import Any

from commands import commands_of
from keys import keys_of
from sphinx.application import Sphinx

MAKERS: dict[str, Callable[[str], str]] = {"keys": keys_of, "commands": commands_of}
"""Name in a page -> what makes the Markdown of an argument."""

LINE = re.compile(rf"^<!-- ({'|'.join(MAKERS)}): (\S+) -->$", re.MULTILINE)


def _fill(_app: Sphinx, _docname: str, source: list[str]) -> None:
    source[0] = LINE.sub(lambda found: MAKERS[found[1]](found[2]), source[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True}
