/* Camera pass through the light from all around that a lattice of points holds (view/surroundings.h).
   Includes expected before: the headers of the bodies' kinds. Requires: what see.h does, with TFM_LATTICE 3. */
#include "view/see.h"

#if TFM_LIGHT_LAYERS
#define AND_LAYER_ARGUMENT , int layer
#else
#define AND_LAYER_ARGUMENT
#endif

/* scattered        of surroundings_view
   lights           how many they are
   layer            which all of them belong to (with TFM_LIGHT_LAYERS only)
   solid            as of camera_pass
   FRAME_ARGUMENTS  as of frame_add: what lies along the rays is there already
   window           x0, y0, x1, y1 of the pixels of this launch */
__kernel void surroundings_pass(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS, ORDERS orders,
                                __global const float *scattered, int lights AND_LAYER_ARGUMENT,
                                __global const float4 *solid, FRAME_ARGUMENTS, int4 window)
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
#if TFM_DEEP_COLOURS
  sums.deep = DEEP_COLOURS(view, ray, pixels);
#endif
  const CameraSums camera = see_media(&scene, &on_ray, on_ray.all, 0, on_ray.meets, &lattice, &sums);
  FRAME(frame);
#if HAS_OCTAVES
  Floats through[3];
  load_through(&frame, view, pixels, through);
  add_octaves(view, through, &sums);
#endif
#if TFM_LIGHT_LAYERS
  const LightLayers layers = light_layers_of(view, added, pixels);
  add_to_layer(&layers, layer, sums.colour);
#endif
  sums.seen_opacity *= (float)lights;
  sums.samples = camera.samples;
  frame_add(&frame, view, pixels, &sums);
}
