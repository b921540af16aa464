/* Light pass: TFM algorithm 2 as corrected (midpoints, normalisation, a miss is T = 1).
   Includes expected before: Params, a basis header, a light header. Requires: what they and map.h do. */
#include "map.h"
#include "walk.h"

/* The texels of this work-item's tile; launches cover the map in windows x0, y0, x1, y1. */
typedef struct {
  Ints x, y;
  Ints inside;
  Floats u, v;
} Texels;

TFM_INLINE Texels tile_texels(int res, int4 window)
{
  Texels texels;
  texels.x = window.x + (int)get_global_id(0) * TILE_WIDTH + LANE_X;
  texels.y = window.y + (int)get_global_id(1) * TILE_HEIGHT + LANE_Y;
  texels.inside = (texels.x < window.z) & (texels.y < window.w);
  texels.u = (TO_FLOATS(texels.x) + 0.5f) / (float)res;
  texels.v = (TO_FLOATS(texels.y) + 0.5f) / (float)res;
  return texels;
}

/* Projects the transmittance of every light ray onto the basis.
   table         what the basis needs for each step
   coefficients  out, [res, res, n]
   occupied      out, [res, res]: the first step with density and the one after the last; equal when there is none
   counts        out, a tile each: the texels whose ray meets the medium's bounds, and the densities read
   window        x0, y0, x1, y1 of the texels of this launch; x0 and y0 where tiles begin */
__kernel void light_pass(__constant const Params *params, GRID_ARGUMENTS, __global const float *table,
                         __global float *coefficients, __global int2 *occupied, __global uint2 *counts, int4 window)
{
  const int res = params->map_res;
  const Texels texels = tile_texels(res, window);
  if (!any_lane(texels.inside))
    return;
  const Ray ray = index_ray(params, light_texel_ray(params, texels.u, texels.v));
  Interval medium;
  const Ints active = texels.inside & light_medium_interval(params, ray, &medium);

  BasisState state;
  basis_begin(&state);
  Ints first = ints(0), end = ints(0), samples = ints(0);
  if (any_lane(active)) {
    PADDED_GRID(grid);
    const Walk walk = walk_from(ray, medium.begin, medium.end - medium.begin, no_warp(), 0,
                                ints(params->light_steps), active);
    const Floats half_step = 0.5f * walk.step;
    Floats optical_depth = floats(0.0f), half_depth = floats(0.0f);
    Steps steps = no_steps();
    /* The second half of a full step still changes the one after it, even if that is empty. */
    while (find_steps(&grid, &walk, active, 1, &steps)) {
      Floats density[MOST_STEPS];
      for (int k = 0; k < steps.count; ++k)
        density[k] = density_at(&grid, &walk, &steps, k, place_of(&walk, steps.n[k]).t, &samples);
      for (int k = 0; k < steps.count; ++k) {
        const int n = steps.n[k];
        optical_depth += half_depth;
        half_depth = half_step * density[k];
        optical_depth = least(optical_depth + half_depth, floats(TFM_MAX_OPTICAL_DEPTH));
        basis_change(params, table, &state, n, optical_depth);
        const Ints dense = half_depth > 0.0f;
        first = (dense & (end == 0)) ? ints(n) : first;
        end = dense ? ints(n + 1) : end;
      }
    }
  }
  Floats c[TFM_N_COEFF];
  basis_finish(params, active, &state, c);

  FloatArray stored[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j)
    stored[j].lanes = c[j];
  IntArray x, y, inside, meets, taken, from, to;
  x.lanes = texels.x;
  y.lanes = texels.y;
  inside.lanes = texels.inside ? ints(1) : ints(0);
  meets.lanes = active ? ints(1) : ints(0);
  taken.lanes = active ? samples : ints(0);
  from.lanes = active ? first : ints(0);
  to.lanes = active ? end : ints(0);
  uint met = 0, read = 0;
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    if (!inside.lane[lane])
      continue;
    const size_t texel = (size_t)y.lane[lane] * (size_t)res + (size_t)x.lane[lane];
    occupied[texel] = (int2)(from.lane[lane], to.lane[lane]);
    met += (uint)meets.lane[lane];
    read += (uint)taken.lane[lane];
    for (int j = 0; j < TFM_N_COEFF; ++j)
      coefficients[texel * TFM_N_COEFF + (size_t)j] = stored[j].lane[lane];
  }
  const size_t tiles_x = (size_t)((window.z - window.x + TILE_WIDTH - 1) / TILE_WIDTH);
  counts[get_global_id(1) * tiles_x + get_global_id(0)] = (uint2)(met, read);
}

/* Optical depth of the density along whole light rays: what density_weighting = auto looks at.
   optical_depths  out, [size, size] */
__kernel void light_optical_depths(__constant const Params *params, GRID_ARGUMENTS, __global float *optical_depths,
                                   int size)
{
  const Texels texels = tile_texels(size, (int4)(0, 0, size, size));
  const Ray ray = index_ray(params, light_texel_ray(params, texels.u, texels.v));
  PADDED_GRID(grid);
  Interval k;
  const Ints active = texels.inside & light_medium_interval(params, ray, &k);
  Ints samples = ints(0);
  FloatArray depth;
  depth.lanes = march_optical_depth(&grid, ray, k.begin, k.end, params->light_steps, active, &samples);
  IntArray x, y;
  x.lanes = texels.x;
  y.lanes = texels.y;
  for (int lane = 0; lane < TFM_LANES; ++lane)
    if (x.lane[lane] < size && y.lane[lane] < size)
      optical_depths[y.lane[lane] * size + x.lane[lane]] = depth.lane[lane];
}

/* Store float coefficients in fewer bits. One work-item a texel.
   ranges  lowest value and extent of each coefficient (8 bits only) */
__kernel void pack_map(__global const float *coefficients, __global MapStorage *map, __global const float2 *ranges,
                       int count)
{
  if ((int)get_global_id(0) >= count)
    return;
  const size_t first = get_global_id(0) * TFM_N_COEFF;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    map_store(map, ranges, first + (size_t)j, j, coefficients[first + (size_t)j]);
}

/* Optical depth of the density between the light and world points; -1 where the light does not reach.
   One work-item a point. */
__kernel void evaluate_map(__constant const Params *params, __global const MapStorage *map,
                           __global const float2 *ranges, __global const float *points,
                           __global float *optical_depths, int count)
{
  const size_t i = get_global_id(0);
  if ((int)i >= count)
    return;
  const Vec3 point = vec3(floats(points[3 * i]), floats(points[3 * i + 1]), floats(points[3 * i + 2]));
  FloatArray depth;
  const Ray ray = light_ray_to(params, transform_point(params->index_from_world, point));
  depth.lanes = map_optical_depth(params, map, ranges, map_place(params, ray, light_at(params, point)));
  depth.lanes = light_reaches(params, point) ? depth.lanes : floats(-1.0f);
  optical_depths[i] = depth.lane[0];
}
