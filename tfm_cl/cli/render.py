"""``tfm render``: a volume or a scene to pictures."""

import json
import logging
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tfm_cl.cli.options import (
    GroupedCommand,
    GroupedOption,
    as_flags,
    device_option,
    look_option,
    overrides,
    scene_options,
)
from tfm_cl.cli.paths import SOURCE, TARGET
from tfm_cl.cli.progress import log_shown, progress_bar
from tfm_cl.cli.streams import one_line
from tfm_cl.files import image_io
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.files.paths import check_writable, path_of, real_path, write_text
from tfm_cl.plan import options
from tfm_cl.plan.plan import Plan, plan
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import SceneFile, Values
from tfm_cl.scene.scene_file_writer import scene_text, to_toml
from tfm_cl.scene.settings import ImageSettings

if TYPE_CHECKING:
    from tfm_cl.render.result import RenderResult


@click.command("render", cls=GroupedCommand)
@click.argument("source", metavar="INPUT", type=SOURCE)
@click.option(
    "-o",
    "outputs",
    metavar="OUT",
    multiple=True,
    type=TARGET,
    cls=GroupedOption,
    group="Output",
    help=".exr .png .npy .deep.exr, by extension, or .toml: a scene file that reproduces this run; may be "
    "repeated",
)
@scene_options()
@look_option
@device_option
@click.option(
    "--print-config",
    is_flag=True,
    cls=GroupedOption,
    help="print a scene file that reproduces this run, without keys at their default; without -o nothing is "
    "rendered",
)
@click.option("--all", "every_key", is_flag=True, cls=GroupedOption, help="print, or write, all of its keys")
@click.option("--stats", is_flag=True, cls=GroupedOption, help="print times, samples and map size")
@click.option(
    "--json", "json_path", metavar="FILE|-", cls=GroupedOption, help="write options and figures as JSON"
)
@click.option("-q", "quiet", is_flag=True, cls=GroupedOption, help="print errors only")
@click.option("-v", "verbose", is_flag=True, cls=GroupedOption, help="print every option as resolved")
def command(
    source: Path,
    outputs: tuple[Path, ...],
    settings: tuple[str, ...],
    look: str,
    device: str | None,
    json_path: str | None,
    *,
    print_config: bool,
    every_key: bool,
    stats: bool,
    quiet: bool,
    verbose: bool,
    **given: Any,
) -> None:
    """Render INPUT, a volume or a scene (.toml), to pictures.

    \b
    tfm render cloud.vdb -o cloud.png
    tfm render scene.toml -o shot.exr -o shot.png --aov depth,transmittance --res 1920x1080
    tfm render cloud.vdb -o reference.exr --method dual
    tfm render cloud.vdb -o cloud.toml
    """  # noqa: D301 - click wants the character \b, not its escape
    started = time.perf_counter()
    pictures, configs = _sorted_out(outputs, print_config=print_config, every_key=every_key)
    json_file = None if json_path in {None, "-"} else path_of(str(json_path))
    _check_writable(pictures, json_file, *configs)
    changes = overrides(given, settings)
    scene_file = SceneFile.read(source, changes, look)
    _check_apart((*outputs, *filter(None, [json_file])), (source, *scene_file.files()))
    scene = scene_file.make(Scene)
    planned = plan(scene, file=scene_file)
    resolved = options.table(scene_file, planned.scene)
    if not quiet:
        _tell_left_out(pictures, scene_file.image)
        _tell_unused(pictures, dict(changes))
        _tell_chosen(source, planned)
    _warn(options.warnings(scene_file, scene), quiet=quiet)
    if verbose:
        _tell_all(resolved, planned)
    _write_configs(resolved, configs, print_config=print_config, every_key=every_key)
    if not pictures:
        return
    scene.read_files()  # before the device is looked for
    load_seconds = time.perf_counter() - started

    # Imported here: printing a configuration needs no OpenCL.
    from tfm_cl.render.diagnosis import too_dark  # noqa: PLC0415
    from tfm_cl.render.renderer import Renderer  # noqa: PLC0415

    with progress_bar(quiet=quiet) as progress, Renderer(device) as renderer:
        image = scene_file.image
        result = renderer.render(scene, progress=progress, **_frame(image, pictures))
    _warn(result.warnings, quiet=quiet)
    stops = _exposure(result, pictures, image)
    if stops is not None:
        dark = too_dark(result, stops, image.view, transparent=image.transparent)
        _warn(filter(None, [dark]), quiet=quiet)
        if image.exposure == "auto" and not quiet:
            print(f"chosen for --exposure auto: {as_flags({'image.exposure': stops})}", file=sys.stderr)
        resolved["image"] |= {"exposure": stops}
    resolved["map"] = _used_map(resolved["map"], result)
    resolved["march"] |= {"steps": result.scene.march.steps}
    _tell_error(scene.map.max_error, result, quiet=quiet)

    rendered = time.perf_counter()
    _save(result, pictures, image, resolved)
    ended = time.perf_counter()
    planned = planned.completed(result.scene, result.stats.map, result.stats.error_estimate, stops)
    report = {"options": resolved, "plan": planned.to_dict()} | result.stats.to_dict()
    report["seconds"] |= {"load": load_seconds, "save": ended - rendered, "total": ended - started}
    if stats and not quiet:
        _print_stats(report)
    if json_path is not None:
        _write_json(json_file, report)


