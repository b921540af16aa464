/* Camera pass through a lattice of light: what lies along camera rays, and what all its lights scatter towards the camera,
   from one march. Requires: what see.h does, with TFM_LATTICE. */
#include "view/see.h"

/* lattice       of light_lattice
   colour        of all lights, where the lattice has one number for three
   lights        how many they are
   radiance      out, as of the camera pass, with single scattering
   light_seen    adds the part of the light that arrives times opacity, RGB, and the opacity
   window        x0, y0, x1, y1 of the pixels of this launch
   The others as of camera_sums_store. */
__kernel void lattice_pass(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, __global const float *lattice,
                           float4 colour, int lights, __global const float4 *albedo, __global float4 *transmittance,
                           __global float4 *radiance, __global float4 *light_seen, __global uint *samples, int4 window)
{
  const Pixels pixels = tile_pixels(view, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(view, pixels);
  const Interval seen = {floats(0.0f), floats(INFINITY)};
  const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, pixels.inside);
  SCENE(scene);
  CameraSums sums = camera_sums_begin(media, on_ray.meets);
  LatticeSums lit = lattice_sums_begin();
  see_grids(&scene, &on_ray, on_ray.all, ints(view->steps), 1, on_ray.meets, &sums, lattice, &lit);
  camera_sums_store(view, media, &sums, on_ray.meets, seen.end, pixels, albedo, transmittance, radiance, samples);
  const Ints index = pixel_index(view, pixels);
  add_float4(radiance, index, pixels.wanted, media->albedo[0] * colour.x * lit.colour[0],
             media->albedo[1] * colour.y * lit.colour[1], media->albedo[2] * colour.z * lit.colour[2], floats(0.0f));
  const float count = (float)lights;
  add_float4(light_seen, index, pixels.wanted, count * lit.seen[0], count * lit.seen[TFM_CHANNELS == 3 ? 1 : 0],
             count * lit.seen[TFM_CHANNELS == 3 ? 2 : 0], count * lit.seen_opacity);
}
