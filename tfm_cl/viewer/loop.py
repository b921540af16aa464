"""The render thread: one renderer for all sessions, which take turns."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import CancelledError, InputError
from tfm_cl.interrupts import interrupts_held
from tfm_cl.viewer.draft import Draft, low_picture
from tfm_cl.viewer.edits import Settings
from tfm_cl.viewer.session import REST, Session, Work

if TYPE_CHECKING:
    from tfm_cl.sequence.shot import Shot
    from tfm_cl.viewer.answers import WriteScene
    from tfm_cl.viewer.files import Files
    from tfm_cl.viewer.renderer import Read, ReadFrame, Renderer
    from tfm_cl.viewer.session import Due

ENDED_WITHIN = 0.2
"""Seconds that `RenderLoop.close` waits for the thread: compilers go on, and end with the process."""
LOW_PICTURES = 16
"""That made something new, after which a lone session's renderer forgets what is of no use any more."""


class RenderLoop:
    """Renders what sessions show, in a thread of its own; nobody else waits for it.

    A session that changes comes before one that waits for its full picture; alike ones take turns. A full
    picture that has become stale, of whichever session, is ended. What a session's work raises is told to its
    clients, and the loop goes on, with another renderer unless it was their input. When the last client has
    gone, work ends, and after a while the device is given back.

    Parameters
    ----------
    make_renderer
        Makes what renders, in the thread, when it is needed: `tfm_cl.render.renderer.Renderer`.
    read
        Reads frames, as `tfm_cl.sequence.frame.read` does.
    curve_at
        Follows the light to a pixel, as `tfm_cl.viewer.curve.curve_at` does.
    rate
        Low pictures per second that are wanted.
    linger
        Seconds for which the device is kept when nobody looks.
    """

    def __init__(
        self,
        make_renderer: Callable[[], Renderer],
        read: Read,
        curve_at: Callable[..., Any],
        *,
        rate: float = 10.0,
        linger: float = 5.0,
    ) -> None:
        self._make_renderer, self._read, self._curve_at = make_renderer, read, curve_at
        self._rate, self._linger = rate, linger
        self._changed = threading.Condition()
        # Under the condition's lock.
        self._sessions: list[Session] = []
        """That somebody looks at, in the order of their turns."""
        self._asleep: list[Session] = []
        """That the last client has left since the thread looked."""
        self._moved: tuple[Session | None, float] = None, -math.inf
        """What session had the last input, and when."""
        self._may_end = False
        """Whether what is being done may become stale."""
        self._is_stale = self._is_closed = False
        self._unwatched_since = time.monotonic()
        self._thread: threading.Thread | None = None
        self._renderer: Renderer | None = None
        """Made and closed by the thread."""
        self._first: ReadFrame | None = None
        """What the thread may render before anybody looks."""
        self._is_ahead = False
        """Whether it does; under the lock."""
        self._made_anew = 0
        """Low pictures that made something, since the renderer forgot."""

    def session(
        self,
        shot: Shot,
        files: Files,
        frame: float | None = None,
        *,
        shared: bool = False,
        write_scene: WriteScene | None = None,
    ) -> Session:
        """Return a new session; it is read when the first client has joined it.

        Parameters
        ----------
        shot
            What it shows.
        files
            What its clients may see of the disk.
        frame
            At which it begins; None: at the first, where it changes from frame to frame.
        shared
            What clients are told: whether others see the same.
        write_scene
            Writes a scene file of what is shown, where arrays go beside it; None: of what files are named.
        """
        return Session(
            Settings(shot, frame),
            files,
            self._read,
            self._curve_at,
            self._rate,
            self._hear,
            shared=shared,
            write_scene=write_scene,
        )

    def start(self, first: ReadFrame | None = None) -> None:
        """Begin to work.

        Parameters
        ----------
        first
            What somebody will look at: until then its first picture is rendered for what that leaves with the
            renderer, unless kernels have to be compiled, of which who looks is told.
        """
        if self._thread is None:
            self._first = first
            self._thread = threading.Thread(target=self._run, name="tfm view: rendering", daemon=True)
            with interrupts_held():
                self._thread.start()

    def close(self) -> None:
        """End the work and the thread, which closes the renderer; closing again does nothing."""
        with self._changed:
            self._is_closed = True
            self._make_stale()
            self._changed.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(ENDED_WITHIN)

    @property
    def is_at_work(self) -> bool:
        """Whether the thread has not ended: after `close`, because a compiler cannot be stopped."""
        return self._thread is not None and self._thread.is_alive()

    def _hear(self, session: Session, *, is_input: bool = False) -> None:
        """Hear from any thread that there is something to do for a session."""
        is_watched = session.is_watched
        with self._changed:
            if is_watched and session not in self._sessions:
                self._sessions.append(session)
            elif not is_watched and session in self._sessions:
                self._sessions.remove(session)
                self._asleep.append(session)
                self._unwatched_since = time.monotonic()
            if is_input and is_watched:
                self._moved = session, time.monotonic()
            if (is_input and is_watched) or not self._sessions or self._is_ahead:
                self._make_stale()
            self._changed.notify_all()

    def _make_stale(self) -> None:
        """End what may be ended of the work that goes on; under the lock."""
        self._is_stale = True
        if self._may_end and self._renderer is not None:
            self._renderer.cancel()

    # The thread.

    def _run(self) -> None:
        self._render_ahead()
        while True:
            with self._changed:
                for session in self._asleep:
                    if session not in self._sessions:
                        session.sleep()
                self._asleep.clear()
                if self._is_closed:
                    break
                turn = self._next()
                wait = self._seconds_to_wait() if turn is None else 0.0
                if turn is None and wait != 0.0:
                    self._changed.wait(wait)
                    continue
                if turn is not None:
                    self._sessions.remove(turn[0])
                    self._sessions.append(turn[0])
                    self._is_stale, self._may_end = False, turn[1] >= Work.FULL
            if turn is None:
                self._close_renderer()  # nobody has looked for long
            else:
                self._do(*turn)
        self._close_renderer()

    def _render_ahead(self) -> None:
        """Render a low picture that nobody sees: what it needs is then there for the first that is seen."""
        read, self._first = self._first, None
        with self._changed:
            if read is None or self._sessions or self._is_closed:
                return
            self._is_stale, self._may_end, self._is_ahead = False, True, True
        try:
            renderer = self._get_renderer()
            renderer.on_compiling = self._end_ahead
            low_picture(Draft(self._rate).scene(read), read, renderer, (), self._check)
        except CancelledError:
            pass
        except Exception:  # noqa: BLE001 - who looks is told, if it fails again
            self._close_renderer()
        finally:
            with self._changed:
                self._may_end = self._is_ahead = False

    def _end_ahead(self, what: str) -> None:
        """Compile nothing as long as nobody looks."""
        raise CancelledError(f"nobody is there to be told that {what} is compiled")

    def _next(self) -> tuple[Session, Work] | None:
        """Return whose turn it is, and what is to be done; None where nothing is due yet."""
        now = time.monotonic()
        ready = [(session, due.work) for session, due in self._due() if due.when <= now]
        return min(ready, key=lambda turn: turn[1]) if ready else None

    def _due(self) -> Iterator[tuple[Session, Due]]:
        """Yield what sessions have to do next: long work waits while another session changes."""
        moved, at = self._moved
        for session in self._sessions:
            due = session.due()
            if due is not None and due.work >= Work.FULL and session is not moved:
                due = due._replace(when=max(due.when, at + REST))
            if due is not None:
                yield session, due

    def _seconds_to_wait(self) -> float | None:
        """Return the seconds until something is due; 0: the renderer is to be closed; None: endless."""
        now = time.monotonic()
        if self._sessions:
            first = min((due.when for _, due in self._due()), default=None)
            return None if first is None else max(first - now, 1e-3)
        if self._renderer is None:
            return None
        return max(self._unwatched_since + self._linger - now, 0.0)

    def _do(self, session: Session, work: Work) -> None:
        try:
            session.do(work, self._get_renderer, self._check)
            if work is Work.LOW:
                self._forget_unused(session)
        except CancelledError:
            pass  # it is due again
        except Exception as error:  # noqa: BLE001 - whatever it is, the loop goes on
            if not isinstance(error, InputError):
                self._close_renderer()
                with self._changed:
                    watched = list(self._sessions)
                for one in watched:
                    one.forget_maps()
            with suppress(Exception):  # what fails again is left alone
                session.failed(error, work)
        finally:
            with self._changed:
                self._may_end = False

    def _get_renderer(self) -> Renderer:
        """Return the renderer; made now where there is none."""
        if self._renderer is None:
            made = self._make_renderer()
            with self._changed:
                self._renderer = made
        return self._renderer

    def _check(self, stage: str, fraction: float) -> None:
        """End work that has become stale, between two launches."""
        del stage, fraction
        if self._is_stale:
            raise CancelledError("the rendering was cancelled")

    def _forget_unused(self, session: Session) -> None:
        """Forget what a drag left behind, where no other session may need it."""
        self._made_anew += session.made_anew
        if self._made_anew >= LOW_PICTURES and self._renderer is not None:
            self._made_anew = 0
            with self._changed:
                is_alone = len(self._sessions) == 1
            if is_alone:
                self._renderer.forget_unused()

    def _close_renderer(self) -> None:
        with self._changed:
            renderer, self._renderer = self._renderer, None
        if renderer is not None:
            with suppress(Exception):  # it failed already, and another is made
                renderer.close()
