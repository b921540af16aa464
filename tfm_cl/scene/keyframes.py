"""Values that change from frame to frame: ``fov = [{ frame = 1, value = 20 }, …]``."""

from __future__ import annotations

import bisect
import copy
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tfm_cl.errors import Fault, Faults, Key
from tfm_cl.scene.matrix_interpolation import Decomposed, affine_of, angle_between, turned_between

INTERPOLATIONS = ("linear", "smooth", "step")
"""Between a key and the next, said by the key: a straight line; a curve without overshoot; none."""
KEYS = ("frame", "value", "interpolation")
"""Of a keyframe's table."""
MATRICES = ("matrix", "transform")
"""Keys of matrices, which are no mere numbers: what turns keeps its size."""
LARGEST = 1e30
"""Of frames and values: what is larger is no number of a scene."""

Number = int | float
Values = dict[str, Any]


def at_frame(values: Values, frame: float) -> Values:
    """Return a scene's values at a frame: every list of keyframes, wherever it is, becomes its value then.

    Numbers, vectors and matrices are interpolated, number by number; texts, tables and what is on or off keep
    the value of the key before. Before the first key and after the last the value is theirs.

    Parameters
    ----------
    values
        As TOML gives them; they stay as they are.
    frame
        May lie between whole frames.

    Raises
    ------
    SceneError
        Keyframes that are none, with the `Key` of each.
    """
    faults = Faults()
    found, _ = evaluated(values, frame, faults)
    faults.raise_any()
    return found


def evaluated(values: Values, frame: float | None, faults: Faults) -> tuple[Values, list[Key]]:
    """Return values as `at_frame` does, and the keys of those that have keyframes.

    What is wrong goes to ``faults``. Without a frame all values stay as they are.
    """
    result, changing = dict(values), list[Key]()
    waiting: list[tuple[Any, Key]] = [(result, ())]
    while waiting:  # no recursion: files may be nested deeper than Python's stack
        holder, place = waiting.pop()
        for name, value in list(holder.items() if isinstance(holder, dict) else enumerate(holder)):
            key, now = (*place, name), value
            if len(key) > 1 and _has_keyframes(value):
                changing.append(key)
                if frame is not None:
                    now = _value_at(value, frame, key, faults)
            elif isinstance(holder, dict) and isinstance(value, dict) and {"frame", "value"} <= value.keys():
                line = "keyframes are a list, even of one: [{ frame = 1, value = … }]"
                faults.add(Fault(f"{'.'.join(map(str, key))}: {line}", key))
            if isinstance(now, dict | list):
                now = copy.copy(now)
                waiting.append((now, key))
            holder[name] = now
    return result, sorted(changing, key=str)


def is_between_whole(given: Values, now: Values, key: Key) -> bool:
    """Tell whether a value lies between keyframes of whole numbers, and is none itself.

    Parameters
    ----------
    given, now
        Values as TOML gives them, and at a frame.
    key
        Of the value.
    """
    of_keys: Any = given
    found: Any = now
    try:
        for name in key:
            of_keys, found = of_keys[name], found[name]
    except (LookupError, TypeError):  # of a body that is not there
        return False
    if not _has_keyframes(of_keys):
        return False  # a file of each frame
    return _is_whole([one.get("value") for one in of_keys]) and not _is_whole(found)


def _is_whole(value: Any) -> bool:
    """Tell whether a value is a whole number, or a list of them."""
    return all(map(_is_whole, value)) if isinstance(value, list) else type(value) is int


def frames_told(values: Values) -> list[float]:
    """Return the frames of all keyframes, in order; those that are none tell nothing."""
    found = set[float]()
    for key in evaluated(values, None, Faults())[1]:
        tables: Any = values
        for part in key:
            tables = tables[part]
        found |= {table["frame"] for table in tables if not _wrong_with(table)}
    return sorted(found)


def _has_keyframes(value: Any) -> bool:
    """Tell whether a value is meant as keyframes: no other tables have such keys."""
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(item, dict) for item in value)
        and any("frame" in item or "value" in item for item in value)
    )


@dataclass(frozen=True)
class _Keyframe:
    frame: float
    value: Any
    interpolation: str


def _value_at(tables: list[Values], frame: float, key: Key, faults: Faults) -> Any:
    """Return the value of keyframes at a frame; of wrong ones None, and what is wrong goes to ``faults``."""
    name = ".".join(map(str, key))
    wrong = [
        Fault(f"{name}: keyframe {number + 1} {line}", (*key, number))
        for number, table in enumerate(tables)
        if (line := _wrong_with(table))
    ]
    keyframes = (
        sorted((_Keyframe(**{"interpolation": "linear", **table}) for table in tables), key=_frame_of)
        if not wrong
        else []
    )
    for one, other in itertools.pairwise(keyframes):
        if one.frame == other.frame:
            wrong.append(Fault(f"{name}: two keyframes at frame {one.frame:g}; keep one", key))
            break
    forms = [_form(table["value"]) for table in tables] if not wrong else []
    for number, form in enumerate(forms):
        if form != forms[0]:
            line = f"is {form}, keyframe 1 {forms[0]}; all values should be of one form"
            wrong.append(Fault(f"{name}: keyframe {number + 1} {line}", (*key, number)))
            break
    if wrong:
        faults.add(*wrong)
        return None
    return _between(keyframes, frame, is_matrix=key[-1] in MATRICES)


def _frame_of(keyframe: _Keyframe) -> float:
    return keyframe.frame


