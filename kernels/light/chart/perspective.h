/* Directions in front of the light, projected to the plane z = 1 of light space.
   chart = scale u, scale v, offset u, offset v. The same in float64: tfm_cl/scene/lights/charts.py. */
#ifndef TFM_LIGHT_CHART_H
#define TFM_LIGHT_CHART_H

#include "../sample.h"

/* A direction in light space, of any length. */
TFM_INLINE Vec3 chart_direction(LIGHT light, Floats u, Floats v)
{
  return vec3((u - light->chart[2]) * (1.0f / light->chart[0]), (v - light->chart[3]) * (1.0f / light->chart[1]),
              floats(1.0f));
}

TFM_INLINE void chart_position(LIGHT light, Vec3 p, Floats *u, Floats *v)
{
  const Ints ahead = p.z > 0.0f;
  const Floats away = 1.0f / (ahead ? p.z : floats(1.0f));
  *u = ahead ? light->chart[2] + light->chart[0] * (p.x * away) : floats(CHART_OUTSIDE);
  *v = light->chart[3] + light->chart[1] * (p.y * away);
}

/* Bounds of u and v over the rays that meet a ball. */
TFM_INLINE void chart_bounds(LIGHT light, Vec3 p, Floats reach, Floats *low, Floats *high)
{
  slope_bounds(p.x, p.z, reach, low, high);
  slope_bounds(p.y, p.z, reach, low + 1, high + 1);
  for (int axis = 0; axis < 2; ++axis) {
    low[axis] = light->chart[2 + axis] + light->chart[axis] * low[axis];
    high[axis] = light->chart[2 + axis] + light->chart[axis] * high[axis];
  }
}

/* Less than 76 degrees off the axis. */
TFM_INLINE Ints chart_is_straight(Vec3 a, Vec3 b, float rounding)
{
  const Floats square_a = dot3(a, a), square_b = dot3(b, b);
  return (a.z > rounding) & (b.z > rounding) & (16.0f * a.z * a.z >= square_a) & (16.0f * b.z * b.z >= square_b);
}

#endif
