"""Clang's declarations of OpenCL's built-in functions, read once and not for each program."""

import subprocess
from pathlib import Path


class HeaderOnce:
    """Calls with a compiler's options return the options that include the declarations.

    Parameters
    ----------
    clang
        The compiler.
    folder
        Where a precompiled header is kept for each set of options.
    """

    def __init__(self, clang: str, folder: Path):
        self._clang = clang
        self._folder = folder
        self._made: dict[tuple[str, ...], Path] = {}

    def __call__(self, *options: str) -> tuple[str, str]:
        """Make it at the first call; Clang refuses one that was made with other options."""
        if options not in self._made:
            path = self._folder / f"{len(self._made)}.pch"
            # As if to assembly: for GPUs there may be no assembler.
            command = [self._clang, *options, "-S", "-Xclang", "-emit-pch", "-o", str(path), "-"]
            text = "#include <opencl-c.h>\n"
            done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr[:4000]
            self._made[options] = path
        return "-include-pch", str(self._made[options])
