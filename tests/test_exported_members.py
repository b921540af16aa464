"""The library's façade."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import tfm_cl as tfm

TREE = ast.parse(Path(tfm.__file__).read_text(encoding="utf-8"))


def test_all_is_sorted_and_everything_is_there():
    assert tfm.__all__ == sorted(tfm.__all__)
    assert dir(tfm) == tfm.__all__ == sorted(tfm._HOME)
    for name in tfm.__all__:
        assert getattr(tfm, name) is not None


def test_type_checkers_see_the_same_names():
    block = next(node for node in TREE.body if isinstance(node, ast.If))
    seen = {alias.name: node.module for node in block.body for alias in node.names}

    assert seen == {name: f"tfm_cl.{module}" for name, module in tfm._HOME.items()}


def test_classes_have_docstrings():
    for name in tfm.__all__:
        assert name == "__version__" or getattr(tfm, name).__doc__


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="no attribute 'Cloud'"):
        _ = tfm.Cloud


def test_importing_is_light():
    heavy = "pyopencl", "OpenEXR", "PIL", "matplotlib", "skimage", "scipy", "blosc"
    code = f"import sys, tfm_cl.cli.render; print([name for name in {heavy} if name in sys.modules])"

    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert run.stdout.strip() == "[]"
