/* Points of a lattice (view/orders.h) whose numbers are no sums of light: beside solids, and at its ends.
   Requires: what view/orders.h does; TFM_CHANNELS and TFM_ORDER_COLOURS may be any. */
#include "core/store.h"
#include "view/orders.h"

/* Gives points behind solids what those in the open beside them have: their mean. A work-item takes one.
   hidden   their numbers, and bits of which of the 27 points around each these are, from one to the next along x
   numbers  of the points, `count` of each: by themselves, or, where `together` is 1, one after the other at each point
   items    first of this launch and end */
__kernel void order_fill(ORDERS orders, __global const int2 *hidden, __global float *numbers, int count, int together,
                         int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const int number = hidden[item].x, bits = hidden[item].y, open = popcount(bits);
  const int nx = orders->size[0], ny = orders->size[1];
  const int x = number % nx, y = number / nx % ny, z = number / (nx * ny);
  const int row = together ? nx : nx + 2 * PAD, layer = together ? nx * ny : row * (ny + 2);
  const int at = together ? number : (z + 1) * layer + (y + 1) * row + x + PAD;
  for (int k = 0; k < count; ++k) {
    __global float *first = numbers + (together ? (size_t)k : (size_t)k * padded_size(orders));
    const int step = together ? count : 1;
    float sum = 0.0f;
    for (int left = bits; left; left &= left - 1) {
      const int bit = popcount((left & -left) - 1);
      sum += first[step * (at + bit % 3 - 1 + (bit / 3 % 3 - 1) * row + (bit / 9 - 1) * layer)];
    }
    first[step * at] = sum / (float)open;
  }
}

/* Takes what the outermost points scatter: in a medium that is everywhere they end the lattice.
   count: of numbers of a point, which lie one after the other; items: first of this launch and end */
__kernel void order_end(ORDERS orders, __global float *scattered, int count, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  Ints ends = points.place[0] < 0;
  for (int axis = 0; axis < 3; ++axis)
    ends |= (points.place[axis] == 0) | (points.place[axis] == orders->size[axis] - 1);
  ends &= points.wanted;
  if (!any_lane(ends))
    return;
  for (int c = 0; c < count; ++c)
    store_floats(scattered, points.number * count + c, ends, floats(0.0f));
}
