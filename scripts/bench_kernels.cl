/* The roofline of scripts/bench.py: how many trilinear samples a second the device takes when it does nothing else.
   Tiles of rays, close together, march through a dense grid of float32; nothing is looked up or left out.
   Requires: TFM_LANES; GRID_EDGE, voxels along each side of the grid, at least 129. */
#include "core/lanes.h"

#define GRID_LAYER (GRID_EDGE * GRID_EDGE)

/* Vectors in memory need only their elements' alignment. */
typedef float2 FloatPair __attribute__((aligned(4)));

/* Eight gathers a sample: one for every voxel around it. */
TFM_INLINE Floats row_by_gathers(__global const float *grid, Ints i, Floats fx)
{
  const Floats low = (Floats)FOR_LANES(GATHER_ONE, grid, i);
  const Floats high = (Floats)FOR_LANES(GATHER_ONE, (grid + 1), i);
  return lerp(low, high, fx);
}

/* Four loads a sample: the two voxels that are neighbours in x come together. */
TFM_INLINE Floats row_by_pairs(__global const float *grid, Ints i, Floats fx)
{
  Floats low, high;
#if TFM_LANES == 1
  low = grid[i];
  high = grid[i + 1];
#else
#define PAIR_OF(s) (*(__global const FloatPair *)(grid + LANE(i, s)))
  SPLIT_PAIRS(PAIR_OF, low, high);
#undef PAIR_OF
#endif
  return lerp(low, high, fx);
}

TFM_INLINE Floats row(__global const float *grid, Ints i, Floats fx, const int pairs)
{
  return pairs ? row_by_pairs(grid, i, fx) : row_by_gathers(grid, i, fx);
}

/* sums  out, [size, size]: the sum of `steps` samples a unit of z apart along each of size x size rays. Rays start
   in the layer z = 3 between 10 and 110 in x and y, and spread by up to 0.05 a step. One tile a work-item. */
TFM_INLINE void march(__global const float *grid, __global float *sums, int size, int steps, const int pairs)
{
  const Ints px = (int)get_global_id(0) * TILE_WIDTH + LANE_X;
  const Ints py = (int)get_global_id(1) * TILE_HEIGHT + LANE_Y;
  const Ints inside = (px < size) & (py < size);
  if (!any_lane(inside))
    return;
  const Floats u = inside ? TO_FLOATS(px) * (1.0f / (float)size) : floats(0.0f);
  const Floats v = inside ? TO_FLOATS(py) * (1.0f / (float)size) : floats(0.0f);
  const Floats dx = (u - 0.5f) * 0.1f, dy = (v - 0.5f) * 0.1f;
  Floats x = 10.0f + 100.0f * u, y = 10.0f + 100.0f * v, z = floats(2.0f), sum = floats(0.0f);
  for (int n = 0; n < steps; ++n) {
    x += dx;
    y += dy;
    z += 1.0f;
    const Ints ix = TO_INTS(x), iy = TO_INTS(y), iz = TO_INTS(z);
    const Floats fx = x - TO_FLOATS(ix), fy = y - TO_FLOATS(iy), fz = z - TO_FLOATS(iz);
    const Ints i = (iz * GRID_EDGE + iy) * GRID_EDGE + ix;
    const Floats near = lerp(row(grid, i, fx, pairs), row(grid + GRID_EDGE, i, fx, pairs), fy);
    const Floats far =
        lerp(row(grid + GRID_LAYER, i, fx, pairs), row(grid + GRID_LAYER + GRID_EDGE, i, fx, pairs), fy);
    sum += lerp(near, far, fz);
  }
  FloatArray found;
  IntArray column, line, wanted;
  found.lanes = sum;
  column.lanes = px;
  line.lanes = py;
  wanted.lanes = inside ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane)
    if (wanted.lane[lane])
      sums[line.lane[lane] * size + column.lane[lane]] = found.lane[lane];
}

__kernel void trilinear_gather(__global const float *grid, __global float *sums, int size, int steps)
{
  march(grid, sums, size, steps, 0);
}

__kernel void trilinear_pairs(__global const float *grid, __global float *sums, int size, int steps)
{
  march(grid, sums, size, steps, 1);
}
