/* Items of test-only kernels: item i goes to lane i % TFM_LANES of work-item i / TFM_LANES, and every lane is written.
   Lanes beyond the last item repeat it. */
#ifndef ITEMS_H
#define ITEMS_H

#include "core/ray.h"

TFM_INLINE int item_of(int lane)
{
  return (int)get_global_id(0) * TFM_LANES + lane;
}

/* Launches are rounded up to whole work-groups. */
#define GUARD              \
  if (item_of(0) >= count) \
    return

TFM_INLINE Ints every_lane(void)
{
  return floats(0.0f) == 0.0f;
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

TFM_INLINE Vec3 load3(__global const float *values, int stride, int at, int count)
{
  return vec3(load(values, stride, at, count), load(values, stride, at + 1, count), load(values, stride, at + 2, count));
}

/* Six numbers an item: origin and direction. */
TFM_INLINE Ray load_ray(__global const float *rays, int stride, int count)
{
  Ray ray;
  ray.origin = load3(rays, stride, 0, count);
  ray.direction = load3(rays, stride, 3, count);
  return ray;
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

/* Begin and end; where nothing is left both are 0. */
TFM_INLINE void store_interval(__global float *values, int stride, int at, int count, Ints left, Interval interval)
{
  store(values, stride, at, count, left ? interval.begin : floats(0.0f));
  store(values, stride, at + 1, count, left ? interval.end : floats(0.0f));
}

#endif
