"""Every command and every program of the README runs as it stands."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from keys import every_key, example_of, examples

from tfm_cl.cli import COMMANDS, main
from tfm_cl.files.image_io import load_image

REPOSITORY = Path(__file__).resolve().parents[1]
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
CONSOLE = [
    line.removeprefix("$ ")
    for block in re.findall(r"```console\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
]


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A folder that looks like the checkout, with an ``out`` of its own."""
    (tmp_path / "volumes").symlink_to(REPOSITORY / "volumes")
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_commands_run_in_order(checkout, capsys):
    commands = [shlex.split(line) for line in CONSOLE if line.startswith("tfm ")]
    for command in commands:
        assert main(command[1:]) == 0, " ".join(command)
    capsys.readouterr()

    assert {command[1] for command in commands} == set(COMMANDS)
    for name in ("plume.png", "figure.exr", "reference.exr", "map.exr"):
        assert load_image(checkout / "out" / name)[..., :3].max() > 0.05
    assert (checkout / "out" / "sweep" / "report.html").is_file()


@pytest.mark.slow
def test_programs_run(checkout):
    programs = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    for program in programs:
        run = subprocess.run(
            [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False
        )
        assert run.returncode == 0, run.stderr

    assert len(programs) == 1
    assert np.isfinite(load_image(checkout / "out" / "plume.exr")).all()


@pytest.mark.parametrize(("model", "table"), examples(), ids=lambda one: getattr(one, "__name__", "table"))
def test_examples_of_the_reference_are_right(model, table):
    model.from_table(table)


def test_every_key_has_an_example():
    for model, key in every_key():
        assert example_of(model, key).startswith(f"{key} = ")


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    command = re.search(r"^docs:.*\n\t\$\(BIN\)/python (.*) docs out/docs$", makefile, re.MULTILINE)
    assert command

    build = [sys.executable, *command[1].split(), "docs", str(tmp_path / "site")]
    run = subprocess.run(build, cwd=REPOSITORY, capture_output=True, text=True, check=False)

    assert run.returncode == 0, run.stderr
    reference = (tmp_path / "site" / "reference" / "scene-file.html").read_text(encoding="utf-8")
    assert 'id="light-spot-cone"' in reference


def test_make_targets_exist():
    targets = [shlex.split(line)[1] for line in CONSOLE if line.startswith("make ")]
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")

    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)
    assert "make test" in (REPOSITORY / ".ci" / "run").read_text(encoding="utf-8")
    assert os.access(REPOSITORY / ".ci" / "run", os.X_OK)


@pytest.mark.parametrize("document", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "volumes/README.md"])
def test_links_lead_somewhere(document):
    path = REPOSITORY / document
    links = re.findall(r"\]\(([^)#]+)\)", path.read_text(encoding="utf-8"))

    missing = [link for link in links if "://" not in link and not (path.parent / link).exists()]

    assert missing == []
