/* View pass: TFM algorithm 1 with section 4.2, for one light. With TFM_METHOD_DUAL the reduced intensity is
   marched instead of looked up: the reference; every other line is shared.
   Includes expected before: Params, a basis, a light and a phase header.
   Requires: what they, absorption.h and reduced_intensity.h do. */
#include "absorption.h"
#include "camera.h"
#include "reduced_intensity.h"
#include "walk.h"

#ifndef TFM_SHOW_RESIDUAL
#define TFM_SHOW_RESIDUAL 0
#endif

/* A sample that scatters, on its way through the loops. */
typedef struct {
  Floats step_depth; /* optical depth of the density along the step; 0 in lanes that do not scatter */
  Floats source;     /* phase function, falloff and edge */
  Floats visible;    /* the part of the light that no solid stops */
#if TFM_TEXTURE
  Floats tint[3];
#endif
  LightPath path;
} ViewSample;

/* What a sample needs before its light is looked up. */
TFM_INLINE ViewSample view_sample(PARAMS params, const LightBuffers *buffers, Ray ray, Ray light_space_ray, Floats t,
                                  Floats step_depth)
{
  const LightSample light = light_at(params, ray_at(light_space_ray, t));
  ViewSample sample;
  sample.step_depth = step_depth;
  sample.source = phase_eval(params, -dot3(light.direction, light_space_ray.direction)) * light.strength;
  sample.visible = light_visibility(params, buffers->shadow, light);
#if TFM_TEXTURE
  light_tint(params, buffers, light, sample.tint);
#endif
  sample.path = light_path(params, buffers, ray_at(ray, t), light);
  return sample;
}

/* radiance       adds this light's single scattering (eq. 4), RGB
   light_seen     adds the part of the light that arrives times opacity, RGB, and the opacity
   transmittance  of the first light only, out: RGB transmittance of the whole camera ray, and the opacity-weighted
                  mean distance (0 without a medium)
   samples        adds the densities read
   solid          normal of the solid that a pixel shows, and its distance, INFINITY without (with TFM_SHADOW only)
   window         x0, y0, x1, y1 of the pixels of this launch */
