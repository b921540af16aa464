/* Bodies whose density is a grid's: trilinear between voxel centres, 0 outside, sparse.
   The padded grid carries one zero voxel on each side, so that the density falls to 0 over one voxel. Its cells
   (the cubes between 8 voxels) are grouped into bricks of 4x4x4, the units of skipping, and blocks of 2x2x2 bricks,
   the units of storage. A block with any density has a record of all voxels that its cells touch, so that a sample
   reads one record only; all others have none. Several grids, each with its transform, add up; they share the table
   and the records. Where voxels have a colour, their densities in red, green and blue are three records, one after the
   other, under one entry of the table.
   Primitives have no voxels, but bounds like a grid: the last of the boxes is the one around them all.
   Requires: TFM_VOXEL_BITS 32, 16 or 8; TFM_POOLS, the number of buffers that hold the records; TFM_GRIDS, the number
   of boxes that are marched, at least 1; what amounts.h does. */
#ifndef TFM_GRID_H
#define TFM_GRID_H

#include "body/amounts.h"
#if TFM_PRIMITIVES
#include "primitive/lists.h"
#define TFM_VOXEL_GRIDS (TFM_GRIDS - 1)
#else
#define TFM_VOXEL_GRIDS TFM_GRIDS
#endif

/* Vectors in memory are aligned like their elements only. Used if TFM_LANES > 1, where vload2 would be a call. */
typedef float2 UnalignedFloat2 __attribute__((aligned(4)));
typedef uint UnalignedUint __attribute__((aligned(2)));
typedef ushort UnalignedUshort __attribute__((aligned(1)));

/* The lanes of a tile share their reads if they lie within MOST_SHARED cells along each axis. They then use the brick
   and the block of the lowest cell, which must also cover the cells of the others. */
#define RECORD_EDGE (BLOCK_EDGE + MOST_SHARED)
#define RECORD_ROW RECORD_EDGE                   /* stride of y, in voxels */
#define RECORD_LAYER (RECORD_EDGE * RECORD_EDGE) /* stride of z, in voxels */
/* A multiple of 4, since 8-bit voxels are followed by a float. */
#define RECORD_VOXELS ((RECORD_EDGE * RECORD_LAYER + 3) / 4 * 4)

#if TFM_VOXEL_GRIDS
/* Records are RECORD_SIZE voxels apart. 8-bit voxels are followed by the density, a float, that 255 stands for. */
#if TFM_VOXEL_BITS == 32
typedef float Voxel;
#define RECORD_SIZE RECORD_VOXELS
#elif TFM_VOXEL_BITS == 16
typedef ushort Voxel;
#define RECORD_SIZE RECORD_VOXELS
#elif TFM_VOXEL_BITS == 8
typedef uchar Voxel;
#define RECORD_SIZE (RECORD_VOXELS + 4)
#else
#error "TFM_VOXEL_BITS must be 32, 16 or 8"
#endif
#endif

/* bricks: one entry per brick, x fastest. For a brick with density, the number of its block's record, counted from 1;
   for other bricks -d, where d is a chessboard distance below which no brick has density. Record 0 is all zeros.
   Devices limit the size of a buffer, so the records of a large volume are spread over several. */
#if TFM_PRIMITIVES
#define AND_PRIMITIVE_ARGUMENTS , PRIMITIVE_ARGUMENTS
#else
#define AND_PRIMITIVE_ARGUMENTS
#endif
#if TFM_VOXEL_GRIDS == 0
#define GRID_ARGUMENTS GRID grids AND_PRIMITIVE_ARGUMENTS
#elif TFM_POOLS == 1
#define GRID_ARGUMENTS GRID grids, __global const int *bricks, __global const Voxel *pool0 AND_PRIMITIVE_ARGUMENTS
#define GRID_POOLS {pool0}
#elif TFM_POOLS == 8
#define GRID_ARGUMENTS                                                                                 \
  GRID grids, __global const int *bricks, __global const Voxel *pool0, __global const Voxel *pool1,                \
      __global const Voxel *pool2, __global const Voxel *pool3, __global const Voxel *pool4,           \
      __global const Voxel *pool5, __global const Voxel *pool6, __global const Voxel *pool7 AND_PRIMITIVE_ARGUMENTS
#define GRID_POOLS {pool0, pool1, pool2, pool3, pool4, pool5, pool6, pool7}
#else
#error "TFM_POOLS must be 1 or 8"
#endif

