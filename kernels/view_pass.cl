/* View pass: TFM algorithm 1 with section 4.2, for one light. With TFM_METHOD_DUAL the reduced intensity is
   marched instead of looked up: the reference; every other line is shared.
   Includes expected before: Params, a basis, a light and a phase header.
   Requires: what they, absorption.h, map.h and volume.h do; TFM_METHOD_DUAL 0 or 1. */
#include "absorption.h"
#include "camera.h"
#include "map.h"
#include "walk.h"

#ifndef TFM_METHOD_DUAL
#error "TFM_METHOD_DUAL must be 0 or 1"
#endif

/* A sample that scatters, on its way through the loops. */
typedef struct {
  Floats step_depth; /* optical depth of the density along the step; 0 in lanes that do not scatter */
  Floats source;     /* phase function, falloff and edge */
#if TFM_METHOD_DUAL
  Ray light_ray;
  Floats distance;
#else
  MapPlace place;
#endif
} ViewSample;

#ifndef TFM_SHOW_RESIDUAL
#define TFM_SHOW_RESIDUAL 0
#endif

/* What a sample needs before its light is looked up. */
TFM_INLINE ViewSample view_sample(__constant const Params *params, __global const float4 *field, Ray ray,
                                  Ray ray_in_grid, Floats t, Floats step_depth)
{
  const LightSample light = light_at(params, ray_at(ray, t));
  const Ray light_ray = light_ray_to(params, ray_at(ray_in_grid, t));
  ViewSample sample;
  sample.step_depth = step_depth;
  sample.source = phase_eval(params, -dot3(light.direction, ray.direction)) * light.strength;
#if TFM_METHOD_DUAL
  (void)field;
  sample.light_ray = light_ray;
  sample.distance = light.distance;
#else
  sample.place = map_place(params, field, light_ray, light);
#endif
  return sample;
}

/* Optical depth of the density between the light and a sample. */
TFM_INLINE Floats light_optical_depth(__constant const Params *params, const Grid *grid,
                                      __global const MapStorage *map, __global const float2 *ranges,
                                      __global const float *modes, const ViewSample *sample, Ints *samples)
{
#if TFM_METHOD_DUAL
  (void)map;
  (void)ranges;
  (void)modes;
  Interval k;
  const Ints lit = (sample->step_depth > 0.0f) & light_medium_interval(params, sample->light_ray, &k) & (k.begin < 1.0f);
  return sample->distance *
         march_optical_depth(grid, sample->light_ray, k.begin, floats(1.0f), params->light_steps, lit, samples);
#else
  (void)grid;
  (void)samples;
  return map_optical_depth(params, map, ranges, modes, sample->place);
#endif
}

/* radiance       adds this light's single scattering (eq. 4), RGB
   light_seen     adds light transmittance times opacity, RGB, and the opacity
   transmittance  of the first light only, out: RGB transmittance of the whole camera ray, and the opacity-weighted
                  mean distance (0 without a medium)
   samples        adds the densities read
   window         x0, y0, x1, y1 of the pixels of this launch */
__kernel void view_pass(__constant const Params *params, GRID_ARGUMENTS, __global const MapStorage *map,
                        __global const float2 *ranges, __global const float4 *field, __global const float *modes,
                        __global float4 *radiance, __global float4 *light_seen, __global float4 *transmittance,
                        __global uint *samples, int is_first_light, int4 window)
{
  const Pixels pixels = tile_pixels(params, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(params, pixels);
  const Ray ray_in_grid = index_ray(params, ray);
  Interval medium = {floats(0.0f), floats(INFINITY)};
  const Ints in_medium = pixels.inside & medium_clip(params, ray_in_grid, &medium);
  Interval lit = medium;
  const Ints active = in_medium & light_clip(params, ray, &lit);
  PADDED_GRID(grid);
  const int steps = params->view_steps;
  CameraRay state = camera_ray_begin(params, active);
  Floats sum[TFM_CHANNELS], seen[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sum[c] = seen[c] = floats(0.0f);
  Floats seen_opacity = floats(0.0f);

  /* What lies between the camera and the light's cone dims all that follows. */
  const Floats share = active ? (lit.begin - medium.begin) / (medium.end - medium.begin) : floats(0.0f);
  const Interval before = {medium.begin, lit.begin};
  march_unlit(params, &grid, ray_in_grid, before, rounded_up((float)steps * share), active, &state);

  if (any_lane(active)) {
    const Floats lit_begin = active ? lit.begin : floats(0.0f);
    const Floats length = active ? lit.end - lit.begin : floats(0.0f);
    Warp warp = no_warp();
    if (params->projective)
      warp = projective_warp(light_projective_depth(params, ray_at(ray, lit_begin)),
                             light_projective_depth(params, ray_at(ray, lit_begin + length)), params->max_stretch);
    const Walk walk = walk_from(ray_in_grid, lit_begin, length, warp, 1, ints(steps), active);
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
        sample[k] = view_sample(params, field, ray, ray_in_grid, place_of(&walk, list.n[k]).t, depth[k]);
      for (int k = 0; k < count; ++k)
        depth[k] = light_optical_depth(params, &grid, map, ranges, modes, &sample[k], &state.samples);
      for (int k = 0; k < count; ++k) {
        Floats opacity[TFM_CHANNELS];
        const Floats weight = camera_ray_step(params, &state, sample[k].step_depth, floats(0.0f), opacity);
        for (int c = 0; c < TFM_CHANNELS; ++c) {
#if TFM_SHOW_RESIDUAL
          const Floats reduced = depth[k]; /* the map holds its residual */
#else
          const Floats reduced = transmittance_of(params->sigma_t[c] * depth[k]);
#endif
          sum[c] += opacity[c] * reduced * sample[k].source;
          seen[c] += weight * reduced;
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
    march_unlit(params, &grid, ray_in_grid, medium, ints(steps), in_medium, &whole);

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
