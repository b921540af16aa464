"""Structs that host and kernels share, each declared once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np


@dataclass(frozen=True)
class Field:
    """One member of a struct. All are 4 bytes wide, so that there is no padding on any device."""

    kind: Literal["float", "int"]
    name: str
    count: int
    meaning: str


@dataclass(frozen=True)
class Struct:
    """A struct of the kernels.

    Attributes
    ----------
    name
        In OpenCL C; in capitals it is how kernels take one or an array of them, a pointer.
    meaning
        What it tells of.
    fields
        Its members, in order.
    """

    name: str
    meaning: str
    fields: tuple[Field, ...]

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """The same for NumPy."""
        return np.dtype(
            [
                (
                    field.name,
                    np.float32 if field.kind == "float" else np.int32,
                    (field.count,) if field.count > 1 else (),
                )
                for field in self.fields
            ]
        )

    def c_declaration(self) -> str:
        """Return the struct as OpenCL C, one commented member per line, and how kernels take it."""
        members = (
            f"  {f.kind} {f.name}{f'[{f.count}]' if f.count > 1 else ''};  /* {f.meaning} */"
            for f in self.fields
        )
        head, pointer = f"/* {self.meaning} */", f"#define {self.name.upper()} __global const {self.name} *"
        return "\n".join([head, "typedef struct {", *members, f"}} {self.name};", pointer])
