/* Point light: everything around a point, mapped on an octahedron that is unfolded into a square with a border.
   light_shape = part of the map's width that the octahedron takes, 0, 0, 1 / reach. Light space: the world's axes, the light at 0.
   In the square [-1, 1]^2 the inner diamond is z >= 0 and the corners are z < 0. The border around it holds the rays
   from across the seam, so that no look-up meets one. Engelhardt, Dachsbacher, "Octahedron Environment Maps", 2008. */
#ifndef TFM_LIGHT_POINT_H
#define TFM_LIGHT_POINT_H

#include "sample.h"

TFM_INLINE Vec3 point_position(PARAMS params)
{
  return vec3(floats(params->world_from_light[3]), floats(params->world_from_light[7]),
              floats(params->world_from_light[11]));
}

TFM_INLINE Floats magnitude_of(Floats x)
{
  return AS_FLOATS(AS_INTS(x) & 0x7fffffff);
}

/* Beyond the side x = +-1 the square goes on as itself, turned by half a turn about the side's middle. */
TFM_INLINE void octahedron_wrap(Floats *x, Floats *y)
{
  const Ints high = *x > 1.0f, low = *x < -1.0f;
  *x = high ? 2.0f - *x : low ? -2.0f - *x : *x;
  *y = (high | low) ? -*y : *y;
}

/* Between the corners (z < 0) and where the lower half would lie if it were seen from above; its own inverse. */
TFM_INLINE void octahedron_fold(Ints lower, Floats *x, Floats *y)
{
  const Floats across = 1.0f - magnitude_of(*y), along = 1.0f - magnitude_of(*x);
  const Floats folded_x = *x < 0.0f ? -across : across, folded_y = *y < 0.0f ? -along : along;
  *x = lower ? folded_x : *x;
  *y = lower ? folded_y : *y;
}

TFM_INLINE Ray light_texel_ray(PARAMS params, Floats u, Floats v)
{
  const float scale = 1.0f / params->light_shape[0];
  Floats x = (2.0f * u - 1.0f) * scale, y = (2.0f * v - 1.0f) * scale;
  octahedron_wrap(&x, &y);
  octahedron_wrap(&y, &x);
  const Floats z = 1.0f - magnitude_of(x) - magnitude_of(y);
  octahedron_fold(z < 0.0f, &x, &y);
  Ray ray;
  ray.origin = point_position(params);
  ray.direction = unit3(vec3(x, y, z));
  return ray;
}

/* The light's ray through a point: its parameter is 0 at the light and 1 at the point. */
TFM_INLINE Ray light_ray_to(PARAMS params, Vec3 point)
{
  Ray ray;
  ray.origin = point_position(params);
  ray.direction = vec3(point.x - ray.origin.x, point.y - ray.origin.y, point.z - ray.origin.z);
  return ray;
}

TFM_INLINE Floats light_projective_depth(PARAMS params, Vec3 point)
{
  (void)params;
  (void)point;
  return floats(1.0f);
}

TFM_INLINE Ints light_reaches(PARAMS params, Vec3 point)
{
  const Vec3 p = light_ray_to(params, point).direction;
  return in_reach(params, dot3(p, p));
}

TFM_INLINE Ints light_clip(PARAMS params, Ray ray, Interval *interval)
{
  const Vec3 position = point_position(params);
  const Vec3 o = vec3(ray.origin.x - position.x, ray.origin.y - position.y, ray.origin.z - position.z);
  const Floats shift = -dot3(o, ray.direction);
  const Ray from_light = {o, ray.direction};
  reach_clip(params, ray_at(from_light, shift), shift, interval);
  return interval->begin < interval->end;
}

TFM_INLINE LightSample light_at(PARAMS params, Vec3 p)
{
  const Floats square = dot3(p, p);
  const Floats inverse = reciprocal_sqrt(square);
  const Ints apart = square > 0.0f;
  const Floats taxicab = magnitude_of(p.x) + magnitude_of(p.y) + magnitude_of(p.z);
  const Floats shrink = 1.0f / (apart ? taxicab : floats(1.0f));
  Floats x = p.x * shrink, y = p.y * shrink;
  octahedron_fold(p.z < 0.0f, &x, &y);
  LightSample sample;
  /* At the light itself any direction serves. */
  sample.direction = vec3(p.x * inverse, p.y * inverse, apart ? p.z * inverse : floats(1.0f));
  sample.distance = square * inverse;
  sample.u = 0.5f + 0.5f * params->light_shape[0] * x;
  sample.v = 0.5f + 0.5f * params->light_shape[0] * y;
  sample.strength = light_falloff(params, inverse) * light_window(params, square);
  return sample;
}

#endif
