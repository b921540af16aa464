"""What waits for one client: however slow it is, it holds nobody and gets the newest."""

from __future__ import annotations

import json
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from typing import Any

MOST_NOTICES = 256
"""That wait; of more the oldest are dropped, but for those that only the newest of matters."""
NEWEST = frozenset(
    ("welcome", "state", "work", "cost", "failed", "cleared", "curve", "compared", "listing", "clients")
)
"""Types of notices that make older ones of their type needless."""
RIVALS = {"failed": "cleared", "cleared": "failed"}
"""Of these the newer one counts."""


class Mailbox:
    """Holds notices and pictures until a client can take them; any thread may use it.

    Of the pictures of a kind (``which``) only the newest waits, and one picture at a time is on its way until
    it was `seen`. Notices keep their order, and come before pictures.

    Parameters
    ----------
    on_ready
        Called, from any thread, when something may be taken.
    """

    def __init__(self, on_ready: Callable[[], None]) -> None:
        self._on_ready, self._lock = on_ready, threading.Lock()
        self._notices: deque[tuple[str, str]] = deque()
        self._pictures: OrderedDict[str, tuple[int, bytes]] = OrderedDict()
        self._under_way: int | None = None

    def put(self, notice: Mapping[str, Any]) -> None:
        """Add a notice."""
        kind, text = str(notice["type"]), json.dumps(notice, allow_nan=False)
        with self._lock:
            if kind in NEWEST:
                needless = {kind, RIVALS.get(kind)}
                self._notices = deque(pair for pair in self._notices if pair[0] not in needless)
            self._notices.append((kind, text))
            while len(self._notices) > MOST_NOTICES:
                self._notices.popleft()
        self._on_ready()

    def put_picture(self, header: Mapping[str, Any], data: bytes) -> None:
        """Add a picture, in the place of one of its kind that still waits.

        Parameters
        ----------
        header
            Has at least ``which``, its kind, and ``picture``, its number.
        """
        said = json.dumps(header, allow_nan=False).encode()
        message = len(said).to_bytes(4, "little") + said + data
        with self._lock:
            self._pictures[str(header["which"])] = int(header["picture"]), message
            is_ready = self._under_way is None
        if is_ready:
            self._on_ready()

    def take(self) -> list[str | bytes]:
        """Return what may be sent now, in order: texts, and at most one picture, which is then on its way."""
        with self._lock:
            taken: list[str | bytes] = [text for _, text in self._notices]
            self._notices.clear()
            if self._under_way is None and self._pictures:
                _, (self._under_way, message) = self._pictures.popitem(last=False)
                taken.append(message)
        return taken

    def seen(self, picture: int) -> None:
        """Let the next picture go: the one on its way has arrived. Other numbers change nothing."""
        with self._lock:
            if picture != self._under_way:
                return
            self._under_way = None
            is_ready = bool(self._pictures)
        if is_ready:
            self._on_ready()
