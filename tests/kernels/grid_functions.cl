/* Test-only kernels around grid.h and walk.h. Requires: what these do. */
#include "body/walk.h"
#include "items.h"

/* [count, 3] to [count, TFM_MEDIA, TFM_AMOUNTS]. */
__kernel void call_densities_at(GRID_ARGUMENTS, __global const float *points, __global float *found, int count)
{
  GUARD;
  PADDED_GRIDS(padded, ints(-1), ints(-1));
  const Ray still = {load3(points, 3, 0, count), vec3(floats(0.0f), floats(0.0f), floats(0.0f))};
  const GridRay ray = index_ray(grids, still);
  const Walk walk = walk_from(&padded, &ray, floats(0.0f), floats(1.0f), no_warp(), 0, ints(1), every_lane());
  Ints samples = ints(0);
  Steps list = no_steps();
  list.forced = 1;
  Amounts density = no_amounts();
  if (find_steps(&padded, &walk, every_lane(), 1, &list))
    density = densities_at(&padded, &walk, &list, 0, floats(0.5f), &samples);
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      store(found, TFM_MEDIA * TFM_AMOUNTS, TFM_AMOUNTS * m + c, count, density.of[m][c]);
}

/* [count, 6] to [count, TFM_MEDIA, TFM_AMOUNTS]. */
__kernel void call_march_amounts(GRID_ARGUMENTS, __global const float *rays, __global float *found, float begin,
                                 float end, int steps, int count)
{
  GUARD;
  PADDED_GRIDS(padded, ints(-1), ints(-1));
  const GridRay ray = index_ray(grids, load_ray(rays, 6, count));
  Ints samples = ints(0);
  const Amounts met = march_amounts(&padded, &ray, floats(begin), floats(end), steps, floats(1.0f), every_lane(), &samples);
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      store(found, TFM_MEDIA * TFM_AMOUNTS, TFM_AMOUNTS * m + c, count, met.of[m][c]);
}

/* [count, 6] to [count, 2]. */
__kernel void call_grids_clip(GRID grids, __global const float *rays, __global float *found, int count)
{
  GUARD;
  const GridRay ray = index_ray(grids, load_ray(rays, 6, count));
  Interval interval = {floats(0.0f), floats(INFINITY)};
  const Ints left = grids_clip(grids, &ray, &interval);
  store_interval(found, 2, 0, count, left, interval);
}
