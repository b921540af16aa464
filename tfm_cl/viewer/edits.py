"""What a session renders: a shot, what was set since it was opened, and the way back."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from tfm_cl.errors import InputError
from tfm_cl.scene import camera, movable
from tfm_cl.scene.lights.base import LIGHTS
from tfm_cl.scene.scene_file import ARRAYS, NUMBERS, SECTIONS

if TYPE_CHECKING:
    from tfm_cl.scene.scene_file import SceneFile
    from tfm_cl.sequence.shot import Shot
    from tfm_cl.viewer.renderer import ReadFrame

MOST_STEPS = 500
"""That can be taken back."""
MOST_KEPT = 1 << 24
"""Letters of all of these steps; of more the oldest go."""
MOST_SET = 1 << 20
"""Letters of all that is set, as of a scene file."""

PLACED = ("camera", "light", "solid")
"""Sections of what is placed where a scene leaves it open."""

Values = Mapping[str, Any]
"""Dotted keys, or whole sections, and what they are set to."""


class _Drag(NamedTuple):
    """A drag that goes on."""

    by: Hashable
    keys: frozenset[str]


class _Step(NamedTuple):
    """What was set before a step, and how large what it changed was."""

    values: Values
    size: int
    drag: _Drag | None = None
    """That adds to it."""


@dataclass(frozen=True)
class Edits:
    """What is set besides what a file says, by the keys of ``--set``, with undo and redo.

    Each method returns what is set after it.
    """

    values: Values = field(default_factory=dict)
    """In the order in which it was set last."""
    _past: tuple[_Step, ...] = ()
    _future: tuple[_Step, ...] = ()

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to be taken back."""
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        """Whether there is one to be made again."""
        return bool(self._future)

    def with_changes(self, changes: Values, *, drag: bool = False, by: Hashable = None) -> Edits:
        """Set some keys.

        What says the same in another way, as ``camera.fov`` and ``camera.focal_length`` do, and keys of a
        section that is set as a whole, are set no longer.

        Parameters
        ----------
        changes
            None takes a key back.
        drag
            Whether more of the same keys follows: all of it, and the first that is no drag, is one step.
        by
            Who does it: each may drag something at the same time, and all of it is one step for each.

        Raises
        ------
        InputError
            More than a scene file holds.
        """
        values = _changed(self.values, changes)
        if len(repr(values)) > MOST_SET:
            raise InputError(f"edit: more than {MOST_SET:,} letters are set; save the scene and open it")
        this = _Drag(by, frozenset(changes))
        goes_on = this if drag else None
        at = next((at for at, step in enumerate(self._past) if step.drag == this), None)
        # Whatever else the same one has dragged is done.
        past = tuple(_Step(*step[:2]) if step.drag and step.drag.by == by else step for step in self._past)
        if at is not None:
            # Steps that others made meanwhile are taken back to what is dragged, too.
            later = (step._replace(values=_changed(step.values, changes)) for step in past[at + 1 :])
            past = (*past[:at], past[at]._replace(drag=goes_on), *later)
            return Edits(values, past)
        if values == self.values and not drag:
            return replace(self, _past=past)
        return Edits(values, _bounded((*past, _Step(self.values, len(repr(changes)), goes_on))))

    def reset(self) -> Edits:
        """Set nothing: a step like others."""
        if not self.values:
            return self
        return Edits({}, _bounded((*self._past, _Step(self.values, len(repr(self.values))))))

    def undo(self) -> Edits:
        """Take the last step back; without one nothing changes."""
        if not self._past:
            return self
        *past, step = self._past
        return Edits(step.values, tuple(past), (*self._future, _Step(self.values, step.size)))

    def redo(self) -> Edits:
        """Make the step again that was taken back last; without one nothing changes."""
        if not self._future:
            return self
        *future, step = self._future
        return Edits(step.values, (*self._past, _Step(self.values, step.size)), tuple(future))


def _bounded(past: tuple[_Step, ...]) -> tuple[_Step, ...]:
    """Return the last steps, as many as are kept."""
    kept = list(past[-MOST_STEPS:])
    while len(kept) > 1 and sum(step.size for step in kept) > MOST_KEPT:
        kept.pop(0)
    return tuple(kept)


