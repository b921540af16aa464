"""What a page may say."""

import json

import pytest

from tfm_cl.errors import InputError
from tfm_cl.viewer.messages import MOST_BYTES, Compare, Edit, SetFrame, SetShow, Show, parsed


def test_an_edit_says_keys_and_values():
    said = parsed('{"type": "edit", "changes": {"light.0.from": [1, 2, 3], "map.res": 8}, "drag": true}')

    assert said == Edit(changes={"light.0.from": [1, 2, 3], "map.res": 8}, drag=True)


def test_none_takes_an_edit_back():
    assert parsed('{"type": "edit", "changes": {"map.res": null}}') == Edit(changes={"map.res": None})


def test_words_of_other_types():
    assert parsed('{"type": "frame", "frame": 3}') == SetFrame(frame=3)
    assert parsed('{"type": "compare", "with": "dual"}') == Compare.model_validate({"with": "dual"})
    assert parsed('{"type": "undo"}').type == "undo"


def test_what_is_left_out_is_shown_as_before():
    before = Show(layer="depth", exposure=1.0, view="agx")

    said = parsed('{"type": "show", "exposure": "auto"}')

    assert isinstance(said, SetShow)
    assert said.applied(before) == Show(layer="depth", exposure="auto", view="agx")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "should be a JSON object of finite numbers"),
        ("[1]", "should be a JSON object"),
        ("{}", "unknown or missing type; known: edit, frame, show"),
        ('{"type": "quit"}', "unknown or missing type"),
        ('{"type": ["edit"]}', "unknown or missing type"),
        ('{"type": "undo", "times": 2}', "undo.times: extra inputs are not permitted"),
        ('{"type": "edit"}', "edit.changes: field required"),
        ('{"type": "edit", "changes": {}}', "edit.changes: dictionary should have at least 1 item"),
        ('{"type": "edit", "changes": {"a.b": 1}, "drag": 1}', "edit.drag: should be a valid boolean"),
        ('{"type": "edit", "changes": {"a.b": NaN}}', "finite numbers"),
        ('{"type": "edit", "changes": {"a.b": 1e999}}', "too large for float64"),
        ('{"type": "edit", "changes": {"a.b": "\\ud800"}}', "should be text"),
        ('{"type": "open", "path": "a\\u0000.vdb"}', "should be text"),
        ('{"type": "show", "layer": "dept"}', "unknown layer 'dept'; did you mean 'depth'?"),
        ('{"type": "show", "view": "film"}', "unknown view 'film'; did you mean 'filmic'?"),
        ('{"type": "show", "exposure": 1e9}', "show.exposure: should be a number of stops"),
        ('{"type": "pick", "x": 1.5, "y": 0}', "pick.x: should be less than or equal to 1"),
        ('{"type": "map", "light": -1, "coefficient": 0}', "map.light: should be greater than or equal to 0"),
        ('{"type": "save", "what": "obj", "name": "a"}', "save.what: should be 'scene', 'exr' or 'png'"),
        (json.dumps({"type": "open", "path": "x" * 5000}), "open.path: string should have at most 4096"),
        ('{"type": "edit", "changes": {"a.b": ' + "[" * 40 + "]" * 40 + "}}", "more than 32 lists"),
        ("[" * 100_000, "finite numbers"),
        ('{"type": "frame", "frame": ' + "9" * 5000 + "}", "finite numbers"),
        (" " * (MOST_BYTES + 1), "longer than 1,048,576 bytes"),
        ("é" * (MOST_BYTES // 2 + 1), "longer than 1,048,576 bytes"),
    ],
)
def test_bad_messages_get_one_line(text, line):
    with pytest.raises(InputError) as caught:
        parsed(text)

    assert line in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_whole_number_too_large_for_float64_is_refused():
    with pytest.raises(InputError):
        parsed('{"type": "frame", "frame": 1' + "0" * 400 + "}")
