/* Light pass: TFM algorithm 2 as corrected (midpoints, normalisation, a miss is T = 1; what a solid shadows keeps the T
   that reaches the solid, so that its neighbours may be interpolated with it: the shadow map darkens it).
   Includes expected before: a basis header, a light header. Requires: what they, walk.h and map/lookup.h do; light
   passes know of one field only. */
#include "body/walk.h"
#include "core/store.h"
#include "map/lookup.h"
#if TFM_OWN_DEPTH
#include "map/own_depth.h"
#endif

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

/* Number of this work-item's tile among those of the launch. */
TFM_INLINE size_t tile_number(int4 window)
{
  const size_t tiles_x = (size_t)((window.z - window.x + TILE_WIDTH - 1) / TILE_WIDTH);
  return get_global_id(1) * tiles_x + get_global_id(0);
}

/* The part of a texel's ray that its numbers speak of; the lanes in which there is one. */
TFM_INLINE Ints texel_range(GRID grids, LIGHT light, MAP map, __global const float4 *ranges, Texels texels, Interval *part)
{
#if TFM_RANGE
  (void)grids;
  (void)light;
  const RayRange range = map_range(map, ranges, texels.u, texels.v);
  part->begin = range.begin;
  part->end = range.end;
  return range.begin < range.end;
#else
  (void)map;
  (void)ranges;
  const GridRay ray = index_ray(grids, light_texel_ray(light, texels.u, texels.v));
  return light_medium_interval(grids, &ray, part);
#endif
}

/* Short ranges take fewer steps: eighths of those of the longest range. A block of texels decides as one, so that the
   map does not depend on how many lanes a work-item has. */
#define BLOCK_TEXELS 4

TFM_INLINE int steps_of_level(int steps, int level)
{
  return (steps * level + MARCH_LEVELS - 1) / MARCH_LEVELS;
}

