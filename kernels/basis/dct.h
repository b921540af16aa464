/* DCT of the density-weighted transmittance f = e^(-tau / alpha) (TFM eq. 8-10, 13, 19), normalised:
     c_0 = int f du,  c_j = 2 int f cos(j pi u) du,  f(u) = sum_j c_j cos(j pi u).
   Requires: TFM_N_COEFF. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#include "volume.h"

/* Sums of 1 - f: in thin media f is near 1, and float32 sums of f would lose what matters. */
typedef struct {
  float sum[TFM_N_COEFF];
  float optical_depth;  /* of the last step, and its 1 - f: most steps are empty and change neither */
  float opacity;
} BasisState;

inline void basis_begin(BasisState *state)
{
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->sum[j] = 0.0f;
  state->optical_depth = 0.0f;
  state->opacity = 0.0f;
}

inline void basis_add(__constant const Params *params, BasisState *state, float u, float du,
                      float optical_depth)
{
  if (optical_depth != state->optical_depth) {
    state->optical_depth = optical_depth;
    state->opacity = opacity_of(optical_depth / params->density_weighting);
  }
  if (state->opacity == 0.0f)
    return;
  const float weighted = du * state->opacity;
  /* cos(j pi u) by the Chebyshev recurrence. */
  const float twice = 2.0f * cospi(u);
  float previous = 0.5f * twice, current = 1.0f;
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    state->sum[j] += weighted * current;
    const float next = twice * current - previous;
    previous = current;
    current = next;
  }
}

inline void basis_finish(__constant const Params *params, const BasisState *state, float *coefficients)
{
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    const float c = j == 0 ? 1.0f - state->sum[j] : -2.0f * state->sum[j];
    /* M midpoints determine M cosines; higher ones would only alias. */
    coefficients[j] = j < params->light_steps ? c : 0.0f;
  }
}

inline void basis_clear(float *coefficients)
{
  for (int j = 0; j < TFM_N_COEFF; ++j)
    coefficients[j] = j == 0 ? 1.0f : 0.0f;
}

inline float basis_optical_depth(__constant const Params *params, const float *coefficients, float u)
{
  const float twice = 2.0f * cospi(u);
  float previous = 0.5f * twice, current = 1.0f, f = 0.0f;
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    f += coefficients[j] * current;
    const float next = twice * current - previous;
    previous = current;
    current = next;
  }
  /* The truncated series leaves [0, 1]: clamp before the power (eq. 20), where a negative value would come
     back as a bright ghost. */
  return -params->density_weighting * log(clamp(f, FLT_MIN, 1.0f));
}

#endif
