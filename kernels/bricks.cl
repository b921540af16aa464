/* From leaves of 8x8x8 voxels, as the host keeps them, to the records of body/grid.h.
   Works on a slab of brick layers and the leaf layers that it touches. Requires: what grid.h does. */
#include "body/grid.h"
#include "body/leaves.h"

/* The voxel behind the leaf of another, along an axis of which `first` is where voxels begin. */
TFM_INLINE int leaf_end(int voxel, int first)
{
  return voxel + LEAF_EDGE - ((voxel + first) & (LEAF_EDGE - 1));
}

/* Store a voxel in a record; most: the largest of the record's (8 bits). */
TFM_INLINE void store_voxel(__global Voxel *record, int at, float value, float scale, float most)
{
#if TFM_VOXEL_BITS == 32
  record[at] = value;
#elif TFM_VOXEL_BITS == 16
  vstore_half(value * scale, (size_t)at, (__global half *)record);
#else
  record[at] = most > 0.0f ? convert_uchar_sat_rte(255.0f * (value / most)) : (uchar)0;
#endif
}

/* Write the records of the blocks listed: x, y, z and the number of the record in the pool given. scale: voxels are
   multiplied by it before they are stored (16 bits). One work-item a record. */
__kernel void fill_records(__global const int *table, __global const float *leaves, int4 leaf_count, int4 first,
                           __global const int4 *blocks, int count, float scale, __global Voxel *pool)
{
  const int i = (int)get_global_id(0);
  if (i >= count)
    return;
  __global Voxel *record = pool + (size_t)blocks[i].w * RECORD_SIZE;
  const LeafSlab slab = {table, leaves, leaf_count, first};
  const int4 begin = blocks[i] * BLOCK_EDGE, end = begin + RECORD_EDGE;
  float most = 0.0f;
  for (int stores = TFM_VOXEL_BITS != 8; stores < 2; ++stores) {
    /* Leaf by leaf: to look one up takes longer than to read a voxel. */
    for (int z0 = begin.z, z1; z0 < end.z; z0 = z1) {
      z1 = min(leaf_end(z0, first.z), end.z);
      for (int y0 = begin.y, y1; y0 < end.y; y0 = y1) {
        y1 = min(leaf_end(y0, first.y), end.y);
        for (int x0 = begin.x, x1; x0 < end.x; x0 = x1) {
          x1 = min(leaf_end(x0, first.x), end.x);
          const int leaf = leaf_of(slab, x0, y0, z0);
          __global const float *voxels = leaves + (size_t)max(leaf, 0) * (LEAF_EDGE * LEAF_EDGE * LEAF_EDGE);
          for (int z = z0; z < z1; ++z)
            for (int y = y0; y < y1; ++y) {
              const int from = leaf_place(slab, x0, y, z) - x0;
              const int to = (z - begin.z) * RECORD_LAYER + (y - begin.y) * RECORD_ROW - begin.x;
              for (int x = x0; x < x1; ++x) {
                const float value = leaf < 0 ? 0.0f : voxels[from + x];
                if (stores)
                  store_voxel(record, to + x, value, scale, most);
                else
                  most = fmax(most, value);
              }
            }
        }
      }
    }
#if TFM_VOXEL_BITS == 8
    *(__global float *)(record + RECORD_VOXELS) = most / 255.0f;
#endif
  }
}