def _changed(values: Values, changes: Values) -> Values:
    """Return what is set after changes."""
    after = dict(values)
    for key, value in changes.items():
        after.pop(key, None)
        if value is not None:
            after = {name: said for name, said in after.items() if not _is_outdone(name, key, value)}
            after[key] = _without_none(value)
    return after


def over(base: Iterable[tuple[str, Any]], values: Values) -> list[tuple[str, Any]]:
    """Return pairs as of ``--set`` with what is set over them; what that says in another way is left out."""
    return [*not_said(base, values), *values.items()]


def not_said(base: Iterable[tuple[str, Any]], values: Values) -> list[tuple[str, Any]]:
    """Return those pairs that say something else than what is set."""
    said = [(_whole(key), value) for key, value in values.items()]
    return [
        (name, kept)
        for name, kept in base
        if not any(_whole(name) == key or _is_outdone(name, key, value) for key, value in said)
    ]


def _whole(key: str) -> str:
    """Write the number of a table that a key leaves out, as it is the first."""
    section, dot, rest = key.partition(".")
    number, _ = _of_table(rest)
    return f"{section}.0.{rest}" if section in ARRAYS and dot and not rest.startswith(f"{number}.") else key


def _is_outdone(name: str, key: str, value: Any) -> bool:
    """Tell whether setting a key makes what another was set to meaningless."""
    section, _, rest = name.partition(".")
    of, _, last = key.partition(".")
    if section != of:
        return False
    if not last:  # the whole section
        return key in {*SECTIONS, *ARRAYS}
    if section == "camera":
        return rest in camera.outdone([last])
    if section == "map":
        return rest != last and {rest, last} <= set(NUMBERS)
    (number, told), (of_number, of_told) = _of_table(rest), _of_table(last)
    if section == "light" and of_told == "type" and str(value) in LIGHTS:
        return number == of_number and told not in LIGHTS[str(value)].keys()  # noqa: SIM118 - no dict
    return number == of_number and told in movable.outdone(of_told)


def _of_table(rest: str) -> tuple[int, str]:
    """Return the number of a table of an array, and its key, of what follows the section's name."""
    number, dot, key = rest.partition(".")
    return (int(number), key.partition(".")[0]) if dot and number.isdecimal() else (0, number)


def _is_of_camera(key: str) -> bool:
    return key.partition(".")[0] == "camera"


def _without_none(value: Any) -> Any:
    """Leave keys out that are None in tables: scene files have no such value."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value


@dataclass(frozen=True)
class Settings:
    """What is rendered."""

    shot: Shot
    frame: float | None
    edits: Edits = field(default_factory=Edits)

    def is_as(self, other: Settings) -> bool:
        """Tell whether both are the same picture."""
        return (self.shot, self.frame, self.edits.values) == (other.shot, other.frame, other.edits.values)

    def file(self, *also: tuple[str, Any]) -> SceneFile:
        """Read the scene file with all that is set; ``also`` is set besides."""
        overrides = [*over(self.shot.overrides, self.edits.values), *also]
        decided = not_said(self.shot.decided, self.edits.values)
        return replace(self.shot, overrides=overrides, decided=decided).scene_file(self.frame)

    def as_kept(self, kept: Edits) -> Settings:
        """Return the settings that were kept, seen by the camera of now."""
        then = {key: value for key, value in kept.values.items() if not _is_of_camera(key)}
        now = {key: value for key, value in self.edits.values.items() if _is_of_camera(key)}
        return replace(self, edits=Edits(then | now))

    def settled(self, read: ReadFrame, *, changes: bool) -> Settings:
        """Return the same where what was placed or chosen stays: no light moves because the camera does.

        Parameters
        ----------
        changes
            Whether the scene changes from frame to frame: then a density that was chosen stays, too.
        """
        kept = (*PLACED, *(("volume",) if changes else ()))
        placed = [
            (key, decision.value)
            for key, decision in read.planned.decisions.items()
            if key.partition(".")[0] in kept and decision.value is not None
        ]
        decided = [*self.shot.decided, *placed]
        return replace(self, shot=replace(self.shot, decided=decided, look=read.file.look.name))
