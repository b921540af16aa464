#!/usr/bin/env python3
"""Reproduce the figures and tables of the papers that this project builds on, beside their numbers.

TFM: Delalandre et al., "Transmittance Function Mapping", I3D 2011. FOM: Jansen and Bavoil, "Fourier
Opacity Mapping", I3D 2010. OSM: Kim and Neumann, "Opacity Shadow Maps", Eurographics Workshop on
Rendering 2001.

Each of their claims gives one line, ``holds``, ``holds when …`` or ``does not hold``, which is computed from
the measurements. Where TFM shows smoke or a bunny, the sample volumes are used instead: ``plume`` is smoke,
``cumulus`` a cloud, and ``figure``, with hard edges, the pathological case. FOM's plume is ``particles``, as
many as in the paper, and the knot ``spirals`` its complex structure; hair and fur are the samples' tufts, and
where OSM tells how many lines, models of 350,000 and more. Voxels that once stood for them are measured
beside them, and a claim says where particles and hair turn out otherwise. Speeds are ratios within one run,
of device seconds measured in turn. Writes ``papers.md``, ``papers.json`` and one picture per study.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path

from reproduce import fom_2010, osm_2001, tfm_2011
from reproduce.claims import Study
from reproduce.lab import QUICK, Lab, Sizes
from reproduce.report import markdown, numbers

import tfm_cl as tfm
from tfm_cl.errors import InputError
from tfm_cl.files.paths import replacing, write_text

STUDIES: dict[str, Callable[[Lab], Study]] = {
    study.__name__: study for study in (*tfm_2011.STUDIES, *fom_2010.STUDIES, *osm_2001.STUDIES)
}
"""Studies by the name used for ``--only`` and for the picture."""


def reproduce(names: Iterable[str], sizes: Sizes, out: Path, device: str | None = None) -> dict[str, Study]:
    """Run studies and write the report."""
    studies = {}
    with tfm.Renderer(device) as renderer:
        lab = Lab(renderer, sizes)
        for name in names:
            began = time.perf_counter()
            studies[name] = STUDIES[name](lab)
            print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
        facts = {"device": renderer.device_name, "sizes": asdict(sizes)}
    for name, study in studies.items():
        if study.figure is not None:
            with replacing(out / f"{name}.png") as temporary:
                study.figure.savefig(temporary, format="png")
    write_text(out / "papers.md", markdown(studies, facts))
    write_text(out / "papers.json", json.dumps(numbers(studies, facts), indent=1) + "\n")
    return studies


def _names(text: str) -> list[str]:
    names = [name for name in text.split(",") if name]
    for name in names:
        if name not in STUDIES:
            raise argparse.ArgumentTypeError(f"'{name}' is unknown; known: {', '.join(STUDIES)}")
    return names


def parse(arguments: list[str]) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--quick", action="store_true", help="smaller maps and pictures, for a quick trial")
    parser.add_argument(
        "--only", type=_names, default=list(STUDIES), metavar="NAME[,NAME]", help=", ".join(STUDIES)
    )
    parser.add_argument("--device", metavar="NAME", help="part of the OpenCL device's name")
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("out/papers"), metavar="DIR", help="default out/papers"
    )
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the studies; returns the exit code."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        try:
            options.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{options.out}: cannot be made a directory ({error.strerror})") from error
        studies = reproduce(options.only, QUICK if options.quick else Sizes(), options.out, options.device)
    except tfm.TfmError as error:
        print(f"reproduce_papers.py: {error}", file=sys.stderr)
        return error.exit_code
    for name, study in studies.items():
        for claim in study.claims:
            changed = f" (otherwise than voxels: {claim.changed})" if claim.changed else ""
            print(
                f"{name}: {claim.text}\n    {claim.verdict}{changed}. {claim.measured}. Paper: {claim.paper}."
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
