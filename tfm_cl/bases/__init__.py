"""Bases of the transmittance function: one module and one kernel header each.

To add one, write both and list it in ``BASES``.
"""

from tfm_cl.bases.base import Basis
from tfm_cl.bases.dct import DCT

BASES: dict[str, Basis] = {basis.name: basis for basis in (DCT,)}
"""Name in scene files -> basis."""

__all__ = ["BASES", "Basis"]
