"""Every command, program and scene of the README and the site is right as it stands.

Pages run from top to bottom in a folder with ``volumes`` and an empty ``out``: commands as they come, a
page's programs as one. A scene whose first line is a comment with a path is written there, for the commands
after it. Compiling takes nearly all of the time, and less than half as much with one ray a work-item, as on
GPUs: but for the README's all pages have one.
What cannot run says why: ``<!-- not run: REASON -->`` before the block.
"""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import pytest
from keys import every_key, example_of, examples

import tfm_cl
from tfm_cl.cli import COMMANDS, main, tfm
from tfm_cl.files.image_io import is_deep, load_image
from tfm_cl.scene.scene_file import SceneFile

REPOSITORY = Path(__file__).resolve().parents[1]
MAKEFILE = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
PAGES = sorted(
    str(path.relative_to(REPOSITORY))
    for path in [REPOSITORY / "README.md", *(REPOSITORY / "docs").rglob("*.md")]
)
VIEWER = "docs/guide/viewer.md"
BLOCK = re.compile(
    r"^(?:<!-- not run: (?P<why>[^>]+) -->\n+)?```(?P<kind>console|python|toml)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
WRITTEN = re.compile(r"# (out/[\w./-]+\.toml)\n")
"""The first line of a scene that commands use."""


class Block(NamedTuple):
    kind: str
    text: str


def blocks(page, kind=None, *, run=True):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    found = [*BLOCK.finditer(text)]
    assert len(found) == len(re.findall(r"```(?:console|python|toml)", text)), f"{page}: a block is indented"
    of_kind = [one for one in found if kind in {None, one["kind"]} and (one["why"] is None) == run]
    return [Block(one["kind"], one["text"]) for one in of_kind]


def commands(text):
    return [
        # A shell's remarks begin a word: in out.####.exr there is none.
        shlex.split(re.sub(r"\s# .*", "", line.removeprefix("$ ")))
        for line in text.replace("\\\n", " ").splitlines()
        if line.startswith("$ ")
    ]


ALL_COMMANDS = [
    (page, command) for page in PAGES for block in blocks(page, "console") for command in commands(block.text)
]
SERVED = [
    (VIEWER, command)
    for block in blocks(VIEWER, "console", run=False)
    for command in commands(block.text)
    if command[0] == "tfm"
]
"""Commands that end when they are told to, which a page does not."""
WITH_CODE = [page for page in PAGES if any(block.kind != "toml" for block in blocks(page))]


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A folder that looks like the checkout, with an ``out`` of its own."""
    for name in ("volumes", "scripts", "docs"):
        (tmp_path / name).symlink_to(REPOSITORY / name)
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_command(command):
    if command[0] == "tfm":
        assert main(command[1:]) == 0, " ".join(command)
    elif command[0] == "python":
        run = subprocess.run([sys.executable, *command[1:]], capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr
    else:
        assert command[0] == "make", f"{command}: mark the block as not run, and why"


ONE_LANE = "from tfm_cl.device import launch\nlaunch.lanes_of = lambda _: (1,)\n"
"""Before a program: in its process, what the fixture ``one_lane`` does in this one."""


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_CODE)
def test_pages_run(page, checkout, capsys, request):
    found = blocks(page)
    program = "\n".join(block.text for block in found if block.kind == "python")
    if page != "README.md":
        request.getfixturevalue("one_lane")
        program = ONE_LANE + program
    last = max((i for i, block in enumerate(found) if block.kind == "python"), default=None)
    for i, block in enumerate(found):
        if block.kind == "toml" and (path := WRITTEN.match(block.text)):
            (checkout / path[1]).write_text(block.text, encoding="utf-8")
        for command in commands(block.text) if block.kind == "console" else ():
            run_command(command)
        if i == last:
            run_command(["python", "-W", "error", "-c", program])
    capsys.readouterr()

    # Not deep images, and no channels of maps.
    for picture in (path for path in (checkout / "out").glob("*.exr") if not is_deep(path)):
        assert np.isfinite(load_image(picture)).all()


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_spelled_right(page, monkeypatch):
    monkeypatch.chdir(REPOSITORY)
    for command in (command for where, command in [*ALL_COMMANDS, *SERVED] if where == page):
        if command[0] == "make":
            assert re.search(rf"^{command[1]}:", MAKEFILE, re.MULTILINE), command
        elif command[0] == "tfm" and not any("out/" in word for word in command[1:3]):
            # As the program does: a command keeps what it was first told of its help.
            whole = click.Context(tfm, **tfm.context_settings)
            known = tfm.get_command(whole, command[1])
            assert known is not None, command
            assert known.make_context(command[1], command[2:], parent=whole), command


@pytest.mark.parametrize("page", PAGES)
def test_programs_compile(page):
    for block in blocks(page, "python"):
        compile(block.text, page, "exec")


@pytest.mark.parametrize("page", PAGES)
def test_scenes_load(page, tmp_path):
    for block in blocks(page, "toml"):
        path, values = tmp_path / "scene.toml", tomllib.loads(block.text)
        whole = block.text if "volume" in values else block.text + '\n[volume]\nshape = "box"\n'
        path.write_text(whole, encoding="utf-8")
        for name in re.findall(r'"(.*?)####(.*?)"', whole):
            (tmp_path / "0101".join(name)).touch()
        changes = "frame = " in whole or "####" in whole
        assert SceneFile.read(path, frame=101 if changes else None).volumes


def test_the_pages_use_every_command():
    found = [*ALL_COMMANDS, *SERVED]
    assert {command[1] for _, command in found if command[0] == "tfm"} == set(COMMANDS)


@pytest.mark.parametrize(("model", "table"), examples(), ids=lambda one: getattr(one, "__name__", "table"))
def test_examples_of_the_reference_are_right(model, table):
    model.from_table(table)


def test_every_key_has_an_example():
    for model, key in every_key():
        assert example_of(model, key).startswith(f"{key} = ")


def test_the_library_s_page_lists_every_name():
    page = (REPOSITORY / "docs/reference/library.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^   (\w+)$", page, re.MULTILINE))

    assert listed == set(tfm_cl.__all__) - {"__version__"}


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    command = re.search(r"^docs:.*\n\t\$\(BIN\)/python (.*) docs out/docs$", MAKEFILE, re.MULTILINE)
    assert command

    build = [sys.executable, *command[1].split(), "docs", str(tmp_path / "site")]
    run = subprocess.run(build, cwd=REPOSITORY, capture_output=True, text=True, check=False)

    assert run.returncode == 0, run.stderr
    reference = (tmp_path / "site" / "reference" / "scene-file.html").read_text(encoding="utf-8")
    assert 'id="light-spot-cone"' in reference
    commands = (tmp_path / "site" / "reference" / "command-line.html").read_text(encoding="utf-8")
    assert all(f'id="tfm-{name}"' in commands for name in COMMANDS)


@pytest.mark.slow
def test_figures_are_drawn(tmp_path):
    figures = REPOSITORY / "docs" / "figures"
    run = [sys.executable, figures / "draw.py", "ray.svg", "coefficients.png", "-o", tmp_path]
    subprocess.run(run, check=True, capture_output=True)

    assert sorted(path.name for path in tmp_path.iterdir()) == ["coefficients.png", "ray.svg"]


def test_make_targets_are_what_people_and_ci_use():
    targets = [command[1] for page, command in ALL_COMMANDS if page == "README.md" and command[0] == "make"]

    assert targets[:2] == ["demo", "test"]
    assert "make test" in (REPOSITORY / ".ci" / "run").read_text(encoding="utf-8")
    assert os.access(REPOSITORY / ".ci" / "run", os.X_OK)


@pytest.mark.parametrize("document", [*PAGES, "CONTRIBUTING.md", "CHANGELOG.md", "volumes/README.md"])
def test_links_lead_somewhere(document):
    path = REPOSITORY / document
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8"))

    missing = [link for link in links if "://" not in link and not (path.parent / link).exists()]

    assert missing == []
