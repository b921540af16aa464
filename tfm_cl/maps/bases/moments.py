"""Power moments of where the optical depth lies: moment-based transparency.

With v in [0, 1] along the range of a light ray and x = 2v - 1, the n = 5 or 7 numbers are

    c_0 = ∫ σ dv = b_0,   c_j = ∫ x^j σ dv,   j = 1 … n - 1

with steps of constant density: sums over the steps in any order, and linear in the density, so that they may
be interpolated and blurred. c_j / c_0 are the moments of a distribution over x, and τ(v) / c_0 is how much
of it lies before x. Of all distributions on the line with these moments the canonical one has (n - 1)/2
nodes besides x itself, the roots z_i of K(x, z) = (1, x, x² …) H⁻¹ (1, z, z² …)ᵀ with Hankel's matrix H_ij =
c_{i+j}/c_0, each of weight 1/K(z_i, z_i). Its nodes before x bound what lies there from below for every one
of them, and with the point's own weight from above (Markov and Chebyshev), so that

    τ(v) = c_0 (Σ_{z_i < x} 1/K(z_i, z_i) + β / K(x, x))

rises with v and stays in [0, c_0] for any β in [0, 1]. Münstermann et al. take β = 0.25, for surfaces; here
it is 0.4. Of 0.25, 0.35, 0.4, 0.45, 0.5 and 0.6 that has the least error of T, weighted by density and
light, of 5 and 7 numbers on three volumes, or one within 5 % of it; 0.25 has 1.4 to 3 times as much, 0.5 a
fifth to a half more. Neither T(0) = 1 nor T(1) is exact: the distributions are those of the whole line. The
bias that keeps H regular is the published one, 5·10⁻⁷ for four moments and 5·10⁻⁶ for six in float32, and
more for numbers in fewer bits.

Sources: Münstermann, Krumpen, Klein and Peters, "Moment-Based Order-Independent Transparency", I3D 2018, and
its supplement (bias); Sharpe, "Moment Transparency", HPG 2018; Peters and Klein, "Moment Shadow Mapping",
I3D 2015 (Hamburger's problem).
"""

from __future__ import annotations

from tfm_cl.maps.bases.base import Basis, Defaults

MOMENTS = Basis(
    name="moments",
    header="basis/moments.h",
    summary="power moments of the optical depth (moment-based transparency)",
    defaults=Defaults("extinction", "l2", "visible", "interpolate"),
    functions=None,
    targets=("extinction",),
    fits=("l2",),
    counts=(5, 7),
)
