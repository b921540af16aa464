/* Point light: light in all directions from a point.
   light_shape = 0, 0, 0, 1 / reach. Light space: the light at the origin, the centre of the map along +z.
   Requires: the header of its chart, included before. */
#ifndef TFM_LIGHT_POINT_H
#define TFM_LIGHT_POINT_H

#include "sample.h"

TFM_INLINE Vec3 point_position(LIGHT light)
{
  return vec3(floats(light->world_from_light[3]), floats(light->world_from_light[7]),
              floats(light->world_from_light[11]));
}

TFM_INLINE Ray light_texel_ray(LIGHT light, Floats u, Floats v)
{
  Ray ray;
  ray.origin = point_position(light);
  ray.direction = unit3(transform_vector(light->world_from_light, chart_direction(light, u, v)));
  return ray;
}

/* The light's ray through a point; its parameter is 0 at the light and 1 at the point. */
TFM_INLINE Ray light_ray_to(LIGHT light, Vec3 point)
{
  Ray ray;
  ray.origin = point_position(light);
  ray.direction = vec3(point.x - ray.origin.x, point.y - ray.origin.y, point.z - ray.origin.z);
  return ray;
}

TFM_INLINE Floats light_projective_depth(LIGHT light, Vec3 point)
{
  (void)light;
  (void)point;
  return floats(1.0f);
}

TFM_INLINE Ints light_reaches(LIGHT light, Vec3 point)
{
  const Vec3 p = light_ray_to(light, point).direction;
  return in_reach(light, dot3(p, p));
}

TFM_INLINE Ints light_clip(LIGHT light, Ray ray, Interval *interval)
{
  const Vec3 position = point_position(light);
  const Vec3 o = vec3(ray.origin.x - position.x, ray.origin.y - position.y, ray.origin.z - position.z);
  const Floats shift = -dot3(o, ray.direction);
  const Ray from_light = {o, ray.direction};
  reach_clip(light, ray_at(from_light, shift), shift, interval);
  return interval->begin < interval->end;
}

TFM_INLINE LightSample light_at(LIGHT light, Vec3 p)
{
  const Floats square = dot3(p, p);
  const Floats inverse = reciprocal_sqrt(square);
  const Ints apart = square > 0.0f;
  LightSample sample;
  /* At the light itself any direction will do. */
  sample.direction = vec3(p.x * inverse, p.y * inverse, apart ? p.z * inverse : floats(1.0f));
  sample.distance = square * inverse;
  chart_position(light, p, &sample.u, &sample.v);
  sample.texture_u = sample.u;
  sample.texture_v = sample.v;
  sample.strength = light_falloff(light, inverse) * light_window(light, square);
  return sample;
}

/* Bounds of u and v over the rays that meet a ball in light space. */
TFM_INLINE void light_bounds(LIGHT light, Vec3 p, Floats reach, Floats *low, Floats *high)
{
  chart_bounds(light, p, reach, low, high);
}

TFM_INLINE Floats light_square(Vec3 p)
{
  return dot3(p, p);
}

TFM_INLINE LightSpan light_span(LIGHT light, Ray ray, Interval part, Vec3 first, Vec3 last, float rounding, float texel)
{
  const float moves = rounding * chart_slope(light) / texel;
  LightSpan span;
  span.nearest = span.clear = nearest_to_origin(ray, part);
  span.is_straight = chart_is_straight(first, last, rounding) & (span.nearest >= moves * moves);
  return span;
}

#endif