__kernel void view_pass(PARAMS params, GRID_ARGUMENTS, LIGHT_ARGUMENTS,
                        __global const float4 *solid, __global float4 *radiance, __global float4 *light_seen, __global float4 *transmittance,
                        __global uint *samples, int is_first_light, int4 window)
{
  const Pixels pixels = tile_pixels(params, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(params, pixels);
  const Ray light_space_ray = ray_in_light(params, ray);
  const GridRay ray_in_grid = index_ray(params, ray);
  LIGHT_BUFFERS(buffers);
  Interval medium = {floats(0.0f), floats(INFINITY)};
#if TFM_SHADOW
  medium.end = solid_distance(params, solid, pixels);
#else
  (void)solid;
#endif
  const Ints in_medium = pixels.inside & medium_clip(params, &ray_in_grid, &medium);
  Interval lit = medium;
  const Ints active = in_medium & light_clip(params, ray, &lit);
  PADDED_GRID(grid);
  const int steps = params->view_steps;
  CameraRay state = camera_ray_begin(params, active);
  Floats sum[TFM_CHANNELS], seen[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sum[c] = seen[c] = floats(0.0f);
  Floats seen_opacity = floats(0.0f);

  /* What lies between the camera and the light's cone dims all that follows; not so in the paper's algorithm 1. */
  const Floats share = active ? (lit.begin - medium.begin) / (medium.end - medium.begin) : floats(0.0f);
  const Interval before = {medium.begin, lit.begin};
  march_unlit(params, &grid, &ray_in_grid, before, rounded_up((float)steps * share),
              params->paper_attenuation ? ints(0) : active, &state);

  if (any_lane(active)) {
    const Floats lit_begin = active ? lit.begin : floats(0.0f);
    const Floats length = active ? lit.end - lit.begin : floats(0.0f);
    Warp warp = no_warp();
    if (params->projective)
      warp = projective_warp(light_projective_depth(params, ray_at(ray, lit_begin)),
                             light_projective_depth(params, ray_at(ray, lit_begin + length)), params->max_stretch);
    const Walk walk = walk_from(&grid, &ray_in_grid, lit_begin, length, warp, 1, ints(steps), active);
    Ints alive = active & is_visible(params, &state);
    Ints read = ints(0);
    Steps list = no_steps();
    while (any_lane(alive) && find_steps(&grid, &walk, alive, 0, &list)) {
      ViewSample sample[MOST_STEPS];
      Floats depth[MOST_STEPS];
      int count = 0;
      for (int k = 0; k < list.count; ++k) {
        const Place place = place_of(&walk, list.n[k]);
        const Floats density = density_at(&grid, &walk, &list, k, place.t, &read);
        const Floats step_depth = least(density * place.length, floats(TFM_MAX_OPTICAL_DEPTH));
        const Ints scatters = active & (step_depth > 0.0f);
        depth[count] = scatters ? step_depth : floats(0.0f);
        list.n[count] = list.n[k];
        count += any_lane(scatters);
      }
      for (int k = 0; k < count; ++k)
        sample[k] = view_sample(params, &buffers, ray, light_space_ray, place_of(&walk, list.n[k]).t, depth[k]);
      for (int k = 0; k < count; ++k)
        depth[k] = any_lane(sample[k].visible > 0.0f)
                       ? light_optical_depth(params, &grid, &buffers, &sample[k].path, sample[k].step_depth > 0.0f,
                                             &state.samples)
                       : floats(0.0f);
      for (int k = 0; k < count; ++k) {
        Floats opacity[TFM_CHANNELS];
        const Floats weight = camera_ray_step(params, &state, sample[k].step_depth, floats(0.0f), opacity);
        for (int c = 0; c < TFM_CHANNELS; ++c) {
#if TFM_SHOW_RESIDUAL
          const Floats reduced = depth[k]; /* the map holds its residual */
#else
          const Floats reduced = transmittance_of(params->sigma_t[c] * depth[k]);
#endif
          const Floats arrives = reduced * sample[k].visible;
#if TFM_TEXTURE
          sum[c] += opacity[c] * arrives * sample[k].source * sample[k].tint[c];
#else
          sum[c] += opacity[c] * arrives * sample[k].source;
#endif
          seen[c] += weight * arrives;
        }
        seen_opacity += weight;
      }
      alive = active & is_visible(params, &state);
    }
    state.samples += active ? read : ints(0);
  }
  /* The whole ray, whatever the light. */
  CameraRay whole = camera_ray_begin(params, in_medium);
  if (is_first_light)
    march_unlit(params, &grid, &ray_in_grid, medium, ints(steps), in_medium, &whole);

  /* What the cutoff leaves of a ray counts as nothing. */
  const Floats whole_depth =
      (in_medium & !is_visible(params, &whole)) ? floats(TFM_MAX_OPTICAL_DEPTH) : whole.optical_depth;
  FloatArray colour[3], light[3], seen_weight, total[3], distance;
  for (int c = 0; c < 3; ++c) {
    const int channel = TFM_CHANNELS == 3 ? c : 0;
    colour[c].lanes = params->albedo[c] * params->light_intensity[c] * sum[channel];
    light[c].lanes = seen[channel];
    total[c].lanes = transmittance_of(params->sigma_t[c] * whole_depth);
  }
  seen_weight.lanes = seen_opacity;
  distance.lanes = whole.opacity_sum > 0.0f ? whole.distance_sum / whole.opacity_sum : floats(0.0f);
  IntArray x, y, wanted, count;
  x.lanes = pixels.x;
  y.lanes = pixels.y;
  wanted.lanes = pixels.wanted ? ints(1) : ints(0);
  count.lanes = state.samples + whole.samples;
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    if (!wanted.lane[lane])
      continue;
    const size_t i = pixel_index(params, x.lane[lane], y.lane[lane]);
    radiance[i] += (float4)(colour[0].lane[lane], colour[1].lane[lane], colour[2].lane[lane], 0.0f);
    light_seen[i] += (float4)(light[0].lane[lane], light[1].lane[lane], light[2].lane[lane], seen_weight.lane[lane]);
    samples[i] += (uint)count.lane[lane];
    if (is_first_light)
      transmittance[i] = (float4)(total[0].lane[lane], total[1].lane[lane], total[2].lane[lane], distance.lane[lane]);
  }
}
