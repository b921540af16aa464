"""What was set since a file was opened."""

import pytest

from tfm_cl.errors import InputError
from tfm_cl.viewer.edits import MOST_STEPS, Edits, over


def test_undo_and_redo():
    edits = Edits().with_changes({"map.res": 64}).with_changes({"camera.fov": 30.0})
    assert edits.values == {"map.res": 64, "camera.fov": 30.0}

    before = edits.undo()
    assert (before.values, before.can_undo, before.can_redo) == ({"map.res": 64}, True, True)
    assert before.undo().undo().values == {}
    assert before.redo().values == edits.values
    assert before.redo().redo().values == edits.values

    changed = before.with_changes({"map.res": 32})
    assert not changed.can_redo


def test_a_drag_is_one_step():
    edits = Edits()
    for x in range(5):
        edits = edits.with_changes({"camera.from": [x, 0, 0]}, drag=x < 4)
    assert edits.values == {"camera.from": [4, 0, 0]}
    assert edits.undo().values == {}

    again = edits.with_changes({"camera.from": [9, 0, 0]})
    assert again.undo().values == edits.values


def test_a_drag_of_other_keys_is_another_step():
    edits = Edits().with_changes({"camera.fov": 20.0}, drag=True).with_changes({"map.res": 64}, drag=True)

    assert edits.undo().values == {"camera.fov": 20.0}


def test_two_who_drag_at_once_make_a_step_each():
    edits = Edits()
    for x in range(5):
        edits = edits.with_changes({"camera.from": [x, 0, 0]}, drag=x < 4, by="one")
        edits = edits.with_changes({"light.0.intensity": x}, drag=x < 3, by="other")
    assert edits.values == {"camera.from": [4, 0, 0], "light.0.intensity": 4}

    # The other's drag ended with its fourth edit; the fifth is a step of its own.
    assert edits.undo().values == {"camera.from": [4, 0, 0], "light.0.intensity": 3}
    assert edits.undo().undo().values == {"camera.from": [4, 0, 0]}
    assert edits.undo().undo().undo().values == {}
    assert edits.undo().undo().redo().redo().values == edits.values


def test_one_who_does_something_else_has_ended_a_drag():
    edits = Edits().with_changes({"camera.fov": 20.0}, drag=True, by="one")
    edits = edits.with_changes({"map.res": 64}, by="one").with_changes({"camera.fov": 30.0}, by="one")

    assert edits.undo().values == {"camera.fov": 20.0, "map.res": 64}


def test_a_drag_that_was_undone_by_another_begins_anew():
    edits = Edits().with_changes({"camera.fov": 20.0}, drag=True, by="one").undo()
    edits = edits.with_changes({"camera.fov": 30.0}, by="one")

    assert (edits.undo().values, edits.undo().can_undo) == ({}, False)


def test_a_drag_that_changed_nothing_ends():
    edits = Edits().with_changes({"map.res": 64}).with_changes({"map.res": 64})

    assert edits.undo().values == {}


def test_none_takes_a_key_back():
    edits = Edits().with_changes({"map.res": 64, "map.steps": 10}).with_changes({"map.res": None})

    assert edits.values == {"map.steps": 10}
    assert edits.undo().values == {"map.res": 64, "map.steps": 10}
    assert edits.with_changes({"never.set": None}) == edits


def test_reset_is_a_step():
    edits = Edits().with_changes({"map.res": 64}).reset()

    assert edits.values == {}
    assert edits.undo().values == {"map.res": 64}
    assert Edits().reset() == Edits()


def test_steps_are_bounded():
    edits = Edits()
    for step in range(MOST_STEPS + 10):
        edits = edits.with_changes({"map.res": step + 1})
    steps = 0
    while edits.can_undo:
        edits, steps = edits.undo(), steps + 1
    assert steps == MOST_STEPS

    for step in range(40):
        edits = edits.with_changes({"image.name": "x" * 900_000 + str(step)})
    steps = 0
    while edits.can_undo:
        edits, steps = edits.undo(), steps + 1
    assert 10 < steps < 20

    with pytest.raises(InputError, match="save the scene and open it"):
        edits.with_changes({f"map.{number}": "x" * 90_000 for number in range(20)})


@pytest.mark.parametrize(
    ("before", "then", "left"),
    [
        ({"light.0.cone": 20.0, "light.1.cone": 9.0, "map.res": 8}, {"light": [{}]}, ["map.res", "light"]),
        ({"camera.fov": 30.0}, {"camera.focal_length": 50.0}, ["camera.focal_length"]),
        ({"camera.from": [1, 2, 3]}, {"camera.to": [0, 0, 0]}, ["camera.from", "camera.to"]),
        ({"camera.matrix": [[1.0]]}, {"camera.from": [1, 2, 3]}, ["camera.from"]),
        ({"map.coeffs": 4, "map.res": 8}, {"map.max_error": 0.1}, ["map.res", "map.max_error"]),
        ({"light.0.cone": 5.0, "light.0.intensity": 2}, {"light.0.type": "sun"}, None),
        ({"light.cone": 5.0, "light.1.cone": 2.0}, {"light.type": "sun"}, ["light.1.cone", "light.type"]),
        ({"solid.0.rotate": [0, 9, 0]}, {"solid.transform": [1.0]}, ["solid.transform"]),
        ({"volume.transform": [1.0]}, {"volume.scale": 2}, ["volume.scale"]),
        ({"solid.1.transform": [1.0]}, {"solid.0.scale": 2}, ["solid.1.transform", "solid.0.scale"]),
        ({"map.res": 64}, {"map.res": 32}, ["map.res"]),
    ],
)
def test_what_says_the_same_in_another_way_goes(before, then, left):
    edits = Edits().with_changes(before).with_changes(then)
    left = ["light.0.intensity", "light.0.type"] if left is None else left

    assert list(edits.values) == left
    assert [key for key, _ in over(before.items(), then)] == left


def test_tables_have_no_none():
    edits = Edits().with_changes({"light": [{"type": "spot", "texture": None, "phase": {"g": None}}]})

    assert edits.values == {"light": [{"type": "spot", "phase": {}}]}
