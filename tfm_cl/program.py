"""Building kernels: one small stub a program, that names the headers and the entry file."""

import time
import warnings
from pathlib import Path

import pyopencl as cl

from tfm_cl.errors import KernelBuildError
from tfm_cl.params import c_declaration


def kernels_dir() -> Path:
    """Return the folder of the OpenCL sources: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent
    for folder in (package / "kernels", package.parent / "kernels"):
        if (folder / "light_pass.cl").is_file():
            return folder
    raise KernelBuildError(f"the OpenCL sources are missing from {package}; reinstall tfm_cl")


def source(entry: str, headers: tuple[str, ...], defines: dict[str, int]) -> str:
    """Return the text handed to the compiler.

    The sources are included, not pasted, so that the compiler's messages name file and line.
    """
    lines = [f"#define {name} {value}" for name, value in sorted(defines.items())]
    return "\n".join([*lines, c_declaration(), *(f'#include "{name}"' for name in (*headers, entry)), ""])


class KernelLibrary:
    """Compiled programs of one context; each variant is built once and its kernels are kept.

    Parameters
    ----------
    context
        With one device.
    options
        Further compiler options; ``-Werror`` makes warnings errors.
    """

    def __init__(self, context: cl.Context, options: tuple[str, ...] = ()) -> None:
        self._context = context
        self._options = ("-cl-std=CL1.2", *options)
        self._kernels: dict[tuple[str, str], cl.Kernel] = {}
        self.seconds = 0.0
        """Time spent compiling so far."""

    def kernel(
        self, name: str, entry: str, headers: tuple[str, ...] = (), defines: dict[str, int] | None = None
    ) -> cl.Kernel:
        """Return kernel ``name`` of the file ``entry``.

        Parameters
        ----------
        entry
            Name below ``kernels/``.
        headers
            Included before it: the basis, light and phase function chosen.
        defines
            Macros that the entry file lists as required.

        Raises
        ------
        KernelBuildError
            With the compiler's log.
        """
        text = source(entry, headers, defines or {})
        if (text, name) not in self._kernels:
            started = time.perf_counter()
            for kernel in self._build(text, entry).all_kernels():
                self._kernels[text, kernel.function_name] = kernel
            self.seconds += time.perf_counter() - started
        return self._kernels[text, name]

    def _build(self, text: str, entry: str) -> cl.Program:
        try:
            with warnings.catch_warnings():
                # pyopencl warns of any compiler output, even empty remarks; errors raise all the same.
                warnings.simplefilter("ignore", cl.CompilerWarning)
                program: cl.Program = cl.Program(self._context, text).build(
                    [*self._options, "-I", str(kernels_dir())]
                )
        except cl.Error as error:
            raise KernelBuildError(f"{entry} does not compile on this device: {error}") from error
        return program
