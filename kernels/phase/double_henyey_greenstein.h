/* Two lobes of Henyey and Greenstein's: w HG(g1, mu) + (1 - w) HG(g2, mu). medium->phase = g1, g2, w. */
#ifndef TFM_PHASE_DOUBLE_HENYEY_GREENSTEIN_H
#define TFM_PHASE_DOUBLE_HENYEY_GREENSTEIN_H

#include "phase/henyey_greenstein.h"

/* mu: cosine between the light's direction of travel and the direction to the camera; 1 is forward scattering. */
TFM_INLINE Floats double_henyey_greenstein(MEDIUM medium, Floats mu)
{
  const float weight = medium->phase[2];
  return weight * henyey_greenstein_lobe(medium->phase[0], mu) +
         (1.0f - weight) * henyey_greenstein_lobe(medium->phase[1], mu);
}

#endif
