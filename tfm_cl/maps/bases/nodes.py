"""A polyline through a few nodes, chosen for each light ray: adaptive volumetric shadow maps.

With v in [0, 1] along the range of a light ray, the n = 2k coefficients are k nodes (v_i, τ_i) in order. τ is
linear between them, starting from (0, 0), and constant after the last node, where the density ends. The march
gives the exact polyline: a node where density begins and one for each step with density. As soon as there are
more than k nodes, the one whose removal costs least is dropped. It cuts off a triangle of area

    A = |(τ_i - τ_{i-1})(v_{i+1} - v_{i-1}) - (τ_{i+1} - τ_{i-1})(v_i - v_{i-1})| / 2

and e^{-τ_i} A is, to first order, the integral of the error of T, for the smallest extinction among the
medium's colours. ``nodes-t`` interpolates T instead of τ, as the sources do; its triangles are those of T
itself. Hard edges stay sharp, since nodes settle on them; a smooth medium needs more coefficients than with a
series of functions. T(0) = 1 and the optical depth after the last node are exact, and so is any curve of k
straight pieces: a homogeneous medium needs one node.

The nodes of neighbouring texels lie at different depths, so the coefficients cannot be interpolated; the
optical depths that they give can.

Sources: Salvi, Vidimče, Lauritzen and Lefohn, "Adaptive Volumetric Shadow Maps", EGSR 2010; Lokovic and
Veach, "Deep Shadow Maps", SIGGRAPH 2000.
"""

from __future__ import annotations

from tfm_cl.maps.bases.base import Basis, Defaults

COUNTS = tuple(range(4, 33, 2))

NODES = Basis(
    name="nodes",
    header="basis/nodes.h",
    summary="optical depth at nodes chosen for each ray, linear in between (adaptive volumetric shadow maps)",
    defaults=Defaults("optical-depth", "l2", "visible", "reconstruct"),
    functions=None,
    targets=("optical-depth",),
    fits=("l2",),
    lerps=False,
    counts=COUNTS,
)
NODES_T = Basis(
    name="nodes-t",
    header="basis/nodes_t.h",
    summary="like nodes, with the transmittance linear in between",
    defaults=Defaults("optical-depth", "l2", "visible", "reconstruct"),
    functions=None,
    targets=("optical-depth",),
    fits=("l2",),
    lerps=False,
    counts=COUNTS,
)
