"""What comes from elsewhere: entry points, single files, and what is wrong with them."""

import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import blobs

import tfm_cl as tfm
from tfm_cl import plugins
from tfm_cl.cli import main
from tfm_cl.errors import InputError
from tfm_cl.files import image_io, volume_io
from tfm_cl.maps.bases import BASES
from tfm_cl.scene.lights import LIGHTS
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.phases import PHASES
from tfm_cl.scene.solids import SOLIDS

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
REGISTRIES = BASES, PHASES, LIGHTS, SOLIDS, volume_io.FORMATS, image_io.FORMATS

WITH_TOO_MANY_COEFFICIENTS = """
from dataclasses import replace
from tfm_cl.maps.bases import BASES
tfm.register_basis(replace(BASES["dct"], name="mine", header=__file__, counts=(0, 600)))
"""


WITH_A_HEADER_OF_OURS = """
from dataclasses import replace
from tfm_cl.maps.bases import BASES
tfm.register_basis(replace(BASES["dct"], name="mine", header=BASES["klt"].header))
"""


@pytest.fixture(autouse=True)
def forgotten(monkeypatch):
    """What a test registers is forgotten after it."""
    monkeypatch.setenv(plugins.VARIABLE, "")
    monkeypatch.setattr(plugins, "_loaded", set())
    before = [dict(registry) for registry in REGISTRIES]
    modules = set(sys.modules)
    yield
    for registry, known in zip(REGISTRIES, before, strict=True):
        registry.clear()
        registry.update(known)
    for name in set(sys.modules) - modules:
        if name.startswith("tfm_cl_plugin_"):
            del sys.modules[name]


@pytest.fixture
def plugin(tmp_path):
    """``plugin(text)`` writes a plugin file."""

    def write(text, name="mine.py"):
        path = tmp_path / name
        path.write_text("import tfm_cl as tfm\n" + text, encoding="utf-8")
        return path

    return write


def test_a_file_registers_a_phase_function():
    tfm.load_plugin(EXAMPLES / "plugin.py")
    tfm.load_plugin(EXAMPLES / "plugin.py")  # once is enough

    phase = Medium(phase="schlick:0.6").phase
    cosines, weights = np.polynomial.legendre.leggauss(64)
    assert 2 * np.pi * weights @ phase.evaluate(cosines) == pytest.approx(1, rel=1e-12)
    assert Medium(phase={"type": "schlick", "k": 0.6}).phase == phase


def test_a_format_of_volumes(plugin, tmp_path):
    path = plugin(
        "from tfm_cl.files.volume_io import numpy_array\n"
        "open_grids = numpy_array.open_grids\n"
        "tfm.register_volume_format('.cloud', __name__)\n"
    )
    np.save(tmp_path / "a.npy", blobs())
    (tmp_path / "a.npy").rename(tmp_path / "a.cloud")

    tfm.load_plugin(path)

    np.testing.assert_array_equal(tfm.Volume.load(tmp_path / "a.cloud").data, blobs())


