/* Light pass: TFM algorithm 2 as corrected (midpoints, normalisation, a miss is T = 1; what a solid shadows keeps the T
   that reaches the solid, so that its neighbours may be interpolated with it: the shadow map darkens it).
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

/* The part of a texel's ray that its numbers speak of; the lanes in which there is one. */
TFM_INLINE Ints texel_range(PARAMS params, __global const float4 *field, Texels texels, const GridRay *ray,
                            Interval *part)
{
#if TFM_RANGE
  (void)ray;
  const RayRange range = map_range(params, field, texels.u, texels.v);
  part->begin = range.begin;
  part->end = range.end;
  return range.begin < range.end;
#else
  (void)field;
  return light_medium_interval(params, ray, part);
#endif
}

/* Short ranges take fewer steps: eighths of those of the longest range. A block of texels decides as one, so that the
   map does not depend on how many lanes a work-item has. */
#define MARCH_LEVELS 8
#define BLOCK_TEXELS 4

TFM_INLINE int steps_of_level(int steps, int level)
{
  return (steps * level + MARCH_LEVELS - 1) / MARCH_LEVELS;
}

TFM_INLINE int march_level(PARAMS params, __global const float4 *field, Texels texels)
{
#if TFM_RANGE
  const float width = (float)BLOCK_TEXELS / (float)params->map_res;
  const RayRange range = map_range(params, field, (TO_FLOATS(texels.x / BLOCK_TEXELS) + 0.5f) * width,
                                   (TO_FLOATS(texels.y / BLOCK_TEXELS) + 0.5f) * width);
  const Floats part = (range.end - range.begin) * params->longest_range_inverse;
  const Ints level = rounded_up(sqrt(clamp_to(part, 1.0f)) * (float)MARCH_LEVELS);
  const int longest = -least_int(-level);
  /* Two steps a number at least. */
  const int needed = (2 * TFM_N_COEFF * MARCH_LEVELS + params->light_steps - 1) / params->light_steps;
  const int chosen = longest > needed ? longest : needed;
  return chosen < MARCH_LEVELS ? chosen : MARCH_LEVELS;
#else
  (void)params;
  (void)field;
  (void)texels;
  return MARCH_LEVELS;
#endif
}

#if TFM_SHADOW
TFM_INLINE Floats texel_clip(Texels texels, int res, __global const float *clip)
{
  const Ints texel = texels.y * res + texels.x;
  return gather_floats(clip, texels.inside ? texel : ints(0));
}
#endif

/* Projects the transmittance of every light ray onto the basis.
   field         ranges of the rays, where they are not the medium's bounds
   tables        what the basis needs for each step of a march of 1/8, 2/8 ... of the steps, one after the other
   table_starts  where each begins
   clip          [res, res]: distance from the light beyond which a texel's ray lights nothing (with TFM_SHADOW only)
   coefficients  out, [res, res, n]
   occupied      out, [res, res]: where density begins and ends along the ray, distances from the light; 0 without
   counts        out, a tile each: the texels whose ray meets the medium's bounds, and the densities read
   window        x0, y0, x1, y1 of the texels of this launch; x0 and y0 where tiles begin */
