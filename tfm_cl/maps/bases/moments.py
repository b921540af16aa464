"""Power moments of the distribution of optical depth: moment-based transparency.

With v in [0, 1] along the range of a light ray and x = 2v - 1, the n = 5 or 7 coefficients are

    c_0 = ∫ σ dv = b_0,   c_j = ∫ x^j σ dv,   j = 1 … n - 1

with steps of constant density. They are sums over the steps in any order and linear in the density, so they
may be interpolated and blurred. c_j / c_0 are the moments of a distribution over x, and τ(v) / c_0 is its
cumulative distribution function. Of all distributions on the real line with these moments, the canonical one
has (n - 1)/2 nodes besides x itself: the roots z_i of K(x, z) = (1, x, x² …) H⁻¹ (1, z, z² …)ᵀ with the
Hankel matrix H_ij = c_{i+j}/c_0, each of weight 1/K(z_i, z_i). The weight of its nodes before x is a lower
bound of the cumulative distribution of all these distributions; with the weight of x itself added it is an
upper bound (Markov and Chebyshev). Therefore

    τ(v) = c_0 (Σ_{z_i < x} 1/K(z_i, z_i) + β / K(x, x))

rises with v and stays in [0, c_0] for any β in [0, 1]. Münstermann et al. use β = 0.25, for surfaces; we use
0.4. Of 0.25, 0.35, 0.4, 0.45, 0.5 and 0.6 this value has the least error of T, weighted by density and light,
or one within 5 % of the least, with 5 and 7 coefficients on three volumes. The error with 0.25 is 1.4 to 3
times as large, that with 0.5 larger by a fifth to a half. Neither T(0) = 1 nor T(1) is exact, since the
distributions extend over the whole line. The bias that keeps H regular is the published one, 5·10⁻⁷ for four
moments and 5·10⁻⁶ for six in float32, and larger for coefficients stored in fewer bits.

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
