"""What a page may say to its session, one JSON object a message, and how a picture is shown.

Everything a page says is checked here, before anything is done about it: it may be anybody's.
"""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError

from tfm_cl.errors import InputError, unknown_key
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.limits import MOST_STOPS
from tfm_cl.render.shown import PICTURE
from tfm_cl.scene.fields import MOST_FIELDS
from tfm_cl.scene.layers import NAMES
from tfm_cl.viewer.files import Kind

MOST_BYTES = 1 << 20
"""Of a message, in UTF-8; as many as of a scene file."""
MOST_CHANGES = 1000
"""Keys that one edit sets."""
MOST_CHARACTERS = 4096
"""Of a key, a name or a path."""
MOST_NESTED = 32
"""Tables and lists in each other, in a value."""
MOST_LIGHTS = 1 << 16
"""Beyond any number of a light that is in a scene file."""
SHOWN_LAYERS = (PICTURE, *NAMES)
"""What a page may look at; of a group that of one light."""


def _layer(value: Any) -> Any:
    if not isinstance(value, str) or value not in SHOWN_LAYERS:
        raise ValueError(unknown_key(str(value)[:40], list(SHOWN_LAYERS)).replace("key", "layer"))
    return value


def _view(value: Any) -> Any:
    if not isinstance(value, str) or value not in VIEWS:
        raise ValueError(unknown_key(str(value)[:40], list(VIEWS)).replace("key", "view"))
    return value


def _stops(value: Any) -> Any:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if value != "auto" and not (is_number and abs(value) <= MOST_STOPS):
        raise ValueError(f"should be a number of stops from -{MOST_STOPS} to {MOST_STOPS}, or 'auto'")
    return value if value == "auto" else float(value)


Text = Annotated[str, Field(max_length=MOST_CHARACTERS)]
Layer = Annotated[str, BeforeValidator(_layer)]
View = Annotated[str, BeforeValidator(_view)]
Stops = Annotated[float | Literal["auto"], BeforeValidator(_stops)]
LightNumber = Annotated[int, Field(ge=0, lt=MOST_LIGHTS)]
"""From 0."""


