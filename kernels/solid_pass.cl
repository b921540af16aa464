/* Solid pass: deferred Lambert shading of what the camera sees of solids, by one light's reduced intensity, dimmed by
   the medium on its way to the camera (TFM section 4.1, algorithm 1). Runs after the view pass of the same light.
   Includes expected before: Params, a basis and a light header.
   Requires: what they, absorption.h and reduced_intensity.h do. */
#include "absorption.h"
#include "reduced_intensity.h"
#include "surface.h"

/* solid          normal (world, unit, towards the camera) and distance of what each pixel shows; INFINITY without
   albedo         RGB
   visible        1 where no other solid stops the light
   radiance       adds the light that comes from solids, RGB
   transmittance  of the camera rays, from the view pass
   samples        adds the densities read
   window         x0, y0, x1, y1 of the pixels of this launch */
__kernel void solid_pass(PARAMS params, GRID_ARGUMENTS, LIGHT_ARGUMENTS, __global const float4 *solid,
                         __global const float4 *albedo, __global const float *visible, __global float4 *radiance,
                         __global const float4 *transmittance, __global uint *samples, int4 window)
{
  const Pixels pixels = tile_pixels(params, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(params, pixels);
  const Surface surface = surface_at(params, solid, albedo, ray, pixels);
  FloatArray lit, through[3];
  IntArray x, y, wanted;
  x.lanes = pixels.x;
  y.lanes = pixels.y;
  wanted.lanes = (pixels.wanted & pixels.inside) ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    const size_t i = wanted.lane[lane] ? pixel_index(params, x.lane[lane], y.lane[lane]) : 0;
    const float4 dimmed = transmittance[i];
    lit.lane[lane] = visible[i];
    through[0].lane[lane] = dimmed.x;
    through[1].lane[lane] = dimmed.y;
    through[2].lane[lane] = dimmed.z;
  }
  const LightSample light = light_at(params, point_in_light(params, surface.point));
  const Floats reflects = surface_reflects(params, &surface, light);
  const Ints shaded = (lit.lanes > 0.0f) & (reflects > 0.0f);
  if (!any_lane(shaded))
    return;
  PADDED_GRID(grid);
  LIGHT_BUFFERS(buffers);
  Ints read = ints(0);
  const LightPath path = light_path(params, &buffers, surface.point, light);
  const Floats depth = light_optical_depth(params, &grid, &buffers, &path, shaded, &read);
  Floats tint[3];
  light_tint(params, &buffers, light, tint);
  if (params->paper_attenuation) {
    /* Algorithm 1 dims what it sees only between the ends of the light's cone. */
    const GridRay ray_in_grid = index_ray(params, ray);
    Interval part = {floats(0.0f), surface.distance};
    Ints dims = shaded & medium_clip(params, &ray_in_grid, &part);
    const Floats whole = part.end - part.begin;
    dims &= light_clip(params, ray, &part);
    CameraRay state = camera_ray_begin(params, dims);
    const Floats share = dims ? (part.end - part.begin) / whole : floats(0.0f);
    march_unlit(params, &grid, &ray_in_grid, part, rounded_up((float)params->view_steps * share), dims, &state);
    for (int c = 0; c < 3; ++c)
      through[c].lanes =
          transmittance_of(params->sigma_t[c] * (dims ? state.optical_depth : floats(0.0f)));
  }
  FloatArray colour[3];
  IntArray on, count;
  for (int c = 0; c < 3; ++c)
    colour[c].lanes = params->light_intensity[c] * tint[c] * surface.albedo[c] * reflects *
                      transmittance_of(params->sigma_t[c] * depth) * through[c].lanes;
  on.lanes = (pixels.wanted & shaded) ? ints(1) : ints(0);
  count.lanes = read;
  for (int lane = 0; lane < TFM_LANES; ++lane)
    if (on.lane[lane]) {
      const size_t i = pixel_index(params, x.lane[lane], y.lane[lane]);
      radiance[i] += (float4)(colour[0].lane[lane], colour[1].lane[lane], colour[2].lane[lane], 0.0f);
      samples[i] += (uint)count.lane[lane];
    }
}
