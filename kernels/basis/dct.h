/* DCT of the density-weighted transmittance f = e^(-tau / alpha) (TFM eq. 8-10, 13, 19), normalised:
     c_0 = int f du,  c_j = 2 int f cos(j pi u) du,  f(u) = sum_j c_j cos(j pi u).
   f changes only where there is density. Summed by parts over the M steps, with F_n the value in step n,
     (1/M) sum_n F_n cos(j pi u_n) = sum_n (F_n - F_(n-1)) S_j(n),  S_j(n) = (1/M) sum_(k >= n) cos(j pi u_k),
   so that empty steps cost nothing; S comes from the host as table[n][j].
   Requires: TFM_N_COEFF. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#include "../volume.h"

/* Sums of 1 - f: in thin media f is near 1, and float32 sums of f would lose what matters. */
typedef struct {
  Floats sum[TFM_N_COEFF];
  Floats opacity; /* 1 - f of the step before */
} BasisState;

TFM_INLINE void basis_begin(BasisState *state)
{
#pragma unroll
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->sum[j] = floats(0.0f);
  state->opacity = floats(0.0f);
}

TFM_INLINE void basis_change(__constant const Params *params, __global const float *table, BasisState *state, int n,
                             Floats optical_depth)
{
  const Floats opacity = opacity_of(optical_depth * params->inverse_weighting);
  const Floats change = opacity - state->opacity;
  state->opacity = opacity;
  table += (size_t)n * TFM_N_COEFF;
#pragma unroll
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->sum[j] += change * table[j];
}

TFM_INLINE void basis_finish(__constant const Params *params, Ints active, const BasisState *state, Floats *coefficients)
{
  (void)params;
  coefficients[0] = active ? 1.0f - state->sum[0] : floats(1.0f);
#pragma unroll
  for (int j = 1; j < TFM_N_COEFF; ++j)
    coefficients[j] = active ? -2.0f * state->sum[j] : floats(0.0f);
}

TFM_INLINE Floats basis_optical_depth(__constant const Params *params, const Floats *coefficients, Floats u)
{
  /* cos(j pi u) by the Chebyshev recurrence. */
  const Floats cosine = cos_pi(u);
  const Floats twice = 2.0f * cosine;
  Floats previous = floats(1.0f), current = cosine, f = coefficients[0];
#pragma unroll
  for (int j = 1; j < TFM_N_COEFF; ++j) {
    f += coefficients[j] * current;
    const Floats next = twice * current - previous;
    previous = current;
    current = next;
  }
  /* The truncated series leaves [0, 1]: clamp before the power (eq. 20), where a negative value would come
     back as a bright ghost. */
  return -params->density_weighting * log_of(least(greatest(f, floats(FLT_MIN)), floats(1.0f)));
}

#endif
