/* Every primitive at its own depth, without steps (FOM eq. 5-6). Numbers that are linear in the density are sums over all
   that lies along a ray, in any order: each primitive adds its optical depth times what the basis makes of its middle.
   Includes expected before: a basis header. Requires: what deposits.h does. */
#ifndef TFM_OWN_DEPTH_H
#define TFM_OWN_DEPTH_H

#include "../body/walk.h"

/* lit       distance beyond which a ray lights nothing
   table     [OWN_DEPTH_ROWS][n], as of a march of so many steps
   occupied  in and out: where density begins and ends; nothing where it begins at INFINITY
   Returns how many primitives each ray adds. */
TFM_INLINE Ints add_at_own_depth(const Lists *lists, Ray ray, Interval part, Floats lit, __global const float *table,
                                 Ints active, BasisState *state, Interval *occupied)
{
  const Floats inverse = inverse_of(part.end - part.begin), end = least(part.end, lit);
  Floats optical_depth = floats(0.0f);
  Ints count = ints(0);
  Near near;
  near_begin(lists, active, &near);
  while (find_near(lists, ray, part.begin, end, &near))
    for (int k = 0; k < near.count; ++k) {
      PRIMITIVE primitive = lists->primitives + near.number[k];
      const Crossing *crossing = &near.crossing[k];
      const Floats t = crossing->t, reach = crossing->reach;
      const Ints crosses = near.crosses[k] & (t >= part.begin) & (t < end);
      /* The other half is as much. */
      const Floats held = 2.0f * primitive->amount[0] * TFM_PRIMITIVE_PART(primitive, crossing, t + 2.0f * reach);
      const Floats depth = crosses ? least(held, TFM_MAX_OPTICAL_DEPTH - optical_depth) : floats(0.0f);
      optical_depth += depth;
      basis_deposit(table, state, crosses ? (t - part.begin) * inverse : floats(0.0f), depth);
      const Ints adds = depth > 0.0f;
      count += adds ? ints(1) : ints(0);
      occupied->begin = adds ? least(occupied->begin, t - reach) : occupied->begin;
      occupied->end = adds ? greatest(occupied->end, t + reach) : occupied->end;
    }
  return count;
}

#endif
