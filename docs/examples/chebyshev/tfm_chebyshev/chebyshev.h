/* Chebyshev polynomials T_j(2 v - 1), by T_(j+1)(x) = 2 x T_j(x) - T_(j-1)(x). */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_HAS_ONE
#include "map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  const Floats x = 2.0f * v - 1.0f;
  Floats before = floats(1.0f), now = x, sum = c[0];
#pragma unroll
  for (int j = 1; j < TFM_N_COEFF; ++j) {
    sum += c[j] * now;
    const Floats next = 2.0f * x * now - before;
    before = now;
    now = next;
  }
  return optical_depth_of_series(map, sum);
}

#endif