def _wrong_with(table: Values) -> str:
    """Say what is wrong with a keyframe's table by itself."""
    strange = [name for name in table if name not in KEYS]
    if strange:
        return f"has an unknown key '{strange[0]}'; known: {', '.join(KEYS)}"
    for name in ("frame", "value"):
        if name not in table:
            return f"has no {name}; write {{ frame = 1, value = … }}"
    if not _is_number(table["frame"]):
        return f"has frame = {_shown(table['frame'])}, which should be a finite number"
    told = table.get("interpolation", "linear")
    if told not in INTERPOLATIONS:
        return f"has interpolation = {_shown(told)}, which should be one of {', '.join(INTERPOLATIONS)}"
    return "has a value that is not finite" if _is_endless(table["value"]) else ""


def _shown(value: Any) -> str:
    text = repr(value) if not isinstance(value, dict | list) else "…"
    return text if len(text) <= len("1e308") * 8 else f"{text[:37]}…"


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
    )  # NaN is not


def _is_endless(value: Any) -> bool:
    """Tell whether a value is, or holds in rows, a number that is none."""
    rows = value if isinstance(value, list) else [value]
    numbers = [item for row in rows for item in (row if isinstance(row, list) else [row])]
    return any(type(item) in {int, float} and not _is_number(item) for item in numbers)


def _form(value: Any) -> str:
    """Say of what form a value is."""
    if _is_number(value):
        return "a number"
    if isinstance(value, list) and value:
        if all(map(_is_number, value)):
            return f"{len(value)} numbers"
        inner = {_form(row) if isinstance(row, list) and not _holds_lists(row) else "" for row in value}
        if len(inner) == 1 and (form := inner.pop()).endswith("numbers"):
            return f"{len(value)} rows of {form}"
    names = {bool: "true or false", str: "a text", dict: "a table", list: "a list"}
    return names.get(type(value), "a date")


def _holds_lists(row: list[Any]) -> bool:
    return any(isinstance(item, list) for item in row)


def _between(keyframes: Sequence[_Keyframe], frame: float, *, is_matrix: bool) -> Any:
    """Return the value of keyframes, in order, at a frame."""
    after = bisect.bisect_right(keyframes, frame, key=_frame_of)
    before = keyframes[max(after - 1, 0)]
    is_at_rest = after in {0, len(keyframes)} or before.frame == frame or before.interpolation == "step"
    if is_at_rest or not _form(before.value).endswith(("number", "numbers")):
        return before.value
    # Of four neighbours a curve knows all that it depends on.
    near = keyframes[max(after - 2, 0) : after + 2]
    matrices = [affine_of(one.value) for one in near] if is_matrix else [None]
    places = [Decomposed.of(matrix) for matrix in matrices if matrix is not None]
    if len(places) == len(near):
        return _moved(places, near, min(after - 1, 1), frame)
    return _mixed([one.value for one in near], near, min(after - 1, 1), frame)


def _moved(
    places: Sequence[Decomposed], near: Sequence[_Keyframe], begin: int, frame: float
) -> list[list[float]]:
    """Return the matrix between two places: turned the shorter way, the rest number by number."""
    shift = _mixed([place.shift.tolist() for place in places], near, begin, frame)
    stretch = _mixed([place.stretch.tolist() for place in places], near, begin, frame)
    turned = list(
        itertools.accumulate(itertools.starmap(angle_between, itertools.pairwise(places)), initial=0.0)
    )
    one, other = places[begin], places[begin + 1]
    angle = turned[begin + 1] - turned[begin]
    along = (_mixed(turned, near, begin, frame) - turned[begin]) / angle if angle > 0 else 0.0
    turn = turned_between(one, other, along)
    found: list[list[float]] = Decomposed(np.array(shift), turn, np.array(stretch)).matrix().tolist()
    return found


def _mixed(values: list[Any], near: Sequence[_Keyframe], begin: int, frame: float) -> Any:
    if isinstance(values[0], list):
        return [_mixed([value[i] for value in values], near, begin, frame) for i in range(len(values[0]))]
    one, other = near[begin], near[begin + 1]
    length = other.frame - one.frame
    along = (frame - one.frame) / length
    low, high = float(values[begin]), float(values[begin + 1])
    found = low + (high - low) * along
    if one.interpolation == "smooth":
        slopes = [_slope(values, near, number) * length for number in (begin, begin + 1)]
        rest = 1 - along
        found = low + (high - low) * along * along * (3 - 2 * along)
        found += along * rest * (slopes[0] * rest - slopes[1] * along)
    whole = all(isinstance(value, int) for value in (values[begin], values[begin + 1]))
    return int(found) if whole and found.is_integer() else found


def _slope(values: Sequence[Number], near: Sequence[_Keyframe], number: int) -> float:
    """Return the slope of a smooth curve at a key: 0 at ends and extremes.

    Elsewhere the weighted harmonic mean of the slopes on both sides, with which a cubic is monotone between
    keys (Fritsch & Butland, "A method for constructing local monotone piecewise cubic interpolants", 1984).
    """
    if number in {0, len(near) - 1} or "step" in {one.interpolation for one in near[number - 1 : number + 1]}:
        return 0.0
    lengths = [near[i + 1].frame - near[i].frame for i in (number - 1, number)]
    slopes = [
        (values[i + 1] - values[i]) / length for i, length in zip((number - 1, number), lengths, strict=True)
    ]
    if slopes[0] * slopes[1] <= 0 or not all(map(math.isfinite, slopes)):
        return 0.0
    weights = 2 * lengths[1] + lengths[0], lengths[1] + 2 * lengths[0]
    return sum(weights) / (weights[0] / slopes[0] + weights[1] / slopes[1])
