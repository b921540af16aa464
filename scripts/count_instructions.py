#!/usr/bin/env python3
"""Explain the passes' speed by the instructions that they execute.

``python scripts/count_instructions.py``. A model of the passes for PoCL on x86: a kernel takes at least as
long as its instructions do at the fastest pace of any kernel here; for what it takes longer, it waits for
memory or for results. Instructions are counted in the kernels' machine code by Valgrind (``apt install
valgrind``), for the baseline of ``bench.py``. Seconds are measured without it: CPU seconds of all cores, the
least of some rounds. Takes twelve minutes of one core, most of them because Valgrind also watches the
kernels being compiled, though it counts nothing then; ``--light``, without the view passes, takes four.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).resolve().parent))

import bench

import tfm_cl as tfm
from tfm_cl.device.device import choose_device
from tfm_cl.device.launch import Launcher
from tfm_cl.device.program import Kernel
from tfm_cl.device.running import Running

VOLUME = bench.REPOSITORY / "volumes" / "cumulus.npz"
ROOFLINE_RAYS = 160
"""Along each side of the roofline's square."""
ROUNDS = 10
NAMES = {
    "trilinear_gather": "roofline, gathers",
    "trilinear_pairs": "roofline, pairs",
    "light_pass": "light pass",
    "scatter_pass": "view pass",
    "light_lattice": "lattice, its look-ups",
    "lattice_pass": "lattice, view pass",
}
"""Kernel -> what it is called here."""
COUNTED = "_pocl_kernel_"
"""What the functions that PoCL makes of kernels begin with."""

Counts = dict[str, float]


def one_round(renderer: tfm.Renderer, launcher: Launcher, samples: Counts, *, views: bool) -> None:
    """Run every kernel, or only maps'; counts trilinear samples, of the lattice's look-ups the look-ups."""
    volume = bench.load(VOLUME)
    roofline = bench.Roofline(launcher, bench.roofline_grid(volume), ROOFLINE_RAYS)
    for form, kernel in bench.FORMS.items():
        roofline.run(form)
        samples[kernel] += ROOFLINE_RAYS**2 * bench.ROOFLINE_STEPS
    scene = bench.baseline_scene(volume, bench.BASELINE_RES)
    if not views:
        samples["light_pass"] += sum(one.buffers.samples for one in renderer.build_maps(scene))
        return
    for lookup, kernel in (("auto", "scatter_pass"), ("lattice", "lattice_pass")):
        asked = bench.with_map(scene, lookup=lookup)
        maps = renderer.build_maps(asked)
        samples["light_pass"] += sum(one.buffers.samples for one in maps)
        samples[kernel] += renderer.render(asked, maps=maps).stats.samples["view_pass"]
    samples["light_lattice"] += volume.leaves.values.size


def run_rounds(rounds: int, before_last: Callable[[], None], *, views: bool) -> dict[str, Counts]:
    """Run all kernels some times; returns each one's samples and least CPU seconds of a round."""
    samples, least = defaultdict[str, float](float), dict[str, float]()
    with tfm.Renderer() as renderer:
        launcher = Launcher(choose_device(None))
        start = Launcher.start

        def watched(
            self: Launcher, kernel: Kernel, size: tuple[int, ...], arguments: Mapping[str, Any]
        ) -> Running:
            began = time.process_time()
            running = start(self, kernel, size, arguments)
            running.wait()
            spent[kernel.function_name] += time.process_time() - began
            return running

        with mock.patch.object(Launcher, "start", watched):
            for number in range(rounds):
                if number == rounds - 1:
                    before_last()
                samples.clear()
                spent = defaultdict[str, float](float)
                one_round(renderer, launcher, samples, views=views)
                least = {name: min(spent[name], least.get(name, spent[name])) for name in samples}
    return {
        name: {"samples": samples[name], "seconds": least[name], "lanes": launcher.lanes} for name in samples
    }


def count_from_now_on() -> None:
    """Let the Valgrind that this process runs in begin to count."""
    command = ["callgrind_control", "--instr=on", str(os.getpid())]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)  # noqa: S603 - a fixed command


def child(rounds: int, before: tuple[str, ...] = (), *, views: bool) -> dict[str, Counts]:
    """Call `run_rounds` in a new process, after a command that watches it: the last round."""
    command = [*before, sys.executable, str(Path(__file__).resolve()), "--rounds", str(rounds)]
    command += [*(["--watched"] if before else []), *([] if views else ["--light"])]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - this script
    found: dict[str, Counts] = json.loads(done.stdout)
    return found


def instructions(*, views: bool) -> Counts:
    """Count the instructions that each kernel executes in one round."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "callgrind.out"
        watch = ("valgrind", "--tool=callgrind", "--instr-atstart=no", f"--toggle-collect={COUNTED}*")
        child(2, (*watch, f"--callgrind-out-file={file}"), views=views)
        listed = subprocess.run(  # noqa: S603 - a fixed command
            ["callgrind_annotate", "--threshold=100", str(file)],  # noqa: S607 - of Valgrind
            capture_output=True,
            text=True,
            check=True,
        )
    found = defaultdict[str, float](float)
    for count, kernel in re.findall(rf"^ *([\d,]+) .*:{COUNTED}(\w+)_workgroup", listed.stdout, re.MULTILINE):
        found[kernel] += int(count.replace(",", ""))
    return found


def report(counted: Counts, measured: dict[str, Counts]) -> str:
    """Return a table of what the model allows, and what was measured."""
    pace = max(counted[name] / found["seconds"] for name, found in measured.items())
    lines = [f"{'':24}{'instructions':>14}{'at least ns':>14}{'measured ns':>14}"]
    for name in measured:
        steps = measured[name]["samples"] / measured[name]["lanes"]
        least, seconds = counted[name] / pace, measured[name]["seconds"]
        figures = counted[name] / steps, 1e9 * least / steps, 1e9 * seconds / steps
        lines.append(f"{NAMES[name]:24}" + "".join(f"{figure:14.0f}" for figure in figures))
    return "\n".join(lines)


def main() -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--watched", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--light", action="store_true", help="only the light pass and the roofline")
    options = parser.parse_args()
    views = not options.light
    if options.rounds:
        before_last = count_from_now_on if options.watched else lambda: None
        print(json.dumps(run_rounds(options.rounds, before_last, views=views)))
        return 0
    if shutil.which("valgrind") is None:
        print("count_instructions.py: needs Valgrind: apt install valgrind", file=sys.stderr)
        return 2
    measured = child(ROUNDS, views=views)
    lanes = int(measured["light_pass"]["lanes"])
    print(f"For every {lanes} samples, which a work-item takes at once; CPU time of one core:")
    print(report(instructions(views=views), measured))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
