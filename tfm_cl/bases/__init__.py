"""Bases of the transmittance function: one module and one kernel header each.

To add one, write both and list it in ``BASES``.
"""

from tfm_cl.bases.base import Basis
from tfm_cl.bases.cosine import DCT, HCOS
from tfm_cl.bases.fourier import FOURIER
from tfm_cl.bases.klt import KLT
from tfm_cl.bases.legendre import LEGENDRE
from tfm_cl.bases.moments import MOMENTS
from tfm_cl.bases.nodes import NODES, NODES_T
from tfm_cl.bases.piecewise import PIECEWISE
from tfm_cl.bases.slices import SLICES, SLICES_CUBIC

BASES: dict[str, Basis] = {
    basis.name: basis
    for basis in (
        DCT,
        HCOS,
        KLT,
        FOURIER,
        LEGENDRE,
        SLICES,
        SLICES_CUBIC,
        PIECEWISE,
        MOMENTS,
        NODES,
        NODES_T,
    )
}
"""Name in scene files -> basis."""

BEST = "klt"
"""What ``basis = "auto"`` means."""

__all__ = ["BASES", "BEST", "Basis"]
