"""The wheel works away from the checkout."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.mark.slow
def test_the_wheel_renders_from_an_empty_directory(tmp_path):
    wheels, site, empty = (tmp_path / name for name in ("wheels", "site", "empty"))
    empty.mkdir()
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "-w", str(wheels), str(REPOSITORY)], check=True)
    (wheel,) = wheels.glob("tfm_cl-*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", str(site), str(wheel)], check=True)

    names = zipfile.ZipFile(wheel).namelist()
    sources = {
        path.relative_to(REPOSITORY).as_posix()
        for path in (REPOSITORY / "kernels").rglob("*")
        if path.is_file()
    }
    assert {f"tfm_cl/{name}" for name in sources} <= set(names)
    assert {"tfm_cl/py.typed", "tfm_cl/files/hosek_wilkie.npz"} <= set(names)
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
