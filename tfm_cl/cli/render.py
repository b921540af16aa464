"""``tfm render``: a volume or a scene to pictures."""

import contextlib
import json
import logging
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tfm_cl.cli.frames import Frame, check_names, frame_options, frames_asked, named
from tfm_cl.cli.openjd import FarmLines, progress_option
from tfm_cl.cli.options import (
    GroupedCommand,
    GroupedOption,
    as_flags,
    device_option,
    look_option,
    overrides,
    scene_options,
    scheduler_option,
)
from tfm_cl.cli.paths import SOURCE, TARGET
from tfm_cl.cli.progress import log_shown, progress_bar
from tfm_cl.cli.sequence import Range, check_one, is_range, sequence_options, share_cores
from tfm_cl.cli.streams import one_line
from tfm_cl.errors import InputError
from tfm_cl.files import image_io
from tfm_cl.files.paths import check_writable, path_of, real_path, write_text
from tfm_cl.files.patterns import FilePattern
from tfm_cl.interrupts import interrupts_held
from tfm_cl.plan.plan import Plan
from tfm_cl.scene.scene_file import SceneFile, Values
from tfm_cl.scene.scene_file_writer import scene_text, to_toml
from tfm_cl.scene.settings import ImageSettings
from tfm_cl.sequence.claims import Ledger
from tfm_cl.sequence.frame import ReadFrame, check_blurred, read
from tfm_cl.sequence.names import Files
from tfm_cl.sequence.plan import RangePlan, looked_at, steady
from tfm_cl.sequence.ranges import frames_of
from tfm_cl.sequence.shot import Shot
from tfm_cl.sequence.shot_frames import FrameWorker, ShotFrames

if TYPE_CHECKING:
    from tfm_cl.render.renderer import Renderer
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
@frame_options
@sequence_options
@scheduler_option
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
@progress_option
def command(
    source: Path,
    outputs: tuple[Path, ...],
    settings: tuple[str, ...],
    look: str,
    device: str | None,
    json_path: str | None,
    frames: str | None,
    frame: float | None,
    turntable: int | None,
    plan_frames: str | None,
    jobs: int,
    scheduler: str | None,
    farm: FarmLines | None,
    *,
    skip_existing: bool,
    print_config: bool,
    every_key: bool,
    stats: bool,
    quiet: bool,
    verbose: bool,
    **given: Any,
) -> int:
    """Render INPUT, a volume or a scene (.toml), to pictures.

    \b
    tfm render cloud.vdb -o cloud.png
    tfm render scene.toml -o shot.exr -o shot.png --aov depth,transmittance --res 1920x1080
    tfm render cloud.vdb -o reference.exr --method dual
    tfm render cloud.vdb -o cloud.toml
    tfm render shot.toml --frames 1-100x2 -o shot.####.exr
    """  # noqa: D301 - click wants the character \b, not its escape
    wanted = frames_asked(frames, frame, turntable)
    pictures, configs = _sorted_out(outputs, print_config=print_config, every_key=every_key)
    json_file = None if json_path in {None, "-"} else path_of(str(json_path))
    check_names(outputs, wanted)
    if json_file is not None and FilePattern.of(json_file) is not None:
        raise click.UsageError(f"{json_file}: --json is one file for all frames; choose a plain name")
    if print_config and len(wanted) > 1:
        raise click.UsageError("--print-config is of one frame: say which with --frame")
    changes = overrides(given, settings)
    shot = Shot(source, changes, look, turntable)
    if pictures and is_range(wanted, frame):
        _check_range(shot, wanted, outputs, json_file, changes, quiet=quiet)
        files = Files(pictures, configs, every_key=every_key)
        of_range = _range(shot, wanted, plan_frames, files, device, jobs, skip_existing=skip_existing)
        of_range.quiet, of_range.verbose = quiet, verbose
        of_range.reports = stats or json_path is not None
        of_range.scheduler, of_range.farm = scheduler, farm
        return _finish_range(of_range, json_path, json_file, stats=stats and not quiet)
    check_one(jobs, plan_frames, scheduler, skip_existing=skip_existing)
    told = _Told(quiet=quiet)
    run = _Run(shot, pictures, configs, json_file, device, told, farm)
    reports: list[Values] = []
    with contextlib.ExitStack() as stack:
        for number in wanted:
            started = time.perf_counter()
            ready = run.read(number)
            if number == wanted[0] and not quiet:
                _tell_left_out(pictures, ready.file.image)
                _tell_unused(pictures, dict(changes), ready.file.image)
                _tell_chosen(source, ready.planned)
            told.warn(ready.warnings())
            if verbose:
                _tell_all(ready.options, ready.planned)
            run.write_configs(ready, print_config=print_config, every_key=every_key)
            if not pictures:
                continue
            report = run.render(ready, stack, time.perf_counter() - started)
            if stats and not quiet:
                _print_stats(report)
            reports.append(report)
    if json_path is not None and reports:
        _write_json(json_file, reports[0] if len(wanted) == 1 else {"frames": reports})
    return 0


