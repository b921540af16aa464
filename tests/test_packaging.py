"""What is released: a wheel that works away from the checkout, small, and what says what it is."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
LARGEST_CORE = 300e6
"""Bytes that tfm_cl and all that it needs may take without extras."""
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
"""That are supported; those that a machine has are tried."""


@pytest.fixture(scope="module")
def dist(tmp_path_factory):
    """The folder with the wheel and the source archive, as they are released."""
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--outdir", str(folder), str(REPOSITORY)]
    subprocess.run(build, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def wheel(dist):
    (found,) = dist.glob("*.whl")
    return found


@pytest.mark.slow
def test_the_package_index_would_show_it(dist):
    files = [str(path) for path in dist.iterdir()]
    assert {path.rpartition(".")[2] for path in files} == {"whl", "gz"}
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *files], check=True)


def _python_that_runs(version):
    """The path of an interpreter that can make environments; None without. A manager's shim may not run."""
    python = shutil.which(f"python{version}")
    if python is None:
        return None
    does = f"import ensurepip, ssl, sys; assert sys.version.startswith('{version}.')"
    done = subprocess.run([python, "-c", does], capture_output=True, check=False)
    return python if done.returncode == 0 else None


def _installed(tmp_path, python, *what):
    """Make an environment with packages; returns what runs ``tfm`` in it, or skips without the network."""
    folder = tmp_path / "venv"
    subprocess.run([python, "-m", "venv", str(folder)], check=True)
    pip = [str(folder / "bin" / "python"), "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]
    done = subprocess.run([*pip, *what], capture_output=True, text=True, check=False)
    if "No matching distribution" in done.stderr or "Connection" in done.stderr:
        pytest.skip("the package index is not to be had here")
    assert done.returncode == 0, done.stderr
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def tfm(*arguments):
        command = [str(folder / "bin" / "tfm"), *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment
        )

    return tfm


def _bytes_installed(folder):
    """Of an environment's packages, without those that make environments."""
    (site,) = folder.glob("lib/python*/site-packages")
    own = re.compile(r"pip|setuptools|pkg_resources|_distutils_hack")
    return sum(
        path.stat().st_size
        for path in site.rglob("*")
        if path.is_file() and not own.match(path.relative_to(site).parts[0])
    )


@pytest.mark.slow
def test_the_core_is_small_and_works_without_extras(wheel, tmp_path):
    tfm = _installed(tmp_path, sys.executable, str(wheel))
    volume = REPOSITORY / "volumes" / "figure.npz"
    small = ("--res", "32x32", "--map-res", "32", "-q")

    assert _bytes_installed(tmp_path / "venv") <= LARGEST_CORE
    assert tfm("render", volume, "-o", "figure.exr", *small).returncode == 0
    assert tfm("render", volume, "-o", "figure.png", *small).returncode == 0
    assert (tmp_path / "figure.png").is_file()
    for arguments in (
        ("compare", "figure.exr", "figure.exr"),
        ("sweep", volume, "-o", "sweep", "-q"),
        ("render", REPOSITORY / "volumes" / "smoke_and_solids.toml", "-o", "a.png", *small),
    ):
        refused = tfm(*arguments)
        assert refused.returncode == 2
        assert re.fullmatch(r"tfm: .* needs .*: pip install 'tfm_cl\[\w+\]'\n", refused.stderr)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figure.exr", "figure.png", "venv"]


@pytest.mark.slow
@pytest.mark.parametrize("version", PYTHONS)
def test_it_installs_on_every_python(wheel, tmp_path, version):
    python = _python_that_runs(version)
    if python is None:
        pytest.skip(f"Python {version} is not installed")
    tfm = _installed(tmp_path, python, f"{wheel}[solids]")

    done = tfm(
        *("render", REPOSITORY / "volumes" / "smoke_and_solids.toml", "-o", "a.exr"),
        *("--res", "32x32", "--map-res", "32", "-q"),
    )

    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("schema", "file"),
    [("github-workflows", ".github/workflows/test.yml"), ("citation-file-format", "CITATION.cff")],
)
def test_files_for_others_are_right(schema, file):
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", f"vendor.{schema}", file]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stdout


def test_versions_are_the_same():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (REPOSITORY / "CITATION.cff").read_text(encoding="utf-8")
    changes = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    version = re.escape(project["version"])
    cited = re.search(rf"^version: {version}\ndate-released: (\S+)$", citation, re.MULTILINE)

    assert cited is not None
    assert f"## [{project['version']}] - {cited[1]}" in changes
    for url in project["urls"].values():
        assert url.startswith("https://")
        assert "doi.org" not in url or f"doi: {url.removeprefix('https://doi.org/')}" in citation


@pytest.mark.slow
def test_the_wheel_renders_from_an_empty_directory(wheel, tmp_path):
    site, empty = (tmp_path / name for name in ("site", "empty"))
    empty.mkdir()
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(wheel)], check=True)

    names = zipfile.ZipFile(wheel).namelist()
    sources = {
        path.relative_to(REPOSITORY).as_posix()
        for path in (REPOSITORY / "kernels").rglob("*")
        if path.is_file()
    }
    assert {f"tfm_cl/{name}" for name in sources} <= set(names)
    assert {"tfm_cl/py.typed", "tfm_cl/files/hosek_wilkie.npz"} <= set(names)
    assert {"tfm_cl/page/flip.js", "tfm_cl/viewer/page/index.html", "tfm_cl/viewer/page/widget.js"} <= set(
        names
    )
    assert [name for name in names if name.endswith("licenses/tfm_cl/files/hosek_wilkie.LICENSE")]
    assert not [name for name in names if name.startswith(("tests", "volumes", "scripts"))]

    # -P and PYTHONPATH: the installed package, not the checkout's.
    environment = {**os.environ, "PYTHONPATH": str(site)}
    volume = REPOSITORY / "volumes" / "figure.npz"
    command = [
        sys.executable,
        "-P",
        "-m",
        "tfm_cl",
        "render",
        str(volume),
        "-o",
        "figure.png",
        "--res",
        "32x32",
    ]
    where = [sys.executable, "-P", "-c", "import tfm_cl; print(tfm_cl.__file__)"]
    location = subprocess.run(where, cwd=empty, env=environment, capture_output=True, text=True, check=True)
    subprocess.run([*command, "--map-res", "32"], cwd=empty, env=environment, check=True)

    assert Path(location.stdout.strip()).is_relative_to(site)
    assert [path.name for path in empty.iterdir()] == ["figure.png"]
