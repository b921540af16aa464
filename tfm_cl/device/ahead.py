"""What is prepared for scenes whose turn is yet to come."""

from __future__ import annotations

from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")

MOST_AHEAD = 2
"""Scenes that are prepared before their turn: that which is waiting, and the one after it."""


def keep_ahead(ahead: dict[K, V], key: K, prepared: V) -> None:
    """Add what was prepared, while another thread may take some; the oldest was not rendered after all."""
    for old in [*ahead][: 1 - MOST_AHEAD]:
        ahead.pop(old, None)
    ahead[key] = prepared
