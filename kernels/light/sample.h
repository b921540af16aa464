/* How light arrives at a point, whatever kind of light it is.
   Requires: TFM_INVERSE_SQUARE 0 or 1. */
#ifndef TFM_LIGHT_SAMPLE_H
#define TFM_LIGHT_SAMPLE_H

#include "../ray.h"

typedef struct {
  Vec3 direction;  /* world, unit: of travel */
  Floats distance; /* travelled, world */
  Floats u, v;     /* the ray's position in the map, [0, 1]^2 */
  Floats strength; /* falloff and edge: what the light's intensity is multiplied by, without the medium */
} LightSample;

TFM_INLINE Floats light_falloff(__constant const Params *params, Floats inverse_distance)
{
#if TFM_INVERSE_SQUARE
  const Floats nearest = least(inverse_distance, floats(params->light_nearest_inverse));
  return nearest * nearest;
#else
  (void)params;
  (void)inverse_distance;
  return floats(1.0f);
#endif
}

#endif
