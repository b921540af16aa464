/* Points: density around a centre that depends on the distance r from it alone and ends at a radius. With r in radii, and
   the density at the centre as 1, it is
     ball      1
     gaussian  exp(-9/2 r^2): three standard deviations reach the end
     smooth    (1 - r^2)^3, the "poly6" kernel of Mueller, Charypar, Gross, "Particle-Based Fluid Simulation for
               Interactive Applications", SCA 2003
   A ray that passes the centre at a distance b is inside for x = 1 - b^2 > 0, from s = -sqrt(x) to sqrt(x) on both sides
   of the nearest point. What it gathers up to s is an odd function of s, in closed form:
     ball      s
     gaussian  exp(-9/2 (1 - x)) (sqrt(pi / 2) / 3) erf(3 s / sqrt(2))
     smooth    x^3 s - x^2 s^3 + (3/5) x s^5 - s^7 / 7 */
#ifndef TFM_POINT_H
#define TFM_POINT_H

#include "primitive/crossing.h"

/* The integral of exp(-9/2 s^2) from 0 to s, for s in [-1, 1]: least squares of the relative error, 2e-7. */
TFM_INLINE Floats gaussian_integral(Floats s)
{
  const Floats s2 = s * s;
  return s * (0.9999998f + s2 * (-1.49997017f + s2 * (2.02423642f + s2 * (-2.16190331f + s2 * (1.858065f +
         s2 * (-1.27568722f + s2 * (0.658780722f + s2 * (-0.222966895f + s2 * 0.0360892089f))))))));
}

/* The lanes whose ray, of a unit direction, crosses the point. shape: 1 / the square of its radius across the ray, its
   radius along it, and 1 / that. */
TFM_INLINE Ints point_crossing(PRIMITIVE point, float4 ball, Ray ray, Crossing *crossing)
{
  const Vec3 to_centre = vec3(ball.x - ray.origin.x, ball.y - ray.origin.y, ball.z - ray.origin.z);
  crossing->t = dot3(to_centre, ray.direction);
  const Vec3 beside = vec3(to_centre.x - crossing->t * ray.direction.x, to_centre.y - crossing->t * ray.direction.y,
                           to_centre.z - crossing->t * ray.direction.z);
  crossing->x = 1.0f - point->shape[0] * dot3(beside, beside);
  crossing->root = root_of(crossing->x);
  crossing->inverse = floats(point->shape[2]);
  crossing->reach = crossing->root * point->shape[1];
  crossing->weight = PRIMITIVE_PROFILE(point) == POINT_GAUSSIAN ? transmittance_of(4.5f - 4.5f * crossing->x) : floats(1.0f);
  return crossing->x > 0.0f;
}

/* What lies between the middle and a ray parameter; times the point's amount it is the optical depth. */
TFM_INLINE Floats point_part(PRIMITIVE point, const Crossing *crossing, Floats t)
{
  const Floats x = crossing->x, s = place_in(crossing, t), s2 = s * s;
  if (PRIMITIVE_PROFILE(point) == POINT_BALL)
    return s;
  if (PRIMITIVE_PROFILE(point) == POINT_SMOOTH)
    return s * (x * x * x - s2 * (x * x - s2 * (0.6f * x - s2 * (1.0f / 7.0f))));
  return crossing->weight * gaussian_integral(s);
}

/* None. */
TFM_INLINE Vec3 point_tangent(PRIMITIVE point, const Crossing *crossing)
{
  (void)point;
  (void)crossing;
  return vec3(floats(0.0f), floats(0.0f), floats(0.0f));
}

/* What is narrower than a few texels becomes a smooth point that holds as much: maps of any resolution have the same mean
   optical depth. Its depth stays. Returns the optical depth that the unit of its profile stands for. */
TFM_INLINE float point_seen(SOURCE source, SET set, const Eye *eye, __global Primitive *seen, float4 *ball)
{
  const float place[3] = {source->a[0], source->a[1], source->a[2]};
  const float narrowest = LEAST_TEXELS * texel_at(eye, place), radius = source->radius[0];
  const int is_small = radius < narrowest;
  const float across = is_small ? narrowest : radius;
  *ball = (float4)(place[0], place[1], place[2], across);
  seen->traits = SHAPE_TRAITS(0, is_small ? POINT_SMOOTH : set->profile);
  seen->shape[0] = 1.0f / (across * across);
  seen->shape[1] = radius;
  seen->shape[2] = 1.0f / radius;
  const float held = set->mass * radius * radius * radius * source->amount;
  return is_small ? held / (SMOOTH_MASS * across * across) : radius * source->amount;
}

#endif
