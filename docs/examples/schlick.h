/* Schlick's phase function: (1 - k^2) / (4 pi (1 - k mu)^2). medium->phase = k. */
#ifndef SCHLICK_H
#define SCHLICK_H

#include "core/fast_math.h"

TFM_INLINE Floats schlick(MEDIUM medium, Floats mu)
{
  const float k = medium->phase[0];
  const Floats base = 1.0f - k * mu;
  return 0.25f * M_1_PI_F * (1.0f - k * k) / (base * base);
}

#endif
