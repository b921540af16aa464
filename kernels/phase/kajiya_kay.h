/* Kajiya and Kay, "Rendering Fur with Three Dimensional Textures", SIGGRAPH 1989, per unit of opacity and bounded in energy:
     sin(t, l) [(1 - s) / pi^2 + s cos^p(angle to the mirror cone) / (2 pi B)],   B = integral of cos^p over [-pi/2, pi/2]
   medium->phase = s, p, 1 / (2 pi B). Where no strand lies it is isotropic. */
#ifndef TFM_PHASE_KAJIYA_KAY_H
#define TFM_PHASE_KAJIYA_KAY_H

#include "phase/fibres.h"

TFM_INLINE Floats kajiya_kay(MEDIUM medium, const FibreAngles *fibres)
{
  const Floats cosine = least(greatest(fibres->cosine, floats(FLT_MIN)), floats(1.0f));
  const Floats mirrored = transmittance_of(-medium->phase[1] * log_of(cosine));
  const Floats shines = fibres->light * ((1.0f - medium->phase[0]) * (M_1_PI_F * M_1_PI_F) +
                                         medium->phase[0] * medium->phase[2] * mirrored);
  return fibres->any ? shines : floats(0.25f * M_1_PI_F);
}

#endif
