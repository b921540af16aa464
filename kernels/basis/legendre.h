/* Shifted Legendre polynomials P_j(2 v - 1). If the target is the extinction, their integrals
   (P_(j+1) - P_(j-1)) / (2 (2 j + 1)).
   Requires: the same as projection.h. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_HAS_ONE
#include "../map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  const Floats x = 2.0f * v - 1.0f;
  Floats before = floats(1.0f), now = x;
#if TFM_TARGET == TARGET_EXTINCTION
  Floats sum = c[0] * v;
#else
  Floats sum = c[0];
#endif
#pragma unroll
  for (int j = 1; j < TFM_N_COEFF; ++j) {
    /* Bonnet's recurrence. */
    const float from_now = (2.0f * (float)j + 1.0f) / ((float)j + 1.0f), from_before = (float)j / ((float)j + 1.0f);
    const Floats next = from_now * x * now - from_before * before;
#if TFM_TARGET == TARGET_EXTINCTION
    sum += 0.5f / (2.0f * (float)j + 1.0f) * c[j] * (next - before);
#else
    sum += c[j] * now;
#endif
    before = now;
    now = next;
  }
  return optical_depth_of_series(map, sum);
}

#endif
