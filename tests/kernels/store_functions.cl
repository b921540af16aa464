/* Test-only kernel around store.h: places and marks of the lanes are given. */
#include "core/store.h"
#include "items.h"

/* values  [count, 4]: what lanes have
   places  [count]: where it goes, a number of its own for each
   wanted  [count]: 0 or 1
   loaded  out, [count, 5]: what comes back from `from`, and its flag
   sums    out, [work-items] */
__kernel void call_store(__global const float *values, __global const float *places, __global const float *wanted,
                         __global const float4 *from, __global const uchar *flags, __global float *singles,
                         __global float2 *pairs, __global float4 *fours, __global float4 *added, __global uint *counts,
                         __global float *loaded, __global uint *sums, float missing, int count)
{
  GUARD;
  const Ints index = TO_INTS(load(places, 1, 0, count));
  /* What repeats the last item does not count. */
  IntArray ours;
  for (int lane = 0; lane < TFM_LANES; ++lane)
    ours.lane[lane] = item_of(lane) < count;
  const Ints marked = (ours.lanes != 0) & (load(wanted, 1, 0, count) > 0.0f);
  const Floats x = load(values, 4, 0, count), y = load(values, 4, 1, count), z = load(values, 4, 2, count),
               w = load(values, 4, 3, count);
  store_floats(singles, index, marked, x);
  store_float2(pairs, index, marked, x, y);
  store_float4(fours, index, marked, x, y, z, w);
  add_float4(added, index, marked, x, y, z, w);
  add_counts(counts, index, marked, TO_INTS(x));
  Floats read[4];
  load_float4(from, index, marked, missing, read);
  for (int i = 0; i < 4; ++i)
    store(loaded, 5, i, count, read[i]);
  store(loaded, 5, 4, count, load_flags(flags, index, marked) ? floats(1.0f) : floats(0.0f));
  sums[get_global_id(0)] = sum_of_lanes(TO_INTS(x), marked);
}
