/* One number a texel, looked up as it is: what a map of residuals holds. Not a basis of the transmittance.
   Requires: what projection.h does. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#include "../map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)map;
  (void)modes;
  (void)v;
  return c[0];
}

#endif
