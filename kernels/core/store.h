/* From lanes to memory and back, where every lane has a place of its own: what loops over lanes is here. Outside hot
   loops.
   index: of the element, a lane each; wanted: the lanes that count. */
#ifndef TFM_STORE_H
#define TFM_STORE_H

#include "core/lanes.h"

#define EACH_WANTED_LANE(index, wanted)                         \
  IntArray index##_lanes, wanted##_lanes;                       \
  index##_lanes.lanes = index;                                  \
  wanted##_lanes.lanes = (wanted) ? ints(1) : ints(0);          \
  for (int lane = 0; lane < TFM_LANES; ++lane)                  \
    if (wanted##_lanes.lane[lane])

TFM_INLINE void store_floats(__global float *out, Ints index, Ints wanted, Floats values)
{
  FloatArray v;
  v.lanes = values;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] = v.lane[lane];
}

TFM_INLINE void store_float2(__global float2 *out, Ints index, Ints wanted, Floats x, Floats y)
{
  FloatArray vx, vy;
  vx.lanes = x;
  vy.lanes = y;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] = (float2)(vx.lane[lane], vy.lane[lane]);
}

TFM_INLINE void store_float4(__global float4 *out, Ints index, Ints wanted, Floats x, Floats y, Floats z, Floats w)
{
  FloatArray vx, vy, vz, vw;
  vx.lanes = x;
  vy.lanes = y;
  vz.lanes = z;
  vw.lanes = w;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] = (float4)(vx.lane[lane], vy.lane[lane], vz.lane[lane], vw.lane[lane]);
}

TFM_INLINE void add_float4(__global float4 *out, Ints index, Ints wanted, Floats x, Floats y, Floats z, Floats w)
{
  FloatArray vx, vy, vz, vw;
  vx.lanes = x;
  vy.lanes = y;
  vz.lanes = z;
  vw.lanes = w;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] += (float4)(vx.lane[lane], vy.lane[lane], vz.lane[lane], vw.lane[lane]);
}

TFM_INLINE void add_counts(__global uint *out, Ints index, Ints wanted, Ints counts)
{
  IntArray v;
  v.lanes = counts;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] += (uint)v.lane[lane];
}

/* values: x, y, z, w of each lane; `missing` in all four of the others. */
TFM_INLINE void load_float4(__global const float4 *from, Ints index, Ints wanted, float missing, Floats *values)
{
  FloatArray v[4];
  for (int i = 0; i < 4; ++i)
    v[i].lanes = floats(missing);
  EACH_WANTED_LANE(index, wanted) {
    const float4 one = from[index_lanes.lane[lane]];
    v[0].lane[lane] = one.x;
    v[1].lane[lane] = one.y;
    v[2].lane[lane] = one.z;
    v[3].lane[lane] = one.w;
  }
  for (int i = 0; i < 4; ++i)
    values[i] = v[i].lanes;
}

/* The lanes in which a flag is set. */
TFM_INLINE Ints load_flags(__global const uchar *from, Ints index, Ints wanted)
{
  IntArray v;
  v.lanes = ints(0);
  EACH_WANTED_LANE(index, wanted)
    v.lane[lane] = from[index_lanes.lane[lane]];
  return v.lanes != 0;
}

/* The sum of all wanted lanes. */
TFM_INLINE uint sum_of_lanes(Ints values, Ints wanted)
{
  IntArray v;
  uint sum = 0;
  v.lanes = values;
  EACH_WANTED_LANE(values, wanted)
    sum += (uint)v.lane[lane];
  return sum;
}

#endif
