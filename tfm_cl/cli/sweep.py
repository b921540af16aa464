"""``tfm sweep``: quality against the number of coefficients."""

from pathlib import Path
from typing import Any

import click

from tfm_cl.cli.options import GroupedCommand, GroupedOption, overrides, scene_options
from tfm_cl.cli.progress import progress_bar


@click.command("sweep", cls=GroupedCommand)
@click.argument("inputs", metavar="INPUT...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "out",
    metavar="DIR",
    required=True,
    type=click.Path(path_type=Path),
    cls=GroupedOption,
    group="Sweep",
    help="folder of the results; an interrupted sweep goes on where it stopped",
)
@click.option(
    "--coeffs",
    default="2,4,8,16",
    show_default=True,
    metavar="N[,N]",
    cls=GroupedOption,
    group="Sweep",
    help="numbers of coefficients",
)
@click.option(
    "--density-weighting",
    "weightings",
    default="1,10",
    show_default=True,
    metavar="A[,A]",
    cls=GroupedOption,
    group="Sweep",
    help="density weightings, numbers ≥ 1 or auto",
)
@scene_options(without=("--coeffs", "--density-weighting", "--method", "--crop", "--exposure", "--aov"))
@click.option("--device", metavar="NAME", cls=GroupedOption, help="part of an OpenCL device's name  [PoCL]")
@click.option("-q", "quiet", is_flag=True, cls=GroupedOption, help="print errors only")
def command(
    inputs: tuple[Path, ...],
    out: Path,
    coeffs: str,
    weightings: str,
    settings: tuple[str, ...],
    device: str | None,
    *,
    quiet: bool,
    **given: Any,
) -> None:
    """Render each INPUT (volume or scene) with maps of many sizes and compare with the dual march.

    \b
    Writes DIR/sweep.jsonl and sweep.csv as it goes, then sweep.md, sweep.png, contact_sheet.png.
    tfm sweep volumes/plume.toml cloud.vdb -o out/sweep --coeffs 2,4,8,16 --density-weighting 1,10
    """  # noqa: D301 - click wants the character \b, not its escape
    # matplotlib and scikit-image take their time to import.
    from tfm_cl import sweep  # noqa: PLC0415

    with progress_bar(quiet=quiet) as progress:
        sweep.run(
            inputs,
            out,
            coeffs=_list(coeffs, int, "--coeffs"),
            density_weightings=_list(weightings, _weighting, "--density-weighting"),
            device=device,
            overrides=overrides(given, settings),
            progress=progress,
        )
    if not quiet:
        print((out / "sweep.md").read_text(encoding="utf-8"), end="")
        print(f"\n{out}: sweep.jsonl sweep.csv sweep.md sweep.png contact_sheet.png")


def _weighting(text: str) -> Any:
    return text if text == "auto" else float(text)


def _list(text: str, convert: Any, flag: str) -> list[Any]:
    try:
        return [convert(part.strip()) for part in text.split(",")]
    except ValueError:
        raise click.UsageError(f"{flag} {text}: should be values with commas between, as 2,4,8") from None
