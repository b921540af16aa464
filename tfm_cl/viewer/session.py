"""A session: what is looked at, what is set, and what its clients are sent.

Clients speak from any thread and never wait; all else is done by the render thread, in the turn that
`tfm_cl.viewer.loop` gives a session.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from tfm_cl._version import __version__
from tfm_cl.errors import CancelledError, InputError
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.render.shown import MEANING, PICTURE
from tfm_cl.scene.layers import GROUPS, LAYERS
from tfm_cl.scene.presets import PRESETS
from tfm_cl.scene.schema import scene_schema
from tfm_cl.viewer import pictures
from tfm_cl.viewer.answers import Answers, Asked, Now, SeenPicture
from tfm_cl.viewer.clients import Clients, failed
from tfm_cl.viewer.draft import Draft, low_picture
from tfm_cl.viewer.edits import Settings
from tfm_cl.viewer.messages import (
    Compare,
    Edit,
    Keep,
    List,
    Open,
    Pick,
    Redo,
    Reset,
    Save,
    Seen,
    SetFrame,
    SetShow,
    Show,
    ShowMap,
    Undo,
)

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress
    from tfm_cl.files.image_io.inline import Quality
    from tfm_cl.scene.settings import ImageSettings
    from tfm_cl.viewer.answers import WriteScene
    from tfm_cl.viewer.files import Files
    from tfm_cl.viewer.mailbox import Mailbox
    from tfm_cl.viewer.messages import Said
    from tfm_cl.viewer.renderer import Read, ReadFrame, Renderer, Result

REST = 0.15
"""Seconds without an input after which it is still: the full picture follows."""
REST_OF_DRAG = 0.6
"""The same while a drag is held: it may go on."""
MOST_WAITING = 2000
"""Messages of clients that wait for the render thread; what comes on top is refused."""
TOLD_AFTER, TOLD_EVERY = 0.3, 0.1
"""Seconds of work after which, and between which, clients are told how far it is."""
RATE_WEIGHT = 0.3
"""Of the last low picture, in the rate that is told."""
PAUSE = 1.0
"""Seconds between two low pictures from which on they are no stream of them."""
MOST_PIXELS = 1 << 25
"""Of a picture: one of 7680×4320 is shown, but no page can ask for any amount of memory."""
FIRST = "first picture"
"""Stage that clients are told at once."""


class Changed(Protocol):
    """Hears that there is something to do."""

    def __call__(self, session: Session, *, is_input: bool = False) -> None:
        """Hear it from any thread; of an input, which makes the picture stale that is being made."""


class Work(IntEnum):
    """What a session may have to do, the most urgent first."""

    LISTEN = 0
    """To what its clients said."""
    LOW = 1
    SHOW = 2
    """The last picture in another way."""
    FULL = 3
    ASKED = 4
    """What was asked for besides: files, curves, maps, comparisons."""


class Due(NamedTuple):
    """What is to be done next, and when."""

    work: Work
    when: float
    """As `time.monotonic` tells."""


class _Heard(NamedTuple):
    """What was said, by whom and when."""

    said: Said | Path
    """A path is to be opened."""
    mailbox: Mailbox | None
    at: float


class Session:
    """What some clients look at together.

    `tfm_cl.viewer.loop.RenderLoop.session` makes one.

    Parameters
    ----------
    settings
        What it begins with.
    files
        What clients may see of the disk.
    read, curve_at, rate
        As of the loop.
    changed
        Called when there is something to do.
    shared
        Whether all clients see the same session: they are told.
    write_scene
        Writes a scene file of what is shown, where arrays go beside it; None: of what files are named.
    """

    def __init__(
        self,
        settings: Settings,
        files: Files,
        read: Read,
        curve_at: Callable[..., Any],
        rate: float,
        changed: Changed,
        *,
        shared: bool = False,
        write_scene: WriteScene | None = None,
    ) -> None:
        self._files, self._read_frame = files, read
        self._changed, self._shared = changed, shared
        self._clients, self._lock = Clients(), threading.Lock()
        self._answers = Answers(files, self._clients, self._read_settings, curve_at, write_scene)
        # Under the lock: what clients say.
        self._heard: deque[_Heard] = deque()
        # The render thread's.
        self._settings = self._good = self._good_in_full = settings
        self._is_open = False
        self._frames: tuple[float, float] | None = None
        self._read: ReadFrame | None = None
        self._image: ImageSettings | None = None
        """Of what was read last."""
        self._show, self._stops = Show(), _Stops()
        self._revision = 0
        self._draft = Draft(rate)
        self._needs: set[Work] = set()
        self._seen: SeenPicture | None = None
        self._left_out = self._warnings = tuple[str, ...]()
        self._input_at = self._first_input_at = -math.inf
        self._rest = 0.0
        self._is_dragged = self._is_telling = False
        self._inputs = 0
        self._failed_at: int | None = None
        """So many inputs there were when something went wrong that is still told."""
        self._has_retried = False
        self._low_at, self._rate = -math.inf, 0.0

    # What clients call, from any thread.

    def say(self, said: Said, mailbox: Mailbox | None = None) -> None:
        """Hear what a page says.

        Parameters
        ----------
        mailbox
            Of the client: what it alone asked for goes there.
        """
        if isinstance(said, Seen):
            if mailbox is not None:
                mailbox.seen(said.picture)
        elif isinstance(said, List):
            self._clients.tell(mailbox, self._listing(said))
        else:
            self._hear(said, mailbox)

    def open(self, path: Path) -> None:
        """Look at another file; nothing is set."""
        self._hear(path, None)

    def join(self, mailbox: Mailbox) -> None:
        """Show it to one more client, who is sent the newest of all at once."""
        mailbox.put(self._welcome())
        self._clients.join(mailbox)
        self._changed(self)

    def leave(self, mailbox: Mailbox) -> None:
        """Show it to one client less."""
        if self._clients.leave(mailbox):
            self._changed(self)

    @property
    def settings(self) -> Settings:
        """What is shown now."""
        return self._settings

    @property
    def is_watched(self) -> bool:
        """Whether it has clients."""
        return self._clients.are_there

    def _hear(self, said: Said | Path, mailbox: Mailbox | None) -> None:
        with self._lock:
            is_full = len(self._heard) >= MOST_WAITING
            if not is_full:
                self._heard.append(_Heard(said, mailbox, time.monotonic()))
        if is_full:
            self._clients.tell(mailbox, failed(InputError("too much was said at once; say it again later")))
        else:
            self._changed(self, is_input=isinstance(said, _INPUTS))

    def _listing(self, said: List) -> Mapping[str, Any]:
        try:
            return self._files.listing(said.path, said.kind)
        except InputError as error:
            return failed(error)

    def _welcome(self) -> dict[str, Any]:
        return _welcome() | {
            "folder": str(self._files.folder),
            "most_upload": self._files.most_upload,
            "shared": self._shared,
            "can": {"open": True, "save": self._files.may_save},
        }

    # What the render thread calls.

    @property
    def made_anew(self) -> bool:
        """Whether the last low picture made what the picture before did not have."""
        return self._seen is not None and bool(self._seen.result.stats.made)

    def due(self) -> Due | None:
        """Return what is to be done next; None: nothing."""
        with self._lock:
            if self._heard or not self._is_open:
                return Due(Work.LISTEN, -math.inf)
        for work in (Work.LOW, Work.SHOW):
            if work in self._needs:
                return Due(work, -math.inf)
        if self._answers.is_one_urgent:
            return Due(Work.ASKED, -math.inf)
        if Work.FULL in self._needs:
            return Due(Work.FULL, self._input_at + self._rest)
        return Due(Work.ASKED, -math.inf) if self._answers.are_asked_for else None

    def do(self, work: Work, renderer: Callable[[], Renderer], progress: Progress) -> None:
        """Do what is due.

        Parameters
        ----------
        renderer
            Returns it.
        progress
            Raises `CancelledError` where the full picture, or what was asked for besides, has become stale;
            it is due again.

        Raises
        ------
        TfmError, and anything a renderer raises: `failed` is to be called.
        """
        told = self._telling(progress if work >= Work.FULL else _silent)

        def ready() -> Renderer:
            there = renderer()
            there.on_compiling = self._tell_compiling
            return there

        if work is Work.LISTEN:
            self._listen()
        elif work is Work.LOW:
            self._make_low(ready(), told)
        elif work is Work.SHOW:
            self._needs.discard(Work.SHOW)
            self._show_again()
        elif work is Work.FULL:
            self._make_full(ready(), told)
        else:
            self._answer(ready, told)
        if self._is_telling:
            self._is_telling = False
            self._clients.send({"type": "work", "stage": "", "fraction": 1.0})

    def failed(self, error: BaseException, work: Work) -> None:
        """Tell clients what went wrong, and go back to what worked."""
        self._tell_failure(error)
        if work in (Work.LOW, Work.FULL, Work.SHOW):
            self._go_back(error, work)

    def forget_maps(self) -> None:
        """Forget which maps there are: another renderer makes them anew."""
        self._draft.forget()

    def sleep(self) -> None:
        """Drop volumes and pictures, which are made again for the next client: nobody looks."""
        self._draft.forget()
        self._seen = self._read = None
        self._is_open = False
        self._needs.clear()
        self._answers.clear()

    # Listening.

    def _listen(self) -> None:
        """Take in all that was said; of several settings the newest is what is shown."""
        if not self._is_open:
            self._is_open = True
            self._first_input_at = time.monotonic()
            self._try(self._settings)
        with self._lock:
            heard = list(self._heard)
            self._heard.clear()
        inputs = list[_Heard]()
        for one in heard:
            if isinstance(one.said, _INPUTS):
                inputs.append(one)
                continue
            if isinstance(one.said, Save | Keep):  # of what was said before
                self._take_inputs(inputs)
            self._take(one)
        self._take_inputs(inputs)

    def _take_inputs(self, inputs: list[_Heard]) -> None:
        """Take in what changes settings, and clear the list."""
        if not inputs:
            return
        self._inputs += 1
        self._has_retried = False
        try:
            self._adopt_all(inputs)
        except InputError:
            for one in inputs:  # those that are right count
                self._try_one(one)
        inputs.clear()

    def _adopt_all(self, inputs: list[_Heard]) -> None:
        settings = self._settings
        for one in inputs:
            settings = self._settings_after(settings, one)
        self._adopt(settings, inputs)

    def _try_one(self, one: _Heard) -> None:
        try:
            self._adopt_all([one])
        except InputError as error:
            self._tell_failure(error)

    def _try(self, settings: Settings) -> None:
        try:
            self._adopt(settings, [])
        except InputError as error:
            self._tell_failure(error)

    def _settings_after(self, settings: Settings, one: _Heard) -> Settings:
        said, edits = one.said, settings.edits
        match said:
            case Edit():
                edits = edits.with_changes(said.changes, drag=said.drag, by=id(one.mailbox))
            case SetFrame():
                whole = float(said.frame).is_integer()
                return replace(settings, frame=int(said.frame) if whole else said.frame)
            case Undo():
                edits = edits.undo()
            case Redo():
                edits = edits.redo()
            case Reset():
                edits = edits.reset()
            case Open() | Path():
                path = self._files.opened(said.path) if isinstance(said, Open) else said
                shot = replace(settings.shot, path=path, overrides=(), decided=(), turntable=None)
                return Settings(shot, None)
        return replace(settings, edits=edits)

    def _adopt(self, settings: Settings, inputs: list[_Heard]) -> None:
        """Look at something from now on.

        Raises
        ------
        InputError
            It cannot be read; then nothing has changed.
        """
        is_new = self._image is None or settings.shot != self._settings.shot
        is_new |= any(isinstance(one.said, Open | Path) for one in inputs)  # it may be another file by now
        if self._read is not None and not is_new and settings.is_as(self._settings):
            self._settings = settings
            self._note(inputs)
            self._send_state()
            return
        frames = self._frames
        if is_new:
            frames = settings.shot.frames()
            if frames is not None and settings.frame is None:
                settings = replace(settings, frame=frames[0])
        read = self._read_settings(settings, None if is_new else self._read)
        if is_new:
            settings = settings.settled(read, changes=frames is not None)
            read = self._read_settings(settings, read)
        self._settings, self._read, self._frames = settings, read, frames
        self._note(inputs)
        self._revision += 1
        if is_new:
            if self._image is not None:
                self._clients.send({"type": "opened"})
            self._warnings = ()
            self._answers.end()
        self._follow(read.file.image, None if is_new else self._image)
        self._needs |= {Work.LOW, Work.FULL}
        self._left_out = read.warnings()
        self._send_state()

    def _read_settings(self, settings: Settings, like: ReadFrame | None, *also: tuple[str, Any]) -> ReadFrame:
        file = settings.file(*also)
        self._files.check(file.files())
        read = self._read_frame(file, settings.frame, like)
        width, height = read.scene.camera.res
        if width * height > MOST_PIXELS:
            raise InputError(
                f"camera.res = [{width}, {height}]: the viewer shows at most {MOST_PIXELS:,} pixels; set "
                "fewer, and let tfm render make the larger picture"
            )
        read.read_files()
        return read

    def _note(self, inputs: list[_Heard]) -> None:
        """Note when there were inputs, and how long it has to be still after them."""
        if not inputs:
            return
        last = inputs[-1]
        if Work.LOW not in self._needs:
            self._first_input_at = inputs[0].at
        self._input_at = last.at
        was_drag, self._is_dragged = self._is_dragged, bool(getattr(last.said, "drag", False))
        ended = was_drag and not self._is_dragged
        self._rest = REST_OF_DRAG if self._is_dragged else 0.0 if ended else REST

    def _follow(self, image: ImageSettings, before: ImageSettings | None) -> None:
        """Show pictures as the scene says, where it says otherwise than before."""
        self._image = image
        if before is None:
            self._show = Show(exposure=image.exposure, view=image.view)
            self._stops.reset()
            return
        keys = [key for key in ("exposure", "view") if getattr(before, key) != getattr(image, key)]
        if keys:
            self._show = self._show.model_copy(update={key: getattr(image, key) for key in keys})
            self._stops.reset()

    def _take(self, one: _Heard) -> None:
        """Take in what changes no settings."""
        match one.said:
            case SetShow() as said:
                self._set_show(said)
            case Keep():
                self._answers.keep(self._settings.edits)
            case Save() | Pick() | Compare() | ShowMap() as said:
                self._answers.ask(Asked(said, one.mailbox, self._settings, self._show))

    def _set_show(self, said: SetShow) -> None:
        before, self._show = self._show, said.applied(self._show)
        if said.exposure == "auto" or self._show.view != before.view:
            self._stops.reset()
        seen = self._seen
        if seen is not None and _has_layer(seen.result, self._show.layer):
            self._needs.add(Work.SHOW)
        else:
            self._needs |= {Work.LOW, Work.FULL}
            self._rest = 0.0
        self._answers.compare_again()
        self._send_state()

    # Pictures.

    def _make_low(self, renderer: Renderer, progress: Progress) -> None:
        if self._seen is None:  # kernels may have to be compiled first
            progress(FIRST, 0.0)
        read, started = self._there(), time.perf_counter()
        result = low_picture(self._draft.scene(read), read, renderer, self._layers(), progress)
        self._draft.took(time.perf_counter() - started, result)
        self._needs.discard(Work.LOW)
        self._good = self._settings
        self._see("low", result)

    def _make_full(self, renderer: Renderer, progress: Progress) -> None:
        read = self._there()
        asked, aov = read, self._aov(read)
        if len(aov) > len(read.file.image.aov):
            asked = self._read_settings(self._settings, read, ("image.aov", aov))
        rendered = asked.render(renderer, (), progress)
        self._draft.rendered(read, rendered.result)
        self._needs.discard(Work.FULL)
        self._good = self._good_in_full = self._settings
        self._see("full", rendered.result)
        if rendered.warnings != self._warnings:
            self._warnings = rendered.warnings
            self._send_state()
        self._answers.all_again()

    def _see(self, quality: Quality, result: Result) -> None:
        """Show a picture that is made, and say what it cost."""
        self._seen = SeenPicture(self._revision, quality, result)
        self._needs.discard(Work.SHOW)
        self._show_again()
        now = time.monotonic()
        if quality == "low":
            self._note_rate(now)
        since = self._first_input_at if quality == "low" else max(self._input_at, self._first_input_at)
        self._clients.send(
            {
                "type": "cost",
                "revision": self._revision,
                "quality": quality,
                "resolution": list(result.image.shape[1::-1]),
                "seconds": dict(result.stats.seconds),
                "made": dict(result.stats.made),
                "rate": round(self._rate, 2),
                "latency": round(now - since, 4),
            }
        )
        if self._failed_at is not None and self._inputs > self._failed_at:
            self._failed_at = None
            self._clients.forget(notice="failed")
            self._clients.send({"type": "cleared"})

    def _note_rate(self, now: float) -> None:
        between, self._low_at = now - self._low_at, now
        if between >= PAUSE:
            self._rate = 0.0
        else:
            rate = 1 / max(between, 1e-3)
            self._rate = rate if self._rate == 0 else self._rate + RATE_WEIGHT * (rate - self._rate)

    def _show_again(self) -> None:
        """Send the last picture as it is to be shown."""
        seen = self._seen
        if seen is None:
            return
        had = self._stops.value
        shown = pictures.shown(seen.result, self._exposed(seen.result, is_full=seen.quality == "full"))
        self._clients.send_shown("a", shown, seen.revision, seen.quality)
        if self._stops.value != had and self._show.exposure == "auto":
            self._send_state()

    def _exposed(self, result: Result, *, is_full: bool) -> Show:
        """Return how a result is shown, with an exposure that is a number."""
        if self._show.exposure != "auto":
            return self._show
        if not self._stops.is_kept:
            transparent = self._there().file.image.transparent
            picture = result.picture(transparent=transparent)
            stops = automatic_exposure(picture, self._show.view, transparent=transparent)
            self._stops = _Stops(stops, is_kept=is_full)
        return self._show.model_copy(update={"exposure": self._stops.value or 0.0})

    def _layers(self) -> tuple[str, ...]:
        """Return the layers that have to be asked for."""
        return () if self._show.layer == PICTURE else (self._show.layer,)

    def _aov(self, read: ReadFrame) -> list[str]:
        """Return the layers of a full picture: those that the scene asks for, and what is shown."""
        aov = list(read.file.image.aov)
        return [*aov, *(layer for layer in self._layers() if layer not in aov)]

    def _there(self) -> ReadFrame:
        if self._read is None:
            raise InputError("nothing is open; open a scene or a volume")
        return self._read

    # What is asked for besides.

    def _answer(self, renderer: Callable[[], Renderer], progress: Progress) -> None:
        asked = self._answers.take()
        try:
            self._answers.answer(asked, self._now(), renderer, progress)
        except CancelledError:
            self._answers.put_back(asked)
            raise
        except InputError as error:
            self._tell_failure(error, asked.mailbox)

    def _now(self) -> Now:
        read, seen, show = self._there(), self._seen, self._show
        if seen is not None and seen.quality == "full":
            show = self._exposed(seen.result, is_full=True)
        return Now(read, self._settings, self._aov(read), self._revision, seen, show, self._stops.value)

    # Telling.

    def _send_state(self) -> None:
        read = self._read
        if read is None:
            return
        settings, changing = self._settings, [".".join(map(str, key)) for key in read.file.changing]
        state = {
            "type": "state",
            "revision": self._revision,
            "source": Path(settings.shot.path).name,
            "options": _plain(read.options),
            "edits": _plain(dict(settings.edits.values)),
            "frame": settings.frame,
            "frames": None if self._frames is None else list(self._frames),
            "changing": changing,
            "undo": settings.edits.can_undo,
            "redo": settings.edits.can_redo,
            "bounds": _bounds(read),
            "show": {**self._show.model_dump(), "stops": self._stops.value},
            "warnings": list(dict.fromkeys((*self._left_out, *self._warnings))),
        }
        self._clients.send(state, lasts=True)

    def _tell_failure(self, error: BaseException, mailbox: Mailbox | None = None) -> None:
        notice = failed(error)
        self._failed_at = self._inputs
        if mailbox is None:
            self._clients.send(notice, lasts=True)
        else:
            mailbox.put(notice)

    def _telling(self, progress: Progress) -> Progress:
        """Tell clients how far work is that takes long; ``progress`` is asked each time."""
        last = time.monotonic() + TOLD_AFTER - TOLD_EVERY

        def told(stage: str, fraction: float) -> None:
            nonlocal last
            progress(stage, fraction)
            now = time.monotonic()
            if now - last >= TOLD_EVERY or stage == FIRST:
                last, self._is_telling = now, True
                self._clients.send(
                    {"type": "work", "stage": stage, "fraction": round(min(fraction, 0.999), 3)}
                )

        return told

    def _tell_compiling(self, what: str) -> None:
        """Tell clients at once what is compiled: nothing can be told while a compiler works."""
        self._is_telling = True
        self._clients.send({"type": "work", "stage": f"compiling kernels: {what}", "fraction": 0.0})

    # Going back.

    def _go_back(self, error: BaseException, work: Work) -> None:
        """Return to the settings of the last picture that could be made."""
        self._needs.clear()
        if self._show.layer != PICTURE and isinstance(error, InputError):
            self._show = self._show.model_copy(update={"layer": PICTURE})
            self._needs |= {Work.LOW, Work.FULL}
            self._send_state()
            return
        good = self._good_in_full if work is Work.FULL else self._good
        if good.is_as(self._settings):
            good = self._good_in_full
        if not good.is_as(self._settings):
            self._try(replace(good, edits=good.edits))
        elif not isinstance(error, InputError) and not self._has_retried:
            self._has_retried = True
            self._needs |= {Work.LOW, Work.FULL}


@dataclass
class _Stops:
    """The exposure that stands for ``"auto"``."""

    value: float | None = None
    is_kept: bool = False
    """Whether it is of a full picture, and stays."""

    def reset(self) -> None:
        """Choose it anew with the next picture."""
        self.is_kept = False


_INPUTS = (Edit, SetFrame, Undo, Redo, Reset, Open, Path)
"""What makes pictures stale."""


def _has_layer(result: Result, layer: str) -> bool:
    return (
        layer == PICTURE
        or layer in result.aovs
        or (layer in GROUPS and any(name.startswith(GROUPS[layer].prefix) for name in result.aovs))
    )


@cache
def _welcome() -> dict[str, Any]:
    """Return what all clients of all sessions are told at first."""
    layers = {PICTURE: MEANING} | {name: group.layer(0).meaning for name, group in GROUPS.items()}
    layers |= {name: layer.meaning for name, layer in LAYERS.items()}
    return {
        "type": "welcome",
        "version": __version__,
        "schema": scene_schema(),
        "layers": [{"name": name, "meaning": meaning} for name, meaning in layers.items()],
        "views": [{"name": view.NAME, "summary": view.SUMMARY} for view in VIEWS.values()],
        "presets": [{"name": name, "summary": preset.summary} for name, preset in PRESETS.items()],
    }


def _bounds(read: ReadFrame) -> list[list[float]] | None:
    """Return the world box around what has density; None of what is everywhere."""
    bounds = read.scene.occupied_bounds
    return bounds.tolist() if np.isfinite(bounds).all() else None


def _plain(value: Any) -> Any:
    """Return what JSON can hold: numbers that are not finite are None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _silent(stage: str, fraction: float) -> None:
    """Never cancel."""
    del stage, fraction
