/* Light pass: TFM algorithm 2 as corrected (midpoints, normalisation, a miss is T = 1).
   Includes expected before: Params, a basis header, a light header. Requires: TFM_N_COEFF. */
#include "map.h"
#include "volume.h"

/* One work-item a texel; launched in bands of rows.
   coefficients  out, [res, res, n]; hits  counts the texels whose ray meets the medium's bounds. */
__kernel void light_pass(__constant const Params *params, __global const float *voxels,
                         __global float *coefficients, __global uint *hits)
{
  const int res = params->map_res;
  const int ix = (int)get_global_id(0);
  const int iy = (int)get_global_id(1);
  const Grid grid = padded_grid(params, voxels);
  float c[TFM_N_COEFF];
  basis_clear(c);

  const float2 uv = ((float2)((float)ix, (float)iy) + 0.5f) / (float)res;
  const Ray ray = index_ray(params, light_texel_ray(params, uv));
  Interval k;
  if (light_medium_interval(params, ray, &k)) {
    atomic_inc(hits);
    const int steps = params->light_steps;
    const float step = (k.end - k.begin) / (float)steps;
    BasisState state;
    basis_begin(&state);
    float optical_depth = 0.0f;
    for (int n = 0; n < steps; ++n) {
      const float u = ((float)n + 0.5f) / (float)steps;
      const float half_step_depth = 0.5f * step * density_at(grid, ray_at(ray, lerp(k.begin, k.end, u)));
      optical_depth = fmin(optical_depth + half_step_depth, TFM_MAX_OPTICAL_DEPTH);
      basis_add(params, &state, u, 1.0f / (float)steps, optical_depth);
      optical_depth = fmin(optical_depth + half_step_depth, TFM_MAX_OPTICAL_DEPTH);
    }
    basis_finish(params, &state, c);
  }

  const size_t texel = (size_t)iy * (size_t)res + (size_t)ix;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    coefficients[texel * (size_t)TFM_N_COEFF + (size_t)j] = c[j];
}

/* Optical depth of the density along whole light rays, on a square of global_size texels: what
   density_weighting = auto looks at. */
__kernel void light_optical_depths(__constant const Params *params, __global const float *voxels,
                                   __global float *optical_depths)
{
  const float2 size = (float2)((float)get_global_size(0), (float)get_global_size(1));
  const float2 uv = ((float2)((float)get_global_id(0), (float)get_global_id(1)) + 0.5f) / size;
  const Ray ray = index_ray(params, light_texel_ray(params, uv));
  const Grid grid = padded_grid(params, voxels);
  Interval k;
  float optical_depth = 0.0f;
  if (light_medium_interval(params, ray, &k))
    optical_depth = march_optical_depth(grid, ray, k.begin, k.end, params->light_steps);
  optical_depths[get_global_id(1) * get_global_size(0) + get_global_id(0)] = optical_depth;
}

/* Store float coefficients in fewer bits. One work-item a texel.
   ranges  lowest value and extent of each coefficient (8 bits only). */
__kernel void pack_map(__global const float *coefficients, __global MapStorage *map,
                       __global const float2 *ranges)
{
  const size_t texel = get_global_id(0);
  for (int j = 0; j < TFM_N_COEFF; ++j)
    map_store(map, ranges, texel, j, coefficients[texel * (size_t)TFM_N_COEFF + (size_t)j]);
}

/* Optical depth of the density between the light and world points; -1 where the light does not reach. */
__kernel void evaluate_map(__constant const Params *params, __global const MapStorage *map,
                           __global const float2 *ranges, __global const float *points,
                           __global float *optical_depths)
{
  const size_t i = get_global_id(0);
  const float3 point = vload3(i, points);
  optical_depths[i] = -1.0f;
  if (light_reaches(params, point))
    optical_depths[i] = map_optical_depth(params, map, ranges, light_at(params, point));
}
