"""A line through a few nodes that each light ray chooses: adaptive volumetric shadow maps.

With v in [0, 1] along the range of a light ray, the n = 2k numbers are k nodes (v_i, τ_i) in order. τ is
linear between them, from (0, 0) on, and constant after the last, which is where density ends. The march
gives the exact line: a node where density begins and one for each step with density. As soon as there are
more than k, the one goes whose removal costs least. Between its neighbours it leaves a triangle of area

    A = |(τ_i - τ_{i-1})(v_{i+1} - v_{i-1}) - (τ_{i+1} - τ_{i-1})(v_i - v_{i-1})| / 2

and e^{-τ_i} A is to first order the integral of the error of T, for the least extinction of the medium's
colours. ``nodes-t`` draws the lines in T rather than τ, as the sources do; its triangles are those of T
itself. Hard edges stay sharp, as nodes settle on them; a smooth medium needs more numbers than with
functions. T(0) = 1 and the depth after the last node are exact, and so are k straight pieces: a homogeneous
medium needs one node.

Numbers of neighbouring texels speak of other places, so that they cannot be interpolated: what they give
can.

Sources: Salvi, Vidimče, Lauritzen and Lefohn, "Adaptive Volumetric Shadow Maps", EGSR 2010; Lokovic and
Veach, "Deep Shadow Maps", SIGGRAPH 2000.
"""

from __future__ import annotations

from tfm_cl.maps.bases.base import Basis, Defaults

COUNTS = tuple(range(4, 33, 2))

NODES = Basis(
    name="nodes",
    header="basis/nodes.h",
    summary="optical depth at places of each ray's own, linear in between (adaptive volumetric shadow maps)",
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
    summary="as nodes, with the transmittance linear in between",
    defaults=Defaults("optical-depth", "l2", "visible", "reconstruct"),
    functions=None,
    targets=("optical-depth",),
    fits=("l2",),
    lerps=False,
    counts=COUNTS,
)
