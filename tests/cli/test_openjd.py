"""``--progress openjd``, and the documentation's job template, by Open Job Description's own programs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from tfm_cl.cli.openjd import FarmLines, failures_told
from tfm_cl.errors import SceneError

TEMPLATE = Path(__file__).parents[2] / "docs" / "farm" / "render-frames.openjd.yaml"


def test_progress_of_frames(capsys):
    farm = FarmLines()
    farm.count = 2
    for number in (7, 8):
        for stage in ("light pass", "view pass"):
            for fraction in (0.0, 0.5, 1.0):
                farm.advance(stage, fraction)
        farm.ended(f"frame {number}: made")
    assert capsys.readouterr().out.splitlines() == [
        "openjd_status: light pass",
        "openjd_progress: 0",
        "openjd_progress: 12",
        "openjd_progress: 25",
        "openjd_status: view pass",
        "openjd_progress: 31",
        "openjd_progress: 37",
        "openjd_status: frame 7: made",
        "openjd_progress: 50",
        "openjd_status: light pass",
        "openjd_progress: 62",
        "openjd_progress: 75",
        "openjd_status: view pass",
        "openjd_progress: 81",
        "openjd_progress: 87",
        "openjd_status: frame 8: made",
        "openjd_progress: 100",
    ]


@pytest.mark.parametrize(
    ("error", "lines"),
    [
        (SceneError("a.toml:1: one\nopenjd_env: PATH=/", "a.toml:2: two"), 2),
        (click.UsageError("wrong"), 1),
        (MemoryError(), 1),
        (KeyboardInterrupt(), 1),
    ],
)
def test_failures(capsys, error, lines):
    with pytest.raises(type(error)), failures_told():
        raise error
    told = capsys.readouterr().out.splitlines()
    assert len(told) == lines
    assert all(line.startswith("openjd_fail: ") for line in told)  # names from files give farms no orders


def test_a_picture(cli, cloud, tiny):
    done = cli("render", cloud, "-o", "a.png", "--progress", "openjd", *tiny)
    assert done.code == 0
    told = done.out.splitlines()
    assert all(re.fullmatch(r"openjd_(status: .+|progress: \d+)", line) for line in told)
    assert told[-1] == "openjd_progress: 100"
    done = cli("render", "none.npy", "-o", "a.png", "--progress", "openjd", *tiny)
    assert done.code == 2
    assert done.out == f"openjd_fail: {done.err.removeprefix('tfm: ')}"


@pytest.mark.parametrize("other", [("--json", "-"), ("--print-config",)])
def test_standard_output_is_the_farm_s(cli, cloud, other):
    done = cli("render", cloud, "-o", "a.png", "--progress", "openjd", *other)
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert "--progress openjd: standard output is the farm's" in done.err


@pytest.mark.slow
def test_the_template_of_the_documentation(cloud, tmp_path):
    pytest.importorskip("openjd.cli")
    scripts = Path(sys.executable).parent
    environment = os.environ | {"PATH": os.pathsep.join([str(scripts), os.environ["PATH"]])}

    def openjd(*arguments):
        command = [sys.executable, "-m", "openjd", *map(str, arguments)]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    checked = openjd("check", TEMPLATE)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    scene = tmp_path / "shot.toml"
    scene.write_text(
        f"[volume]\nfile = {str(cloud)!r}\n[camera]\nres = [16, 9]\n[map]\nres = 16\nsteps = 8\n"
        "[march]\nsteps = 8\n",
        encoding="utf-8",
    )
    out = tmp_path / "out"
    out.mkdir()
    asked = {"Scene": scene, "Output": out / "a.####.npy", "Frames": "1-5:2,8-9", "FramesPerChunk": 3}
    run = openjd("run", TEMPLATE, *(f"-p{key}={value}" for key, value in asked.items()))
    assert run.returncode == 0, run.stdout + run.stderr
    assert sorted(path.name for path in out.glob("*.npy")) == [f"a.{n:04d}.npy" for n in (1, 3, 5, 8, 9)]
    assert "openjd_progress: 100" in run.stdout

    asked |= {"Scene": tmp_path / "none.toml"}
    run = openjd("run", TEMPLATE, *(f"-p{key}={value}" for key, value in asked.items()))
    assert run.returncode != 0
    assert "openjd_fail: " in run.stdout
