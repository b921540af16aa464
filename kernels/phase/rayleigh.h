/* Rayleigh (1871), of unpolarised light: 3 / (16 pi) (1 + mu^2). */
#ifndef TFM_PHASE_RAYLEIGH_H
#define TFM_PHASE_RAYLEIGH_H

#include "../core/fast_math.h"

/* mu: cosine between the light's direction of travel and the direction to the camera. */
TFM_INLINE Floats rayleigh(MEDIUM medium, Floats mu)
{
  (void)medium;
  return 0.1875f * M_1_PI_F * (1.0f + mu * mu);
}

#endif