class _Checked(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Show(_Checked):
    """How pictures are shown; nothing is rendered anew for it, unless a layer was not asked for before."""

    layer: Layer = PICTURE
    exposure: Stops = 0.0
    """Stops; ``"auto"``: chosen from the first full picture, and kept until it is asked for again."""
    view: View = "standard"
    light: LightNumber = 0
    """Whose layer is shown, of a group."""


class Edit(_Checked):
    """Set keys of the scene, as ``--set`` does; None takes back what was set since the file was opened."""

    type: Literal["edit"] = "edit"
    changes: dict[Text, Any] = Field(min_length=1, max_length=MOST_CHANGES)
    drag: bool = False
    """Whether more of the same follows: until one with false all are one step of undo."""


class SetFrame(_Checked):
    """Go to a frame."""

    type: Literal["frame"] = "frame"
    frame: float
    drag: bool = False


class SetShow(_Checked):
    """Show pictures in another way; what is left out stays."""

    type: Literal["show"] = "show"
    layer: Layer | None = None
    exposure: Stops | None = None
    view: View | None = None
    light: LightNumber | None = None

    def applied(self, show: Show) -> Show:
        """Return how pictures are shown from now on."""
        said = self.model_dump(exclude={"type"}, exclude_none=True)
        return Show(**{**show.model_dump(), **said})


class Undo(_Checked):
    """Take the last step back."""

    type: Literal["undo"] = "undo"


class Redo(_Checked):
    """Make the last step again that was taken back."""

    type: Literal["redo"] = "redo"


class Reset(_Checked):
    """Go back to what the file says; a step that can be undone."""

    type: Literal["reset"] = "reset"


class Pick(_Checked):
    """Ask for the transmittance along the light ray through what a place of the picture shows."""

    type: Literal["pick"] = "pick"
    x: float = Field(ge=0, le=1)
    """Of the picture's width, from its left edge."""
    y: float = Field(ge=0, le=1)
    """Of its height, from its upper edge."""
    light: LightNumber = 0


class Keep(_Checked):
    """Keep the settings as they are now, to compare with."""

    type: Literal["keep"] = "keep"


class Compare(_Checked):
    """Compare with the dual march, with the settings that were kept, or no longer."""

    type: Literal["compare"] = "compare"
    with_: Literal["nothing", "dual", "kept"] = Field(validation_alias="with")


class ShowMap(_Checked):
    """Look at a coefficient of a light's map."""

    type: Literal["map"] = "map"
    light: LightNumber = 0
    coefficient: int = Field(ge=-1, lt=1024)
    """From 0; -1: no longer."""
    field: int = Field(default=0, ge=0, lt=MOST_FIELDS)
    """From 0, as of `tfm_cl.scene.fields`; the last one where the scene has fewer by now."""


class Save(_Checked):
    """Write a file of the folder: the scene as a scene file, or the picture."""

    type: Literal["save"] = "save"
    what: Literal["scene", "exr", "png"]
    name: Text


class Open(_Checked):
    """Open a file of the folder."""

    type: Literal["open"] = "open"
    path: Text


class List(_Checked):
    """List a folder within the folder, with its files of a kind."""

    type: Literal["list"] = "list"
    path: Text = ""
    kind: Kind = "scene"


class Seen(_Checked):
    """Say that a picture was drawn: the next may come."""

    type: Literal["seen"] = "seen"
    picture: int = Field(ge=0)


Said = (
    Edit
    | SetFrame
    | SetShow
    | Undo
    | Redo
    | Reset
    | Pick
    | Keep
    | Compare
    | ShowMap
    | Save
    | Open
    | List
    | Seen
)
"""Anything that a page may say."""

_SAID: TypeAdapter[Said] = TypeAdapter(Annotated[Said, Field(discriminator="type")])


def parsed(text: str) -> Said:
    """Read a message of a page.

    Raises
    ------
    InputError
        One line: it is no message, too large, or says something impossible.
    """
    if len(text) > MOST_BYTES or len(text.encode("utf-8", "surrogatepass")) > MOST_BYTES:
        raise InputError(f"message: longer than {MOST_BYTES:,} bytes")
    try:
        value = json.loads(text, parse_constant=_refused)
    except (ValueError, RecursionError):  # no JSON, NaN, numbers of thousands of digits, very deep
        raise InputError(f"message: {text[:40]!r}: should be a JSON object of finite numbers") from None
    if not isinstance(value, dict):
        raise InputError(f"message: {text[:40]!r}: should be a JSON object")
    _check(value)
    try:
        return _SAID.validate_python(value)
    except ValidationError as error:
        raise InputError(_line(error)) from None


def _refused(constant: str) -> float:
    raise ValueError(constant)


def _check(value: Any) -> None:
    """Refuse what no scene file can hold: too deep, not finite, or no text."""
    waiting = [(value, 0)]
    while waiting:
        item, depth = waiting.pop()
        if depth > MOST_NESTED:
            raise InputError(f"message: more than {MOST_NESTED} lists and tables in each other")
        if isinstance(item, dict):
            waiting += ((part, depth + 1) for pair in item.items() for part in pair)
        elif isinstance(item, list):
            waiting += ((part, depth + 1) for part in item)
        elif isinstance(item, float) and not math.isfinite(item):
            raise InputError("message: a number is too large for float64")
        elif isinstance(item, str) and not _is_text(item):
            raise InputError(f"message: {item[:40]!a}: should be text without NUL and half characters")


def _is_text(item: str) -> bool:
    return "\0" not in item and not any("\ud800" <= letter <= "\udfff" for letter in item)


def _line(error: ValidationError) -> str:
    """Say what is wrong first."""
    fault = error.errors(include_url=False)[0]
    place = [str(part)[:80] for part in fault["loc"]]
    if fault["type"].startswith("union_tag"):
        known = ", ".join(kind.model_fields["type"].default for kind in Said.__args__)
        return f"message: unknown or missing type; known: {known}"
    message = fault["msg"].removeprefix("Value error, ").replace("Input should be", "should be")
    what = ".".join(place)
    return f"message: {what}: {message[:1].lower()}{message[1:]}"
