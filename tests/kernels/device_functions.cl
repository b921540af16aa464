/* Test-only kernels: one around each device function, so that it can be compared with float64 NumPy. */
#include "map.h"
#include "sampling.h"
#include "volume.h"

__kernel void call_density_at(__constant const Params *params, __global const float *voxels,
                              __global const float *points, __global float *densities)
{
  const size_t i = get_global_id(0);
  densities[i] = density_at(padded_grid(params, voxels), transform_point(params->index_from_world, vload3(i, points)));
}

__kernel void call_march_optical_depth(__constant const Params *params, __global const float *voxels,
                                       __global const float *origins, __global const float *directions,
                                       __global float *optical_depths, float begin, float end, int steps)
{
  const size_t i = get_global_id(0);
  const Ray ray = {vload3(i, origins), vload3(i, directions)};
  optical_depths[i] = march_optical_depth(padded_grid(params, voxels), index_ray(params, ray), begin, end, steps);
}

/* Misses are written as begin = end = 0. */
__kernel void call_medium_clip(__constant const Params *params, __global const float *origins,
                               __global const float *directions, __global float2 *intervals)
{
  const size_t i = get_global_id(0);
  const Ray ray = {vload3(i, origins), vload3(i, directions)};
  Interval interval = {0.0f, INFINITY};
  const int hit = medium_clip(params, index_ray(params, ray), &interval);
  intervals[i] = hit ? (float2)(interval.begin, interval.end) : (float2)(0.0f);
}

__kernel void call_light_clip(__constant const Params *params, __global const float *origins,
                              __global const float *directions, __global float2 *intervals)
{
  const size_t i = get_global_id(0);
  const Ray ray = {vload3(i, origins), vload3(i, directions)};
  Interval interval = {0.0f, INFINITY};
  const int hit = light_clip(params, ray, &interval);
  intervals[i] = hit ? (float2)(interval.begin, interval.end) : (float2)(0.0f);
}

__kernel void call_light_at(__constant const Params *params, __global const float *points,
                            __global float *uv_distance, __global float *radiance)
{
  const size_t i = get_global_id(0);
  const LightSample sample = light_at(params, vload3(i, points));
  vstore3((float3)(sample.uv, sample.distance), i, uv_distance);
  vstore3(sample.radiance, i, radiance);
}

__kernel void call_light_texel_ray(__constant const Params *params, __global const float2 *uvs,
                                   __global float *directions)
{
  const size_t i = get_global_id(0);
  vstore3(light_texel_ray(params, uvs[i]).direction, i, directions);
}

__kernel void call_phase_eval(__constant const Params *params, __global const float *mus,
                              __global float *values)
{
  const size_t i = get_global_id(0);
  values[i] = phase_eval(params, mus[i]);
}

__kernel void call_warp_fraction(__global const float2 *depths, __global const float *fractions,
                                 __global float *warped, float max_stretch)
{
  const size_t i = get_global_id(0);
  warped[i] = warp_fraction(projective_warp(depths[i].x, depths[i].y, max_stretch), fractions[i]);
}

/* Optical depths of one ray, [steps], to coefficients. */
__kernel void call_basis_project(__constant const Params *params, __global const float *optical_depths,
                                 __global float *coefficients, int steps)
{
  const size_t i = get_global_id(0);
  BasisState state;
  basis_begin(&state);
  for (int n = 0; n < steps; ++n)
    basis_add(params, &state, ((float)n + 0.5f) / (float)steps, 1.0f / (float)steps,
              optical_depths[i * (size_t)steps + (size_t)n]);
  float c[TFM_N_COEFF];
  basis_finish(params, &state, c);
  for (int j = 0; j < TFM_N_COEFF; ++j)
    coefficients[i * (size_t)TFM_N_COEFF + (size_t)j] = c[j];
}

__kernel void call_basis_optical_depth(__constant const Params *params, __global const float *coefficients,
                                       __global const float *us, __global float *optical_depths)
{
  const size_t i = get_global_id(0);
  float c[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j)
    c[j] = coefficients[i * (size_t)TFM_N_COEFF + (size_t)j];
  optical_depths[i] = basis_optical_depth(params, c, us[i]);
}

__kernel void call_map_storage(__global const float *values, __global const float2 *ranges,
                               __global MapStorage *map, __global float *loaded)
{
  const size_t i = get_global_id(0);
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    map_store(map, ranges, i, j, values[i * (size_t)TFM_N_COEFF + (size_t)j]);
    loaded[i * (size_t)TFM_N_COEFF + (size_t)j] = map_load(map, ranges, i, j);
  }
}

__kernel void call_opacity_of(__global const float *optical_depths, __global float *opacities)
{
  const size_t i = get_global_id(0);
  opacities[i] = opacity_of(optical_depths[i]);
}
