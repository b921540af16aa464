"""What is not installed is said in one line, with what to do; the rest works without it."""

import importlib
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import InputError, SceneError, VolumeError
from tfm_cl.extras import EXTRAS, missing, needs
from tfm_cl.files import usd
from tfm_cl.scene.bodies.primitive_settings import spacing
from tfm_cl.sweep import run

PYPROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
HEAVY = {"notebook"}
"""Extras that are not in `all`."""


def _names(requirements):
    return {requirement.partition(">=")[0] for requirement in requirements}


def test_extras_are_those_of_the_package():
    declared = dict(PROJECT["optional-dependencies"])
    everything = declared.pop("all")

    assert everything == [f"tfm_cl[{','.join(sorted(EXTRAS.keys() - HEAVY))}]"]
    assert {name: _names(packages) for name, packages in declared.items()} == {
        name: {package.lower() for package in modules.values()} for name, modules in EXTRAS.items()
    }
    core = _names(PROJECT["dependencies"])
    assert not core & {package.lower() for modules in EXTRAS.values() for package in modules.values()}


def test_modules_belong_to_their_packages():
    of_module = packages_distributions()
    for modules in EXTRAS.values():
        for module, package in modules.items():
            assert package.lower() in {name.lower() for name in of_module.get(module, [package])}


@pytest.fixture
def without(monkeypatch):
    """``without(module, …)`` makes modules seem not to be installed."""

    def hide(*modules):
        for module in modules:
            for name in [name for name in sys.modules if name.partition(".")[0] == module]:
                monkeypatch.delitem(sys.modules, name)
            monkeypatch.setitem(sys.modules, module, None)

    return hide


def test_a_mesh_says_what_to_install(without, monkeypatch):
    monkeypatch.delitem(sys.modules, "tfm_cl.files.mesh_io.loading", raising=False)
    monkeypatch.delattr("tfm_cl.files.mesh_io.loading", raising=False)
    without("trimesh")

    with pytest.raises(SceneError, match=r"^a.glb: a mesh needs trimesh: pip install 'tfm_cl\[solids\]'$"):
        tfm.MeshSolid(mesh="a.glb").read_files()


def test_ssim_says_what_to_install(without):
    without("skimage")
    image = np.ones((8, 8, 4), np.float32)

    with pytest.raises(InputError, match=r"^SSIM needs scikit-image: pip install 'tfm_cl\[sweep\]'$"):
        tfm.compare(image, image)


def test_a_sweep_says_what_to_install_before_it_begins(without, tmp_path):
    without("plotly")

    with pytest.raises(InputError, match=r"^a sweep needs plotly: pip install 'tfm_cl\[sweep\]'$"):
        run.run([tmp_path / "cloud.npy"], tmp_path / "out", tfm.Renderer)
    assert not list(tmp_path.iterdir())


def test_points_without_a_radius_say_what_to_install(without):
    without("scipy")

    with pytest.raises(VolumeError, match=r"needs SciPy: pip install 'tfm_cl\[points\]'$"):
        spacing(np.zeros((4, 3)))


def test_the_widget_says_what_to_install(without, monkeypatch):
    monkeypatch.delitem(sys.modules, "tfm_cl.viewer.cell", raising=False)
    without("anywidget")

    with pytest.raises(InputError, match=r"^tfm.view needs anywidget: pip install 'tfm_cl\[notebook\]'$"):
        tfm.view("cloud.vdb")


def test_usd_says_what_to_install(without):
    without("pxr")

    with pytest.raises(VolumeError, match=r"^a.usd: a USD file needs usd-core: pip install 'tfm_cl\[usd\]'$"):
        usd.read_prims(Path("a.usd"), "Points")


def test_the_viewer_says_what_to_install(without, monkeypatch):
    monkeypatch.delitem(sys.modules, "tfm_cl.viewer.server", raising=False)
    without("tornado")

    with pytest.raises(InputError, match=r"^the viewer needs tornado: pip install 'tfm_cl\[view\]'$"):
        importlib.import_module("tfm_cl.viewer.server")


def test_other_faults_of_imports_stay_what_they_are():
    with pytest.raises(ModuleNotFoundError), needs("solids", "a mesh", InputError):
        importlib.import_module("tfm_cl.no_such_module")

    assert missing("solids") is None
