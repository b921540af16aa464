/* Test-only kernels around the functions of a light's header and of texture.h. */
#include "light/sample.h"
#include "core/texture.h"
#include "items.h"

/* [count, 2] to [count, 6]: origin and direction. */
__kernel void call_texel_ray(LIGHT light, __global const float *positions, __global float *found, int count)
{
  GUARD;
  const Ray ray = light_texel_ray(light, load(positions, 2, 0, count), load(positions, 2, 1, count));
  store3(found, 6, 0, count, ray.origin);
  store3(found, 6, 3, count, ray.direction);
}

/* [count, 3] to [count, 15]: direction, distance, u, v, strength, reached, depth, origin and direction of the ray to it. */
__kernel void call_light(LIGHT light, __global const float *points, __global float *found, int count)
{
  GUARD;
  const Vec3 point = load3(points, 3, 0, count);
  const LightSample sample = light_at(light, point_in_light(light, point));
  const Ray ray = light_ray_to(light, point);
  store3(found, 15, 0, count, transform_vector(light->world_from_light, sample.direction));
  store(found, 15, 3, count, sample.distance);
  store(found, 15, 4, count, sample.u);
  store(found, 15, 5, count, sample.v);
  store(found, 15, 6, count, sample.strength);
  store(found, 15, 7, count, light_reaches(light, point) ? floats(1.0f) : floats(0.0f));
  store(found, 15, 8, count, light_projective_depth(light, point));
  store3(found, 15, 9, count, ray.origin);
  store3(found, 15, 12, count, ray.direction);
}

/* [count, 8]: origin, direction and interval to [count, 3]: interval, and whether something is left. */
__kernel void call_clip(LIGHT light, __global const float *rays, __global float *found, int count)
{
  GUARD;
  Interval interval = {load(rays, 8, 6, count), load(rays, 8, 7, count)};
  const Ints left = light_clip(light, load_ray(rays, 8, count), &interval);
  store(found, 3, 0, count, interval.begin);
  store(found, 3, 1, count, interval.end);
  store(found, 3, 2, count, left ? floats(1.0f) : floats(0.0f));
}

/* [count, 2] to [count, 3]. */
__kernel void call_texture(__global const float4 *texture, int width, int height, __global const float *positions,
                           __global float *found, int count)
{
  GUARD;
  Floats rgb[3];
  texture_at(texture, width, height, load(positions, 2, 0, count), load(positions, 2, 1, count), rgb);
  for (int c = 0; c < 3; ++c)
    store(found, 3, c, count, rgb[c]);
}
