/* Solids among the points of a lattice of later orders (order_sweep.cl): where a ray meets one, what it carries arrives there,
   and what the solid reflects goes on.
   Requires: what view/orders.h does; TFM_ORDER_WALLS, 0 where there are none: then this is nothing. */
#ifndef TFM_WALLS_H
#define TFM_WALLS_H

#include "core/fast_math.h"
#include "view/orders.h"

#if TFM_ORDER_WALLS
/* walls        of the rays of a work-item, in the order in which they meet them: plane towards which a ray is on its way,
                its lane, patch whose light goes on or a number below 0, and the part of the way to that plane, as bits
   wall_starts  of each direction and work-item, where its walls begin, and the end
   reflected    of each colour of all patches
   arriving     out: of each colour of all walls
   wall_items   work-items of a direction; wall_base: first direction of `wall_starts` that is known here
   patches, wall_count  their numbers */
#define WALLS_ARGUMENTS , __global const int4 *walls, __global const int *wall_starts, __global const float *reflected, \
                        __global float *arriving, int wall_items, int wall_base, int patches, int wall_count

/* What goes on in the place of a patch's light: the ray's own; below that the same, held in the dark within a solid; and,
   held likewise, that of a patch, by so many less than HELD_FROM. */
#define OWN -1
#define HELD_FROM -3

typedef struct {
  int next, end;
  int holds;   /* whether any of the rays does */
  Floats held; /* 1 of rays that hold what they carry */
} WallsAhead;

/* A step up to a plane, as it would be without walls. Gains are what its ends would add to a ray in all of it, were there no
   extinction. */
typedef struct {
  Floats light[TFM_ORDER_COLOURS]; /* at its beginning */
  Floats gain[TFM_ORDER_COLOURS];  /* as at its beginning */
} StepBefore;

#define WALLS_OF(number, item)                                                                     \
  WallsAhead ahead;                                                                                \
  {                                                                                                \
    const size_t of_item = (size_t)(wall_base + (number)) * wall_items + (item);                   \
    ahead.next = wall_starts[of_item];                                                             \
    ahead.end = wall_starts[of_item + 1];                                                          \
    ahead.holds = 0;                                                                               \
    ahead.held = floats(0.0f);                                                                     \
  }
#define BEFORE_WALLS(radiances, of_gain)           \
  StepBefore before_walls;                         \
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {    \
    before_walls.light[c] = radiances[c];          \
    before_walls.gain[c] = of_gain;                \
  }
#define MEET_WALLS(m, depth, of_gain, radiances)                                                              \
  if (ahead.next < ahead.end && walls[ahead.next].x <= (m)) {                                                 \
    Floats gain_after[TFM_ORDER_COLOURS];                                                                     \
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c)                                                               \
      gain_after[c] = of_gain;                                                                                \
    meet_walls(walls, &ahead, m, depth, &before_walls, gain_after, reflected, arriving, patches, wall_count, radiances); \
  }                                                                                                           \
  if (ahead.holds)                                                                                            \
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c)                                                               \
      radiances[c] = ahead.held > 0.0f ? before_walls.light[c] : radiances[c];

/* What is left of light after a part of a step, with what that adds. */
TFM_INLINE Floats after_part(Floats light, Floats gain, Floats depth, Floats part)
{
  const Floats of_part = part * depth;
  const Exp2 e = exp_of_minus(of_part);
  const Floats lost = (1.0f - e.scale) - e.scale * e.part;
  return light * (1.0f - lost) + gain * part * (of_part > 1e-6f ? lost / of_part : floats(1.0f));
}

TFM_INLINE void meet_walls(__global const int4 *walls, WallsAhead *ahead, int m, const Floats *depth, StepBefore *step,
                           const Floats *gain_after, __global const float *reflected, __global float *arriving, int patches,
                           int count, Floats *radiances)
{
  FloatArray part, met, held, light[TFM_ORDER_COLOURS];
  part.lanes = met.lanes = floats(0.0f);
  held.lanes = ahead->held;
  for (; ahead->next < ahead->end && walls[ahead->next].x <= m; ++ahead->next) {
    const int4 wall = walls[ahead->next];
    const float at = as_float(wall.w);
    const int patch = wall.z <= HELD_FROM ? HELD_FROM - wall.z : wall.z;
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
      const Floats gain = met.lanes > 0.0f ? gain_after[c] : step->gain[c];
      light[c].lanes = after_part(step->light[c], gain, depth[TFM_CHANNELS == 3 ? c : 0],
                                  greatest(at - part.lanes, floats(0.0f)));
      light[c].lanes = held.lanes > 0.0f ? step->light[c] : light[c].lanes;
      const float arrives = light[c].lane[wall.y];
      arriving[(size_t)c * count + ahead->next] = arrives;
      if (wall.z != OWN) {
        light[c].lanes = step->light[c];
        light[c].lane[wall.y] = patch >= 0 ? reflected[(size_t)c * patches + patch] : arrives;
        step->light[c] = light[c].lanes;
      }
    }
    if (wall.z >= 0) {
      part.lane[wall.y] = at;
      met.lane[wall.y] = 1.0f;
      held.lane[wall.y] = 0.0f;
    } else if (wall.z != OWN)
      held.lane[wall.y] = 1.0f;
  }
  ahead->held = held.lanes;
  ahead->holds = any_lane(held.lanes > 0.0f);
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    const Floats after =
        after_part(step->light[c], gain_after[c], depth[TFM_CHANNELS == 3 ? c : 0], 1.0f - part.lanes);
    radiances[c] = met.lanes > 0.0f ? after : radiances[c];
  }
}
#else
#define WALLS_ARGUMENTS
#define WALLS_OF(number, item)
#define BEFORE_WALLS(radiances, of_gain)
#define MEET_WALLS(m, depth, of_gain, radiances)
#endif

#endif
