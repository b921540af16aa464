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

/* Density D at a point of the padded grid's index space. */
inline float density_at(__constant const Params *params, __global const float *grid, float3 point)
{
  const int nx = params->grid_size[0];
  const int ny = params->grid_size[1];
  const int nz = params->grid_size[2];
  const float x = clamp(point.x, 0.0f, (float)(nx - 1));
  const float y = clamp(point.y, 0.0f, (float)(ny - 1));
  const float z = clamp(point.z, 0.0f, (float)(nz - 1));
  const int ix = min((int)x, nx - 2);
  const int iy = min((int)y, ny - 2);
  const int iz = min((int)z, nz - 2);
  const float fx = x - (float)ix;
  const float fy = y - (float)iy;
  const float fz = z - (float)iz;
  __global const float *low = grid + ((size_t)iz * (size_t)ny + (size_t)iy) * (size_t)nx + (size_t)ix;
  __global const float *high = low + (size_t)ny * (size_t)nx;
  const float low_near = mix(low[0], low[1], fx);
  const float low_far = mix(low[nx], low[nx + 1], fx);
  const float high_near = mix(high[0], high[1], fx);
  const float high_far = mix(high[nx], high[nx + 1], fx);
  return params->density_scale * mix(mix(low_near, low_far, fy), mix(high_near, high_far, fy), fz);
}

/* Largest optical depth kept: products with a zero coefficient stay 0 instead of NaN. */
#define TFM_MAX_OPTICAL_DEPTH 1e30f

/* Optical depth of the density (sigma_t = 1) from begin to end, by the midpoint rule. */
inline float march_optical_depth(__constant const Params *params, __global const float *grid, Ray ray,
                                 float begin, float end, int steps)
{
  const float step = (end - begin) / (float)steps;
  float sum = 0.0f;
  for (int n = 0; n < steps; ++n)
    sum += density_at(params, grid, ray_at(ray, begin + ((float)n + 0.5f) * step));
  return fmin(sum * step, TFM_MAX_OPTICAL_DEPTH);
}

#endif
