/* Directions in front of the light, mapped to the half octahedron |x| + |y| + z = 1. Seen along z it is a square that
   stands on a corner; it is rotated by 45 degrees. chart = scale u, scale v, offset u, offset v.
   The same in float64: tfm_cl/scene/lights/charts.py. */
#ifndef TFM_LIGHT_CHART_H
#define TFM_LIGHT_CHART_H

#include "../sample.h"

/* A direction in light space, of any length. */
TFM_INLINE Vec3 chart_direction(LIGHT light, Floats u, Floats v)
{
  const Floats sum = (u - light->chart[2]) * (1.0f / light->chart[0]);
  const Floats difference = (v - light->chart[3]) * (1.0f / light->chart[1]);
  const Floats x = 0.5f * (sum + difference), y = 0.5f * (sum - difference);
  return vec3(x, y, 1.0f - magnitude_of(x) - magnitude_of(y));
}

TFM_INLINE void chart_position(LIGHT light, Vec3 p, Floats *u, Floats *v)
{
  const Floats size = magnitude_of(p.x) + magnitude_of(p.y) + p.z;
  const Ints ahead = (p.z >= 0.0f) & (size > 0.0f);
  const Floats shrink = 1.0f / (ahead ? size : floats(1.0f));
  *u = ahead ? light->chart[2] + light->chart[0] * ((p.x + p.y) * shrink) : floats(CHART_OUTSIDE);
  *v = light->chart[3] + light->chart[1] * ((p.x - p.y) * shrink);
}

/* Bounds of u and v over the rays that meet a ball. A position moves at most CHART_TURN times as far as the direction. */
TFM_INLINE void chart_bounds(LIGHT light, Vec3 p, Floats reach, Floats *low, Floats *high)
{
  const Floats square = dot3(p, p), angle = CHART_TURN * angle_of_ball(square, reach);
  const Floats z = greatest(p.z, floats(0.0f)), size = magnitude_of(p.x) + magnitude_of(p.y) + z;
  const Floats shrink = 1.0f / (size > 0.0f ? size : floats(1.0f));
  const Floats at[2] = {(p.x + p.y) * shrink, (p.x - p.y) * shrink};
  const Ints behind = p.z < -reach;
  for (int axis = 0; axis < 2; ++axis) {
    const float scale = light->chart[axis], offset = light->chart[2 + axis];
    low[axis] = behind ? floats(INFINITY) : offset + scale * (at[axis] - 1.5f * angle);
    high[axis] = behind ? floats(-INFINITY) : offset + scale * (at[axis] + 1.5f * angle);
  }
}

/* Within a face. */
TFM_INLINE Ints chart_is_straight(Vec3 a, Vec3 b, float rounding)
{
  return (a.z > rounding) & (b.z > rounding) & same_side(a.x, b.x, rounding) & same_side(a.y, b.y, rounding);
}

#endif
