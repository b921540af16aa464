/* Draine (2003): HG(g, mu) (1 + alpha mu^2) / (1 + alpha (1 + 2 g^2) / 3). medium->phase = g, alpha. */
#ifndef TFM_PHASE_DRAINE_H
#define TFM_PHASE_DRAINE_H

#include "phase/henyey_greenstein.h"

/* mu: cosine between the light's direction of travel and the direction to the camera; 1 is forward scattering. */
TFM_INLINE Floats draine_lobe(float g, float alpha, Floats mu)
{
  const float scale = 3.0f / (3.0f + alpha * (1.0f + 2.0f * g * g));
  return henyey_greenstein_lobe(g, mu) * (scale * (1.0f + alpha * mu * mu));
}

TFM_INLINE Floats draine(MEDIUM medium, Floats mu)
{
  return draine_lobe(medium->phase[0], medium->phase[1], mu);
}

#endif