@dataclass
class _Run:
    """What is rendered to what, by a renderer that serves all frames."""

    shot: Shot
    pictures: tuple[Path, ...]
    configs: tuple[Path, ...]
    json_file: Path | None
    device: str | None
    told: "_Told"
    farm: FarmLines | None
    renderer: "Renderer | None" = None

    def read(self, number: Frame) -> ReadFrame:
        """Read a frame, and find out whether its files can be written, before the hours that make them."""
        pictures, configs = named(self.pictures, number), named(self.configs, number)
        _check_writable(pictures, self.json_file, *configs)
        scene_file = self.shot.scene_file(number)
        check_blurred(scene_file.image, pictures)
        _check_apart((*pictures, *configs, *filter(None, [self.json_file])), scene_file)
        return read(scene_file, number)

    def write_configs(self, ready: ReadFrame, *, print_config: bool, every_key: bool) -> None:
        """Print and write scene files that reproduce this run, and tell what they leave out."""
        if self.configs or print_config:
            self.told.warn(ready.warnings_of_scene())
        if print_config:
            print(scene_text(ready.options, every_key=every_key), end="")
        for path in named(self.configs, ready.number):
            write_text(path, scene_text(ready.options, path.parent, every_key=every_key))

    def render(self, ready: ReadFrame, stack: contextlib.ExitStack, seconds: float) -> Values:
        """Render and write a frame that took some seconds to read, and return its figures."""
        started, told, pictures = time.perf_counter(), self.told, named(self.pictures, ready.number)
        ready.read_files()  # before the device is looked for
        loaded = time.perf_counter()
        with progress_bar(quiet=told.quiet, farm=self.farm) as progress:
            if self.renderer is None:
                self.renderer = stack.enter_context(_renderer(self.device))
            done = ready.render(self.renderer, pictures, progress)
        told.warn(done.warnings)
        if done.stops is not None and ready.file.image.exposure == "auto":
            told.tell(f"chosen for --exposure auto: {as_flags({'image.exposure': done.stops})}")
        _tell_error(ready.scene.map.max_error, done.result, quiet=told.quiet)
        rendered = time.perf_counter()
        done.save(pictures)
        ended, report = time.perf_counter(), done.report()
        if self.farm is not None:
            self.farm.ended("done")
        load = seconds + loaded - started
        report["seconds"] |= {"load": load, "save": ended - rendered, "total": seconds + ended - started}
        return report


class _Told:
    """What was told already, as of another frame, is not told again."""

    def __init__(self, *, quiet: bool) -> None:
        self.quiet = quiet
        self._lines: set[str] = set()

    def tell(self, line: str) -> None:
        """Print a line to stderr."""
        if not self.quiet and line not in self._lines:
            self._lines.add(line)
            print(line, file=sys.stderr)

    def warn(self, warnings: Iterable[str]) -> None:
        """Print warnings."""
        for warning in warnings:
            self.tell(f"tfm: warning: {one_line(warning)}")


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


def _check_writable(pictures: tuple[Path, ...], *others: Path | None) -> None:
    for path in pictures:
        image_io.check_writable(path)
    for other in filter(None, others):
        check_writable(other)


