/* Camera pass: what lies along the camera rays of a frame without lights; with lights the first scatter pass sees to it.
   Includes expected before: the headers of the bodies' kinds. Requires: what see.h does. */
#include "view/see.h"

/* solid            normal and distance of the solid that a pixel shows, INFINITY without (with TFM_SHADOW only)
   albedo           RGB of that, and 1 on holdouts (with TFM_SHADOW only)
   FRAME_ARGUMENTS  out, as of frame_store
   window           x0, y0, x1, y1 of the pixels of this launch */
__kernel void camera_pass(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS, __global const float4 *solid,
                          __global const float4 *albedo, FRAME_ARGUMENTS, int4 window)
{
  const Pixels pixels = tile_pixels(view, places, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(view, pixels);
  const Interval seen = before_solids(view, solid, pixels);
  const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, pixels.inside);
  SCENE(scene, TO_INTS(pixels.at_x), TO_INTS(pixels.at_y));
  const CameraSums camera = see_media(&scene, &on_ray, on_ray.all, 0, on_ray.meets);
  LightSums none = light_sums_begin();
  none.samples = camera.samples;
  const Seen met = camera_sums_end(view, media, &camera, on_ray.meets, seen.end, pixels, albedo);
  FRAME(frame);
  frame_store(&frame, view, pixels, &met, &none);
}