__kernel void light_pass(PARAMS params, GRID_ARGUMENTS, __global const float4 *field,
                         __global const float *tables, __global const int *table_starts,
                         __global const float *clip, __global float *coefficients, __global float2 *occupied,
                         __global uint2 *counts, int4 window)
{
  const int res = params->map_res;
  const Texels texels = tile_texels(res, window);
  if (!any_lane(texels.inside))
    return;
  const GridRay ray = index_ray(params, light_texel_ray(params, texels.u, texels.v));
  Interval part;
  const Ints active = texels.inside & texel_range(params, field, texels, &ray, &part);

#if !TFM_SHADOW
  (void)clip;
#endif
  const int level = march_level(params, field, texels);
  const int most = steps_of_level(params->light_steps, level);
  __global const float *table = tables + table_starts[level - 1];
  BasisState state;
  basis_begin(&state);
  Ints first = ints(0), end = ints(0), samples = ints(0);
  Floats step = floats(0.0f);
  if (any_lane(active)) {
    PADDED_GRID(grid);
    const Floats length = part.end - part.begin;
#if TFM_SHADOW
    /* Behind a solid nothing is lit: k_out. Every ray takes the step that holds it to the end, and walks one more, which
       finds nothing: a full step changes the one after it too. */
    const Floats open = clamp_to((texel_clip(texels, res, clip) - part.begin) / length, 1.0f) * (float)most;
    const Ints taken_steps = TO_INTS(open) + 1 < most ? TO_INTS(open) + 1 : ints(most);
    const Ints walked = taken_steps < most ? taken_steps + 1 : taken_steps;
    const Walk walk = walk_from(&grid, &ray, part.begin, length * TO_FLOATS(walked) * (1.0f / (float)most), no_warp(), 0,
                                walked, active);
#else
    const Ints taken_steps = ints(most);
    const Walk walk = walk_from(&grid, &ray, part.begin, length, no_warp(), 0, taken_steps, active);
#endif
    step = walk.step;
    Floats optical_depth = floats(0.0f);
    Steps list = no_steps();
    LightSteps steps;
    /* The second half of a full step still changes the one after it, even if that is empty. */
    while (find_steps(&grid, &walk, active, 1, &list)) {
      steps.count = list.count;
      for (int k = 0; k < list.count; ++k) {
        steps.n[k] = list.n[k];
        const Floats density = density_at(&grid, &walk, &list, k, place_of(&walk, list.n[k]).t, &samples);
        steps.depth[k] = (active & (list.n[k] < taken_steps)) ? walk.step * density : floats(0.0f);
      }
      for (int k = 0; k < list.count; ++k) {
        const int n = list.n[k];
        const Ints dense = steps.depth[k] > 0.0f;
        first = (dense & (end == 0)) ? ints(n) : first;
        end = dense ? ints(n + 1) : end;
        steps.before[k] = optical_depth;
        steps.depth[k] = least(steps.depth[k], TFM_MAX_OPTICAL_DEPTH - optical_depth);
        optical_depth += steps.depth[k];
      }
      basis_steps(params, table, &state, &steps, most);
    }
  }
  Floats c[TFM_N_COEFF];
  basis_finish(params, table, active, &state, most, c);

  FloatArray stored[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j)
    stored[j].lanes = c[j];
  IntArray x, y, inside, meets, taken;
  FloatArray from, to;
  const Ints dense = active & (end > 0);
  x.lanes = texels.x;
  y.lanes = texels.y;
  inside.lanes = texels.inside ? ints(1) : ints(0);
  meets.lanes = active ? ints(1) : ints(0);
  taken.lanes = active ? samples : ints(0);
  from.lanes = dense ? part.begin + TO_FLOATS(first) * step : floats(0.0f);
  to.lanes = dense ? part.begin + TO_FLOATS(end) * step : floats(0.0f);
  uint met = 0, read = 0;
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    if (!inside.lane[lane])
      continue;
    const size_t texel = (size_t)y.lane[lane] * (size_t)res + (size_t)x.lane[lane];
    occupied[texel] = (float2)(from.lane[lane], to.lane[lane]);
    met += (uint)meets.lane[lane];
    read += (uint)taken.lane[lane];
    for (int j = 0; j < TFM_N_COEFF; ++j)
      coefficients[texel * TFM_N_COEFF + (size_t)j] = stored[j].lane[lane];
  }
  const size_t tiles_x = (size_t)((window.z - window.x + TILE_WIDTH - 1) / TILE_WIDTH);
  counts[get_global_id(1) * tiles_x + get_global_id(0)] = (uint2)(met, read);
}

/* Store float coefficients in fewer bits. One work-item a texel.
   ranges  lowest value and extent of each coefficient (8 bits only)
   scale   1 / the unit in which they are stored */
