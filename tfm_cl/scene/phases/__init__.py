"""Phase functions, one module per kind.

To add one, write a module with a `Phase` subclass and its kernel header, and add the class to
``PHASES``.
"""

from typing import Any

from tfm_cl.model import unknown_key
from tfm_cl.scene.phases.base import Phase
from tfm_cl.scene.phases.henyey_greenstein import HenyeyGreenstein
from tfm_cl.scene.phases.isotropic import Isotropic

PHASES: dict[str, type[Phase]] = {
    cls.model_fields["type"].default: cls for cls in (Isotropic, HenyeyGreenstein)
}
"""The phase function classes by their names in scene files."""

__all__ = ["PHASES", "HenyeyGreenstein", "Isotropic", "Phase", "parse_phase"]


def parse_phase(value: Any) -> Phase:
    """Make a phase function from a `Phase`, ``"name"``, ``"name:numbers"`` or a table with ``type``.

    Raises
    ------
    ValueError
        Unknown name or wrong form.
    """
    if isinstance(value, Phase):
        return value
    if isinstance(value, str):
        name, _, text = value.partition(":")
        return _phase_class(name).from_text(text)
    if isinstance(value, dict) and isinstance(value.get("type"), str):
        return _phase_class(value["type"])(**value)
    raise ValueError('should be a name, as "isotropic" or "hg:0.3", or a table { type = "hg", g = 0.3 }')


def _phase_class(name: str) -> type[Phase]:
    if name not in PHASES:
        raise ValueError(unknown_key(name, list(PHASES)).replace("key", "phase function"))
    return PHASES[name]
