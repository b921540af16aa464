"""``tfm compare``: how far a picture is from its reference."""

import json
import math
from pathlib import Path
from typing import Any

import click

from tfm_cl.cli.paths import SOURCE
from tfm_cl.errors import ImageError

LOWER_IS_BETTER = ("rmse", "flip")


@click.command("compare")
@click.argument("test", type=SOURCE)
@click.argument("reference", type=SOURCE)
@click.option("--layer", metavar="NAME", help="compare this layer of EXR files, as ambient or light.key")
@click.option("--json", "as_json", is_flag=True, help="print JSON")
@click.option("--flip", "with_flip", is_flag=True, help="FLIP too (needs pip install 'tfm_cl[flip]')")
@click.option(
    "--fail-under",
    "limits",
    metavar="METRIC=VALUE",
    multiple=True,
    help="exit with 1 when the metric is worse, as ssim=0.99 or lit.psnr=35; rmse and flip: when larger",
)
def command(
    test: Path,
    reference: Path,
    layer: str | None,
    limits: tuple[str, ...],
    *,
    as_json: bool,
    with_flip: bool,
) -> int:
    """Compare TEST with REFERENCE (.exr .png .npy): SSIM, PSNR, RMSE; full frame and where it is lit.

    Of crops, which EXR files place in the full frame, the pixels that both have.
    """
    wanted = [_limit(text) for text in limits]
    # scikit-image takes its time to import.
    from tfm_cl import metrics  # noqa: PLC0415
    from tfm_cl.render.comparison import in_common  # noqa: PLC0415

    common = in_common(test, reference, layer)
    images = common.test, common.reference
    values: dict[str, Any] = metrics.compare(*images).to_dict()
    if with_flip or any(name == "flip" for name, _ in wanted):
        values["flip"] = metrics.flip(*images)
    if common.note:
        click.echo(f"tfm: note: {common.note}", err=True)
    if as_json:
        placed = {"window": common.window, "note": common.note} if common.note else {}
        print(json.dumps(values | placed, indent=2))
    else:
        for name, value in _flat(values).items():
            print(f"{name:10} {_number(value):.6g}")
    missed, flat = 0, _flat(values)
    for name, limit in wanted:
        if name not in flat:
            raise ImageError(f"{reference}: has no lit pixel, and so no {name}")
        value = _number(flat[name])
        worse = value > limit if name.split(".")[-1] in LOWER_IS_BETTER else value < limit
        if worse or math.isnan(value):
            click.echo(f"tfm: {name} = {value:.6g} misses {limit:g}", err=True)
            missed = 1
    return missed


def _flat(values: dict[str, Any]) -> dict[str, Any]:
    lit = values["lit"]
    full = {name: value for name, value in values.items() if name != "lit"}
    return full | {f"lit.{name}": value for name, value in (lit or {}).items()}


def _number(value: float | None) -> float:
    return math.inf if value is None else float(value)


def _limit(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    known = ("ssim", "psnr", "rmse", "lit.ssim", "lit.psnr", "lit.rmse", "flip")
    try:
        limit = float(value)
    except ValueError:
        limit = math.nan
    if name not in known or math.isnan(limit):
        raise click.UsageError(
            f"--fail-under {text}: should be METRIC=VALUE with METRIC one of {', '.join(known)}"
        )
    return name, limit
