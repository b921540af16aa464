/* Henyey and Greenstein (1941): (1 - g^2) / (4 pi (1 + g^2 - 2 g mu)^(3/2)). medium->phase = g.
   The base is written as (1 - |g|)^2 + 2 |g| (1 -+ mu) to avoid cancellation at the peak. */
#ifndef TFM_PHASE_HENYEY_GREENSTEIN_H
#define TFM_PHASE_HENYEY_GREENSTEIN_H

#include "../core/fast_math.h"

/* mu: cosine between the light's direction of travel and the direction to the camera; 1 is forward scattering. */
TFM_INLINE Floats henyey_greenstein_lobe(float g, Floats mu)
{
  const float size = g < 0.0f ? -g : g;
  const Floats off_peak = greatest(g < 0.0f ? 1.0f + mu : 1.0f - mu, floats(0.0f));
  const Floats base = (1.0f - size) * (1.0f - size) + 2.0f * size * off_peak;
  const Floats inverse = reciprocal_sqrt(base);
  return 0.25f * M_1_PI_F * (1.0f - g * g) * inverse * inverse * inverse;
}

TFM_INLINE Floats henyey_greenstein(MEDIUM medium, Floats mu)
{
  return henyey_greenstein_lobe(medium->phase[0], mu);
}

#endif
