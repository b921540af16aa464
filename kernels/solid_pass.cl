/* Solid pass: deferred Lambert shading of what the camera sees of solids, by one light's reduced intensity, dimmed by
   the medium on its way to the camera (TFM section 4.1, algorithm 1). Runs after the view pass of the same light.
   Includes expected before: Params, a basis and a light header.
   Requires: what they, absorption.h and reduced_intensity.h do. */
#include "absorption.h"
#include "camera.h"
#include "reduced_intensity.h"

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
  FloatArray normal[3], distance, lit, reflectance[3], through[3];
  IntArray x, y, wanted;
  x.lanes = pixels.x;
  y.lanes = pixels.y;
  wanted.lanes = (pixels.wanted & pixels.inside) ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    const size_t i = wanted.lane[lane] ? pixel_index(params, x.lane[lane], y.lane[lane]) : 0;
    const float4 surface = solid[i], colour = albedo[i], dimmed = transmittance[i];
    distance.lane[lane] = wanted.lane[lane] ? surface.w : INFINITY;
    lit.lane[lane] = visible[i];
    normal[0].lane[lane] = surface.x;
    normal[1].lane[lane] = surface.y;
    normal[2].lane[lane] = surface.z;
    reflectance[0].lane[lane] = colour.x;
    reflectance[1].lane[lane] = colour.y;
    reflectance[2].lane[lane] = colour.z;
    through[0].lane[lane] = dimmed.x;
    through[1].lane[lane] = dimmed.y;
    through[2].lane[lane] = dimmed.z;
  }
  const Ray ray = camera_rays(params, pixels);
  const Ints shows = (distance.lanes < MAXFLOAT) & (lit.lanes > 0.0f);
  const Vec3 point = ray_at(ray, shows ? distance.lanes : floats(0.0f));
  const LightSample light = light_at(params, point_in_light(params, point));
  const Vec3 facing = vec3(normal[0].lanes, normal[1].lanes, normal[2].lanes);
  const Floats cosine = -dot3(light.direction, transform_vector(params->light_from_world, facing));
  const Ints shaded = shows & (cosine > 0.0f) & (light.strength > 0.0f) & light_reaches(params, point);
  if (!any_lane(shaded))
    return;
  PADDED_GRID(grid);
  LIGHT_BUFFERS(buffers);
  Ints read = ints(0);
  const LightPath path = light_path(params, &buffers, point, light);
  const Floats depth = light_optical_depth(params, &grid, &buffers, &path, shaded, &read);
  Floats tint[3];
  light_tint(params, &buffers, light, tint);
  if (params->paper_attenuation) {
    /* Algorithm 1 dims what it sees only between the ends of the light's cone. */
    const GridRay ray_in_grid = index_ray(params, ray);
    Interval part = {floats(0.0f), distance.lanes};
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
    colour[c].lanes = M_1_PI_F * params->light_intensity[c] * tint[c] * reflectance[c].lanes * light.strength * cosine *
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
