"""Phase functions, one module per kind.

To add one, write a module with a `Phase` subclass and its kernel header, and list the class here.
"""

from tfm_cl.plugins import register_class, register_installed
from tfm_cl.scene.phases.base import PHASES, Phase, parse_phase
from tfm_cl.scene.phases.double_henyey_greenstein import DoubleHenyeyGreenstein
from tfm_cl.scene.phases.draine import Draine
from tfm_cl.scene.phases.fournier_forand import FournierForand
from tfm_cl.scene.phases.henyey_greenstein import HenyeyGreenstein
from tfm_cl.scene.phases.isotropic import Isotropic
from tfm_cl.scene.phases.kajiya_kay import KajiyaKay
from tfm_cl.scene.phases.mie import Mie
from tfm_cl.scene.phases.mixture import PhaseMixture
from tfm_cl.scene.phases.rayleigh import Rayleigh
from tfm_cl.scene.phases.tabulated import TabulatedPhase

PHASES.update(
    {
        cls.model_fields["type"].default: cls
        for cls in (
            Isotropic,
            HenyeyGreenstein,
            DoubleHenyeyGreenstein,
            Rayleigh,
            Draine,
            Mie,
            FournierForand,
            TabulatedPhase,
            PhaseMixture,
            KajiyaKay,
        )
    }
)

__all__ = [
    "PHASES",
    "DoubleHenyeyGreenstein",
    "Draine",
    "FournierForand",
    "HenyeyGreenstein",
    "Isotropic",
    "KajiyaKay",
    "Mie",
    "Phase",
    "PhaseMixture",
    "Rayleigh",
    "TabulatedPhase",
    "parse_phase",
    "register_phase",
]


def register_phase(cls: type[Phase]) -> None:
    """Add a kind of phase function, which scene files then take by its ``type``.

    Parameters
    ----------
    cls
        A class of `Phase` whose ``type`` has its name as default, and whose ``HEADER`` is the whole path of a
        file.

    Raises
    ------
    InputError
        It is no such class, its name is taken, or its header is not there.
    """
    register_class("phase function", cls, Phase, "type", PHASES)


register_installed("phases", lambda _name, cls: register_phase(cls))
