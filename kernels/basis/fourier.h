/* Fourier series 1, cos(2 pi k v), sin(2 pi k v), k = 1, 2 ... If the target is the extinction, "Fourier Opacity
   Mapping" eq. 3: c_0 v + sum of (a_k sin(2 pi k v) + b_k (1 - cos(2 pi k v))) / (2 pi k). The coefficients are stored
   as c_0, a_1, b_1, a_2, b_2 ...
   Requires: the same as projection.h. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_HAS_ONE
#include "../map/projection.h"

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  /* Measured from the middle, so that the sines and 1 - cos vanish at both ends up to rounding. */
  const Floats from_middle = v < 0.5f ? 1.0f - 2.0f * v : 2.0f * v - 1.0f;
  const Floats cosine = -cos_pi(from_middle);
  const Floats sine_beyond = -sin_pi(from_middle);
  Floats sine = v < 0.5f ? -sine_beyond : sine_beyond;
  /* Chebyshev recurrence. */
  const Floats twice = 2.0f * cosine;
  Floats cosine_before = floats(1.0f), cosine_now = cosine, sine_before = floats(0.0f);
#if TFM_TARGET == TARGET_EXTINCTION
  Floats sum = c[0] * v;
#else
  Floats sum = c[0];
#endif
#pragma unroll
  for (int k = 1; 2 * k < TFM_N_COEFF; ++k) {
#if TFM_TARGET == TARGET_EXTINCTION
    const float scale = 0.159154943f; /* 1 / (2 pi) */
    sum += scale / (float)k * (c[2 * k - 1] * sine + c[2 * k] * (1.0f - cosine_now));
#else
    sum += c[2 * k - 1] * cosine_now + c[2 * k] * sine;
#endif
    const Floats next_cosine = twice * cosine_now - cosine_before, next_sine = twice * sine - sine_before;
    cosine_before = cosine_now;
    cosine_now = next_cosine;
    sine_before = sine;
    sine = next_sine;
  }
  return optical_depth_of_series(map, sum);
}

#endif
