/* Cosines cos(j pi v): the normalised discrete cosine transform of TFM eq. 8-10. If the target is the extinction,
   their integrals v and sin(j pi v) / (j pi).
   Requires: the same as projection.h. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_HAS_ONE
#include "../map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  /* Chebyshev recurrence. */
  const Floats cosine = cos_pi(v);
  const Floats twice = 2.0f * cosine;
#if TFM_TARGET == TARGET_EXTINCTION
  Floats previous = floats(0.0f), current = sin_pi(v), sum = c[0] * v;
  const float scale = 0.318309886f; /* 1 / pi */
#pragma unroll
  for (int j = 1; j < TFM_N_COEFF; ++j) {
    sum += scale / (float)j * c[j] * current;
#else
  Floats previous = floats(1.0f), current = cosine, sum = c[0];
#pragma unroll
  for (int j = 1; j < TFM_N_COEFF; ++j) {
    sum += c[j] * current;
#endif
    const Floats next = twice * current - previous;
    previous = current;
    current = next;
  }
  return optical_depth_of_series(map, sum);
}

#endif
