"""Bases of the transmittance function, each with one module and one kernel header.

To add one, write both and add the basis to ``BASES``.
"""

from tfm_cl.errors import InputError
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
from tfm_cl.plugins import check_header, claim, register_installed

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

MOST_COEFFS = max(max(basis.counts) for basis in BASES.values())
"""Of any basis."""

__all__ = ["BASES", "BEST", "MOST_COEFFS", "Basis", "register_basis"]


def register_basis(basis: Basis) -> None:
    """Add a basis, which ``map.basis`` then takes by its name.

    Parameters
    ----------
    basis
        Its ``header`` is the whole path of a file, ``str(Path(__file__).with_name("mine.h"))``, or that of a
        basis that is there: ``"basis/tabulated.h"`` looks its functions up in the table ``modes``.

    Raises
    ------
    InputError
        It is no `Basis`, its name is taken, its header is not there, or it has no number of coefficients from
        1 to `MOST_COEFFS`.
    """
    found: object = basis
    if not isinstance(found, Basis):
        raise InputError(f"a basis should be a tfm_cl.Basis; got {found!r:.80}")
    claim("basis", basis.name, BASES)
    if basis.header not in {known.header for known in BASES.values()}:
        check_header(basis.header)
    if not basis.counts or not 1 <= min(basis.counts) <= max(basis.counts) <= MOST_COEFFS:
        raise InputError(f"basis '{basis.name}': counts should be numbers from 1 to {MOST_COEFFS}")
    BASES[basis.name] = basis


register_installed("bases", lambda _name, basis: register_basis(basis))
