"""``tfm``, and ``python -m tfm_cl``: what answers Ctrl-C until the command line is there to do so."""

import os
import signal
import sys
from typing import Any, NoReturn


def program() -> int:
    """Be the program ``tfm``: `tfm_cl.cli.program`, which takes a while to import.

    Returns
    -------
    int
        The exit code.
    """
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # nobody wants it ignored
        signal.signal(signal.SIGINT, _end)
    from tfm_cl import cli  # noqa: PLC0415 - what comes before has to be quick

    try:
        if before is signal.default_int_handler:
            signal.signal(signal.SIGINT, before)
        return cli.program()
    except KeyboardInterrupt as error:
        return cli.interrupted(error)


def _end(_number: int, _frame: Any) -> NoReturn:
    """End at once: nothing is to be cleaned up yet, and libraries that are imported may catch exceptions."""
    os.write(2, b"tfm: interrupted\n")
    os._exit(128 + signal.SIGINT)


if __name__ == "__main__":
    sys.exit(program())
