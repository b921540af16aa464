/* Leaves of 8x8x8 voxels, as the host keeps them: a slab of layers of a grid. Requires: core/lanes.h. */
#ifndef TFM_LEAVES_H
#define TFM_LEAVES_H

#define LEAF_SHIFT 3
#define LEAF_EDGE 8

/* table: number of a leaf among the slab's, or -1; leaf_count: leaves along x, y and layers of the slab;
   first: where voxel (0, 0, 0), as voxels are counted, lies from the slab's first leaf voxel on. */
typedef struct {
  __global const int *table;
  __global const float *leaves;
  int4 leaf_count;
  int4 first;
} LeafSlab;

/* Number of the leaf that holds a voxel, or -1. */
TFM_INLINE int leaf_of(LeafSlab slab, int x, int y, int z)
{
  const int vx = x + slab.first.x, vy = y + slab.first.y, vz = z + slab.first.z;
  const int lx = vx >> LEAF_SHIFT, ly = vy >> LEAF_SHIFT, lz = vz >> LEAF_SHIFT;
  if (vx < 0 || vy < 0 || vz < 0 || lx >= slab.leaf_count.x || ly >= slab.leaf_count.y || lz >= slab.leaf_count.z)
    return -1;
  return slab.table[(lz * slab.leaf_count.y + ly) * slab.leaf_count.x + lx];
}

/* Number of a voxel within its leaf. */
TFM_INLINE int leaf_place(LeafSlab slab, int x, int y, int z)
{
  const int vx = x + slab.first.x, vy = y + slab.first.y, vz = z + slab.first.z;
  return ((vz & (LEAF_EDGE - 1)) * LEAF_EDGE + (vy & (LEAF_EDGE - 1))) * LEAF_EDGE + (vx & (LEAF_EDGE - 1));
}

TFM_INLINE float leaf_voxel(LeafSlab slab, int x, int y, int z)
{
  const int leaf = leaf_of(slab, x, y, z);
  if (leaf < 0)
    return 0.0f;
  return slab.leaves[(size_t)leaf * (LEAF_EDGE * LEAF_EDGE * LEAF_EDGE) + (size_t)leaf_place(slab, x, y, z)];
}

#endif