def _frame(image: ImageSettings, outputs: tuple[Path, ...]) -> dict[str, Any]:
    """Return what the renderer is asked for; deep images have no use for several samples of a pixel."""
    deep = [image_io.is_deep(path) for path in outputs]
    asked: dict[str, Any] = {**image.frame, "deep_colour": image.deep_colour}
    return (
        asked | ({"deep": image.deep_tolerance} if any(deep) else {}) | ({"samples": 1} if all(deep) else {})
    )


def _warn(warnings: Iterable[str], *, quiet: bool) -> None:
    for warning in () if quiet else warnings:
        print(f"tfm: warning: {one_line(warning)}", file=sys.stderr)


def _tell_chosen(source: Path, planned: Plan) -> None:
    """Say what was placed, scaled and counted, as flags to start from."""
    if planned.told:
        print(f"chosen for {source.name}: {as_flags(planned.told)}", file=sys.stderr)


def _tell_all(resolved: Values, planned: Plan) -> None:
    """Print every option, and why those are what they are that were left open."""
    of_map = resolved["map"] if planned.map is None else planned.map.to_dict()
    with log_shown("# %(message)s", logging.DEBUG):
        planned.log()
    print(to_toml(resolved | {"map": of_map}), file=sys.stderr)


def _tell_error(asked: float | None, result: "RenderResult", *, quiet: bool) -> None:
    """Say what was chosen for an error, if one was asked for, and the error measured."""
    if asked is None or quiet:
        return
    used = result.scene.map.to_dict() | ({} if result.stats.map is None else result.stats.map.to_dict())
    chosen = {"march.steps": result.scene.march.steps, "map.steps": used["steps"]}
    if result.stats.map is not None:
        chosen |= {"map.res": used["res"], "map.coeffs": used["coeffs"]}
    measured = f"measured error {result.stats.error_estimate:.2g}"
    print(f"chosen for --max-error {asked:g}: {as_flags(chosen)}; {measured}", file=sys.stderr)


def _used_map(asked: Values, result: "RenderResult") -> Values:
    """Return what the map's settings came to; asked for: those of the scene."""
    used = result.stats.map
    if used is None:
        return asked
    # Where the target is not the transmittance, α means nothing.
    alpha = {} if used.target == "transmittance" else {"density_weighting": asked["density_weighting"]}
    return used.to_dict() | alpha


