/* All directions, mapped to the octahedron |x| + |y| + |z| = 1, which is unfolded into the square [-1, 1]^2 with a
   border. The inner diamond holds z >= 0, the corners z < 0. The border repeats the rays from across the seam, so that
   look-ups never see the seam. chart = scale u, scale v, offset u, offset v. Engelhardt, Dachsbacher, "Octahedron
   Environment Maps", 2008.
   The same in float64: tfm_cl/scene/lights/charts.py. */
#ifndef TFM_LIGHT_CHART_H
#define TFM_LIGHT_CHART_H

#include "../sample.h"

/* Beyond the side x = +-1 the square continues as a copy of itself, rotated by 180 degrees about the centre of the
   side. */
TFM_INLINE void octahedron_wrap(Floats *x, Floats *y)
{
  const Ints high = *x > 1.0f, low = *x < -1.0f;
  *x = high ? 2.0f - *x : low ? -2.0f - *x : *x;
  *y = (high | low) ? -*y : *y;
}

/* Exchange the corners (z < 0) with the projection of the lower half along z. It is its own inverse. */
TFM_INLINE void octahedron_fold(Ints lower, Floats *x, Floats *y)
{
  const Floats across = 1.0f - magnitude_of(*y), along = 1.0f - magnitude_of(*x);
  const Floats folded_x = *x < 0.0f ? -across : across, folded_y = *y < 0.0f ? -along : along;
  *x = lower ? folded_x : *x;
  *y = lower ? folded_y : *y;
}

/* A direction in light space, of any length. */
TFM_INLINE Vec3 chart_direction(LIGHT light, Floats u, Floats v)
{
  Floats x = (u - light->chart[2]) * (1.0f / light->chart[0]);
  Floats y = (v - light->chart[3]) * (1.0f / light->chart[1]);
  octahedron_wrap(&x, &y);
  octahedron_wrap(&y, &x);
  const Floats z = 1.0f - magnitude_of(x) - magnitude_of(y);
  octahedron_fold(z < 0.0f, &x, &y);
  return vec3(x, y, z);
}

/* At the light itself any direction will do. */
TFM_INLINE void chart_position(LIGHT light, Vec3 p, Floats *u, Floats *v)
{
  const Floats taxicab = magnitude_of(p.x) + magnitude_of(p.y) + magnitude_of(p.z);
  const Floats shrink = 1.0f / (taxicab > 0.0f ? taxicab : floats(1.0f));
  Floats x = p.x * shrink, y = p.y * shrink;
  octahedron_fold(p.z < 0.0f, &x, &y);
  *u = light->chart[2] + light->chart[0] * x;
  *v = light->chart[3] + light->chart[1] * y;
}

/* Bounds of u and v over the rays that meet a ball, and of their images across the sides of the square, which the border
   repeats. A position moves at most CHART_TURN times as far as the direction. */
#define CHART_IMAGES 4
TFM_INLINE void chart_bounds(LIGHT light, Vec3 p, Floats reach, Floats *low, Floats *high)
{
  Floats at[2];
  chart_position(light, p, at, at + 1);
  const Floats angle = CHART_TURN * angle_of_ball(dot3(p, p), reach);
  const Ints is_large = angle > 0.5f;
  for (int axis = 0; axis < 2; ++axis) {
    const float scale = light->chart[axis], offset = light->chart[2 + axis];
    const Floats x = (at[axis] - offset) * (1.0f / scale);
    /* Image 1 is across the nearer side in x, 2 in y, 3 across both. */
    for (int image = 0; image < CHART_IMAGES; ++image) {
      Floats middle = x;
      if (image & (axis == 0 ? 1 : 2))
        middle = (x < 0.0f ? floats(-2.0f) : floats(2.0f)) - middle;
      if (image & (axis == 0 ? 2 : 1))
        middle = -middle;
      const Ints all = is_large & (image == 0 ? -1 : 0), none = is_large & (image == 0 ? 0 : -1);
      low[2 * image + axis] = all ? floats(-INFINITY) : none ? floats(INFINITY) : offset + scale * (middle - angle);
      high[2 * image + axis] = all ? floats(INFINITY) : none ? floats(-INFINITY) : offset + scale * (middle + angle);
    }
  }
}

/* Within a face. */
TFM_INLINE Ints chart_is_straight(Vec3 a, Vec3 b, float rounding)
{
  return same_side(a.x, b.x, rounding) & same_side(a.y, b.y, rounding) & same_side(a.z, b.z, rounding);
}

#endif
