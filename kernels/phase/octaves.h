/* Multiple scattering by octaves (Wrenninge, Kulla, Lundqvist, "Oz: The Great and Volumetric", SIGGRAPH 2013 Talks): light
   that was scattered i times before is as if the medium were attenuation^i times as dense, of contribution^i of it there is
   some, and its phase function p is closer to even: eccentricity^i p + (1 - eccentricity^i) / 4 pi. All of them follow from
   one optical depth.
   Requires: TFM_OCTAVES, the most of any medium; 1: single scattering. */
#ifndef TFM_PHASE_OCTAVES_H
#define TFM_PHASE_OCTAVES_H

#include "phase/phase.h"

/* Phase function times transmittance, summed over the octaves. */
TFM_INLINE Floats octaves_of(MEDIUM medium, Floats phase, Floats depth)
{
  Floats sum = phase * transmittance_of(depth);
  for (int i = 1; i < TFM_OCTAVES; ++i)
    sum += (medium->octave_lobe[i] * phase + medium->octave_even[i]) * transmittance_of(medium->octave_depth[i] * depth);
  return sum;
}

#endif
