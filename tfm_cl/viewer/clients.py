"""The clients of a session: what each is sent, and what one that comes later finds."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import OUT_OF_MEMORY, TfmError
from tfm_cl.files.image_io.inline import encoded

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from tfm_cl.files.image_io.inline import Quality
    from tfm_cl.render.shown import Shown
    from tfm_cl.viewer.mailbox import Mailbox

MOST_LINE = 1000
"""Characters of a line about a failure."""


class Clients:
    """Those who look at one session; from any thread, and nothing waits for any of them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._mailboxes: list[Mailbox] = []
        self._lasting: dict[str, Mapping[str, Any]] = {}
        self._pictures: dict[str, tuple[Mapping[str, Any], bytes]] = {}
        self._number = 0

    @property
    def are_there(self) -> bool:
        """Whether there is any."""
        with self._lock:
            return bool(self._mailboxes)

    def join(self, mailbox: Mailbox) -> None:
        """Take one in: all that lasts is sent at once."""
        with self._lock:
            if mailbox not in self._mailboxes:
                self._mailboxes.append(mailbox)
            for notice in self._lasting.values():
                mailbox.put(notice)
            for header, data in self._pictures.values():
                mailbox.put_picture(header, data)
        self._count()

    def leave(self, mailbox: Mailbox) -> bool:
        """Let one go; tell whether it was there."""
        with self._lock:
            if mailbox not in self._mailboxes:
                return False
            self._mailboxes.remove(mailbox)
        self._count()
        return True

    def _count(self) -> None:
        with self._lock:
            count = len(self._mailboxes)
        self.send({"type": "clients", "count": count})

    def send(self, notice: Mapping[str, Any], *, lasts: bool = False) -> None:
        """Send a notice to all.

        Parameters
        ----------
        lasts
            Clients that come later are sent it, too, until one of its type takes its place.
        """
        with self._lock:
            if lasts:
                self._lasting[notice["type"]] = notice
            mailboxes = list(self._mailboxes)
        for mailbox in mailboxes:
            mailbox.put(notice)

    def tell(self, mailbox: Mailbox | None, notice: Mapping[str, Any]) -> None:
        """Send a notice to one client; to all where it is not known who asked."""
        if mailbox is None:
            self.send(notice)
        else:
            mailbox.put(notice)

    def send_picture(
        self, which: str, pixels: NDArray[np.uint8], revision: int, quality: Quality, **more: Any
    ) -> None:
        """Send pixels, [H, W, 3], to all, and to those that come later.

        Parameters
        ----------
        which, revision, quality, more
            Of its header.
        """
        mime, data = encoded(pixels, quality)
        height, width = pixels.shape[:2]
        with self._lock:
            self._number += 1
            header = {
                "type": "picture",
                "picture": self._number,
                "which": which,
                "revision": revision,
                "quality": quality,
                "width": width,
                "height": height,
                "mime": mime,
                "gain": 1.0,
                **more,
            }
            self._pictures[which] = header, data
            for mailbox in self._mailboxes:
                mailbox.put_picture(header, data)

    def send_shown(self, which: str, shown: Shown, revision: int, quality: Quality, **more: Any) -> None:
        """Send a layer likewise, with the range that its colours stand for."""
        if shown.range is not None:
            more |= {"range": list(shown.range), "colours": shown.colours}
        self.send_picture(which, shown.pixels, revision, quality, **more)

    def forget(self, *, notice: str = "", pictures_of: tuple[str, ...] = ()) -> None:
        """Send clients that come later no notice of a type, and no such pictures, any more."""
        with self._lock:
            self._lasting.pop(notice, None)
            for which in pictures_of:
                self._pictures.pop(which, None)


def failed(error: BaseException) -> dict[str, Any]:
    """Return the notice of something that went wrong, in one line."""
    if isinstance(error, TfmError):
        line = "; ".join(" ".join(line.split()) for line in error.lines)
    elif isinstance(error, MemoryError):
        line = OUT_OF_MEMORY
    else:
        said = " ".join(str(error).split())
        line = f"the renderer failed ({type(error).__name__}{': ' if said else ''}{said})"
    return {"type": "failed", "line": line if len(line) <= MOST_LINE else f"{line[:MOST_LINE]}…"}
