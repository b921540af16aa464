/* Extinction at the points of a lattice (view/orders.h): the mean over the cube around each, so that none of the density
   is lost between them.
   Includes expected before: the headers of the bodies' kinds. Requires: what view/cells.h does. */
#include "core/store.h"
#include "view/cells.h"

/* extinction  out, of the points
   items       first of this launch and end */
__kernel void order_media(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, ORDERS orders,
                          __global float *extinction, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  if (!any_lane(points.wanted))
    return;
  SCENE(scene, ints(-1), ints(-1));
  const Vec3 centre = position_of(orders, &points);
  Floats sum[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sum[c] = floats(0.0f);
  EACH_SAMPLE(orders) {
    Floats here[TFM_CHANNELS];
    extinction_at(&scene, orders, sample_of_cell(orders, centre, i, j, k), here);
    for (int c = 0; c < TFM_CHANNELS; ++c)
      sum[c] += here[c];
  }
  const float share = 1.0f / (float)(orders->samples * orders->samples * orders->samples);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    store_floats(extinction + (size_t)c * padded_size(orders), points.at, points.wanted, share * sum[c]);
}
