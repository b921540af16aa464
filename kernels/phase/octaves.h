/* Multiple scattering by octaves (after Wrenninge, Kulla, Lundqvist, "Oz: The Great and Volumetric", SIGGRAPH 2013 Talks):
   light of octave i > 0 is that which was scattered more often. To it the medium is octave_depth as dense, it is scattered
   more evenly, and there is octave_share of it, the more of it the deeper the medium is along the camera's ray. All octaves
   follow from one optical depth.
   Requires: TFM_OCTAVES, the most of any medium; 1: single scattering. */
#ifndef TFM_PHASE_OCTAVES_H
#define TFM_PHASE_OCTAVES_H

#include "phase/henyey_greenstein.h"

#ifndef TFM_SHOW_RESIDUAL
#define TFM_SHOW_RESIDUAL 0
#endif
/* Of a map's errors there are no octaves. */
#define HAS_OCTAVES (TFM_OCTAVES > 1 && !TFM_SHOW_RESIDUAL)

#if HAS_OCTAVES
/* Phase function times transmittance, summed over all octaves but the first. mu: as of henyey_greenstein_lobe. */
TFM_INLINE Floats later_octaves(MEDIUM medium, Floats mu, Floats depth)
{
  Floats sum = floats(0.0f);
  for (int i = 1; i < TFM_OCTAVES; ++i)
    sum += medium->octave_share[i] * henyey_greenstein_lobe(medium->octave_cosine[i], mu) *
           transmittance_of(medium->octave_depth[i] * depth);
  return sum;
}

/* How much of that there is on a ray of which so much is left behind everything. A march that ends where the cutoff is
   left does not know of more. */
TFM_INLINE Floats octaves_on_ray(VIEW view, Floats through)
{
  const float least = fmax(view->cutoff, OCTAVE_LEAST_THROUGH);
  const Floats depth = -log_of(greatest(through, floats(least)));
  return depth > 0.0f ? exp2_of(OCTAVE_GROWTH * TFM_LOG2_E * log_of(greatest(depth, floats(FLT_MIN)))) : floats(0.0f);
}
#endif

#endif