/* What is each grid's own. */
typedef struct {
  __global const int *bricks;
  int row;   /* stride of y, in bricks */
  int layer; /* stride of z, in bricks */
  float upper[3];
  int channel_records; /* from the record of a channel to that of the next; 0 without a colour */
  float density_scale[TFM_VOXEL_CHANNELS];
} Extent;

/* The grids with all that a sample needs of them, read once before a loop. */
typedef struct {
  int skip; /* 0: sample empty bricks too */
#if TFM_VOXEL_GRIDS
  __global const Voxel *pools[TFM_POOLS];
  int pool_size; /* records a pool */
  Extent of[TFM_VOXEL_GRIDS];
#endif
#if TFM_PRIMITIVES
  Lists lists;
#endif
} Grids;

/* A ray in every padded grid. */
typedef struct {
  Ray of[TFM_GRIDS];
#if TFM_PRIMITIVES
  Ray world;
#endif
} GridRay;

#if TFM_VOXEL_GRIDS
#define PADDED_VOXELS(name)                                \
  __global const Voxel *const name##_pools[] = GRID_POOLS; \
  Grids name;                                              \
  for (int k = 0; k < TFM_POOLS; ++k)                      \
    name.pools[k] = name##_pools[k];                       \
  describe_grids(grids, bricks, &name)
#else
#define PADDED_VOXELS(name) \
  Grids name;               \
  name.skip = grids->skip_empty
#endif

/* Declares the grids of a kernel's arguments; x, y: the texels or pixels that its rays belong to. */
#if TFM_PRIMITIVES
#define PADDED_GRIDS(name, x, y) \
  PADDED_VOXELS(name);           \
  name.lists = (Lists){primitives, balls, bin_starts, bin_members, bins, bin_of(bins, x, y)}
#else
#define PADDED_GRIDS(name, x, y) PADDED_VOXELS(name)
#endif

#if TFM_VOXEL_GRIDS
TFM_INLINE void describe_grids(GRID grids, __global const int *bricks, Grids *padded)
{
  padded->pool_size = grids->pool_size;
  padded->skip = grids->skip_empty;
  for (int i = 0; i < TFM_VOXEL_GRIDS; ++i) {
    Extent *extent = &padded->of[i];
    extent->bricks = bricks + grids[i].first_brick;
    extent->row = grids[i].brick_count[0];
    extent->layer = grids[i].brick_count[0] * grids[i].brick_count[1];
    for (int axis = 0; axis < 3; ++axis)
      extent->upper[axis] = (float)(grids[i].size[axis] - 1);
    extent->channel_records = grids[i].channel_records;
    for (int c = 0; c < TFM_VOXEL_CHANNELS; ++c)
      extent->density_scale[c] = grids[i].density_scale[c];
  }
}
#endif

/* Transform a world ray to the index spaces of the padded grids. */
TFM_INLINE GridRay index_ray(GRID grids, Ray world_ray)
{
  GridRay ray;
  for (int i = 0; i < TFM_GRIDS; ++i)
    ray.of[i] = transform_ray(grids[i].index_from_world, world_ray);
#if TFM_PRIMITIVES
  ray.world = world_ray;
#endif
  return ray;
}

/* The part of a ray from the first to the last of the grids' bounds; the lanes in which there is one. */
TFM_INLINE Ints grids_clip(GRID grids, const GridRay *ray, Interval *interval)
{
  const Interval whole = *interval;
  Interval joined = {floats(INFINITY), floats(-INFINITY)};
  for (int i = 0; i < TFM_GRIDS; ++i) {
    float upper[3];
    for (int axis = 0; axis < 3; ++axis)
      upper[axis] = (float)(grids[i].size[axis] - 1);
    Interval part = whole;
    const Ints meets = box_clip(ray->of[i], upper, &part);
    if (TFM_GRIDS == 1) {
      *interval = part;
      return meets;
    }
    joined.begin = meets ? least(joined.begin, part.begin) : joined.begin;
    joined.end = meets ? greatest(joined.end, part.end) : joined.end;
  }
  *interval = joined;
  return joined.begin < joined.end;
}

/* The part of a light ray within the grids' bounds: from k_in, or the light itself, to k_out. */
TFM_INLINE Ints light_medium_interval(GRID grids, const GridRay *ray, Interval *k)
{
  k->begin = floats(0.0f);
  k->end = floats(INFINITY);
  return grids_clip(grids, ray, k);
}

#if TFM_VOXEL_GRIDS
/* The number of a brick in a grid's table. */
#define BRICK_AT(extent, bx, by, bz) ((bz) * (extent)->layer + (by) * (extent)->row + (bx))

