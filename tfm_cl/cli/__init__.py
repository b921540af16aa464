"""The command line ``tfm``: parse, call the library, print. One module a command."""

import atexit
import gc
import importlib
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from tfm_cl.cli.streams import guarded_streams, one_line
from tfm_cl.errors import OUT_OF_MEMORY, TfmError, TfmWarning
from tfm_cl.interrupts import TerminatedError, end_on_sigterm, interrupts_held

COMMANDS = ("render", "view", "info", "compare", "sweep", "bake", "movie", "schema", "devices", "warm")
"""Modules of this package, each with a click command called ``command``; imported when used."""

COLLECTED_AFTER = 50_000, 10, 10
"""`gc.set_threshold`: objects made before the youngest are looked at, and how often the older ones are."""

PLUGIN_FLAG = "--plugin"

EXIT_WRONG_USE = 2
EXIT_RESOURCE = 3
EXIT_INTERRUPTED = 130
EXIT_TERMINATED = 143
"""128 and the number of the signal, as shells have it."""


class LazyGroup(click.Group):
    """Commands from `COMMANDS`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the help."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        with interrupts_held():  # threads of libraries, which begin here, need not hear of them
            command: click.Command = importlib.import_module(f"tfm_cl.cli.{cmd_name}").command
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Turn Ctrl-C into click's own exception, which it passes on without printing an empty line."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise click.Abort from interrupt


def _print_version(ctx: click.Context, _parameter: click.Parameter, wanted: Any) -> None:
    if wanted and not ctx.resilient_parsing:
        from tfm_cl._version import __version__  # noqa: PLC0415 - reading package metadata takes time

        print(f"tfm {__version__}")
        ctx.exit()


@click.group(
    cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_print_version,
    help="Print the version.",
)
def tfm() -> None:
    """Render voxel volumes through transmittance function maps, on OpenCL.

    Exit codes: 0 good, 1 `compare --fail-under` missed, 2 wrong use or bad input, 3 device or resource
    failure, of several frames 4 out of memory and 5 some failed, 130 interrupted, 143 terminated.
    """


def program() -> int:
    """Be the program ``tfm``: `main`, in a process that is its own and may be set up for it.

    Returns
    -------
    int
        The exit code.
    """
    # Our matrices are small, and OpenBLAS's other threads wait for them on the cores that the device uses.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What libraries make while they are imported stays to the end: looking for garbage in it takes time.
    gc.set_threshold(*COLLECTED_AFTER)
    atexit.register(gc.freeze)
    end_on_sigterm()
    return main()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; every failure is one line on stderr.

    Returns
    -------
    int
        The exit code.
    """
    with guarded_streams() as output, warnings.catch_warnings():
        warnings.simplefilter("ignore", TfmWarning)  # commands print what there is to know
        code = _run(arguments)
        output.flush()
        if output.failure is not None:
            reason = output.failure.strerror or output.failure
            code = _fail(f"standard output: cannot be written ({reason})", code or EXIT_RESOURCE)
    return code


def _load_plugins(arguments: Sequence[str]) -> None:
    """Run the files of ``--plugin FILE``, before what they bring is listed by a command's options."""
    following = [*arguments[1:], ""]
    for argument, after in zip(arguments, following, strict=False):
        flag, equals, value = argument.partition("=")
        if flag != PLUGIN_FLAG or not (value if equals else after):
            continue
        from tfm_cl import plugins  # noqa: PLC0415 - few ask

        path = str(Path(value if equals else after).absolute())
        # Processes that this one starts need it too.
        others = [name for name in os.environ.get(plugins.VARIABLE, "").split(os.pathsep) if name]
        os.environ[plugins.VARIABLE] = os.pathsep.join(dict.fromkeys([*others, path]))
        plugins.load_plugin(path)


def _run(arguments: Sequence[str] | None) -> int:
    try:
        _load_plugins(sys.argv[1:] if arguments is None else list(arguments))
        code = tfm(
            args=None if arguments is None else list(arguments), prog_name="tfm", standalone_mode=False
        )
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message(), file=sys.stderr)
        code = EXIT_WRONG_USE
    except click.ClickException as error:
        code = _fail(_said(error), EXIT_WRONG_USE)
    except TfmError as error:
        for line in error.lines:
            _fail(line, error.exit_code)
        code = error.exit_code
    except MemoryError:
        code = _fail(OUT_OF_MEMORY, EXIT_RESOURCE)
    except (click.Abort, KeyboardInterrupt) as error:
        # Python ends by the signal, whatever we return, if Ctrl-C came where text was executed, as libraries
        # do while they are imported; executing text again makes it forget that.
        exec("")  # noqa: S102
        code = interrupted(error.__cause__ or error)
    return code if isinstance(code, int) else 0


def interrupted(error: BaseException) -> int:
    """Say what ended a command, Ctrl-C or SIGTERM, and return the exit code."""
    if isinstance(error, TerminatedError):
        return _fail("terminated", EXIT_TERMINATED)
    return _fail("interrupted", EXIT_INTERRUPTED)


def _said(error: click.ClickException) -> str:
    message = " ".join(error.format_message().split())
    context = getattr(error, "ctx", None)
    path = f"; see {context.command_path} --help" if context is not None else ""
    return message.rstrip(".") + path


def _fail(message: str, code: int) -> int:
    print(f"tfm: {one_line(message)}", file=sys.stderr)
    return code
