"""Frames of a shot as `tfm_cl.sequence.run` makes them: from the scene file at a frame to its files."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from tfm_cl.errors import InputError
from tfm_cl.files.paths import write_text
from tfm_cl.scene.scene_file_writer import scene_text
from tfm_cl.sequence import fingerprint
from tfm_cl.sequence.claims import Ledger
from tfm_cl.sequence.names import Files
from tfm_cl.sequence.run import Outcome, Told, run
from tfm_cl.sequence.shot import Shot

if TYPE_CHECKING:
    from tfm_cl.device.launch import Progress
    from tfm_cl.scene.scene_file import SceneFile
    from tfm_cl.sequence.frame import ReadFrame, RenderedFrame
    from tfm_cl.sequence.renderer import Renderer

SHORT = 1.0
"""Seconds of a frame, at most, beside which the next is begun before it has ended: its files are written
later by as much, and both take memory."""

Read = Callable[["SceneFile", float | None, "ReadFrame | None"], "ReadFrame"]
States = list[tuple[str, int, int]]
MakeRenderer = Callable[[], AbstractContextManager["Renderer"]]


class _Read(NamedTuple):
    """A frame that is read."""

    frame: ReadFrame
    seconds: float
    """That it took."""
    is_prepared: bool
    """Whether its voxels are on the device beside others."""


class _Made(NamedTuple):
    """A frame that is rendered."""

    frame: RenderedFrame
    read: float
    """Seconds of reading."""
    rendered: float
    """Seconds of rendering."""


class ShotFrames:
    """Makes frames with one renderer; a context manager, which closes it.

    Parameters
    ----------
    shot
        With all that was decided for the range.
    files
        To write.
    read
        Reads a frame, as `tfm_cl.sequence.frame.read` does.
    make_renderer
        Called when the first frame is rendered.
    """

    progress: Progress | None = None
    """Of the renderer."""

    def __init__(self, shot: Shot, files: Files, read: Read, make_renderer: MakeRenderer) -> None:
        self._shot, self._files = shot, files
        self._read, self._make_renderer = read, make_renderer
        self._stack = ExitStack()
        self._made: Renderer | None = None
        self._last: tuple[int, SceneFile] | None = None
        self._before: tuple[States, ReadFrame] | None = None
        """The frame that was read last, of files as they were then."""
        self._seconds = math.inf
        """Of the last frame that was rendered; of the first nothing is known."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the renderer; the next frame makes another."""
        self._made = self._before = None
        self._stack.close()

    def decided(self, shot: Shot) -> None:
        """Go on with a shot of which all is decided."""
        self._shot, self._last = shot, None

    def _file(self, frame: int) -> SceneFile:
        """Read the scene file of a frame, once for all that is done with it."""
        if self._last is None or self._last[0] != frame:
            self._last = frame, self._shot.scene_file(frame)
        return self._last[1]

    @property
    def renderer(self) -> Renderer:
        """Made when it is first asked for."""
        if self._made is None:
            self._made = self._stack.enter_context(self._make_renderer())
        return self._made

    def name(self, frame: int) -> str:
        """As `tfm_cl.sequence.run.Frames.name`."""
        return self._files.name(frame)

    def outputs(self, frame: int) -> tuple[Path, ...]:
        """As `tfm_cl.sequence.run.Frames.outputs`."""
        return self._files.of(frame)

    def fingerprint(self, frame: int) -> str:
        """As `tfm_cl.sequence.run.Frames.fingerprint`."""
        return fingerprint.of_frame(self._file(frame), self.outputs(frame))

    def read(self, frame: int) -> _Read:
        """As `tfm_cl.sequence.run.Frames.read`."""
        started = time.perf_counter()
        file = self._file(frame)
        for path in self.outputs(frame):
            if file.is_file_of_a_frame(path):
                raise InputError(f"{path}: is the input of a frame; choose another name")
        states = fingerprint.states(file)
        ready = self._read(file, frame, self._like(states))
        ready.read_files()
        self._before = states, ready
        is_prepared = False
        if self._made is not None and not file.image.is_blurred:
            is_prepared = self._made.prepare(ready.scene)
        return _Read(ready, time.perf_counter() - started, is_prepared)

    def _like(self, states: States) -> ReadFrame | None:
        """Return the frame before, whose files a frame need not read again; None if they have changed."""
        if self._before is None:
            return None
        before, ready = self._before
        known = {name: state for name, *state in before}
        return ready if all(known.get(name, state) == state for name, *state in states) else None

    def render(self, read: _Read) -> Callable[[], _Made]:
        """As `tfm_cl.sequence.run.Frames.render`."""
        renderer, started = self.renderer, time.perf_counter()
        end = read.frame.begin(renderer, self._files.pictures, self.progress)
        begun = time.perf_counter() - started

        def made() -> _Made:
            started = time.perf_counter()
            done = end()
            self._seconds = begun + time.perf_counter() - started
            return _Made(done, read.seconds, self._seconds)

        # What is large is given back before others take its place.
        if read.is_prepared and self._seconds < SHORT:
            renderer.forget_unused()
            return made
        done = made()
        renderer.forget_unused()
        return lambda: done

    def write(self, frame: int, made: _Made) -> Told:
        """As `tfm_cl.sequence.run.Frames.write`."""
        (done, load, render), started = made, time.perf_counter()
        outputs, pictures = self.outputs(frame), len(self._files.pictures)
        done.save(outputs[:pictures])
        for path in outputs[pictures:]:
            write_text(path, scene_text(done.options, path.parent, every_key=self._files.every_key))
        save, report = time.perf_counter() - started, done.report()
        report["seconds"] |= {"load": load, "save": save, "total": load + render + save}
        of_scene = done.read.warnings_of_scene() if outputs[pictures:] else ()
        return Told((*done.read.warnings(), *of_scene, *done.warnings), report)


class FrameWorker:
    """Makes one frame after the other in a process of its own.

    Parameters
    ----------
    shot, files, read, make_renderer
        As of `ShotFrames`.
    skip_existing
        As of `tfm_cl.sequence.run.run`.
    """

    def __init__(
        self,
        shot: Shot,
        files: Files,
        read: Read,
        make_renderer: MakeRenderer,
        *,
        skip_existing: bool = False,
    ) -> None:
        self._skips, self._stack = skip_existing, ExitStack()
        self._frames = self._stack.enter_context(ShotFrames(shot, files, read, make_renderer))
        self._ledger = self._stack.enter_context(Ledger(files.ledger))

    def close(self) -> None:
        """Release the renderer and all claims."""
        self._stack.close()

    def frame(self, frame: int, progress: Progress) -> tuple[Outcome, Told | None]:
        """Make a frame, or find out that it is made; returns what became of it."""
        self._frames.progress = progress
        told: list[Told] = []

        def tell(_frame: int, how: str, what: Any) -> None:
            if how == "made":
                told.append(what)

        outcome = run([frame], self._frames, self._ledger, skip_existing=self._skips, waits=False, tell=tell)
        return outcome, told[0] if told else None
