/* Jendersie and d'Eon, "An Approximate Mie Scattering Function for Fog and Cloud Rendering", SIGGRAPH Talks 2023:
   (1 - w) HG(g_hg, mu) + w Draine(g_d, alpha, mu). medium->phase = g_hg, g_d, alpha, w. */
#ifndef TFM_PHASE_MIE_H
#define TFM_PHASE_MIE_H

#include "phase/draine.h"

/* mu: cosine between the light's direction of travel and the direction to the camera; 1 is forward scattering. */
TFM_INLINE Floats mie(MEDIUM medium, Floats mu)
{
  const float weight = medium->phase[3];
  return (1.0f - weight) * henyey_greenstein_lobe(medium->phase[0], mu) +
         weight * draine_lobe(medium->phase[1], medium->phase[2], mu);
}

#endif