__kernel void pack_map(__global const float *coefficients, __global MapStorage *map, __global const float2 *ranges,
                       float scale, int count)
{
  if ((int)get_global_id(0) >= count)
    return;
  const size_t first = get_global_id(0) * TFM_N_COEFF;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    map_store(map, ranges, first + (size_t)j, j, scale * coefficients[first + (size_t)j]);
}

/* Optical depth of the density between the light and world points; -1 where the light does not reach.
   One work-item a point. */
__kernel void evaluate_map(PARAMS params, __global const MapStorage *map,
                           __global const float2 *ranges, __global const float4 *field, __global const float *modes,
                           __global const float *points, __global float *optical_depths, int count)
{
  const size_t i = get_global_id(0);
  if ((int)i >= count)
    return;
  const Vec3 point = vec3(floats(points[3 * i]), floats(points[3 * i + 1]), floats(points[3 * i + 2]));
  FloatArray depth;
  const MapPlace place = map_place(params, field, point, light_at(params, point_in_light(params, point)));
  depth.lanes = map_optical_depth(params, map, ranges, modes, place);
  depth.lanes = light_reaches(params, point) ? depth.lanes : floats(-1.0f);
  optical_depths[i] = depth.lane[0];
}

/* How far the map is from its own light rays: T is marched between the medium's bounds and compared at every step.
   clip       as of light_pass
   residuals  out, [res, res]: the integrals of D (T_map - T)^2 and of D T^2 along the texel's ray
   steps      of this march */
__kernel void map_residual(PARAMS params, GRID_ARGUMENTS, __global const MapStorage *map,
                           __global const float2 *ranges, __global const float4 *field, __global const float *modes,
                           __global const float *clip, __global float2 *residuals, int steps, int4 window)
{
  const int res = params->map_res;
  const Texels texels = tile_texels(res, window);
  if (!any_lane(texels.inside))
    return;
  const Ray world_ray = light_texel_ray(params, texels.u, texels.v);
  const GridRay ray = index_ray(params, world_ray);
  Interval bounds;
  Ints active = texels.inside & light_medium_interval(params, &ray, &bounds);
#if TFM_SHADOW
  bounds.end = least(bounds.end, texel_clip(texels, res, clip));
  active &= bounds.begin < bounds.end;
#else
  (void)clip;
#endif
  Floats error = floats(0.0f), light = floats(0.0f);
  if (any_lane(active)) {
    PADDED_GRID(grid);
    const Walk walk =
        walk_from(&grid, &ray, bounds.begin, bounds.end - bounds.begin, no_warp(), 0, ints(steps), active);
    Floats optical_depth = floats(0.0f);
    Ints samples = ints(0);
    Steps list = no_steps();
    while (find_steps(&grid, &walk, active, 0, &list))
      for (int k = 0; k < list.count; ++k) {
        const Floats t = place_of(&walk, list.n[k]).t;
        const Floats density = density_at(&grid, &walk, &list, k, t, &samples);
        const Floats depth = active ? walk.step * density : floats(0.0f);
        LightSample sample;
        sample.u = texels.u;
        sample.v = texels.v;
        sample.distance = t;
        const MapPlace place = map_place(params, field, ray_at(world_ray, t), sample);
        const Floats found = map_optical_depth(params, map, ranges, modes, place);
        const Floats exact =
            transmittance_of(params->reference_extinction * (optical_depth + 0.5f * depth));
        const Floats difference = transmittance_of(params->reference_extinction * found) - exact;
        error += depth * difference * difference;
        light += depth * exact * exact;
        optical_depth = least(optical_depth + depth, floats(TFM_MAX_OPTICAL_DEPTH));
      }
  }
  FloatArray errors, lights;
  IntArray x, y, inside;
  errors.lanes = error;
  lights.lanes = light;
  x.lanes = texels.x;
  y.lanes = texels.y;
  inside.lanes = texels.inside ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane)
    if (inside.lane[lane])
      residuals[(size_t)y.lane[lane] * (size_t)res + (size_t)x.lane[lane]] =
          (float2)(errors.lane[lane], lights.lane[lane]);
}
