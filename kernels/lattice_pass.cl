/* Camera pass through a lattice of light: what lies along camera rays, and what all its lights scatter towards the camera,
   from one march. Requires: what see.h does, with TFM_LATTICE. */
#include "view/see.h"

#if TFM_LIGHT_LAYERS
#define AND_LAYERS_ARGUMENT , __global const int *layers
#else
#define AND_LAYERS_ARGUMENT
#endif

/* lattice          of light_lattice
   colour           of all lights, where the lattice has one number for three
   lights           how many they are
   layers           which each part of the light belongs to (with TFM_LIGHT_LAYERS only)
   FRAME_ARGUMENTS  out, as of frame_store
   window           x0, y0, x1, y1 of the pixels of this launch */
__kernel void lattice_pass(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS, __global const float *lattice,
                           float4 colour, int lights AND_LAYERS_ARGUMENT, __global const float4 *albedo, FRAME_ARGUMENTS,
                           int4 window)
{
  const Pixels pixels = tile_pixels(view, places, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(view, pixels);
  const Interval seen = {floats(0.0f), floats(INFINITY)};
  const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, pixels.inside);
  SCENE(scene, TO_INTS(pixels.at_x), TO_INTS(pixels.at_y));
  CameraSums camera = camera_sums_begin(media, on_ray.meets);
  LightSums sums = light_sums_begin();
  const float scale[3] = {media->albedo[0] * colour.x, media->albedo[1] * colour.y, media->albedo[2] * colour.z};
#if TFM_DEEP_COLOURS
  sums.deep = DEEP_COLOURS(view, ray, pixels);
  for (int c = 0; c < 3; ++c)
    sums.deep.scale[c] = scale[c];
#endif
  see_grids(&scene, &on_ray, on_ray.all, ints(view->steps), 1, on_ray.meets, &camera, lattice, &sums);
  const Seen met = camera_sums_end(view, media, &camera, on_ray.meets, seen.end, pixels, albedo);
#if TFM_LIGHT_LAYERS
  const LightLayers of_crop = light_layers_of(view, added, pixels);
  for (int i = 0; i < TFM_LATTICE_APART; ++i) {
    for (int c = 0; c < 3; ++c) {
#if HAS_OCTAVES
      sums.apart[i][c] += octaves_on_ray(view, met.through[c]) * sums.later_apart[i][c];
#endif
      sums.apart[i][c] *= scale[c];
      sums.colour[c] += sums.apart[i][c];
    }
    add_to_layer(&of_crop, layers[i], sums.apart[i]);
  }
#else
#if HAS_OCTAVES
  add_octaves(view, met.through, &sums);
#endif
  for (int c = 0; c < 3; ++c)
    sums.colour[c] *= scale[c];
#endif
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums.seen[c] *= (float)lights;
  sums.seen_opacity *= (float)lights;
  sums.samples = camera.samples;
  FRAME(frame);
  frame_store(&frame, view, pixels, &met, &sums);
}
