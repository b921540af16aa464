/* Extinction that is constant in each of n equal parts of the range ("Fourier Opacity Mapping", section 5.1). The
   coefficients are the optical depths of the parts.
   Requires: the same as projection.h. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#include "../map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  const Floats parts = v * (float)TFM_N_COEFF;
  Floats sum = floats(0.0f);
#pragma unroll
  for (int j = 0; j < TFM_N_COEFF; ++j)
    sum += c[j] * clamp_to(parts - (float)j, 1.0f);
  return optical_depth_of_series(map, sum);
}

#endif
