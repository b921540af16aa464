/* From leaves of 8x8x8 voxels, as the host keeps them, to the bricks and records of body/grid.h.
   Works on a slab of brick layers and the leaf layers that it touches. Requires: what grid.h does. */
#include "body/grid.h"
#include "body/leaves.h"

/* Whether the cube of at most 8 voxels along each axis from (x, y, z) on touches a leaf: one does at its corners. */
TFM_INLINE int touches_leaf(LeafSlab slab, int x, int y, int z, int edge)
{
  int touched = 0;
  for (int corner = 0; corner < 8; ++corner)
    touched |= leaf_of(slab, x + (corner & 1) * (edge - 1), y + (corner >> 1 & 1) * (edge - 1),
                       z + (corner >> 2) * (edge - 1)) >= 0;
  return touched;
}

/* occupied  out: 1 for every brick of the slab (x fastest, from layer first_layer) with a voxel > 0 in the cells that
   it answers for. brick_count  bricks along x, y and layers of the slab. One work-item a brick. */
__kernel void find_occupied(__global const int *table, __global const float *leaves, int4 leaf_count, int4 first,
                            int4 brick_count, int first_layer, __global uchar *occupied)
{
  const int bx = (int)get_global_id(0), by = (int)get_global_id(1), bz = (int)get_global_id(2);
  if (bx >= brick_count.x || by >= brick_count.y || bz >= brick_count.z)
    return;
  const LeafSlab slab = {table, leaves, leaf_count, first};
  const int first_x = bx * BRICK_EDGE, first_y = by * BRICK_EDGE, first_z = (first_layer + bz) * BRICK_EDGE;
  const int is_near = touches_leaf(slab, first_x, first_y, first_z, BRICK_EDGE + MOST_SHARED);
  int found = 0;
  for (int z = 0; z < BRICK_EDGE + MOST_SHARED && is_near && !found; ++z)
    for (int y = 0; y < BRICK_EDGE + MOST_SHARED && !found; ++y)
      for (int x = 0; x < BRICK_EDGE + MOST_SHARED && !found; ++x)
        found = leaf_voxel(slab, first_x + x, first_y + y, first_z + z) > 0.0f;
  occupied[((size_t)bz * (size_t)brick_count.y + (size_t)by) * (size_t)brick_count.x + (size_t)bx] = (uchar)found;
}

/* Write the records of the blocks listed: x, y, z and the number of the record in the pool given. exponent: voxels are multiplied by 2 to this power before they are stored (16 bits). One work-item a
   record. */
__kernel void fill_records(__global const int *table, __global const float *leaves, int4 leaf_count, int4 first,
                           __global const int4 *blocks, int count, int exponent, __global Voxel *pool)
{
  const int i = (int)get_global_id(0);
  if (i >= count)
    return;
  const LeafSlab slab = {table, leaves, leaf_count, first};
  const int4 corner = blocks[i] * BLOCK_EDGE;
  __global Voxel *record = pool + (size_t)blocks[i].w * RECORD_SIZE;
#if TFM_VOXEL_BITS == 8
  float most = 0.0f;
  for (int z = 0; z < RECORD_EDGE; ++z)
    for (int y = 0; y < RECORD_EDGE; ++y)
      for (int x = 0; x < RECORD_EDGE; ++x)
        most = fmax(most, leaf_voxel(slab, corner.x + x, corner.y + y, corner.z + z));
  *(__global float *)(record + RECORD_VOXELS) = most / 255.0f;
#endif
  for (int z = 0; z < RECORD_EDGE; ++z)
    for (int y = 0; y < RECORD_EDGE; ++y)
      for (int x = 0; x < RECORD_EDGE; ++x) {
        const float value = leaf_voxel(slab, corner.x + x, corner.y + y, corner.z + z);
        const int at = z * RECORD_LAYER + y * RECORD_ROW + x;
#if TFM_VOXEL_BITS == 32
        record[at] = value;
#elif TFM_VOXEL_BITS == 16
        vstore_half(ldexp(value, exponent), at, (__global half *)record);
#else
        record[at] = most > 0.0f ? convert_uchar_sat_rte(255.0f * (value / most)) : (uchar)0;
#endif
      }
}
