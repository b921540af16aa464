/* Isotropic phase function, 1 / 4 pi. */
#ifndef TFM_PHASE_ISOTROPIC_H
#define TFM_PHASE_ISOTROPIC_H

#include "../core/fast_math.h"

/* mu: cosine between the light's direction of travel and the direction to the camera. */
TFM_INLINE Floats isotropic(MEDIUM medium, Floats mu)
{
  (void)medium;
  (void)mu;
  return floats(0.25f * M_1_PI_F);
}

#endif
