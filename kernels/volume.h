/* The medium's density: trilinear between voxel centres, 0 outside.
   The grid carries one zero voxel on each side, so that it falls to 0 over one voxel and a sample needs no
   bounds test beyond the clamp. */
#ifndef TFM_VOLUME_H
#define TFM_VOLUME_H

#include "ray.h"

/* A world ray in the padded grid's index space. */
inline Ray index_ray(__constant const Params *params, Ray world_ray)
{
  return transform_ray(params->index_from_world, world_ray);
}

/* The part of a ray, given in index space, that lies in the medium's bounds; 0 when there is none. */
inline int medium_clip(__constant const Params *params, Ray ray, Interval *interval)
{
  const float3 upper = (float3)((float)(params->grid_size[0] - 1), (float)(params->grid_size[1] - 1),
                                (float)(params->grid_size[2] - 1));
  return box_clip(ray, upper, interval);
}

/* The grid with all that a sample needs of it, read once before a loop. */
typedef struct {
  __global const float *voxels;
  int row;       /* voxels to the next y */
  int slice;     /* voxels to the next z */
  float3 upper;  /* largest coordinates */
  int3 last;     /* lowest corner of the last cell */
  float density_scale;
} Grid;

inline Grid padded_grid(__constant const Params *params, __global const float *voxels)
{
  const int3 size = vload3(0, params->grid_size);
  Grid grid;
  grid.voxels = voxels;
  grid.row = size.x;
  grid.slice = size.x * size.y;
  grid.upper = convert_float3(size - 1);
  grid.last = size - 2;
  grid.density_scale = params->density_scale;
  return grid;
}

/* Density D at a point of the padded grid's index space. */
inline float density_at(Grid grid, float3 point)
{
  const float3 p = clamp(point, 0.0f, grid.upper);
  const int3 i = min(convert_int3(p), grid.last);
  const float3 f = p - convert_float3(i);
  __global const float *low = grid.voxels + (i.z * grid.slice + i.y * grid.row + i.x);
  __global const float *high = low + grid.slice;
  const float low_near = lerp(low[0], low[1], f.x);
  const float low_far = lerp(low[grid.row], low[grid.row + 1], f.x);
  const float high_near = lerp(high[0], high[1], f.x);
  const float high_far = lerp(high[grid.row], high[grid.row + 1], f.x);
  return grid.density_scale * lerp(lerp(low_near, low_far, f.y), lerp(high_near, high_far, f.y), f.z);
}

/* Largest optical depth kept: products with a zero coefficient stay 0 instead of NaN. */
#define TFM_MAX_OPTICAL_DEPTH 1e30f

/* Optical depth of the density (sigma_t = 1) from begin to end, by the midpoint rule. */
inline float march_optical_depth(Grid grid, Ray ray, float begin, float end, int steps)
{
  const float step = (end - begin) / (float)steps;
  float sum = 0.0f;
  for (int n = 0; n < steps; ++n)
    sum += density_at(grid, ray_at(ray, begin + ((float)n + 0.5f) * step));
  return fmin(sum * step, TFM_MAX_OPTICAL_DEPTH);
}

/* 1 - e^-tau for tau >= 0, to a few ulp also where it is small; expm1 costs several times as much. */
inline float opacity_of(float optical_depth)
{
  const float t = fmin(optical_depth, 0.25f);
  const float series =
      t * (1.0f - t / 2.0f * (1.0f - t / 3.0f * (1.0f - t / 4.0f * (1.0f - t / 5.0f * (1.0f - t / 6.0f)))));
  return optical_depth < 0.25f ? series : 1.0f - exp(-optical_depth);
}

inline float3 opacity_of_rgb(float3 optical_depth)
{
  return (float3)(opacity_of(optical_depth.x), opacity_of(optical_depth.y), opacity_of(optical_depth.z));
}

#endif
