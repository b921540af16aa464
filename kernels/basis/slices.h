/* The optical depth at n planes across the light ("Opacity Shadow Maps"), 0 at v = 0, and what lies between them.
   modes  [n][2], the n intervals that end at the planes: begin and 1 / width
   Requires: what projection.h does; SLICES_CUBIC for cubic interpolation, else linear. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#include "../map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
#ifdef SLICES_CUBIC
  /* Hermite's cubics through the planes with the slope of the chord between their neighbours; the intervals at the
     ends take their own. Intervals before v have part 1 and after it 0, where both bumps vanish. */
  Floats sum = floats(0.0f), chord = floats(0.0f);
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    const float rate = modes[2 * j + 1], width = 1.0f / rate;
    const Floats low = j > 0 ? c[j - (j > 0)] : floats(0.0f);
    const Floats rise = c[j] - low;
    const Floats part = clamp_to((v - modes[2 * j]) * rate, 1.0f);
    /* Chords as they rise over this interval's width. */
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
