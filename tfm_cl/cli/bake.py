"""``tfm bake``: a volume or a scene to what other programs show."""

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import click
from pydantic.fields import FieldInfo

from tfm_cl.bake import KINDS, Bake
from tfm_cl.cli.frames import checked, frame_option
from tfm_cl.cli.options import (
    LOOKS,
    GroupedCommand,
    GroupedOption,
    as_flags,
    device_option,
    names,
    overrides,
    scene_options,
    toml_value,
)
from tfm_cl.cli.paths import SOURCE, TARGET
from tfm_cl.cli.progress import progress_bar
from tfm_cl.cli.streams import one_line
from tfm_cl.files.paths import real_path
from tfm_cl.interrupts import interrupts_held
from tfm_cl.plan import options
from tfm_cl.plan.plan import plan
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import SceneFile

PICTURES = (
    *("--crop", "--samples", "--filter", "--exposure", "--view", "--background", "--transparent"),
    *("--png-bits", "--dither", "--aov", "--method", "--shutter", "--motion-samples"),
)
"""Flags of pictures, which no kind uses."""


def _fields() -> dict[str, dict[str, FieldInfo]]:
    """Options of all kinds, by their name, then by the kinds that have one of that name."""
    found: dict[str, dict[str, FieldInfo]] = {}
    for kind in KINDS.values():
        for name, field in kind.model_fields.items():
            found.setdefault(name, {})[kind.NAME] = field
    return found


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _parameter(name: str) -> str:
    return f"bake_{name}"


def _typed(field: FieldInfo) -> click.ParamType[Any]:
    """Return how the text of a flag is read; what the values may be is for the model to check."""
    plain: dict[Any, click.ParamType[Any]] = {bool: click.BOOL, int: click.INT, float: click.FLOAT}
    if get_origin(field.annotation) is Literal:
        return click.Choice([str(value) for value in get_args(field.annotation)])
    return plain.get(field.annotation, click.STRING)


def _read(field: FieldInfo, value: Any) -> Any:
    """Turn the text of a flag into the field's value: several are written with commas between."""
    if not isinstance(value, str):
        return value
    if get_origin(field.annotation) is tuple:
        numeric = {int, float} & set(get_args(field.annotation))
        return tuple(toml_value(part) if numeric else part for part in names(value))
    if get_origin(field.annotation) is Literal:
        return {str(known): known for known in get_args(field.annotation)}[value]
    return value if field.annotation is str else toml_value(value)


def _help(of_kinds: dict[str, FieldInfo]) -> str:
    """Say what an option means to each kind that has it, and its default."""
    return "; ".join(
        f"{kind}: {field.description}  [{_shown(field.default)}]" for kind, field in of_kinds.items()
    )


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ",".join(map(_shown, value))
    return {"True": "on", "False": "off", "None": "none"}.get(str(value), str(value))


def _bake_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add a flag for each option of any kind."""
    for name, of_kinds in reversed(_fields().items()):
        typed, flag = _typed(next(iter(of_kinds.values()))), _flag(name)
        function = click.option(
            f"{flag}/--no-{flag[2:]}" if typed is click.BOOL else flag,
            _parameter(name),
            default=None,
            type=typed,
            cls=GroupedOption,
            group="Bake",
            help=_help(of_kinds),
        )(function)
    return function


@click.command("bake", cls=GroupedCommand)
@click.argument("sources", metavar="INPUT...", nargs=-1, required=True, type=SOURCE)
@click.option(
    "-o",
    "out",
    metavar="OUT",
    required=True,
    type=TARGET,
    cls=GroupedOption,
    group="Bake",
    help="file or folder to write, as the kind has it",
)
@click.option(
    "--what",
    type=click.Choice(list(KINDS)),
    default=next(iter(KINDS)),
    show_default=True,
    cls=GroupedOption,
    group="Bake",
    help="; ".join(f"{kind.NAME}: {kind.SUMMARY}" for kind in KINDS.values()),
)
@_bake_options
@scene_options(without=PICTURES)
@click.option(
    "--look",
    type=LOOKS,
    cls=GroupedOption,
    group="Medium",
    help="what is chosen where nothing is given, as of tfm render  [what suits the kind]",
)
@frame_option
@device_option
@click.option("-q", "quiet", is_flag=True, cls=GroupedOption, help="print errors only")
def command(
    sources: tuple[Path, ...],
    out: Path,
    what: str,
    settings: tuple[str, ...],
    look: str | None,
    frame: float | None,
    device: str | None,
    *,
    quiet: bool,
    **given: Any,
) -> None:
    """Bake INPUT, a volume or a scene (.toml), to what other programs show; some kinds take a sequence.

    \b
    tfm bake cloud.vdb -o maps --what map
    tfm bake scene.toml -o maps --what map --map-res 256 --coeffs 4
    tfm bake scene.toml -o light.vdb --what light-grid --quantity light
    tfm bake smoke_*.vdb -o smoke.png --what six-way --tile 128
    """  # noqa: D301 - click wants the character \b, not its escape
    kind = KINDS[what]
    bake = kind(**dict(_chosen(kind, given)))
    changes = overrides(given, settings)
    _check_used(kind, [key for key, _ in changes])
    if len(sources) > 1 and not kind.TAKES_SEVERAL:
        raise click.UsageError(f"--what {what} takes one INPUT; got {len(sources)}")
    sources = tuple(sorted(sources, key=_in_order))
    scene_files, shared = alike(sources, changes, look or kind.LOOK, checked(frame))
    for path in (*sources, *(file for scene_file in scene_files for file in scene_file.files())):
        if real_path(path) == real_path(out):
            raise click.UsageError(f"{out}: is the input itself; choose another name")
    bake.check(out)
    scene_file = scene_files[0]
    scene = scene_file.make(Scene)
    bake.check_scene(scene)
    planned = plan(scene, file=scene_file)
    if not quiet:
        told = {key: value for key, value in planned.told.items() if not key.startswith(kind.NOT_USED)}
        _tell_chosen(sources[0].name, told)
        _tell_chosen(f"all {len(sources)}", shared)
        for warning in options.warnings(scene_file, scene):
            print(f"tfm: warning: {one_line(warning)}", file=sys.stderr)
    scene_file.check_files()
    scene.read_files()  # before the device is looked for

    # OpenCL takes its time to import.
    with interrupts_held():  # modules in C fail where Ctrl-C meets them while they are imported
        from tfm_cl.render.renderer import Renderer  # noqa: PLC0415

    with progress_bar(quiet=quiet) as progress, Renderer(device) as renderer:
        frames: list[Callable[[], Scene]] = [lambda: scene]
        if len(scene_files) > 1:  # one is in memory at a time
            del scene
            frames = [partial(scene_file.make, Scene) for scene_file in scene_files]
        written = bake.bake_frames(renderer, frames, out, progress)
    if not quiet:
        for path in written:
            print(path)


def _tell_chosen(what: str, chosen: dict[str, Any]) -> None:
    if chosen:
        print(f"chosen for {what}: {as_flags(chosen)}", file=sys.stderr)


def _in_order(path: Path) -> list[tuple[int, str]]:
    """Return what a sequence is sorted by: numbers in names by what they count."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", str(path))]


