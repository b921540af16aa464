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
#if TFM_LANES > 1
  if (all_lanes(wanted)) {
#define STORE(p, i, s) (out[LANE(index, s)] = LANE(values, s), 0)
    (void)(Ints)FOR_LANES(STORE, 0, 0);
#undef STORE
    return;
  }
#endif
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

/* Of a tile whose rows are neighbours in memory: where all its lanes are wanted, a row is written at once.
   EACH_ROW(DO): DO(first lane, part of a vector). */
#if TFM_LANES == 4
#define EACH_ROW(DO) DO(s0, lo) DO(s2, hi)
#elif TFM_LANES == 8
#define EACH_ROW(DO) DO(s0, lo) DO(s4, hi)
#elif TFM_LANES == 16
#define EACH_ROW(DO) DO(s0, lo.lo) DO(s4, lo.hi) DO(s8, hi.lo) DO(sc, hi.hi)
#endif
#if TFM_LANES == 4
typedef float8 Float4Row __attribute__((aligned(16)));
typedef uint2 CountRow __attribute__((aligned(4)));
#define TO_COUNT_ROW convert_uint2
#define FLOAT4_ROW(x, y, z, w) (float8)((x).s0, (y).s0, (z).s0, (w).s0, (x).s1, (y).s1, (z).s1, (w).s1)
#elif TFM_LANES > 4
typedef float16 Float4Row __attribute__((aligned(16)));
typedef uint4 CountRow __attribute__((aligned(4)));
#define TO_COUNT_ROW convert_uint4
#define FLOAT4_ROW(x, y, z, w)                                                                                  \
  (float16)((x).s0, (y).s0, (z).s0, (w).s0, (x).s1, (y).s1, (z).s1, (w).s1, (x).s2, (y).s2, (z).s2, (w).s2, \
            (x).s3, (y).s3, (z).s3, (w).s3)
#endif

TFM_INLINE void store_float4(__global float4 *out, Ints index, Ints wanted, Floats x, Floats y, Floats z, Floats w)
{
#if TFM_LANES > 1
  if (all_lanes(wanted)) {
#define STORE_ROW(first, part) *(__global Float4Row *)(out + index.first) = FLOAT4_ROW(x.part, y.part, z.part, w.part);
    EACH_ROW(STORE_ROW)
    return;
  }
#endif
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
#if TFM_LANES > 1
  if (all_lanes(wanted)) {
#define ADD_ROW(first, part) *(__global Float4Row *)(out + index.first) += FLOAT4_ROW(x.part, y.part, z.part, w.part);
    EACH_ROW(ADD_ROW)
    return;
  }
#endif
  FloatArray vx, vy, vz, vw;
  vx.lanes = x;
  vy.lanes = y;
  vz.lanes = z;
  vw.lanes = w;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] += (float4)(vx.lane[lane], vy.lane[lane], vz.lane[lane], vw.lane[lane]);
}

TFM_INLINE void store_counts(__global uint *out, Ints index, Ints wanted, Ints counts)
{
#if TFM_LANES > 1
  if (all_lanes(wanted)) {
#define STORE_COUNTS(first, part) *(__global CountRow *)(out + index.first) = TO_COUNT_ROW(counts.part);
    EACH_ROW(STORE_COUNTS)
    return;
  }
#endif
  IntArray v;
  v.lanes = counts;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] = (uint)v.lane[lane];
}

TFM_INLINE void add_counts(__global uint *out, Ints index, Ints wanted, Ints counts)
{
#if TFM_LANES > 1
  if (all_lanes(wanted)) {
#define ADD_COUNTS(first, part) *(__global CountRow *)(out + index.first) += TO_COUNT_ROW(counts.part);
    EACH_ROW(ADD_COUNTS)
    return;
  }
#endif
  IntArray v;
  v.lanes = counts;
  EACH_WANTED_LANE(index, wanted)
    out[index_lanes.lane[lane]] += (uint)v.lane[lane];
}

/* x, y of each lane; `missing` in the others. */
TFM_INLINE void load_float2(__global const float2 *from, Ints index, Ints wanted, float missing, Floats *x, Floats *y)
{
  FloatArray vx, vy;
  vx.lanes = floats(missing);
  vy.lanes = floats(missing);
  EACH_WANTED_LANE(index, wanted)
  {
    vx.lane[lane] = from[index_lanes.lane[lane]].x;
    vy.lane[lane] = from[index_lanes.lane[lane]].y;
  }
  *x = vx.lanes;
  *y = vy.lanes;
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
