/* A phase function that is known by its values, linear in r = sqrt(1 - |mu|): PHASE_CELLS / 2 cells from mu = 1, and as many
   from mu = -1. They lie behind the media. At the poles r grows as the angle does, and float32 tells cosines there apart no
   better than cells. */
#ifndef TFM_PHASE_TABULATED_PHASE_H
#define TFM_PHASE_TABULATED_PHASE_H

#include "../core/fast_math.h"

#define HALF_CELLS (PHASE_CELLS / 2)

/* mu: cosine between the light's direction of travel and the direction to the camera; 1 is forward scattering. */
TFM_INLINE Floats tabulated_phase(MEDIUM medium, Floats mu)
{
  const Ints is_back = mu < 0.0f;
  const Floats off_pole = greatest(1.0f - magnitude_of(mu), floats(0.0f));
  const Floats cell = (float)HALF_CELLS * off_pole * reciprocal_sqrt(off_pole);
  const Ints whole = TO_INTS(least(cell, floats((float)(HALF_CELLS - 1))));
  const Ints first = whole + (is_back ? ints(HALF_CELLS + 1) : ints(0));
  __global const float *values = (__global const float *)medium + medium->phase_table;
  return lerp(gather_floats(values, first), gather_floats(values + 1, first), cell - TO_FLOATS(whole));
}

#endif
