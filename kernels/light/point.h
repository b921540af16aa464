/* Point light: light in all directions from a point.
   light_shape = 0, 0, 0, 1 / reach. Light space: the light at the origin, the centre of the map along +z.
   Requires: the header of its chart, included before. */
#ifndef TFM_LIGHT_POINT_H
#define TFM_LIGHT_POINT_H

#include "sample.h"

TFM_INLINE Vec3 point_position(PARAMS params)
{
  return vec3(floats(params->world_from_light[3]), floats(params->world_from_light[7]),
              floats(params->world_from_light[11]));
}

TFM_INLINE Ray light_texel_ray(PARAMS params, Floats u, Floats v)
{
  Ray ray;
  ray.origin = point_position(params);
  ray.direction = unit3(transform_vector(params->world_from_light, chart_direction(params, u, v)));
  return ray;
}

/* The light's ray through a point; its parameter is 0 at the light and 1 at the point. */
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
  LightSample sample;
  /* At the light itself any direction will do. */
  sample.direction = vec3(p.x * inverse, p.y * inverse, apart ? p.z * inverse : floats(1.0f));
  sample.distance = square * inverse;
  chart_position(params, p, &sample.u, &sample.v);
  sample.texture_u = sample.u;
  sample.texture_v = sample.v;
  sample.strength = light_falloff(params, inverse) * light_window(params, square);
  return sample;
}

#endif
