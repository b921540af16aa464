/* Test-only kernels around homogeneous.h and what of camera_ray.h cuts rays. Requires: what these do. */
#include "view/camera_ray.h"
#include "items.h"

/* [count, 8]: ray and interval, to [count, 2]. */
__kernel void call_body_clip(BODY bodies, __global const float *given, __global float *found, int count)
{
  GUARD;
  Interval interval = {load(given, 8, 6, count), load(given, 8, 7, count)};
  const Ints left = TFM_BODY_CLIP(bodies, load_ray(given, 8, count), &interval);
  store_interval(found, 2, 0, count, left, interval);
}

/* [count, 10]: ray, interval and a stretch, to [count, 2 + TFM_MEDIA * TFM_AMOUNTS]: hull and amounts. Each amount
   starts at 1, which has to stay. */
__kernel void call_add_bodies(BODY bodies, __global const float *given, __global float *found, int count)
{
  GUARD;
  const int width = 2 + TFM_MEDIA * TFM_AMOUNTS;
  const Interval interval = {load(given, 10, 6, count), load(given, 10, 7, count)};
  BodiesOnRay on_ray;
  Interval hull;
  const Ints meets = bodies_on_ray(bodies, load_ray(given, 10, count), interval, &on_ray, &hull);
  store_interval(found, width, 0, count, meets, hull);
  Amounts amounts;
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      amounts.of[m][c] = floats(1.0f);
  add_bodies(bodies, &on_ray, load(given, 10, 8, count), load(given, 10, 9, count), &amounts);
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      store(found, width, 2 + TFM_AMOUNTS * m + c, count, amounts.of[m][c]);
}

/* [count, 7]: ray to a point at parameter 1, and its length, to [count, TFM_BODIES]. */
__kernel void call_ways_to_light(BODY bodies, __global const float *given, __global float *found, int from_inside,
                                 int to_inside, int count)
{
  GUARD;
  Floats ways[TFM_BODIES];
  ways_to_light(bodies, load_ray(given, 7, count), load(given, 7, 6, count), from_inside, to_inside, ways);
  for (int i = 0; i < TFM_BODIES; ++i)
    store(found, TFM_BODIES, i, count, ways[i]);
}

/* [count, 12]: rays of light to two points, to [count]. */
__kernel void call_is_smooth(BODY bodies, __global const float *given, __global float *found, float ratio, int count)
{
  GUARD;
  const Ray first = {load3(given, 12, 0, count), load3(given, 12, 3, count)};
  const Ray last = {load3(given, 12, 6, count), load3(given, 12, 9, count)};
  const Ints smooth = TFM_BODY_IS_SMOOTH(bodies, first, last, ratio);
  store(found, 1, 0, count, smooth ? floats(1.0f) : floats(0.0f));
}

/* [count, 2]: optical depth and length, to [count]. */
__kernel void call_mean_distance(__global const float *given, __global float *found, int count)
{
  GUARD;
  store(found, 1, 0, count, mean_distance(load(given, 2, 0, count), load(given, 2, 1, count)));
}

/* [count, 5]: interval, and the grids' with whether it is met, to [count, STRETCHES, 3]: each stretch and its steps. */
__kernel void call_split_at_grids(__global const float *given, __global float *found, int steps, int count)
{
  GUARD;
  const Interval whole = {load(given, 5, 0, count), load(given, 5, 1, count)};
  MediaOnRay media;
  media.grids.begin = load(given, 5, 2, count);
  media.grids.end = load(given, 5, 3, count);
  media.meets_grids = load(given, 5, 4, count) > 0.0f;
  Interval stretch[STRETCHES];
  split_at_grids(&media, whole, stretch);
  for (int i = 0; i < STRETCHES; ++i) {
    store(found, 3 * STRETCHES, 3 * i, count, stretch[i].begin);
    store(found, 3 * STRETCHES, 3 * i + 1, count, stretch[i].end);
    store(found, 3 * STRETCHES, 3 * i + 2, count, TO_FLOATS(steps_of_stretch(stretch[i], whole, steps)));
  }
}
