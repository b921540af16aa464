"""What kernels are told: one struct for each owner.

They are declared without what fills them, so that a program depends on no scene.

The C text is put in front of every kernel; a test compares the offsets with the compiler's.
"""

import functools

from tfm_cl.constants import c_definitions
from tfm_cl.device.structs.base import Field, Struct
from tfm_cl.device.structs.declared import (
    BODY,
    GRID,
    LIGHT,
    MAP,
    MEDIUM,
    ORDERS,
    PRIMITIVE,
    SET,
    SOURCE,
    SWEEP,
    VIEW,
)

STRUCTS = (VIEW, MEDIUM, BODY, GRID, LIGHT, MAP, SOURCE, SET, PRIMITIVE, ORDERS, SWEEP)

__all__ = [
    "BODY",
    "GRID",
    "LIGHT",
    "MAP",
    "MEDIUM",
    "ORDERS",
    "PRIMITIVE",
    "SET",
    "SOURCE",
    "STRUCTS",
    "SWEEP",
    "VIEW",
    "Field",
    "Struct",
    "c_text",
]


@functools.cache
def c_text() -> str:
    """Return all structs and shared constants as OpenCL C."""
    return "\n".join([c_definitions(), *(struct.c_declaration() for struct in STRUCTS)])