def _range(
    shot: Shot,
    asked: tuple[Frame, ...],
    plan_frames: str | None,
    files: Files,
    device: str | None,
    jobs: int,
    *,
    skip_existing: bool,
) -> Range:
    """Return how a range is rendered."""
    frames = tuple(int(number) for number in asked if number is not None)
    planned = frozenset((*frames, *(() if plan_frames is None else _frames_of(plan_frames))))
    exposes = any(path.suffix.lower() == ".png" for path in files.pictures)

    def decide(ledger: Ledger, rendering: Callable[[], Any]) -> RangePlan:
        return steady(shot, planned, files.plan, ledger, exposes=exposes, renderer=rendering)

    def decided(overrides: list[tuple[str, Any]]) -> Shot:
        return replace(shot, decided=overrides)

    return Range(
        frames,
        files,
        ShotFrames(shot, files, read, partial(_renderer, device)),
        decide,
        lambda overrides: partial(_worker, decided(overrides), files, device, jobs, skip_existing),
        decided,
        jobs,
        skip_existing,
    )


def _frames_of(text: str) -> tuple[int, ...]:
    try:
        return frames_of(text)
    except InputError as error:
        raise InputError(f"--plan-frames: {error}") from None


def _renderer(device: str | None) -> "Renderer":
    with interrupts_held():  # modules in C, which fail or forget Ctrl-C while they are imported
        from tfm_cl.render.renderer import Renderer  # noqa: PLC0415 - reading needs no OpenCL
    return Renderer(device)


def _worker(shot: Shot, files: Files, device: str | None, jobs: int, skip_existing: bool) -> FrameWorker:  # noqa: FBT001 - partial
    """Make what works in one of several processes."""
    if jobs > 1:
        share_cores(jobs)
    return FrameWorker(shot, files, read, partial(_renderer, device), skip_existing=skip_existing)


def _finish_range(of_range: Range, json_path: str | None, json_file: Path | None, *, stats: bool) -> int:
    """Render a range, and print and write its figures; returns the exit code."""
    code = of_range.render()
    order = {frame: place for place, frame in enumerate(of_range.frames)}
    of_range.found.sort(key=lambda report: order[report["frame"]])
    for report in of_range.found if stats else ():
        _print_stats(report)
    if json_path is not None:
        _write_json(json_file, {"frames": of_range.found})
    return code


def _check_range(
    shot: Shot,
    frames: tuple[Frame, ...],
    outputs: tuple[Path, ...],
    json_file: Path | None,
    changes: list[tuple[str, Any]],
    *,
    quiet: bool,
) -> None:
    """Find out what is wrong with all frames of a range, before the first is made."""
    pictures = tuple(path for path in outputs if path.suffix.lower() != ".toml")
    _check_writable(named(pictures, frames[0]), json_file)
    for number in looked_at([int(frame) for frame in frames if frame is not None]):
        try:
            scene_file = shot.scene_file(number)
        except InputError:
            continue  # told with that frame, or by the plan
        check_blurred(scene_file.image, pictures)
        _check_apart((*named(outputs, number), *filter(None, [json_file])), scene_file)
        if not quiet:
            _tell_left_out(named(pictures, number), scene_file.image)
            _tell_unused(pictures, dict(changes), scene_file.image)
        return


def _check_apart(outputs: tuple[Path, ...], scene_file: SceneFile) -> None:
    """Refuse to replace what a picture is made from (both may be ``.npy``), or what was just written."""
    inputs = (scene_file.path, *scene_file.files())
    taken = {real_path(source): "is the input itself" for source in inputs}
    for path in outputs:
        if scene_file.is_file_of_a_frame(path):
            raise click.UsageError(f"{path}: is the input of a frame; choose another name")
        what = taken.setdefault(real_path(path), "")
        if what:
            raise click.UsageError(f"{path}: {what}; choose another name")
        taken[real_path(path)] = "is written twice"


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


def _tell_unused(outputs: tuple[Path, ...], changes: Values, image: ImageSettings) -> None:
    """Say which options were given for pictures that are not asked for."""
    moments = "image.motion_samples"
    if moments in changes and outputs and not image.is_blurred:
        flag = as_flags({moments: changes[moments]})
        print(f"tfm: note: {flag} is of a shutter that is open for some time (--shutter)", file=sys.stderr)
    for extension, keys in OF_FORMATS.items():
        given = {key: changes[key] for key in keys if key in changes}
        if given and outputs and not any(path.name.lower().endswith(extension) for path in outputs):
            print(f"tfm: note: {as_flags(given)} is of {extension}, and none is written", file=sys.stderr)


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
