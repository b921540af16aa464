"""What a scene can be baked to for other programs; one module a kind.

To add one, write a module with a subclass of `Bake` and add it to ``KINDS``.
"""

from tfm_cl.bake.base import Bake
from tfm_cl.bake.light_grid import LightGridBake
from tfm_cl.bake.map import MapBake
from tfm_cl.bake.six_way import SixWayBake

KINDS: dict[str, type[Bake]] = {kind.NAME: kind for kind in (MapBake, LightGridBake, SixWayBake)}
"""The kinds by their names on the command line."""

__all__ = ["KINDS", "Bake"]
