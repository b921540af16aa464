/* How light arrives at a point, whatever kind of light it is. */
#ifndef TFM_LIGHT_SAMPLE_H
#define TFM_LIGHT_SAMPLE_H

#include "ray.h"

typedef struct {
  Ray ray;         /* world ray of the light through the point, unit direction of travel */
  float distance;  /* of the point along it */
  float2 uv;       /* the ray's position in the map, [0, 1]^2 */
  float3 radiance; /* intensity with falloff, without the medium */
} LightSample;

inline float light_falloff(__constant const Params *params, float distance)
{
  if (!params->light_inverse_square)
    return 1.0f;
  const float safe = fmax(distance, params->light_min_distance);
  return 1.0f / (safe * safe);
}

#endif
