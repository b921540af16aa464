"""``tfm sweep``: quality against what a texel costs."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import click

from tfm_cl.cli.frames import checked, frame_option
from tfm_cl.cli.options import (
    GroupedCommand,
    GroupedOption,
    device_option,
    overrides,
    scene_options,
    scheduler_option,
)
from tfm_cl.cli.paths import SOURCE, TARGET
from tfm_cl.cli.progress import progress_bar
from tfm_cl.cli.streams import one_line
from tfm_cl.interrupts import interrupts_held

AXES = {
    "bases": ("--bases", "basis"),
    "coeffs": ("--coeffs", "coeffs"),
    "weightings": ("--density-weighting", "density_weighting"),
    "ranges": ("--ranges", "range"),
    "fits": ("--fits", "fit"),
    "lookups": ("--lookups", "lookup"),
    "storages": ("--storages", "storage"),
    "map_sizes": ("--map-sizes", "res"),
}
"""Parameter -> flag, and key of [map] that the flag gives the values of."""

NOT_ASKED = ("bytes", "max_error")
"""Keys of [map] that choose what the sweep goes through."""


def _option(*names: str, **attributes: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    return click.option(*names, cls=GroupedOption, group="Sweep", **attributes)


@click.command("sweep", cls=GroupedCommand)
@click.argument("inputs", metavar="INPUT...", nargs=-1, required=True, type=SOURCE)
@_option(
    "-o",
    "out",
    metavar="DIR",
    required=True,
    type=TARGET,
    help="folder of the results; an interrupted sweep goes on where it stopped",
)
@_option("--bases", default="dct,auto", show_default=True, metavar="NAME[,NAME]", help="bases of the maps")
@_option(
    "--coeffs",
    default="2,4,8,16",
    show_default=True,
    metavar="N[,N]",
    help="numbers of coefficients a texel; where a basis has not one of them, the nearest that it has",
)
@_option(
    "--density-weighting",
    "weightings",
    default="1,10",
    show_default=True,
    metavar="A[,A]",
    help="density weightings, numbers ≥ 1 or auto, where the target is transmittance",
)
@_option("--ranges", metavar="NAME[,NAME]", help="ranges of the light rays, as box,visible  [the scene's]")
@_option("--fits", metavar="NAME[,NAME]", help="fits, as l2,visibility  [the scene's]")
@_option(
    "--lookups", metavar="NAME[,NAME]", help="ways to look maps up, as interpolate,lattice  [the scene's]"
)
@_option("--storages", metavar="TYPE[,TYPE]", help="storage types, as f32,f16,u8  [the scene's]")
@_option("--map-sizes", metavar="N[,N]", help="map resolutions, as 256,1024  [the scene's]")
@_option(
    "--converged/--no-converged",
    default=True,
    show_default=True,
    help="compare with a dual march of more steps too",
)
@_option(
    "--converged-steps",
    metavar="N",
    type=click.INT,
    help="its steps, of both marches  [4 times the scene's, at most 1000]",
)
@_option(
    "--ray",
    metavar="U,V",
    help="place on the light's map, 0 to 1, of the ray whose transmittance is kept  [a dark one]",
)
@_option(
    "--jobs",
    default=1,
    show_default=True,
    metavar="N",
    type=click.INT,
    help="processes; with several, each one's seconds are longer",
)
@_option("--latex", is_flag=True, help="write DIR/sweep.tex too, tables for a paper (booktabs)")
@_option(
    "--figures",
    metavar="TYPE[,TYPE]",
    help="draw DIR/figures too, as svg,pdf: quality against bytes, and the ray "
    "(needs pip install 'tfm_cl[figures]')",
)
@scene_options(
    without=(
        "--basis",
        "--coeffs",
        "--density-weighting",
        "--map-bytes",
        "--max-error",
        "--method",
        "--crop",
        "--samples",
        "--filter",
        "--exposure",
        "--view",
        "--background",
        "--transparent",
        "--png-bits",
        "--dither",
        "--deep-tolerance",
        "--deep-colour",
        "--shutter",
        "--motion-samples",
        "--aov",
    )
)
@frame_option
@device_option
@scheduler_option
@click.option("-q", "quiet", is_flag=True, cls=GroupedOption, help="print errors only")
def command(
    inputs: tuple[Path, ...],
    out: Path,
    settings: tuple[str, ...],
    ray: str | None,
    frame: float | None,
    device: str | None,
    scheduler: str | None,
    *,
    converged: bool,
    converged_steps: int | None,
    jobs: int,
    latex: bool,
    figures: str | None,
    quiet: bool,
    **given: Any,
) -> None:
    """Render each INPUT (volume or scene) with maps of many settings and compare with the dual march.

    Every combination of the lists is rendered, but those that a basis refuses. Writes DIR/sweep.jsonl and
    sweep.csv as it goes, then DIR/curves and the report.

    \b
    tfm sweep volumes/plume.toml cloud.vdb -o out/sweep --bases dct,klt --coeffs 2,4,8,16
    tfm sweep cloud.vdb -o out/sweep --bases klt --ranges box,visible --storages f16,u8 --jobs 2
    """  # noqa: D301 - click wants the character \b, not its escape
    axes = {parameter: given.pop(parameter) for parameter in AXES}
    changes = overrides(given, settings)
    for key, _ in changes:
        if key.startswith("image."):
            raise click.UsageError(f"{key}: a sweep compares what passes make of whole frames; leave it out")
    _check_apart(axes, [key for key, _ in changes])
    if converged_steps is not None and not converged:
        raise click.UsageError("--converged-steps: there is nothing converged with --no-converged")

    # OpenCL and scikit-image take their time to import.
    with interrupts_held():  # modules in C fail where Ctrl-C meets them while they are imported
        from tfm_cl.render.renderer import Renderer  # noqa: PLC0415
    from tfm_cl.sweep import run as sweep  # noqa: PLC0415

    with progress_bar(quiet=quiet) as progress:
        sweep.run(
            inputs,
            out,
            partial(Renderer, device),
            bases=_list(axes, "bases", str),
            coeffs=_list(axes, "coeffs", int),
            density_weightings=_list(axes, "weightings", _weighting),
            ranges=_list(axes, "ranges", str),
            fits=_list(axes, "fits", str),
            lookups=_list(axes, "lookups", str),
            storages=_list(axes, "storages", str),
            map_sizes=_list(axes, "map_sizes", int),
            converged=converged,
            converged_steps=converged_steps,
            ray=_ray(ray),
            jobs=jobs,
            scheduler=scheduler,
            latex=latex,
            figures=() if figures is None else tuple(part.strip() for part in figures.split(",")),
            overrides=changes,
            frame=checked(frame),
            # One stage, so that the time left is that of the whole.
            progress=lambda _, fraction: progress("sweep", fraction),
            notice=lambda line: None if quiet else print(f"tfm: {one_line(line)}", file=sys.stderr),
        )
    if not quiet:
        print((out / "sweep.md").read_text(encoding="utf-8"), end="")
        names = sorted(path.name for path in out.iterdir() if not path.name.startswith("."))
        print(f"\n{out}: {' '.join(names)}")


def _check_apart(axes: dict[str, str | None], changed: list[str]) -> None:
    """Refuse one value for what the sweep goes through: it would be ignored."""
    for parameter, (flag, key) in AXES.items():
        if axes[parameter] is not None and f"map.{key}" in changed:
            raise click.UsageError(f"map.{key} is what the sweep goes through: give its values to {flag}")
    for key in NOT_ASKED:
        if f"map.{key}" in changed:
            raise click.UsageError(f"map.{key} chooses coeffs, which the sweep goes through: use --coeffs")


def _weighting(text: str) -> Any:
    return text if text == "auto" else float(text)


def _list(axes: dict[str, str | None], parameter: str, convert: Callable[[str], Any]) -> list[Any]:
    text = axes[parameter]
    if text is None:
        return []
    parts = [part.strip() for part in text.split(",")]
    try:
        if all(parts):
            return [convert(part) for part in parts]
    except ValueError:
        pass
    example = "2,4,8" if convert is not str else "a,b"
    raise click.UsageError(f"{AXES[parameter][0]} {text}: should be values with commas between, as {example}")


def _ray(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        u, v = (float(part) for part in text.split(","))
    except ValueError:
        raise click.UsageError(f"--ray {text}: should be u,v, as 0.5,0.5") from None
    return u, v
