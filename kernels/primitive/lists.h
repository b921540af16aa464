/* Which primitives the rays of a tile may meet: lists for bins of texels or pixels, made by primitives.cl. */
#ifndef TFM_LISTS_H
#define TFM_LISTS_H

#include "core/ray.h"

/* primitives   as seen from where the rays come from
   balls        around all that rays may meet of each: centre and radius
   bin_starts   [bins + 1]: where the members of each begin
   bin_members  numbers of primitives, rising in each bin
   bins         columns and rows of bins, texels along a side of a bin as a power of two, 0 */
#define PRIMITIVE_ARGUMENTS \
  PRIMITIVE primitives, __global const float4 *balls, __global const int *bin_starts, \
      __global const int *bin_members, int4 bins

typedef struct {
  PRIMITIVE primitives;
  __global const float4 *balls;
  __global const int *starts, *members;
  int4 bins;
  Ints bin; /* of each lane; -1: none */
} Lists;

TFM_INLINE Ints bin_of(int4 bins, Ints x, Ints y)
{
  const Ints column = x >> bins.z, row = y >> bins.z;
  return ((column >= 0) & (row >= 0) & (column < bins.x) & (row < bins.y)) ? row * bins.x + column : ints(-1);
}

/* One after the other the bins of some lanes, and the lanes of each; -1 after the last. left: the lanes still to come. */
TFM_INLINE int next_bin(const Lists *lists, Ints *left, Ints *here)
{
  if (!any_lane(*left))
    return -1;
  const int bin = least_int(*left ? lists->bin : ints(0x7fffffff));
  *here = *left & (lists->bin == bin);
  *left &= lists->bin != bin;
  return bin;
}

#endif