/* Two voxels that are neighbours in x, in every lane. i: offset from the start of the lane's pool. */
TFM_INLINE void gather_voxel_pairs(const Grids *grid, Ints pool, Ints i, int offset, Floats *low_x, Floats *high_x)
{
#if TFM_POOLS == 1
#define VOXELS(s) (grid->pools[0] + offset + LANE(i, s))
#else
#define VOXELS(s) (grid->pools[LANE(pool, s)] + offset + LANE(i, s))
#endif
#if TFM_LANES == 1
#if TFM_VOXEL_BITS == 16
  *low_x = vload_half(0, (__global const half *)VOXELS());
  *high_x = vload_half(1, (__global const half *)VOXELS());
#else
  *low_x = (float)VOXELS()[0];
  *high_x = (float)VOXELS()[1];
#endif
#elif TFM_VOXEL_BITS == 32
#define VOXEL_PAIR(s) (*(__global const UnalignedFloat2 *)VOXELS(s))
  SPLIT_PAIRS(VOXEL_PAIR, *low_x, *high_x);
#elif TFM_VOXEL_BITS == 16
  /* Halves are >= 0 and finite; their bits, shifted into place, are floats that are too small by a factor of 2^112. */
#define VOXEL_PAIR(p, i, s) (int)(*(__global const UnalignedUint *)VOXELS(s))
  const Ints pair = (Ints)FOR_LANES(VOXEL_PAIR, 0, 0);
  *low_x = 0x1p112f * AS_FLOATS((pair & 0x7fff) << 13);
  *high_x = 0x1p112f * AS_FLOATS((pair >> 3) & 0x0fffe000);
#else
#define VOXEL_PAIR(p, i, s) (int)(*(__global const UnalignedUshort *)VOXELS(s))
  const Ints pair = (Ints)FOR_LANES(VOXEL_PAIR, 0, 0);
  *low_x = TO_FLOATS(pair & 255);
  *high_x = TO_FLOATS(pair >> 8);
#endif
#ifdef VOXEL_PAIR
#undef VOXEL_PAIR
#endif
#undef VOXELS
}

#if TFM_LANES > 1
/* One voxel as stored, shared by all lanes. */
TFM_INLINE float voxel_value(__global const Voxel *voxel)
{
#if TFM_VOXEL_BITS == 16
  return 0x1p112f * as_float((uint)*voxel << 13);
#else
  return (float)*voxel;
#endif
}

/* The voxels that surround the samples of a tile. */
typedef struct {
  int record;      /* record of their block; 0: nothing to read */
  int first;       /* the lowest of them, in the record */
  int sizes;       /* 2 to MOST_SHARED + 1 of them along x, y and z, in a byte each */
  float corner[3]; /* where the lowest is in the padded grid */
} Window;

/* Nearly all windows have so few voxels along each axis. They are summed in straight code, in which voxels beyond the window
   weigh 0: it is faster than branches on sizes that no CPU foresees. */
#define FEW_SHARED 3
/* Of sizes from 2 to 4, only 4 has this bit. */
#define IS_FEW(window) (((window)->sizes & 0x040404) == 0)

/* Linear interpolation weights (tent functions) of a row of voxels. x: positions relative to the first voxel, before the
   last one: no sample is on its far side, if a row is known to end there. */
TFM_INLINE void tents(Floats x, int voxels, int ends, Floats *weight)
{
  weight[0] = greatest(1.0f - x, floats(0.0f));
#pragma unroll
  for (int i = 1; i <= MOST_SHARED; ++i)
    if (i < voxels) {
      const Floats rises = x - (float)(i - 1);
      weight[i] = greatest(i == ends ? rises : least(rises, (float)(i + 1) - x), floats(0.0f));
    }
}

typedef struct {
  Floats x[MOST_SHARED + 1], y[MOST_SHARED + 1], z[MOST_SHARED + 1];
} Tents;

TFM_INLINE Tents window_tents(const Window *window, Vec3 point, int nx, int ny, int nz, int ends)
{
  Tents weights;
  tents(point.x - window->corner[0], nx, ends, weights.x);
  tents(point.y - window->corner[1], ny, ends, weights.y);
  tents(point.z - window->corner[2], nz, ends, weights.z);
  return weights;
}

