"""Trigonometric moments of the distribution of optical depth: moment-based transparency.

With v in [0, 1] along the range of a light ray and φ = πv, the n = 2M + 1 coefficients, M = 2, 3 or 4, are

    c_0 = ∫ σ dv,   c_{2m-1} + i c_{2m} = ∫ σ e^{imφ} dv,   m = 1 … M

with steps of constant density. They are sums over the steps in any order and linear in the density, so they
may be interpolated and blurred: the numbers of a Fourier opacity map, of angles that go half way round.
b_m = (c_{2m-1} + i c_{2m}) / c_0 are the moments of a distribution on the unit circle, and τ(v) / c_0 is its
cumulative distribution function. Of all distributions on the circle with these moments, the canonical one has
M nodes besides the point z = e^{iφ} itself: the roots z_j of K(z, w) = (1, z, z² …)* C⁻¹ (1, w, w² …)ᵀ, which
are all on the circle, with the Toeplitz matrix C_jk = b_{j-k} (b_{-m} is the conjugate of b_m), each of
weight 1/K(z_j, z_j). The weight of its nodes before the point, and that with the weight of the point itself
added, serve as bounds of the distribution function, as with power moments (`moments`). Therefore

    τ(v) = c_0 (Σ_j s_j / K(z_j, z_j) + β / K(z, z))

stays in [0, c_0] for any β and any shares s_j in [0, 1]: s_j is 1 for angles from 0 to φ, and 0 for those
from φ to π. The rest of the circle, the wrapping zone, holds no density, but it may hold a node, which is
neither before nor behind. Münstermann et al. leave a zone of 0.1π and let the share rise over all of it,
from 0 behind the range to 1 before it. Here the zone is half of the circle, and the share rises over the half
of the zone that is farther from the density.

For volumes a narrow zone is worse. On four of them (two sample volumes, the Disney cloud and a simulation of
smoke), the error of T, weighted by density and light, is 1.3 to 1.7 times as large with 5 coefficients and
1.7 to 2.7 times with 9, where zone and β = 0.25 are the published ones; with the best β for that zone 1.05 to
1.9 times. The true τ is then outside the bounds by up to a third of c_0, and T rises along a ray, by nearly a
half at worst. With the wide zone the true τ is within the bounds to 10⁻⁴ c_0 on these volumes; there and on
10,000 random rays τ falls by no more than 10⁻⁵ c_0 (measured in float64, not proven). A zone wider yet turns
trigonometric moments into power moments, whose matrix is worse conditioned. Neither T(0) = 1 nor T(1) is
exact.

Of 0.25, 0.3, 0.325, 0.35, 0.375, 0.4, 0.45 and 0.5 we take β = 0.375: for each volume and count its error is
at most 12 % above the least; that of 0.35 is up to 18 %, that of 0.4 up to 25 % above it.

The bias is the share of an even distribution on the circle that is mixed in, which keeps C regular. Published
are 4·10⁻⁷, 8·10⁻⁷ and 1.5·10⁻⁶ for 2, 3 and 4 moments in float32, and 4·10⁻⁴, 6.5·10⁻⁴ and 8.5·10⁻⁴ in 16
bits. On half of the circle C is worse conditioned. For 3 and 4 moments in float32 we take ten times the
published: the error on the volumes is larger by less than 2 %, and rounding does less by far to thin sheets.
Float16 rounds large numbers more coarsely than the published 16-bit integers: with their biases τ behind a
thin sheet can fall to any value, with ours it falls by 10⁻³ c_0 at most, and the error on the volumes is
larger by up to 8 %. The biases for 8 bits have about the least error on the volumes.

Sources: Münstermann, Krumpen, Klein and Peters, "Moment-Based Order-Independent Transparency", I3D 2018, and
its shaders (wrapping zone, biases); Peters, Merzbach, Hanika and Dachsbacher, "Using Moments to Represent
Bounded Signals for Spectral Rendering", SIGGRAPH 2019 (trigonometric moment problem).
"""

from __future__ import annotations

from tfm_cl.maps.bases.base import Basis, Defaults

TRIGONOMETRIC_MOMENTS = Basis(
    name="trig-moments",
    header="basis/trigonometric_moments.h",
    summary="trigonometric moments of the optical depth (moment-based transparency)",
    defaults=Defaults("extinction", "l2", "visible", "interpolate"),
    functions=None,
    targets=("extinction",),
    fits=("l2",),
    counts=(5, 7, 9),
)
