/* Test-only kernels around the functions of a light's header and of texture.h. Item i goes to lane i % TFM_LANES of
   work-item i / TFM_LANES; every lane is written. */
#include "light/sample.h"
#include "texture.h"

TFM_INLINE int item_of(int lane)
{
  return (int)get_global_id(0) * TFM_LANES + lane;
}

TFM_INLINE Floats load(__global const float *values, int stride, int at, int count)
{
  FloatArray lanes;
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    const int item = item_of(lane) < count ? item_of(lane) : count - 1;
    lanes.lane[lane] = values[(size_t)item * (size_t)stride + (size_t)at];
  }
  return lanes.lanes;
}

TFM_INLINE Vec3 load3(__global const float *values, int count)
{
  return vec3(load(values, 3, 0, count), load(values, 3, 1, count), load(values, 3, 2, count));
}

TFM_INLINE void store(__global float *values, int stride, int at, int count, Floats v)
{
  FloatArray lanes;
  lanes.lanes = v;
  for (int lane = 0; lane < TFM_LANES; ++lane)
    if (item_of(lane) < count)
      values[(size_t)item_of(lane) * (size_t)stride + (size_t)at] = lanes.lane[lane];
}

TFM_INLINE void store3(__global float *values, int stride, int at, int count, Vec3 v)
{
  store(values, stride, at, count, v.x);
  store(values, stride, at + 1, count, v.y);
  store(values, stride, at + 2, count, v.z);
}

/* [count, 2] to [count, 6]: origin and direction. */
__kernel void call_texel_ray(PARAMS params, __global const float *positions, __global float *rays, int count)
{
  const Ray ray = light_texel_ray(params, load(positions, 2, 0, count), load(positions, 2, 1, count));
  store3(rays, 6, 0, count, ray.origin);
  store3(rays, 6, 3, count, ray.direction);
}

/* [count, 3] to [count, 15]: direction, distance, u, v, strength, reached, depth, origin and direction of the ray to it. */
__kernel void call_light(PARAMS params, __global const float *points, __global float *found, int count)
{
  const Vec3 point = load3(points, count);
  const LightSample sample = light_at(params, point_in_light(params, point));
  const Ray ray = light_ray_to(params, point);
  store3(found, 15, 0, count, transform_vector(params->world_from_light, sample.direction));
  store(found, 15, 3, count, sample.distance);
  store(found, 15, 4, count, sample.u);
  store(found, 15, 5, count, sample.v);
  store(found, 15, 6, count, sample.strength);
  store(found, 15, 7, count, light_reaches(params, point) ? floats(1.0f) : floats(0.0f));
  store(found, 15, 8, count, light_projective_depth(params, point));
  store3(found, 15, 9, count, ray.origin);
  store3(found, 15, 12, count, ray.direction);
}

/* [count, 8]: origin, direction and interval to [count, 3]: interval, and whether something is left. */
__kernel void call_clip(PARAMS params, __global const float *rays, __global float *found, int count)
{
  Ray ray;
  ray.origin = vec3(load(rays, 8, 0, count), load(rays, 8, 1, count), load(rays, 8, 2, count));
  ray.direction = vec3(load(rays, 8, 3, count), load(rays, 8, 4, count), load(rays, 8, 5, count));
  Interval interval = {load(rays, 8, 6, count), load(rays, 8, 7, count)};
  const Ints left = light_clip(params, ray, &interval);
  store(found, 3, 0, count, interval.begin);
  store(found, 3, 1, count, interval.end);
  store(found, 3, 2, count, left ? floats(1.0f) : floats(0.0f));
}

/* [count, 2] to [count, 3]. */
__kernel void call_texture(__global const float4 *texture, int width, int height, __global const float *positions,
                           __global float *colours, int count)
{
  Floats rgb[3];
  texture_at(texture, width, height, load(positions, 2, 0, count), load(positions, 2, 1, count), rgb);
  for (int c = 0; c < 3; ++c)
    store(colours, 3, c, count, rgb[c]);
}
