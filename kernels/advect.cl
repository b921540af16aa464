/* What a grid holds, moved by its velocities: the value at x is that at x - u(x) t (Eulerian, to first order).
   Works on the leaves that what moves may reach. */
#include "core/lanes.h"
#include "body/leaves.h"

#define LEAF_VOXELS (LEAF_EDGE * LEAF_EDGE * LEAF_EDGE)

/* Sums of the voxels around a place, by their trilinear weights. */
typedef struct {
  float value;
  float weight; /* of those that are not 0 */
} Around;

/* At a voxel, and a fraction from 0 to 1 after it along each axis. */
TFM_INLINE Around leaf_around(LeafSlab slab, int4 voxel, float4 after)
{
  Around sums = {0.0f, 0.0f};
  for (int corner = 0; corner < 8; ++corner) {
    const int dx = corner & 1, dy = corner >> 1 & 1, dz = corner >> 2;
    const float weight =
        (dx ? after.x : 1.0f - after.x) * (dy ? after.y : 1.0f - after.y) * (dz ? after.z : 1.0f - after.z);
    if (weight == 0.0f) /* all but one, where voxels of both grids coincide */
      continue;
    const float value = leaf_voxel(slab, voxel.x + dx, voxel.y + dy, voxel.z + dz);
    sums.value += weight * value;
    sums.weight += value != 0.0f ? weight : 0.0f;
  }
  return sums;
}

/* The place of a work-item's voxel within its leaf. */
TFM_INLINE int4 within_leaf(int voxel)
{
  return (int4)(voxel & (LEAF_EDGE - 1), voxel >> LEAF_SHIFT & (LEAF_EDGE - 1), voxel >> 2 * LEAF_SHIFT, 0);
}

/* velocity  out: component number `component` of the four of each voxel, where the grid of that component has it, and
   in the fourth, which is 0 at first, whether anything is known of it: there is a velocity, or something that moves. At
   the rim of what is stored zeros do not count.
   voxels, after  of each leaf, where its low voxel lies in the component's grid: a voxel, and fractions after it;
   x_along, y_along, z_along  from there, for a step along each axis; corners  in the grid that moves; most: no
   component is larger. One work-item a voxel, from leaf first_leaf on. */
__kernel void sample_velocity(__global const int *table, __global const float *leaves, int4 leaf_count, int4 first,
                              __global const int *moving_table, __global const float *moving, int4 moving_count,
                              int4 moving_first, __global const int4 *voxels, __global const float4 *after,
                              __global const int4 *corners, float4 x_along, float4 y_along, float4 z_along, float most,
                              int component, int first_leaf, int count, __global float *velocity)
{
  const int i = (int)get_global_id(0);
  if (i >= count * LEAF_VOXELS)
    return;
  const LeafSlab slab = {table, leaves, leaf_count, first};
  const LeafSlab density = {moving_table, moving, moving_count, moving_first};
  const int leaf = first_leaf + i / LEAF_VOXELS;
  const int4 within = within_leaf(i % LEAF_VOXELS), corner = corners[leaf] + within;
  const float4 place = after[leaf] + (float)within.x * x_along + (float)within.y * y_along + (float)within.z * z_along;
  const float4 low = floor(place);
  const Around sums = leaf_around(slab, voxels[leaf] + convert_int4(low), place - low);
  const int moves = leaf_voxel(density, corner.x, corner.y, corner.z) > 0.0f;
  const float value = moves || sums.weight <= 0.0f ? sums.value : sums.value / sums.weight;
  __global float *found = velocity + 4 * ((size_t)leaf * LEAF_VOXELS + (size_t)(i % LEAF_VOXELS));
  found[component] = fmin(fmax(value, -most), most);
  if (moves || sums.weight > 0.0f)
    found[3] = 1.0f;
}

/* extended  out: as velocity, and where nothing is known of it the mean of those of the 26 voxels around, so many voxels
   apart along each axis, of which there is. corners  of the leaves, as table knows them. One work-item a voxel, from leaf
   first_leaf on. */
__kernel void extend_velocity(__global const int *table, int4 leaf_count, int4 first, __global const int4 *corners,
                              int apart, int first_leaf, int count, __global const float4 *velocity,
                              __global float4 *extended)
{
  const int i = (int)get_global_id(0);
  if (i >= count * LEAF_VOXELS)
    return;
  const LeafSlab slab = {table, 0, leaf_count, first};
  const int leaf = first_leaf + i / LEAF_VOXELS;
  const size_t at = (size_t)leaf * LEAF_VOXELS + (size_t)(i % LEAF_VOXELS);
  float4 sum = velocity[at];
  if (sum.w <= 0.0f) {
    const int4 corner = corners[leaf] + within_leaf(i % LEAF_VOXELS);
    for (int neighbour = 0; neighbour < 27; ++neighbour) {
      const int x = corner.x + apart * (neighbour % 3 - 1);
      const int y = corner.y + apart * (neighbour / 3 % 3 - 1);
      const int z = corner.z + apart * (neighbour / 9 - 1);
      const int other = leaf_of(slab, x, y, z);
      if (other >= 0) {
        const float4 known = velocity[(size_t)other * LEAF_VOXELS + (size_t)leaf_place(slab, x, y, z)];
        sum += known.w > 0.0f ? known : (float4)(0.0f);
      }
    }
    sum = sum.w > 0.0f ? sum / sum.w : sum;
  }
  extended[at] = sum;
}

/* moved  out: what the grid holds at x - u(x) t. x_by, y_by, z_by: of u t along x, y, z, in voxels, from the three
   components of the velocity. One work-item a voxel, from leaf first_leaf on, the first of moved. */
__kernel void advect(__global const int *table, __global const float *leaves, int4 leaf_count, int4 first,
                     __global const int4 *corners, int first_leaf, int count, __global const float4 *velocity,
                     float4 x_by, float4 y_by, float4 z_by, __global float *moved)
{
  const int i = (int)get_global_id(0);
  if (i >= count * LEAF_VOXELS)
    return;
  const LeafSlab slab = {table, leaves, leaf_count, first};
  const int leaf = first_leaf + i / LEAF_VOXELS;
  const float4 u = velocity[(size_t)leaf * LEAF_VOXELS + (size_t)(i % LEAF_VOXELS)];
  const float4 back = -(float4)(dot(x_by.xyz, u.xyz), dot(y_by.xyz, u.xyz), dot(z_by.xyz, u.xyz), 0.0f);
  const float4 low = floor(back);
  const int4 voxel = corners[leaf] + within_leaf(i % LEAF_VOXELS) + convert_int4(low);
  moved[i] = leaf_around(slab, voxel, back - low).value;
}
