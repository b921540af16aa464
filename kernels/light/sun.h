/* Sun: parallel light along +z. Its map is the rectangle that bounds the medium as seen from the light.
   light_shape = half width, half height. Light space: the origin is the centre of the rectangle, on the plane from
   which distances are measured; the plane lies in front of everything that the light meets. */
#ifndef TFM_LIGHT_SUN_H
#define TFM_LIGHT_SUN_H

#include "sample.h"

TFM_INLINE Vec3 sun_direction(LIGHT light)
{
  return vec3(floats(light->world_from_light[2]), floats(light->world_from_light[6]),
              floats(light->world_from_light[10]));
}

TFM_INLINE Ray light_texel_ray(LIGHT light, Floats u, Floats v)
{
  Ray ray;
  ray.origin = transform_point(light->world_from_light,
                               vec3((2.0f * u - 1.0f) * light->shape[0],
                                    (2.0f * v - 1.0f) * light->shape[1], floats(0.0f)));
  ray.direction = sun_direction(light);
  return ray;
}

/* The light's ray through a point; its parameter is 0 where the ray begins and 1 at the point. */
TFM_INLINE Ray light_ray_to(LIGHT light, Vec3 point)
{
  const Floats distance = transform_point(light->light_from_world, point).z;
  Ray ray;
  ray.direction = scale3(distance, sun_direction(light));
  ray.origin = vec3(point.x - ray.direction.x, point.y - ray.direction.y, point.z - ray.direction.z);
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
  (void)light;
  (void)point;
  return ints(-1);
}

TFM_INLINE Ints light_clip(LIGHT light, Ray ray, Interval *interval)
{
  (void)light;
  (void)ray;
  return interval->begin < interval->end;
}

TFM_INLINE LightSample light_at(LIGHT light, Vec3 p)
{
  LightSample sample;
  sample.direction = vec3(floats(0.0f), floats(0.0f), floats(1.0f));
  sample.distance = p.z;
  sample.u = 0.5f + p.x * (0.5f / light->shape[0]);
  sample.v = 0.5f + p.y * (0.5f / light->shape[1]);
  sample.texture_u = sample.u;
  sample.texture_v = sample.v;
  sample.strength = floats(1.0f);
  return sample;
}

/* Bounds of u and v over the rays that meet a ball in light space. */
TFM_INLINE void light_bounds(LIGHT light, Vec3 p, Floats reach, Floats *low, Floats *high)
{
  const Floats at[2] = {p.x, p.y};
  for (int axis = 0; axis < 2; ++axis) {
    const float scale = 0.5f / light->shape[axis];
    low[axis] = 0.5f + scale * (at[axis] - reach);
    high[axis] = 0.5f + scale * (at[axis] + reach);
  }
}

TFM_INLINE Floats light_square(Vec3 p)
{
  return p.z * p.z;
}

TFM_INLINE LightSpan light_span(LIGHT light, Ray ray, Interval part, Vec3 first, Vec3 last, float rounding, float texel)
{
  const float narrow = light->shape[0] < light->shape[1] ? light->shape[0] : light->shape[1];
  (void)ray;
  (void)part;
  LightSpan span;
  span.nearest = least(light_square(first), light_square(last));
  span.clear = floats(INFINITY);
  span.is_straight = floats(0.5f * rounding) <= floats(texel * narrow);
  return span;
}

#endif
