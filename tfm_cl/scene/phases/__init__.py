"""Phase functions, one module per kind.

To add one, write a module with a `Phase` subclass and its kernel header, and list the class here.
"""

from tfm_cl.scene.phases.base import PHASES, Phase, parse_phase
from tfm_cl.scene.phases.henyey_greenstein import HenyeyGreenstein
from tfm_cl.scene.phases.isotropic import Isotropic
from tfm_cl.scene.phases.kajiya_kay import KajiyaKay

PHASES.update({cls.model_fields["type"].default: cls for cls in (Isotropic, HenyeyGreenstein, KajiyaKay)})

__all__ = ["PHASES", "HenyeyGreenstein", "Isotropic", "KajiyaKay", "Phase", "parse_phase"]
