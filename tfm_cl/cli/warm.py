"""``tfm warm``: compiles kernels before they are needed."""

import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import numpy as np

from tfm_cl.cli.frames import checked, frame_option
from tfm_cl.cli.options import (
    GroupedCommand,
    GroupedOption,
    device_option,
    look_option,
    overrides,
    scene_options,
)
from tfm_cl.cli.paths import SOURCE
from tfm_cl.cli.progress import progress_bar
from tfm_cl.interrupts import interrupts_held
from tfm_cl.scene import looks
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import SceneFile

SAMPLE_SIZE = 24
"""Voxels along a side of the volume that stands for any."""


@click.command("warm", cls=GroupedCommand)
@click.argument("sources", metavar="[INPUT]...", nargs=-1, type=SOURCE)
@scene_options()
@look_option
@frame_option
@device_option
@click.option("-q", "quiet", is_flag=True, cls=GroupedOption, help="print errors only")
def command(
    sources: tuple[Path, ...],
    settings: tuple[str, ...],
    look: str,
    frame: float | None,
    device: str | None,
    *,
    quiet: bool,
    **given: Any,
) -> None:
    """Compile what `tfm render` of each INPUT with the same options needs, and keep it for later runs.

    Without INPUT it is what a bare volume needs, with its look and with `--look plain`. Kernels are kept on
    this machine for its device; another version of tfm_cl compiles its own.

    \b
    tfm warm
    tfm warm scene.toml --aov depth
    """  # noqa: D301 - click wants the character \b, not its escape
    changes = overrides(given, settings)
    with tempfile.TemporaryDirectory(prefix="tfm-warm-") as folder:
        if sources:
            wanted = [(source, look) for source in sources]
        else:
            sample = _sample(Path(folder))
            wanted = [(sample, name) for name in dict.fromkeys((look, looks.PLAIN))]
        scenes = [SceneFile.read(source, changes, name, checked(frame)) for source, name in wanted]
        _compile(scenes, device, quiet=quiet)


def _compile(files: list[SceneFile], device: str | None, *, quiet: bool) -> None:
    made = [(file, file.make(Scene)) for file in files]
    for file, scene in made:
        file.check_files()
        scene.read_files()  # before the device is looked for

    # Imported here: what is refused needs no OpenCL.
    with interrupts_held():  # modules in C fail where Ctrl-C meets them while they are imported
        from tfm_cl.render.renderer import Renderer  # noqa: PLC0415

    with progress_bar(quiet=quiet) as progress, Renderer(device) as renderer:
        seconds = sum(
            renderer.render(scene, progress=progress, **file.image.frame).stats.seconds["compile"]
            for file, scene in made
        )
    if not quiet:
        print(f"tfm: {renderer.device_name}: compiled in {seconds:.1f} s", file=sys.stderr)


def _sample(folder: Path) -> Path:
    """Write a small ball of density."""
    axis = np.linspace(-1, 1, SAMPLE_SIZE)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    path = folder / "cloud.npy"
    np.save(path, np.clip(1 - np.sqrt(x**2 + y**2 + z**2), 0, None).astype(np.float32))
    return path