def _sorted_out(
    outputs: tuple[Path, ...], *, print_config: bool, every_key: bool
) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return the pictures and the scene files among the outputs."""
    if not outputs and not print_config:
        raise click.UsageError("no picture asked for; add -o OUT.png (or --print-config)")
    configs = tuple(path for path in outputs if path.suffix.lower() == ".toml")
    if every_key and not (configs or print_config):
        raise click.UsageError("--all is of a scene file: add --print-config, or -o OUT.toml")
    return tuple(path for path in outputs if path not in configs), configs


def _write_configs(resolved: Values, paths: tuple[Path, ...], *, print_config: bool, every_key: bool) -> None:
    """Print and write scene files that reproduce this run."""
    if print_config:
        print(scene_text(resolved, every_key=every_key), end="")
    for path in paths:
        write_text(path, scene_text(resolved, path.parent, every_key=every_key))


def _check_writable(pictures: tuple[Path, ...], *others: Path | None) -> None:
    for path in pictures:
        image_io.check_writable(path)
    for other in filter(None, others):
        check_writable(other)


def _check_apart(outputs: tuple[Path, ...], inputs: tuple[Path, ...]) -> None:
    """Refuse to replace what the picture is made from (both may be ``.npy``), or what was just written."""
    taken = {real_path(source): "is the input itself" for source in inputs}
    for path in outputs:
        what = taken.setdefault(real_path(path), "")
        if what:
            raise click.UsageError(f"{path}: {what}; choose another name")
        taken[real_path(path)] = "is written twice"


def _exposure(result: "RenderResult", outputs: tuple[Path, ...], image: ImageSettings) -> float | None:
    """Return the stops of the PNGs; None without one."""
    if not any(path.suffix.lower() == ".png" for path in outputs):
        return None
    if image.exposure != "auto":
        return image.exposure
    picture = result.picture(transparent=image.transparent)
    return automatic_exposure(picture, image.view, transparent=image.transparent)


def _tell_left_out(outputs: tuple[Path, ...], image: ImageSettings) -> None:
    """Say which outputs are without the layers or the background asked for."""
    for path in outputs:
        if image.transparent and image.has_background and path.suffix.lower() == ".png":
            print(
                f"tfm: note: {path}: has alpha in place of the background (--no-transparent shows it)",
                file=sys.stderr,
            )
        if image.samples > 1 and image_io.is_deep(path):
            print(
                f"tfm: note: {path}: has one ray a pixel, through its centre (--samples {image.samples} is "
                "for other pictures)",
                file=sys.stderr,
            )
        if image.aov and not image_io.holds_layers(path):
            layers = ", ".join(image.aov)
            print(
                f"tfm: note: {path}: has no room for layers: {layers} (.exr has)",
                file=sys.stderr,
            )


OF_FORMATS = {
    ".png": ("image.exposure", "image.view", "image.transparent", "image.png_bits", "image.dither"),
    image_io.DEEP: ("image.deep_tolerance", "image.deep_colour"),
}
"""Extension -> options that are of such pictures alone."""


def _tell_unused(outputs: tuple[Path, ...], changes: Values) -> None:
    """Say which options were given for pictures that are not asked for."""
    for extension, keys in OF_FORMATS.items():
        given = {key: changes[key] for key in keys if key in changes}
        if given and outputs and not any(path.name.lower().endswith(extension) for path in outputs):
            print(f"tfm: note: {as_flags(given)} is of {extension}, and none is written", file=sys.stderr)


def _save(result: "RenderResult", outputs: tuple[Path, ...], image: ImageSettings, resolved: Values) -> None:
    for path in outputs:
        result.save(
            path,
            exposure=resolved["image"]["exposure"],
            aovs=image.aov,
            pixel_type=image.pixel_type,
            metadata={"tfm_cl:options": json.dumps(resolved)},
            **image.png,
        )


def _write_json(path: Path | None, report: Values) -> None:
    text = json.dumps(report, indent=2)
    if path is None:
        print(text)
    else:
        write_text(path, text + "\n")


def _print_stats(report: Values) -> None:
    print(f"device       {report['device']['name']}", file=sys.stderr)
    for name in ("load", "compile", "light_pass", "view_pass", "orders", "host", "save", "total"):
        if name not in report["seconds"]:
            continue
        samples = report["samples"].get(name)
        seconds = report["seconds"][name]
        rate = (
            f"   {samples:>15,} samples, {samples / seconds / 1e6:,.0f} M/s"
            if samples and seconds > 0
            else ""
        )
        print(f"{name:12} {seconds:8.3f} s{rate}", file=sys.stderr)
    if report["refined_pixels"]:
        print(f"refined      {report['refined_pixels']:8,} pixels", file=sys.stderr)
    print(f"maps         {report['map_bytes'] / 2**20:8.1f} MiB", file=sys.stderr)
