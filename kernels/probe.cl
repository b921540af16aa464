/* What the host looks at before it builds a light's map: where density lies along coarse light rays, and the optical
   depth along some of them. No map is read or written.
   Includes expected before: a light header. Requires: what walk.h does; light passes know of one field only. */
#include "body/walk.h"
#include "core/store.h"
#include "light/sample.h"

/* Marches the rays of a coarse map between the medium's bounds, in `steps` steps.
   clip     [size, size]: distance beyond which no ray around lights anything (with TFM_SHADOW only)
   ranges   out, [size, size]: where density begins, where it ends or the optical depth reaches `cut`, the optical depth
            per unit length from there to the last density, and the optical depth of the whole ray; begin and end are
            equal without density. Distances from the light.
   lasts    out, [size, size]: where the last density is
   window   x0, y0, x1, y1 of this launch's part of it */
__kernel void light_ranges(GRID_ARGUMENTS, LIGHT light, __global const float *clip, __global float4 *ranges,
                           __global float *lasts, int size,
                           int steps, float cut, int4 window)
{
  const Ints x_lanes = window.x + (int)get_global_id(0) * TILE_WIDTH + LANE_X;
  const Ints y_lanes = window.y + (int)get_global_id(1) * TILE_HEIGHT + LANE_Y;
  const Ints inside_lanes = (x_lanes < window.z) & (y_lanes < window.w);
  if (!any_lane(inside_lanes))
    return;
  const GridRay ray = index_ray(grids, light_texel_ray(light, (TO_FLOATS(x_lanes) + 0.5f) / (float)size,
                                                    (TO_FLOATS(y_lanes) + 0.5f) / (float)size));
  Interval bounds = {floats(0.0f), floats(INFINITY)};
  Ints active = inside_lanes & grids_clip(grids, &ray, &bounds);
#if TFM_SHADOW
  const Ints entry = inside_lanes ? y_lanes * size + x_lanes : ints(0);
  bounds.end = least(bounds.end, gather_floats(clip, entry));
  active &= bounds.begin < bounds.end;
#else
  (void)clip;
#endif
  Floats optical_depth = floats(0.0f), until_cut = floats(0.0f);
  Ints first = ints(0), end = ints(0), last = ints(0), samples = ints(0);
  Floats step = floats(0.0f);
  if (any_lane(active)) {
    PADDED_GRIDS(padded, x_lanes, y_lanes);
    const Walk walk =
        walk_from(&padded, &ray, bounds.begin, bounds.end - bounds.begin, no_warp(), 0, ints(steps), active);
    step = walk.step;
    Steps list = no_steps();
    while (find_steps(&padded, &walk, active, 0, &list))
      for (int k = 0; k < list.count; ++k) {
        const int n = list.n[k];
        const Floats density = densities_at(&padded, &walk, &list, k, place_of(&walk, n).t, &samples).of[0][0];
        const Ints dense = active & (density > 0.0f);
        const Ints kept = dense & ((end == 0) | (optical_depth < cut));
        first = (dense & (last == 0)) ? ints(n) : first;
        last = dense ? ints(n + 1) : last;
        optical_depth = dense ? least(optical_depth + step * density, floats(TFM_MAX_OPTICAL_DEPTH)) : optical_depth;
        end = kept ? ints(n + 1) : end;
        until_cut = kept ? optical_depth : until_cut;
      }
  }
  const Ints dense = last > 0;
  const Floats beyond = TO_FLOATS(last - end) * step;
  /* Density may begin up to half a step before the first step that meets it. */
  const Floats begin_step = TO_FLOATS(first) - 0.5f, end_step = TO_FLOATS(end) + 0.5f;
  const Floats begins = dense ? greatest(bounds.begin + begin_step * step, bounds.begin) : floats(0.0f);
  const Floats ends = dense ? least(bounds.begin + end_step * step, bounds.end) : floats(0.0f);
  const Floats slope = beyond > 0.0f ? (optical_depth - until_cut) / beyond : floats(0.0f);
  const Ints index = y_lanes * size + x_lanes;
  store_float4(ranges, index, inside_lanes, begins, ends, slope, optical_depth);
  store_floats(lasts, index, inside_lanes, dense ? bounds.begin + TO_FLOATS(last) * step : floats(0.0f));
}

#define STEPS_A_CELL 2

/* Optical depth of the density along some rays, at CURVE_CELLS + 1 equal distances; what is before the first counts 0.
   rays    [count]: map position u, v, begin and end (distances from the light); the medium's bounds clip them where
           the end is infinite
   size    rays along a side of the map whose bins list primitives
   curves  out, [count, CURVE_CELLS + 1] */
__kernel void light_curves(GRID_ARGUMENTS, LIGHT light, __global const float4 *rays,
                           __global float *curves, int size, int count)
{
  const int start = (int)get_global_id(0) * TFM_LANES;
  if (start >= count)
    return;
  FloatArray u, v, begin, end;
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    const float4 one = rays[start + lane < count ? start + lane : count - 1];
    u.lane[lane] = one.x;
    v.lane[lane] = one.y;
    begin.lane[lane] = one.z;
    end.lane[lane] = one.w;
  }
  const GridRay ray = index_ray(grids, light_texel_ray(light, u.lanes, v.lanes));
  Interval bounds = {begin.lanes, end.lanes};
  const Ints open = end.lanes >= MAXFLOAT;
  const Ints meets = grids_clip(grids, &ray, &bounds);
  begin.lanes = open ? bounds.begin : begin.lanes;
  end.lanes = open ? bounds.end : end.lanes;
  const Ints active = (begin.lanes < end.lanes) & (!open | meets);
  FloatArray curve[CURVE_CELLS];
  for (int cell = 0; cell < CURVE_CELLS; ++cell)
    curve[cell].lanes = floats(0.0f);
  if (any_lane(active)) {
    PADDED_GRIDS(padded, TO_INTS(u.lanes * (float)size), TO_INTS(v.lanes * (float)size));
    const Walk walk = walk_from(&padded, &ray, begin.lanes, end.lanes - begin.lanes, no_warp(), 0,
                                ints(STEPS_A_CELL * CURVE_CELLS), active);
    Ints samples = ints(0);
    Steps list = no_steps();
    while (find_steps(&padded, &walk, active, 0, &list))
      for (int k = 0; k < list.count; ++k) {
        const Floats density = densities_at(&padded, &walk, &list, k, place_of(&walk, list.n[k]).t, &samples).of[0][0];
        curve[list.n[k] / STEPS_A_CELL].lanes += active ? walk.step * density : floats(0.0f);
      }
  }
  for (int lane = 0; lane < TFM_LANES && start + lane < count; ++lane) {
    __global float *out = curves + (size_t)(start + lane) * (CURVE_CELLS + 1);
    float sum = 0.0f;
    out[0] = 0.0f;
    for (int cell = 0; cell < CURVE_CELLS; ++cell) {
      sum += curve[cell].lane[lane];
      out[cell + 1] = sum < TFM_MAX_OPTICAL_DEPTH ? sum : TFM_MAX_OPTICAL_DEPTH;
    }
  }
}
