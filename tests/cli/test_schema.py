"""``tfm schema``, to standard output and to a file."""

import json

from tfm_cl.scene.schema import scene_schema


def test_it_is_printed_or_written(cli, folder):
    printed = cli("schema")
    assert (printed.code, printed.err) == (0, "")
    assert printed.json == json.loads(json.dumps(scene_schema()))
    written = cli("schema", "-o", "scene.schema.json")
    assert (written.code, written.out) == (0, "")
    assert (folder / "scene.schema.json").read_text(encoding="utf-8") == printed.out
    assert [path.name for path in folder.iterdir()] == ["scene.schema.json"]


def test_a_folder_that_is_not_there(cli):
    done = cli("schema", "-o", "none/scene.schema.json")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("tfm: none/scene.schema.json: there is no directory")