TFM_INLINE int march_level(MAP map, __global const float4 *ranges, Texels texels)
{
#if TFM_RANGE
  const float width = (float)BLOCK_TEXELS / (float)map->res;
  const RayRange range = map_range(map, ranges, (TO_FLOATS(texels.x / BLOCK_TEXELS) + 0.5f) * width,
                                   (TO_FLOATS(texels.y / BLOCK_TEXELS) + 0.5f) * width);
  const Floats part = (range.end - range.begin) * map->longest_range_inverse;
  const Ints level = rounded_up(sqrt(clamp_to(part, 1.0f)) * (float)MARCH_LEVELS);
  const int longest = -least_int(-level);
  /* Two steps a number at least. */
  const int needed = (2 * TFM_N_COEFF * MARCH_LEVELS + map->steps - 1) / map->steps;
  const int chosen = longest > needed ? longest : needed;
  return chosen < MARCH_LEVELS ? chosen : MARCH_LEVELS;
#else
  (void)map;
  (void)ranges;
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

/* c: of each lane's texel. */
TFM_INLINE void store_coefficients(__global float *coefficients, Ints texel, Ints inside, const Floats *c)
{
#if TFM_LANES > 1
  if (all_lanes(inside)) {
    int j = 0;
#define STORED(s) (coefficients + (size_t)LANE(texel, s) * TFM_N_COEFF + j)
#define FOUR(s) (float4)(LANE(c[j], s), LANE(c[j + 1], s), LANE(c[j + 2], s), LANE(c[j + 3], s))
#define STORE4(p, i, s) (*(__global Unaligned4 *)STORED(s) = FOUR(s), 0)
#define STORE1(p, i, s) (*STORED(s) = LANE(c[j], s), 0)
    for (; j + 4 <= TFM_N_COEFF; j += 4)
      (void)(Ints)FOR_LANES(STORE4, 0, 0);
    for (; j < TFM_N_COEFF; ++j)
      (void)(Ints)FOR_LANES(STORE1, 0, 0);
    return;
  }
#endif
  FloatArray stored[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j)
    stored[j].lanes = c[j];
  EACH_WANTED_LANE(texel, inside)
    for (int j = 0; j < TFM_N_COEFF; ++j)
      coefficients[(size_t)texel_lanes.lane[lane] * TFM_N_COEFF + (size_t)j] = stored[j].lane[lane];
}

/* Projects the transmittance of every light ray onto the basis.
   map           what is decided of the map
   ranges        of the rays, where they are not the grids' bounds
   tables        what the basis needs for each step of a march of 1/8, 2/8 ... of the steps, one after the other
   table_starts  where each begins; with TFM_OWN_DEPTH, of one more table (own_depth.h)
   clip          [res, res]: distance from the light beyond which a texel's ray lights nothing (with TFM_SHADOW only)
   coefficients  out, [res, res, n], from map->first_number on
   occupied      out, [res, res]: where density begins and ends along the ray, distances from the light; 0 without
   counts        out, a tile each: the texels whose ray meets the medium's bounds, and the densities read
   window        x0, y0, x1, y1 of the texels of this launch; x0 and y0 where tiles begin */
__kernel void light_pass(GRID_ARGUMENTS, LIGHT light, MAP map, __global const float4 *ranges,
                         __global const float *tables, __global const int *table_starts,
                         __global const float *clip, __global float *coefficients, __global float2 *occupied,
                         __global uint2 *counts, int4 window)
{
  const int res = map->res;
  const Texels texels = tile_texels(res, window);
  if (!any_lane(texels.inside))
    return;
#if !TFM_SHADOW
  (void)clip;
#endif
  const Ints texel = texels.y * res + texels.x;
  __global uint2 *counted = counts + tile_number(window);
  coefficients += (size_t)map->first_number * NUMBERS_UNIT;
  Interval part;
  const Ints active = texels.inside & texel_range(grids, light, map, ranges, texels, &part);
  if (!any_lane(active)) {
    Floats clear[TFM_N_COEFF];
    for (int j = 0; j < TFM_N_COEFF; ++j)
      clear[j] = floats(clear_coefficient(j));
    store_coefficients(coefficients, texel, texels.inside, clear);
    store_float2(occupied, texel, texels.inside, floats(0.0f), floats(0.0f));
    *counted = (uint2)(0, 0);
    return;
  }
  const int level = march_level(map, ranges, texels);
  const int most = steps_of_level(map->steps, level);
  __global const float *table = tables + table_starts[level - 1];
  BasisState state;
  basis_begin(&state);
  Ints first = ints(most), last = ints(-1), samples = ints(0); /* steps with density */
  const GridRay ray = index_ray(grids, light_texel_ray(light, texels.u, texels.v));
  PADDED_GRIDS(padded, texels.x, texels.y);
  const Floats length = part.end - part.begin;
#if TFM_SHADOW
  /* Behind a solid nothing is lit: k_out. Every ray takes the step that holds it to the end, and walks one more, which
     finds nothing: a full step changes the one after it too. */
  const Floats open = clamp_to((texel_clip(texels, res, clip) - part.begin) / length, 1.0f) * (float)most;
  const Ints taken_steps = TO_INTS(open) + 1 < most ? TO_INTS(open) + 1 : ints(most);
  const Ints walked = taken_steps < most ? taken_steps + 1 : taken_steps;
  Walk walk = walk_from(&padded, &ray, part.begin, length * TO_FLOATS(walked) * (1.0f / (float)most), no_warp(), 0,
                        walked, active);
#else
  const Ints taken_steps = ints(most);
  Walk walk = walk_from(&padded, &ray, part.begin, length, no_warp(), 0, taken_steps, active);
#endif
#if TFM_OWN_DEPTH
  walk.deposits = 0;
#endif
  Floats optical_depth = floats(0.0f);
  Steps list = no_steps();
  LightSteps steps;
  /* The second half of a full step still changes the one after it, even if that is empty. */
  while (find_steps(&padded, &walk, active, 1, &list)) {
    steps.count = list.count;
    for (int k = 0; k < list.count; ++k) {
      steps.n[k] = list.n[k];
      const Floats density = densities_at(&padded, &walk, &list, k, place_of(&walk, list.n[k]).t, &samples).of[0][0];
#if TFM_SHADOW
      const Ints taken = active & (list.n[k] < taken_steps);
#else
      const Ints taken = active;
#endif
      steps.depth[k] = taken ? walk.step * density : floats(0.0f);
      const Ints dense = steps.depth[k] > 0.0f, number = ints(list.n[k]);
      first = (dense & (number < first)) ? number : first;
      last = dense ? number : last;
    }
    for (int k = 0; k < list.count; ++k) {
      steps.before[k] = optical_depth;
      steps.depth[k] = least(steps.depth[k], TFM_MAX_OPTICAL_DEPTH - optical_depth);
      optical_depth += steps.depth[k];
    }
    basis_steps(map, table, &state, &steps, most);
  }
  Interval held;
  held.begin = last >= 0 ? part.begin + TO_FLOATS(first) * walk.step : floats(INFINITY);
  held.end = last >= 0 ? part.begin + TO_FLOATS(last + 1) * walk.step : floats(0.0f);
#if TFM_OWN_DEPTH
#if TFM_SHADOW
  const Floats reach = texel_clip(texels, res, clip);
#else
  const Floats reach = floats(INFINITY);
#endif
  samples += add_at_own_depth(&padded.lists, ray.world, part, reach, tables + table_starts[MARCH_LEVELS], active, &state,
                              &held);
#endif
  Floats c[TFM_N_COEFF];
  basis_finish(map, table, active, &state, most, c);

  const Ints dense = active & (held.end > 0.0f);
  store_float2(occupied, texel, texels.inside, dense ? greatest(held.begin, part.begin) : floats(0.0f),
               dense ? least(held.end, part.end) : floats(0.0f));
  store_coefficients(coefficients, texel, texels.inside, c);
  *counted = (uint2)(sum_of_lanes(ints(1), active), sum_of_lanes(samples, active));
}

/* The lowest and the highest value of each coefficient, which are its limits in 8 bits; the host joins the parts.
   coefficients  [count, n]
   lowest, highest  out, [parts, n]; one work-item a part
   part          texels of each part but the last */
__kernel void coefficient_limits(__global const float *coefficients, __global float *lowest, __global float *highest,
                                 int part, int count)
{
  const size_t number = get_global_id(0);
  const size_t first = number * (size_t)part;
  if (first >= (size_t)count)
    return;
  const size_t end = min(first + (size_t)part, (size_t)count);
  float low[TFM_N_COEFF], high[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j)
    low[j] = high[j] = coefficients[first * TFM_N_COEFF + (size_t)j];
  for (size_t texel = first + 1; texel < end; ++texel)
    for (int j = 0; j < TFM_N_COEFF; ++j) {
      const float value = coefficients[texel * TFM_N_COEFF + (size_t)j];
      low[j] = value < low[j] ? value : low[j];
      high[j] = value > high[j] ? value : high[j];
    }
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    lowest[number * TFM_N_COEFF + (size_t)j] = low[j];
    highest[number * TFM_N_COEFF + (size_t)j] = high[j];
  }
}

