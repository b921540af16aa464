/* Directions in front of the light, projected to the plane z = 1 of light space.
   chart = scale u, scale v, offset u, offset v. The same in float64: tfm_cl/scene/lights/charts.py. */
#ifndef TFM_LIGHT_CHART_H
#define TFM_LIGHT_CHART_H

#include "../sample.h"

/* A direction in light space, of any length. */
TFM_INLINE Vec3 chart_direction(PARAMS params, Floats u, Floats v)
{
  return vec3((u - params->chart[2]) * (1.0f / params->chart[0]), (v - params->chart[3]) * (1.0f / params->chart[1]),
              floats(1.0f));
}

TFM_INLINE void chart_position(PARAMS params, Vec3 p, Floats *u, Floats *v)
{
  const Ints ahead = p.z > 0.0f;
  const Floats away = 1.0f / (ahead ? p.z : floats(1.0f));
  *u = ahead ? params->chart[2] + params->chart[0] * (p.x * away) : floats(CHART_OUTSIDE);
  *v = params->chart[3] + params->chart[1] * (p.y * away);
}

#endif
