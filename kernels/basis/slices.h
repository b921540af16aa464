/* Optical depth at n planes across the light's rays ("Opacity Shadow Maps"), interpolated in between; it is 0 at v = 0.
   modes  [n][2], for the interval that ends at each plane its beginning and 1 / width
   Requires: the same as projection.h; SLICES_CUBIC for cubic instead of linear interpolation. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#include "../map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
#ifdef SLICES_CUBIC
  /* Cubic Hermite interpolation. The slope at a plane is that of the chord between its neighbours, and at either end
     that of the interval itself. part is 1 for intervals before v and 0 for those after it; both correction terms
     vanish there. */
  Floats sum = floats(0.0f), chord = floats(0.0f);
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    const float rate = modes[2 * j + 1], width = 1.0f / rate;
    const Floats low = j > 0 ? c[j - (j > 0)] : floats(0.0f);
    const Floats rise = c[j] - low;
    const Floats part = clamp_to((v - modes[2 * j]) * rate, 1.0f);
    /* Rise of the chords at both ends over the width of this interval. */
    Floats at_begin = rise, at_end = rise;
    if (j > 0)
      at_begin = (width / (width + 1.0f / modes[2 * j - 1])) * (rise + chord);
    if (j + 1 < TFM_N_COEFF)
      at_end = (width / (width + 1.0f / modes[2 * j + 3])) * (c[j + (j + 1 < TFM_N_COEFF)] - low);
    const Floats rest = 1.0f - part;
    sum += rise * part + part * rest * (rest * (at_begin - rise) - part * (at_end - rise));
    chord = rise;
  }
#else
  Floats sum = floats(0.0f), low = floats(0.0f);
#pragma unroll
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    sum += (c[j] - low) * clamp_to((v - modes[2 * j]) * modes[2 * j + 1], 1.0f);
    low = c[j];
  }
#endif
  return optical_depth_of_series(map, sum);
}

#endif