/* The sum of a window's voxels, each times the product of its tents. first: the lowest; ends: of `tents`. */
TFM_INLINE Floats window_sum(__global const Voxel *first, const Window *window, Vec3 point, int nx, int ny, int nz, int ends)
{
  const Tents weights = window_tents(window, point, nx, ny, nz, ends);
  const Floats *wx = weights.x, *wy = weights.y, *wz = weights.z;
  Floats sum = floats(0.0f);
#pragma unroll
  for (int k = 0; k <= MOST_SHARED; ++k)
    if (k < nz) {
      Floats layer = floats(0.0f);
#pragma unroll
      for (int j = 0; j <= MOST_SHARED; ++j)
        if (j < ny) {
          __global const Voxel *voxel = first + k * RECORD_LAYER + j * RECORD_ROW;
          Floats row = wx[0] * voxel_value(voxel) + wx[1] * voxel_value(voxel + 1);
#pragma unroll
          for (int i = 2; i <= MOST_SHARED; ++i)
            if (i < nx)
              row += wx[i] * voxel_value(voxel + i);
          layer += wy[j] * row;
        }
      sum += wz[k] * layer;
    }
  return sum;
}

/* Density D, of one channel, of all lanes from one window: trilinear, as every voxel weighs the product of its tents. */
TFM_INLINE Floats density_together(const Grids *grid, const Window *window, Vec3 point, int channel)
{
  const int record = window->record + channel * grid->of[0].channel_records;
  const int pool = TFM_POOLS == 1 ? 0 : record / grid->pool_size;
  __global const Voxel *start = grid->pools[pool] + (size_t)(record - pool * grid->pool_size) * RECORD_SIZE;
  __global const Voxel *first = start + window->first;
  Floats sum;
  if (IS_FEW(window))
    sum = window_sum(first, window, point, FEW_SHARED, FEW_SHARED, FEW_SHARED, FEW_SHARED - 1);
  else
    sum = window_sum(first, window, point, window->sizes & 255, window->sizes >> 8 & 255, window->sizes >> 16, 0);
#if TFM_VOXEL_BITS == 8
  return grid->of[0].density_scale[channel] * *(__global const float *)(start + RECORD_VOXELS) * sum;
#else
  return grid->of[0].density_scale[channel] * sum;
#endif
}
#endif

/* Density D, of one channel, of one grid where every lane reads for itself, at points in it; 0 where their brick has no
   record (<= 0). */
TFM_INLINE Floats density_apart(const Grids *grid, int i_grid, Ints record, Vec3 point, int channel)
{
  const Ints ix = TO_INTS(point.x), iy = TO_INTS(point.y), iz = TO_INTS(point.z);
  record = record > 0 ? record + channel * grid->of[i_grid].channel_records : ints(0);
#if TFM_POOLS == 1
  const Ints pool = ints(0);
  const Ints start = record * RECORD_SIZE;
#else
  const Ints pool = record / grid->pool_size;
  const Ints start = (record - pool * grid->pool_size) * RECORD_SIZE;
#endif
  const Ints i = start + (iz & (BLOCK_EDGE - 1)) * RECORD_LAYER + (iy & (BLOCK_EDGE - 1)) * RECORD_ROW +
                 (ix & (BLOCK_EDGE - 1));
  const Floats fx = point.x - TO_FLOATS(ix), fy = point.y - TO_FLOATS(iy), fz = point.z - TO_FLOATS(iz);
  Floats low, high;
  gather_voxel_pairs(grid, pool, i, 0, &low, &high);
  const Floats low_near = lerp(low, high, fx);
  gather_voxel_pairs(grid, pool, i, RECORD_ROW, &low, &high);
  const Floats low_far = lerp(low, high, fx);
  gather_voxel_pairs(grid, pool, i, RECORD_LAYER, &low, &high);
  const Floats high_near = lerp(low, high, fx);
  gather_voxel_pairs(grid, pool, i, RECORD_LAYER + RECORD_ROW, &low, &high);
  const Floats high_far = lerp(low, high, fx);
  const Floats density = lerp(lerp(low_near, low_far, fy), lerp(high_near, high_far, fy), fz);
#if TFM_VOXEL_BITS == 8
#if TFM_POOLS == 1
#define SCALE(p, i, s) (*(__global const float *)(grid->pools[0] + RECORD_VOXELS + LANE(start, s)))
#else
#define SCALE(p, i, s) (*(__global const float *)(grid->pools[LANE(pool, s)] + RECORD_VOXELS + LANE(start, s)))
#endif
  return grid->of[i_grid].density_scale[channel] * density * (Floats)FOR_LANES(SCALE, 0, 0);
#undef SCALE
#else
  return grid->of[i_grid].density_scale[channel] * density;
#endif
}

#endif

#endif
