/* Surface pass: deferred Lambert shading of what the camera sees of solids, by the reduced intensity of any number of
   lights of one kind, dimmed by the media on its way to the camera (TFM section 4.1, algorithm 1). Runs after the
   camera's transmittance is known.
   Includes expected before: a basis and a light header, those of the bodies' kinds.
   Requires: what batch.h, camera_ray.h and surface.h do. */
#include "light/batch.h"
#include "view/see.h"
#include "view/surface.h"

/* The lanes whose pixels show what the light sees, where no other solid stops it. lit: 1 for each such pixel of the
   light's rectangle. */
TFM_INLINE Ints lit_pixels(LIGHT light, __global const uchar *lit, Pixels pixels, Ints shaded)
{
  const int x0 = light->lit_pixels[0], y0 = light->lit_pixels[1], width = light->lit_pixels[2] - x0;
  const Ints within = (pixels.x >= x0) & (pixels.y >= y0) & (pixels.x < light->lit_pixels[2]) &
                      (pixels.y < light->lit_pixels[3]);
  const Ints index = light->first_lit + (pixels.y - y0) * width + pixels.x - x0;
  return load_flags(lit, index, shaded & within);
}

/* starts, touching, blocks   as of lights_of_block
   solid          normal (world, unit, towards the camera) and distance of what each pixel shows; INFINITY without
   albedo         RGB of that; 0 on holdouts
   lit            of all lights, for the pixels of their rectangles: 1 where no other solid stops the light
   transmittance  of the camera rays
   radiance       adds what solids reflect, RGB
   samples        adds the densities read
   added          adds what they reflect of each light (with TFM_LIGHT_LAYERS only)
   window         x0, y0, x1, y1 of the pixels of this launch */
__kernel void surface_pass(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                           __global const int *starts, __global const int *touching, __global const float4 *solid,
                           __global const float4 *albedo, __global const uchar *lit,
                           __global const float4 *transmittance, __global float4 *radiance,
                           __global uint *samples AND_ADDED_ARGUMENT, int4 blocks, int4 window)
{
  const Pixels pixels = tile_pixels(view, places, window);
  LIGHT_BUFFERS(buffers);
  const Lights here = lights_of_block(lights, starts, touching, blocks, window, &buffers);
  if (!any_lane(pixels.wanted) || here.count == 0)
    return;
  const Ray ray = camera_rays(view, pixels);
  const Surface surface = surface_at(view, solid, albedo, ray, pixels);
  if (!any_lane(surface.shown))
    return;
  SCENE(scene, TO_INTS(pixels.at_x), TO_INTS(pixels.at_y));
  const Ints index = pixel_index(view, pixels), wanted = pixels.wanted & pixels.inside;
  Floats dimmed[4], colour[3];
  load_float4(transmittance, index, wanted, 0.0f, dimmed);
  for (int c = 0; c < 3; ++c)
    colour[c] = floats(0.0f);
#if TFM_LIGHT_LAYERS
  const LightLayers layers = light_layers_of(view, added, pixels);
#endif
  Ints read = ints(0);
  for (int k = 0; k < here.count; ++k) {
    LIGHT light = lights + here.numbers[k];
    const LightSample sample = light_at(light, point_in_light(light, surface.point));
    const Floats reflects = surface_reflects(light, &surface, sample);
    const Ints shaded = lit_pixels(light, lit, pixels, wanted & (reflects > 0.0f));
    if (!any_lane(shaded))
      continue;
    const LightPath path = light_path(&scene, light, &buffers, surface.point, sample, 0, 0);
    Floats depth[TFM_CHANNELS], tint[3], through[3];
    light_optical_depths(&scene, light, &buffers, &path, shaded, &read, depth);
    light_tint(light, &buffers, sample, tint);
    for (int c = 0; c < 3; ++c)
      through[c] = dimmed[c];
    if (view->paper_attenuation) {
      /* Algorithm 1 dims what it sees only between the ends of the light's cone. */
      const Interval seen = {floats(0.0f), surface.distance};
      const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, shaded);
      Interval cone = on_ray.all;
      const Ints dims = on_ray.meets & light_clip(light, ray, &cone);
      const CameraSums sums = see_media(&scene, &on_ray, cone, 1, dims);
      for (int c = 0; c < 3; ++c)
        through[c] = transmittance_of(extinguished(media, &sums.total, c));
      read += sums.samples;
    }
    Floats adds[3];
    for (int c = 0; c < 3; ++c) {
      const Floats arrives = transmittance_of(depth[TFM_CHANNELS == 3 ? c : 0]) * tint[c] * reflects;
      adds[c] = shaded ? light->intensity[c] * surface.albedo[c] * arrives * through[c] : floats(0.0f);
      colour[c] += adds[c];
    }
#if TFM_LIGHT_LAYERS
    add_to_layer(&layers, light->layer, adds);
#endif
  }
  add_float4(radiance, index, pixels.wanted, colour[0], colour[1], colour[2], floats(0.0f));
  add_counts(samples, index, pixels.wanted, read);
}
