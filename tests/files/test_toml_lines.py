"""Lines of keys, in all the ways that TOML writes tables."""

import tomllib

import pytest

from tfm_cl.files.toml_lines import TomlLines

TEXT = '''# a remark
title = 1
"a b".c.'d e' = 2
[camera]  # another
from = [0,
  1, 2]
[[light]]
type = "spot"
[[light]]
cone = 3
nested = { a = 1, b = { c = [{ d = 1 },  # one
   { e = 2 }] } }
[light.below]
x = 1
[[light]]
cone = 4
text = """
[[light]]
cone = 5
"""
[medium]
phase.type = "hg"
phase.g = 3
bodies = [{ file = "a" },
  # a remark
  { file = "b" }]
'''
LINES = {
    ("title",): 2,
    ("a b", "c", "d e"): 3,
    ("camera",): 4,
    ("camera", "from"): 5,
    ("camera", "from", 2): 6,
    ("light",): 7,
    ("light", 0): 7,
    ("light", 0, "type"): 8,
    ("light", 1): 9,
    ("light", 1, "cone"): 10,
    ("light", 1, "nested", "b", "c", 0, "d"): 11,
    ("light", 1, "nested", "b", "c", 1, "e"): 12,
    ("light", 1, "below", "x"): 14,
    ("light", 2): 15,
    ("light", 2, "cone"): 16,
    ("light", 2, "text"): 17,
    ("medium", "phase"): 22,
    ("medium", "phase", "g"): 23,
    ("medium", "bodies", 1, "file"): 26,
}


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_every_key_has_its_line(newline):
    lines = TomlLines(TEXT.replace("\n", newline))
    assert {key: lines.exactly(key) for key in LINES} == LINES


def test_what_is_not_there_is_where_it_would_be():
    lines = TomlLines(TEXT)
    assert lines.exactly(("light", 1, "blend")) is None
    assert lines.nearest(("light", 1, "blend")) == 9
    assert lines.nearest(("light", 1, "below", "y")) == 13
    assert lines.nearest(("light", 9, "cone")) == 7
    assert lines.nearest(("map", "res")) is None
    assert lines.nearest(()) is None


def test_deep_nesting_is_no_trouble():
    depth = 200
    text = "a = " + "[" * depth + "\n1" + "]" * depth
    tomllib.loads(text)
    assert TomlLines(text).nearest(("a", *[0] * depth)) == 2
