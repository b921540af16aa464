"""What is prepared for scenes whose turn is yet to come."""

from __future__ import annotations

from typing import Any

MOST_AHEAD = 2
"""Scenes that are prepared before their turn: that which is waiting, and the one after it."""


def keep_newest(ahead: dict[Any, Any], count: int) -> None:
    """Drop what was added first, so that so many entries stay, while another thread may take some."""
    for key in [*ahead][:-count]:
        ahead.pop(key, None)