def alike(
    sources: Sequence[Path], changes: list[tuple[str, Any]], look: str, frame: float | None = None
) -> tuple[list[SceneFile], dict[str, float]]:
    """Read the files of a sequence, in which bare volumes have the same look and the same scales.

    What is chosen for a volume by itself flickers in a sequence: where densities are scaled, the deepest of
    all decides, and where temperatures are, the hottest. Returns these scales, too, by dotted key.
    """
    first = SceneFile.read(sources[0], changes, look, frame)
    if len(sources) == 1:
        return [first], {}
    found = [first, *(SceneFile.read(source, changes, first.look.name, frame) for source in sources[1:])]
    scaled = [scene_file.make(Scene).bodies[0] for scene_file in found if _scales_density(scene_file)]
    hot = [scene_file.medium for scene_file in found if _glows(scene_file)]
    shared: dict[str, float] = {}
    if scaled:
        shared["volume.density_scale"] = min(getattr(body, "density_scale", 1.0) for body in scaled)
    if hot:
        shared["medium.temperature_scale"] = min(medium.temperature_scale for medium in hot)
        shared["medium.Le_scale"] = min(medium.Le_scale for medium in hot)
    return [_with_scales(scene_file, shared) for scene_file in found], shared


def _with_scales(scene_file: SceneFile, shared: dict[str, float]) -> SceneFile:
    """Return a frame's file with the scales of its sequence."""
    if _scales_density(scene_file):
        scale = shared["volume.density_scale"]
        volumes = tuple(body.replace(density_scale=scale) for body in scene_file.volumes)
        scene_file = replace(scene_file, volumes=volumes)
    if _glows(scene_file):
        scales = {key.removeprefix("medium."): value for key, value in shared.items() if "medium." in key}
        scene_file = replace(scene_file, medium=scene_file.medium.replace(**scales))
    return scene_file


def _is_bare(scene_file: SceneFile) -> bool:
    return scene_file.path.suffix.lower() != ".toml"


def _glows(scene_file: SceneFile) -> bool:
    """Tell whether a bare file's temperatures glow, by scales that were chosen for it."""
    return _is_bare(scene_file) and scene_file.medium.temperature is not None


def _scales_density(scene_file: SceneFile) -> bool:
    """Tell whether a bare file's density scale is chosen for it."""
    scales = (getattr(body, "density_scale", None) for body in scene_file.volumes)
    return _is_bare(scene_file) and any(scale == "auto" for scale in scales)


def _chosen(kind: type[Bake], given: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the options given for a kind; refuse those of others."""
    for name, of_kinds in _fields().items():
        value = given.pop(_parameter(name))
        if value is None:
            continue
        if kind.NAME not in of_kinds:
            raise click.UsageError(
                f"{_flag(name)}: is an option of --what {' and '.join(of_kinds)}; leave it out"
            )
        yield name, _read(of_kinds[kind.NAME], value)


def _check_used(kind: type[Bake], changed: list[str]) -> None:
    """Refuse what would be ignored."""
    for key in changed:
        if key.startswith(kind.NOT_USED):
            raise click.UsageError(f"{key}: makes no difference to --what {kind.NAME}; leave it out")
