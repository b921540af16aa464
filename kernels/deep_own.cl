/* Gives deep samples the ambient light that media scatter there, and what they emit.
   Includes expected before: the headers of the bodies' kinds. Requires: what see.h does, with TFM_DEEP 2. */
#include "view/see.h"

/* solid               as of camera_pass
   AND_DEEP_ARGUMENTS  adds to the colours
   window              x0, y0, x1, y1 of the pixels of this launch */
__kernel void deep_own(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS,
                       __global const float4 *solid AND_DEEP_ARGUMENTS, int4 window)
{
  const Pixels pixels = tile_pixels(view, places, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(view, pixels);
  const Interval seen = before_solids(view, solid, pixels);
  const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, pixels.inside);
  SCENE(scene, TO_INTS(pixels.at_x), TO_INTS(pixels.at_y));
  DeepColours deep = DEEP_COLOURS(view, ray, pixels);
  see_media(&scene, &on_ray, on_ray.all, 0, on_ray.meets, &deep);
}