/* Store float coefficients in fewer bits. One work-item per texel.
   coefficients  [count, n], from 0 on
   numbers       out, from map->first_number on
   limits        lowest value and extent of each coefficient (8 bits only)
   scale         1 / the unit in which they are stored */
__kernel void pack_map(MAP map, __global const float *coefficients, __global MapStorage *numbers,
                       __global const float2 *limits, float scale, int count)
{
  if ((int)get_global_id(0) >= count)
    return;
  const size_t first = get_global_id(0) * TFM_N_COEFF, begin = (size_t)map->first_number * NUMBERS_UNIT;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    map_store(numbers, limits, begin + first + (size_t)j, j, scale * coefficients[first + (size_t)j]);
}

/* Optical depth of the density between the light and world points; -1 where the light does not reach.
   One work-item per point. */
__kernel void evaluate_map(GRID grids, LIGHT light, MAP_ARGUMENTS, __global const float *points,
                           __global float *optical_depths, int count)
{
  const size_t i = get_global_id(0);
  if ((int)i >= count)
    return;
  const Maps all = MAP_BUFFERS;
  const Vec3 point = vec3(floats(points[3 * i]), floats(points[3 * i + 1]), floats(points[3 * i + 2]));
  FloatArray depth;
  const MapPlace place = map_place(grids, light, &all, maps, point, light_at(light, point_in_light(light, point)));
  depth.lanes = map_optical_depth(&all, maps, place);
  depth.lanes = light_reaches(light, point) ? depth.lanes : floats(-1.0f);
  optical_depths[i] = depth.lane[0];
}

/* How far the map is from its own light rays: T is marched between the medium's bounds and compared at every step.
   clip       as of light_pass
   residuals  out, [res, res]: the integrals of D (T_map - T)^2 and of D T^2 along the texel's ray
   steps      of this march */
__kernel void map_residual(GRID_ARGUMENTS, LIGHT light, MAP_ARGUMENTS,
                           __global const float *clip, __global float2 *residuals, int steps, int4 window)
{
  const Maps all = MAP_BUFFERS;
  const int res = maps->res;
  const Texels texels = tile_texels(res, window);
  if (!any_lane(texels.inside))
    return;
  const Ray world_ray = light_texel_ray(light, texels.u, texels.v);
  const GridRay ray = index_ray(grids, world_ray);
  Interval bounds;
  Ints active = texels.inside & light_medium_interval(grids, &ray, &bounds);
#if TFM_SHADOW
  bounds.end = least(bounds.end, texel_clip(texels, res, clip));
  active &= bounds.begin < bounds.end;
#else
  (void)clip;
#endif
  Floats error = floats(0.0f), lit = floats(0.0f);
  if (any_lane(active)) {
    PADDED_GRIDS(padded, texels.x, texels.y);
    const Walk walk =
        walk_from(&padded, &ray, bounds.begin, bounds.end - bounds.begin, no_warp(), 0, ints(steps), active);
    Floats optical_depth = floats(0.0f);
    Ints samples = ints(0);
    Steps list = no_steps();
    while (find_steps(&padded, &walk, active, 0, &list))
      for (int k = 0; k < list.count; ++k) {
        const Floats t = place_of(&walk, list.n[k]).t;
        const Floats density = densities_at(&padded, &walk, &list, k, t, &samples).of[0][0];
        const Floats depth = active ? walk.step * density : floats(0.0f);
        LightSample sample;
        sample.u = texels.u;
        sample.v = texels.v;
        sample.distance = t;
        const MapPlace place = map_place(grids, light, &all, maps, ray_at(world_ray, t), sample);
        const Floats found = map_optical_depth(&all, maps, place);
        const Floats exact =
            transmittance_of(maps->reference_extinction * (optical_depth + 0.5f * depth));
        const Floats difference = transmittance_of(maps->reference_extinction * found) - exact;
        error += depth * difference * difference;
        lit += depth * exact * exact;
        optical_depth = least(optical_depth + depth, floats(TFM_MAX_OPTICAL_DEPTH));
      }
  }
  store_float2(residuals, texels.y * res + texels.x, texels.inside, error, lit);
}