def test_a_basis_may_share_the_header_of_another(plugin):
    tfm.load_plugin(plugin(WITH_A_HEADER_OF_OURS))

    assert tfm.MapSettings(basis="mine").basis == "mine"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 / 0", "fails: ZeroDivisionError: division by zero"),
        ("import no_such_package", "fails: ModuleNotFoundError: No module named 'no_such_package'"),
        ("", "registers nothing"),
        ("tfm.register_basis('dct')", "a basis should be a tfm_cl.Basis; got 'dct'"),
        ("tfm.register_phase(tfm.Medium)", "a phase function should be a class of tfm_cl.Phase"),
        ("tfm.register_phase(tfm.Mie)", "there is a phase function 'mie' already"),
        ("tfm.register_light(tfm.SunLight)", "there is a light 'sun' already"),
        ("tfm.register_solid(tfm.SpotLight)", "a solid should be a class of tfm_cl.AnalyticSolid"),
        ("tfm.register_solid(tfm.BoxSolid)", "there is a solid 'box' already"),
        ("tfm.register_volume_format('.vdb', __name__)", "there is a format '.vdb' already"),
        ("tfm.register_image_format('jpg', __name__)", "extension of images should be like '.abc'"),
        (
            "class Own(tfm.Phase):\n  type: str = 'own'\n  HEADER = 'own.h'\ntfm.register_phase(Own)",
            "whole path",
        ),
        (
            WITH_TOO_MANY_COEFFICIENTS,
            "basis 'mine': counts should be numbers from 1 to 512",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(plugin, text, message):
    path = plugin(text)

    with pytest.raises(InputError) as caught:
        tfm.load_plugin(path)

    assert str(caught.value).startswith(f"plugin {path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"^plugin "):  # and stays wrong
        tfm.load_plugin(path)


@pytest.mark.parametrize("name", ["missing.py", "README.md"])
def test_what_is_no_file_of_python(name, capsys, tmp_path):
    (tmp_path / "README.md").write_text("text")

    assert main(["render", "a.npy", "-o", "a.png", "--plugin", str(tmp_path / name)]) == 2
    assert capsys.readouterr().err.startswith(f"tfm: plugin {tmp_path / name}: ")


def test_the_command_line_takes_one(capsys, tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", blobs())
    monkeypatch.chdir(tmp_path)
    phase = (EXAMPLES / "plugin.py").as_posix()

    arguments = ["render", "a.npy", "--phase", "schlick:0.25", "--print-config", "-q", f"--plugin={phase}"]
    assert main(arguments) == 0
    assert "schlick" in capsys.readouterr().out
    assert os.environ[plugins.VARIABLE] == phase


def test_an_entry_point_that_fails_names_its_package(monkeypatch):
    point = EntryPoint("mine", "no_such_package:MINE", "tfm_cl.bases")
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [point] * (group == point.group))

    with pytest.raises(InputError, match=r"^plugin no_such_package:MINE: fails: ModuleNotFoundError: .*pip"):
        plugins.register_installed("bases", lambda _name, _value: None)


class Wrong:
    """Functions of a basis that forgets one."""

    modes = np.zeros(0, np.float32)

    def values(self, v):
        return np.ones((len(v), 3))


def test_functions_of_the_wrong_shape_are_one_line():
    choices = SimpleNamespace(coeffs=4, fit="visibility", target="optical-depth")
    message = (
        r"^basis 'dct': values should return finite numbers of the shape \(50, 4\); got the shape \(50, 3\)$"
    )
    with pytest.raises(InputError, match=message):
        BASES["dct"].table(Wrong(), choices, 50)


@pytest.mark.slow
def test_the_worked_example_is_installed(tmp_path):
    site = tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-deps"]
    subprocess.run([*pip, "--target", str(site), str(EXAMPLES / "chebyshev")], check=True)
    np.save(tmp_path / "a.npy", blobs())
    environment = {**os.environ, "PYTHONPATH": str(site)}

    def tfm_command(*arguments):
        command = [sys.executable, "-m", "tfm_cl", *arguments]
        subprocess.run(command, cwd=tmp_path, env=environment, check=True)

    small = ("--look", "plain", "--res", "64x36", "--steps", "50", "--light-steps", "50", "-q")
    tfm_command("render", "a.npy", "-o", "map.exr", *small, "--basis", "chebyshev", "--map-res", "64")
    tfm_command("render", "a.npy", "-o", "dual.exr", *small, "--method", "dual")
    tfm_command("compare", "map.exr", "dual.exr", "--fail-under", "ssim=0.98")


@pytest.mark.slow
def test_processes_of_a_sweep_have_it(tmp_path):
    np.save(tmp_path / "a.npy", blobs())
    command = [
        *(sys.executable, "-m", "tfm_cl", "sweep", "a.npy", "-o", "out", "--bases", "dct", "--coeffs", "4,8"),
        *("--res", "16x9", "--map-res", "16", "--steps", "8", "--light-steps", "8", "--jobs", "2", "-q"),
        *("--no-converged", "--phase", "schlick:0.5", "--plugin", str(EXAMPLES / "plugin.py")),
    ]
    subprocess.run(command, cwd=tmp_path, check=True)

    assert (tmp_path / "out" / "report.html").is_file()
