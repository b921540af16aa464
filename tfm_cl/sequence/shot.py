"""A shot: a scene file, what is set besides, and what each of its frames is of."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from tfm_cl.errors import SceneError
from tfm_cl.files.paths import source_of
from tfm_cl.scene import looks
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import SceneFile, frames_of
from tfm_cl.sequence.ranges import LARGEST_FRAME
from tfm_cl.sequence.turntable import FULL_TURN, angle_of


@dataclass(frozen=True)
class Shot:
    """A scene that may change from frame to frame, by keyframes and files of each frame.

    Parameters
    ----------
    path
        A scene file (``.toml``), a volume, or a pattern of either: ``smoke.####.vdb``.
    overrides
        Pairs of a dotted key and a value that win over the file: ``("camera.fov", 30.0)``.
    look
        As of `tfm_cl.scene.scene_file.SceneFile.read`.
    turntable
        Frames of one turn of the camera about ``camera.up`` through ``camera.to``, which begins at frame 1;
        None: it does not turn.
    decided
        Pairs like the overrides, of what is left open, decided for many frames.

    Raises
    ------
    SceneError
        A turn of no frames, overrides that are no pairs, or a path that is none.
    """

    path: str | os.PathLike[str]
    overrides: Iterable[tuple[str, Any]] = ()
    look: str = looks.PLAIN
    turntable: int | None = None
    decided: Iterable[tuple[str, Any]] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", source_of(self.path, error=SceneError))
        object.__setattr__(self, "overrides", _pairs("overrides", self.overrides))
        object.__setattr__(self, "decided", _pairs("decided", self.decided))
        turn = self.turntable
        if turn is not None and not (isinstance(turn, Integral) and 1 <= turn <= LARGEST_FRAME):
            raise SceneError(f"turntable = {turn!r}: should be a number of frames from 1")

    def scene_file(self, frame: float | None = None) -> SceneFile:
        """Read what is asked for in a frame; without one, in all frames of what does not change.

        Raises
        ------
        SceneError, VolumeError
            As `tfm_cl.scene.scene_file.SceneFile.read`; and a frame that is no number.
        """
        frame = _checked(frame)
        found = SceneFile.read(Path(self.path), self.overrides, self.look, frame, self.decided)
        if self.turntable is None or frame is None:
            return found
        return replace(found, turn=angle_of(frame, self.turntable), turn_a_frame=FULL_TURN / self.turntable)

    def frames(self) -> tuple[float, float] | None:
        """Return the first and the last frame that files, keyframes and the turntable tell of.

        None where nothing changes from frame to frame.

        Raises
        ------
        SceneError
            As `tfm_cl.scene.scene_file.frames_of`.
        """
        found = frames_of(Path(self.path), self.overrides)
        if self.turntable is None:
            return found
        first, last = found or (1, self.turntable)
        return min(first, 1), max(last, self.turntable)

    def scene(self, frame: float | None = None) -> Scene:
        """Read the scene of a frame with its volumes, ready for `tfm_cl.render.renderer.Renderer.render`.

        Raises
        ------
        SceneError, VolumeError
            As `scene_file`; and a volume that cannot be used.
        """
        return self.scene_file(frame).make(Scene)


def _pairs(name: str, values: Iterable[tuple[str, Any]]) -> tuple[tuple[str, Any], ...]:
    pairs: tuple[tuple[str, Any], ...] | None = None
    with suppress(TypeError, ValueError):
        pairs = tuple((key, value) for key, value in values)
    if pairs is None or not all(isinstance(key, str) for key, _ in pairs):
        raise SceneError(f'{name}: should be pairs of a dotted key and a value, as ("camera.fov", 30.0)')
    return pairs


def _checked(frame: float | None) -> float | None:
    """Return a frame as a number of Python's own."""
    if frame is None:
        return None
    if not isinstance(frame, Real) or isinstance(frame, bool) or not abs(frame) <= LARGEST_FRAME:
        raise SceneError(f"frame = {frame!r:.40}: should be a number up to {LARGEST_FRAME:,}")
    return int(frame) if float(frame).is_integer() else float(frame)
