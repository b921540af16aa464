/* Deep pass: the samples of a deep image, counted and then stored (view/deep.h).
   Includes expected before: the headers of the bodies' kinds. Requires: what see.h does, with TFM_DEEP. */
#include "view/see.h"

/* solid      as of camera_pass
   albedo     as of camera_pass
   tolerance  of the transmittance
   firsts     where each pixel's samples begin (where they are stored)
   counts     of each pixel: out where they are counted, else in
   samples    DEEP_NUMBERS each: out
   stores     0: they are counted
   window     x0, y0, x1, y1 of the pixels of this launch */
__kernel void deep_pass(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS, __global const float4 *solid,
                        __global const float4 *albedo, float tolerance, __global const int *firsts, __global int *counts,
                        __global float *samples, int stores, int4 window)
{
  const Pixels pixels = tile_pixels(view, places, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(view, pixels);
  Interval seen = {floats(0.0f), floats(INFINITY)};
  Ints shows = ints(0);
#if TFM_SHADOW
  Floats reflects[4];
  seen.end = solid_distance(view, solid, pixels);
  load_float4(albedo, pixel_index(view, pixels), pixels.wanted & pixels.inside, 0.0f, reflects);
  shows = (seen.end < INFINITY) & (reflects[3] == 0.0f);
#else
  (void)solid;
  (void)albedo;
#endif
  IntArray first, most, index, wanted;
  first.lanes = most.lanes = ints(0);
  index.lanes = pixel_index(view, pixels);
  wanted.lanes = pixels.wanted;
  for (int lane = 0; lane < TFM_LANES; ++lane)
    if (stores && wanted.lane[lane]) {
      first.lane[lane] = firsts[index.lane[lane]];
      most.lane[lane] = counts[index.lane[lane]];
    }
  DeepRay deep = deep_begin(view, ray, tolerance, samples, first.lanes, most.lanes, pixels.wanted);
  const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, pixels.inside);
  SCENE(scene, TO_INTS(pixels.at_x), TO_INTS(pixels.at_y));
  const CameraSums sums = see_media(&scene, &on_ray, on_ray.all, 0, on_ray.meets, &deep);
#if TFM_GRIDS
  const Ints gone = on_ray.meets & !is_visible(view, &sums.ray);
#else
  const Ints gone = ints(0);
  (void)sums;
#endif
  deep_end(&deep, gone, shows, seen.end, seen_through_haze(view, seen.end));
  if (!stores)
    store_counts((__global uint *)counts, pixel_index(view, pixels), pixels.wanted, deep.count);
}
