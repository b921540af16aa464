"""Bases of the transmittance function, each with one module and one kernel header.

To add one, write both and add the basis to ``BASES``.
"""

from tfm_cl.maps.bases.base import Basis
from tfm_cl.maps.bases.cosine import DCT, HCOS
from tfm_cl.maps.bases.fourier import FOURIER
from tfm_cl.maps.bases.klt import KLT
from tfm_cl.maps.bases.legendre import LEGENDRE
from tfm_cl.maps.bases.moments import MOMENTS
from tfm_cl.maps.bases.nodes import NODES, NODES_T
from tfm_cl.maps.bases.piecewise import PIECEWISE
from tfm_cl.maps.bases.slices import SLICES, SLICES_CUBIC
from tfm_cl.maps.bases.trigonometric_moments import TRIGONOMETRIC_MOMENTS
from tfm_cl.maps.bases.wavelets import WAVELETS

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
        WAVELETS,
        MOMENTS,
        TRIGONOMETRIC_MOMENTS,
        NODES,
        NODES_T,
    )
}
"""The bases by their names in scene files."""

BEST = "klt"
"""The basis that ``basis = "auto"`` selects."""

__all__ = ["BASES", "BEST", "Basis"]
