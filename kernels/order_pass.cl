/* Camera pass through what the later orders scatter (view/orders.h).
   Includes expected before: the headers of the bodies' kinds. Requires: what see.h does, with TFM_LATTICE 2. */
#include "view/see.h"

/* scattered  sum over the orders of the light that arrives, TFM_ORDER_COLOURS of each point
   colour     of the light, where that is one number for three
   solid      as of camera_pass
   later      adds to
   window     x0, y0, x1, y1 of the pixels of this launch */
__kernel void order_pass(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS, ORDERS orders,
                         __global const float *scattered, float4 colour, __global const float4 *solid,
                         __global float4 *later AND_DEEP_ARGUMENTS, int4 window)
{
  const Pixels pixels = tile_pixels(view, places, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(view, pixels);
  const Interval seen = before_solids(view, solid, pixels);
  const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, pixels.inside);
  SCENE(scene, TO_INTS(pixels.at_x), TO_INTS(pixels.at_y));
  const OrdersOnRay lattice = orders_on_ray(orders, scattered, ray);
  LightSums sums = light_sums_begin();
#if TFM_ORDER_MEDIA
  const float4 scale = colour; /* each medium's share is known */
#else
  const float4 scale = (float4)(media->albedo[0], media->albedo[1], media->albedo[2], 0.0f) * colour;
#endif
#if TFM_DEEP_COLOURS
  sums.deep = DEEP_COLOURS(view, ray, pixels);
  sums.deep.scale[0] = scale.x;
  sums.deep.scale[1] = scale.y;
  sums.deep.scale[2] = scale.z;
#endif
  see_media(&scene, &on_ray, on_ray.all, 0, on_ray.meets, &lattice, &sums);
  add_float4(later, pixel_index(view, pixels), pixels.wanted, scale.x * sums.colour[0], scale.y * sums.colour[1],
             scale.z * sums.colour[2], floats(0.0f));
}
