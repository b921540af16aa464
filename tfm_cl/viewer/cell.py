"""The viewer in a cell of a notebook: a widget whose messages are the kernel's, without a server."""

from __future__ import annotations

import asyncio
import contextlib
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Self

import anywidget
import traitlets

from tfm_cl.errors import InputError
from tfm_cl.viewer.clients import failed
from tfm_cl.viewer.files import break_off, kind_of
from tfm_cl.viewer.mailbox import Mailbox
from tfm_cl.viewer.messages import parsed
from tfm_cl.viewer.page import script, style

if TYPE_CHECKING:
    from tfm_cl.scene.scene import Scene
    from tfm_cl.viewer.files import Files, Upload
    from tfm_cl.viewer.session import Session

SILENT = 150.0
"""Seconds after which a view that has said nothing is taken for gone: a tab was closed. Views say every 20 s
that they are there, browsers let those of hidden tabs do so every minute."""
MOST_VIEWS = 64
"""Of one widget."""
HEIGHT = "min(46rem, 90vh)"
"""Of a cell's view."""
_KEY = re.compile(r"[0-9a-f]{32}")


@dataclass(frozen=True)
class Shown:
    """What a widget shows, and how."""

    session: Session
    files: Files
    scene: Callable[[], Scene]
    """Returns the scene as it is now."""
    release: Callable[[], None]
    """Called when nobody will look any more."""


@dataclass
class _View:
    """A place where the widget is shown: a client of the session."""

    mailbox: Mailbox
    loop: asyncio.AbstractEventLoop | None
    """Where messages of this view were handled last, and may be sent; None outside of kernels."""
    silence: asyncio.TimerHandle | None = None
    upload: Upload | None = None
    opened: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def break_off(self) -> None:
        """Remove what is there of a file that arrives."""
        self.upload = None
        break_off(self.opened)


class Viewer(anywidget.AnyWidget):
    """A scene in a notebook that is rendered as it is changed there; `tfm_cl.viewer.widget.view` makes it.

    Where it is shown several times, all views show the same. It is a context manager, too, which closes it.
    """

    _esm = "\n".join([script(), (files("tfm_cl.viewer.page") / "widget.js").read_text(encoding="utf-8")])
    _css = style()
    height = traitlets.Unicode(HEIGHT, help="of the view, as CSS says it").tag(sync=True)

    def __init__(self, shown: Shown, height: str = HEIGHT) -> None:
        self._shown: Shown | None = shown
        self._views: dict[str, _View] = {}
        self._lock = threading.RLock()
        super().__init__(height=height)
        self.on_msg(self._receive)

    @property
    def scene(self) -> Scene:
        """The scene as it is now, with all that was changed in the view.

        Raises
        ------
        InputError
            The viewer is closed.
        """
        if self._shown is None:
            raise InputError("the viewer is closed; take `viewer.scene` before it is")
        return self._shown.scene()

    def close(self) -> None:
        """End it and its views. The device is free when the last viewer has been closed."""
        shown = getattr(self, "_shown", None)
        if shown is not None:
            with self._lock:
                views, self._shown = dict(self._views), None
            for key in views:
                self._leave(key, shown)
            shown.release()
        super().close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _receive(self, _: Any, content: Any, buffers: list[Any]) -> None:
        """Do what a view says."""
        key = content.get("view") if isinstance(content, dict) else None
        shown = self._shown
        if shown is None or not (isinstance(key, str) and _KEY.fullmatch(key)):
            return
        if content.get("gone"):
            self._leave(key, shown)
            return
        view = self._view(key, shown)
        if view is None:
            return
        if "upload" in content:
            self._tell(key, {"taken": _taken(view, content, buffers, shown.files)})
        elif "said" in content:
            try:
                shown.session.say(parsed(str(content["said"])), view.mailbox)
            except InputError as error:
                view.mailbox.put(failed(error))
        else:
            self._tell(key, {"here": True})

    def _view(self, key: str, shown: Shown) -> _View | None:
        """Return a view, which is new where it has not been heard of, or not for long; None of too many."""
        loop: asyncio.AbstractEventLoop | None = None
        with contextlib.suppress(RuntimeError):  # outside of kernels none runs
            loop = asyncio.get_running_loop()
        with self._lock:
            view = self._views.get(key)
            is_new = view is None
            if view is None:
                if len(self._views) >= MOST_VIEWS:
                    return None
                view = self._views[key] = _View(Mailbox(lambda: self._wake(key)), loop)
            view.loop = loop
            if view.silence is not None:
                view.silence.cancel()
            if loop is not None:
                view.silence = loop.call_later(SILENT, self._leave, key, shown)
        if is_new:
            shown.session.join(view.mailbox)
        return view

    def _leave(self, key: str, shown: Shown) -> None:
        """Show the session to one view less."""
        with self._lock:
            view = self._views.pop(key, None)
        if view is not None:
            if view.silence is not None and view.loop is not None:
                with contextlib.suppress(RuntimeError):  # the loop has ended
                    view.loop.call_soon_threadsafe(view.silence.cancel)
            view.break_off()
            shown.session.leave(view.mailbox)

    def _wake(self, key: str) -> None:
        """Send what waits, from any thread: messages are handed over where those of the view are handled."""
        view = self._views.get(key)
        if view is None:
            return
        if view.loop is None:
            self._deliver(key)
            return
        with contextlib.suppress(RuntimeError):  # the loop has ended
            view.loop.call_soon_threadsafe(self._deliver, key)

    def _deliver(self, key: str) -> None:
        with self._lock:
            view = self._views.get(key)
            for message in view.mailbox.take() if view is not None else ():
                if isinstance(message, bytes):
                    self._tell(key, {}, [message])
                else:
                    self._tell(key, {"text": message})

    def _tell(self, key: str, content: dict[str, Any], buffers: list[bytes] | None = None) -> None:
        with self._lock:
            self.send({"view": key, **content}, buffers)


def _taken(view: _View, content: dict[str, Any], buffers: list[Any], into: Files) -> dict[str, str]:
    """Add a part to a file that a view sends; answer with its path once it is whole, or what is wrong."""
    try:
        if content.get("isFirst"):
            view.break_off()
            kind = kind_of(content.get("kind", "scene"))
            view.upload = view.opened.enter_context(into.upload(str(content["upload"]), kind))
        upload = view.upload
        if upload is None:
            return {"line": "the file was broken off; send it again"}
        for buffer in buffers:
            upload.write(bytes(buffer))
        if not content.get("isLast"):
            return {}
        view.upload = None
        view.opened.close()
    except InputError as error:
        view.break_off()
        return {"line": error.lines[0]}
    return {"path": upload.name}
