"""``tfm view``: a scene in the browser, which is rendered as it is changed."""

import atexit
import logging
import os
import sys
import threading
import webbrowser
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tfm_cl.cli import interrupted
from tfm_cl.cli.frames import checked, frame_option
from tfm_cl.cli.options import (
    GroupedCommand,
    GroupedOption,
    device_option,
    look_option,
    overrides,
    scene_options,
)
from tfm_cl.cli.paths import SOURCE, TARGET
from tfm_cl.cli.progress import log_shown
from tfm_cl.interrupts import interrupts_held, interrupts_to
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.sequence.frame import ReadFrame, read
from tfm_cl.sequence.shot import Shot
from tfm_cl.viewer.files import Files
from tfm_cl.viewer.renderer import LAUNCH_SECONDS

if TYPE_CHECKING:
    from tfm_cl.render.renderer import Renderer

MOST_PORT = 65535
BROWSER = "tfm view: browser"
"""Name of the thread that opens the page."""


@click.command("view", cls=GroupedCommand)
@click.argument("source", metavar="INPUT", type=SOURCE)
@click.option(
    "--port",
    metavar="N",
    type=click.IntRange(0, MOST_PORT),
    cls=GroupedOption,
    group="Server",
    help="port to listen at; 0: any  [the first that is free from 8090 on]",
)
@click.option(
    "--host",
    metavar="ADDRESS",
    cls=GroupedOption,
    group="Server",
    help="address or name to listen at, as 0.0.0.0 for all; whoever opens the page needs the token of the "
    "address that is printed  [this machine only, without a token]",
)
@click.option("--no-browser", is_flag=True, cls=GroupedOption, group="Server", help="print the address only")
@click.option(
    "--shared",
    is_flag=True,
    cls=GroupedOption,
    group="Server",
    help="all who open the page see and change the same scene, not one each",
)
@click.option(
    "--folder",
    metavar="DIR",
    type=TARGET,
    cls=GroupedOption,
    group="Server",
    help="folder that the page opens and saves files in, and no other  [that of INPUT]",
)
@scene_options()
@look_option
@frame_option
@device_option
def command(
    source: Path,
    port: int | None,
    host: str | None,
    folder: Path | None,
    settings: tuple[str, ...],
    look: str,
    frame: float | None,
    device: str | None,
    *,
    no_browser: bool,
    shared: bool,
    **given: Any,
) -> None:
    """Show INPUT, a volume or a scene (.toml), in the browser, and render it as it is changed there.

    The address is printed first; Ctrl-C ends it.

    \b
    tfm view cloud.vdb
    tfm view scene.toml --no-browser --port 8090
    """  # noqa: D301 - click wants the character \b, not its escape
    if host is not None and not host.strip():
        raise click.UsageError("--host: should be an address or a name of this machine, as 0.0.0.0")
    shot, number = Shot(source, overrides(given, settings), look), checked(frame)
    if number is None and (frames := shot.frames()) is not None:
        number = frames[0]
    files = Files(source.parent if folder is None else folder)
    first = _First(shot.scene_file(number), number)
    files.trust(first.file.files(), first.file.is_file_of_a_frame)
    with interrupts_held():  # modules in C, which fail or forget Ctrl-C while they are imported
        from tfm_cl.viewer.curve import curve_at  # noqa: PLC0415 - what is refused needs none of it
        from tfm_cl.viewer.loop import RenderLoop  # noqa: PLC0415
        from tfm_cl.viewer.server import Server  # noqa: PLC0415

        if device is not None:
            from tfm_cl.device.device import choose_device  # noqa: PLC0415

            choose_device(device)  # one that is not there is told at once

    loop = RenderLoop(partial(_renderer, device), first.read, curve_at)
    session = partial(loop.session, shot, files, number, shared=shared)
    server = Server(session, files, host=host, port=port, shared=shared)
    try:
        with closing(loop), closing(server), log_shown("tfm: %(message)s", logging.INFO):
            print(server.address, flush=True)
            if not no_browser:
                threading.Thread(target=_open, args=(server.address,), name=BROWSER, daemon=True).start()
            with interrupts_to(server.stop):
                loop.start(first.made)
                server.run()
    except KeyboardInterrupt as error:
        if loop.is_at_work:
            _end_at_once(error)
        raise


class _First:
    """Reads frames; the first before anybody looks, so that what is wrong with it is told at once."""

    def __init__(self, file: SceneFile, number: float | None) -> None:
        self.file = file
        self.made: ReadFrame | None = read(file, number)
        """Until it is asked for."""
        self.made.read_files()

    def read(self, file: SceneFile, number: float | None, like: ReadFrame | None = None, /) -> ReadFrame:
        """Read a frame, but the first, which is there already."""
        made, self.made = self.made, None
        return made if made is not None and file.asked == made.file.asked else read(file, number, like)


def _end_at_once(error: KeyboardInterrupt) -> None:
    """End this process while a compiler works: it cannot be stopped, and C++ would end badly around it."""
    code = interrupted(error)
    sys.stdout.flush()
    sys.stderr.flush()
    atexit._run_exitfuncs()  # removes temporary folders  # noqa: SLF001
    os._exit(code)


def _renderer(device: str | None) -> "Renderer":
    with interrupts_held():  # likewise
        from tfm_cl.render.renderer import Renderer  # noqa: PLC0415
    return Renderer(device, launch_seconds=LAUNCH_SECONDS)


def _open(address: str) -> None:
    """Open the page, unless the only browser is one that would take the terminal."""
    with suppress(webbrowser.Error, OSError):
        browser = webbrowser.get()
        if type(browser) is not webbrowser.GenericBrowser and browser.open(address):
            return
    print("tfm: note: no browser was found: open the address in one", file=sys.stderr)
