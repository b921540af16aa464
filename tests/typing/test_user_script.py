"""What type checkers and `help` tell users, with nothing but the wheel."""

import ast
import inspect
import pydoc
import re
import runpy
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from typing import get_args

import pytest

import tfm_cl as tfm
from tfm_cl.model import Model

REPOSITORY = Path(__file__).resolve().parents[2]
SCRIPT, WRONG = (Path(__file__).with_name(f"{name}_script.py") for name in ("user", "wrong"))
MODELS = [
    cls for name in tfm.__all__ if isinstance(cls := getattr(tfm, name), type) and issubclass(cls, Model)
]


def test_the_script_makes_every_public_class():
    made = set(re.findall(r"\btfm\.(\w+)", SCRIPT.read_text(encoding="utf-8")))

    assert set(tfm.__all__) - made == set()
    assert runpy.run_path(str(SCRIPT))["red"] == 0.9


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_help_tells_of_every_field_in_words(model):
    said = pydoc.render_doc(model, renderer=pydoc.plaintext)

    assert not re.search(r"Validator\(|<function|__pydantic_\w+ =", said)
    for name, field in model.model_fields.items():
        is_kind = get_args(field.annotation) == (field.default,)  # it is the class that says it
        assert is_kind or re.search(rf"\n \|  {name} : \S.*\n \|      \S", said), name


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_type_checkers_know_which_fields_have_defaults(model):
    calls = [node for node in ast.walk(ast.parse(inspect.getsource(model))) if isinstance(node, ast.Call)]

    # Of `Field` they know what is given by name.
    assert [ast.unparse(call) for call in calls if ast.unparse(call.func) == "Field" and call.args] == []


def test_help_tells_type_range_default_and_meaning():
    said = tfm.SpotLight.__doc__

    assert "from_ : three numbers [x, y, z]\n    position, world units" in said
    assert "cone : float > 0 and < 90, default 25.0\n    half angle, degrees" in said
    assert "falloff : {'none', 'inverse-square'}, default 'none'" in said
    assert "up : 'x', 'y', 'z', '-x', '-y' or '-z' or 'auto', default 'auto'" in tfm.GroundSolid.__doc__
    assert 'phase : name, as "isotropic" or "hg:0.3", or a table' in tfm.Medium.__doc__


@pytest.mark.slow
def test_type_checkers_accept_users_scripts_and_see_mistakes(tmp_path):
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv" / "bin" / "python"
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
    pyright = "pyright" if shutil.which("node") else "pyright[nodejs]"
    build = [sys.executable, "-m", "pip", "--quiet", "wheel", "--no-deps", "-w", str(tmp_path)]
    subprocess.run([*build, str(REPOSITORY)], check=True)
    subprocess.run([*pip, *map(str, tmp_path.glob("*.whl")), "mypy", pyright], check=True)
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    example = tmp_path / "readme.py"
    blocks = re.findall(r"^```python\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)
    example.write_text("\n".join(blocks), encoding="utf-8")
    assert "import tfm_cl" in example.read_text(encoding="utf-8")
    wrong = shutil.copy(WRONG, tmp_path)
    lines = WRONG.read_text(encoding="utf-8").splitlines()
    mistakes = {number for number, line in enumerate(lines, 1) if "# wrong" in line}
    checkers = [
        [str(python), "-m", "mypy", "--strict", "--config-file="],
        [str(python), "-m", "pyright", "--pythonpath", str(python)],
    ]

    for checker in checkers:
        right = [*checker, shutil.copy(SCRIPT, tmp_path), str(example)]
        found = subprocess.run(right, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert found.returncode == 0, found.stdout
        found = subprocess.run([*checker, wrong], cwd=tmp_path, capture_output=True, text=True, check=False)
        seen = {int(number) for number in re.findall(rf"{WRONG.name}:(\d+)[: ].*error", found.stdout)}
        assert seen == mistakes, found.stdout
