/* Extinction at the points of a lattice (view/orders.h): the mean over the cube around each, so that none of the density
   is lost between them.
   Includes expected before: the headers of the bodies' kinds. Requires: what view/cells.h does; TFM_ORDER_DEGREE, as
   order_lights.cl does; TFM_ORDER_EMISSION, 1 where what media emit is swept through the lattice. */
#include "core/store.h"
#include "view/cells.h"

/* extinction  out, of the points
   deposited   what primitives hold (with these only)
   scattering  out, of several media: of each colour what they scatter; then, where scattering has a lobe, what of that
               goes straight on
   of_media    out, in that case: what each medium scatters
   emitted     out, of each colour: radiance that is emitted, per world unit
   items       first of this launch and end */
__kernel void order_media(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, ORDERS orders,
                          __global float *extinction DEPOSITED_ARGUMENT
#if TFM_ORDER_MEDIA
                          , __global float *scattering, __global float *of_media
#endif
#if TFM_ORDER_EMISSION
                          , __global float *emitted
#endif
                          , int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  if (!any_lane(points.wanted))
    return;
  SCENE(scene, ints(-1), ints(-1));
  const Vec3 centre = position_of(orders, &points);
  const Amounts deposits = DEPOSITED_IN(orders, &points);
  Floats sum[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sum[c] = floats(0.0f);
#if TFM_ORDER_MEDIA
  Floats scatters[TFM_ORDER_MEDIA][3];
  for (int m = 0; m < TFM_ORDER_MEDIA; ++m)
    for (int c = 0; c < 3; ++c)
      scatters[m][c] = floats(0.0f);
#endif
#if TFM_ORDER_EMISSION
  Floats emits[TFM_ORDER_COLOURS];
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    emits[c] = floats(0.0f);
#endif
  EACH_SAMPLE(orders) {
    const Amounts density = density_at(&scene, orders, sample_of_cell(orders, centre, i, j, k), &deposits);
    for (int c = 0; c < TFM_CHANNELS; ++c)
      sum[c] += extinguished(media, &density, c);
#if TFM_ORDER_MEDIA
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m)
      for (int c = 0; c < 3; ++c)
        scatters[m][c] += media[m].sigma_s[c] * density.of[m][AMOUNT_OF(c)];
#endif
#if TFM_ORDER_EMISSION
    for (int m = 0; m < TFM_MEDIA; ++m)
      for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
        emits[c] += COLOUR_OF(media[m].emission, c) * density.of[m][AMOUNT_OF(c)];
#endif
  }
  const float share = 1.0f / (float)(orders->samples * orders->samples * orders->samples);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    store_floats(extinction + (size_t)c * padded_size(orders), points.at, points.wanted, share * sum[c]);
#if TFM_ORDER_EMISSION
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    store_floats(emitted + (size_t)c * padded_size(orders), points.at, points.wanted, share * emits[c]);
#endif
#if TFM_ORDER_MEDIA
  for (int c = 0; c < 3; ++c) {
    Floats all = floats(0.0f), straight = floats(0.0f);
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m) {
      all += scatters[m][c];
      straight += orders[m].straight * scatters[m][c];
    }
    store_floats(scattering + (size_t)c * padded_size(orders), points.at, points.wanted, share * all);
#if TFM_ORDER_DEGREE
    store_floats(scattering + (size_t)(3 + c) * padded_size(orders), points.at, points.wanted, share * straight);
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m)
      store_floats(of_media + (size_t)(3 * m + c) * padded_size(orders), points.at, points.wanted, share * scatters[m][c]);
#else
    (void)straight;
    (void)of_media;
#endif
  }
#endif
}
