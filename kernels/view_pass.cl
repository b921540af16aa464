/* View pass: TFM algorithm 1 with section 4.2, for one light. With TFM_METHOD_DUAL the reduced intensity is
   marched instead of looked up: the reference; every other line is shared.
   Includes expected before: Params, a basis, a light and a phase header.
   Requires: TFM_N_COEFF, TFM_STORAGE_BITS; TFM_METHOD_DUAL 0 or 1. */
#include "camera.h"
#include "map.h"
#include "sampling.h"
#include "volume.h"

#ifndef TFM_METHOD_DUAL
#error "TFM_METHOD_DUAL must be 0 or 1"
#endif

/* Optical depth of the density between the light and a sample. */
inline float light_optical_depth(__constant const Params *params, Grid grid,
                                 __global const MapStorage *map, __global const float2 *ranges,
                                 LightSample sample, uint *samples)
{
#if TFM_METHOD_DUAL
  (void)map;
  (void)ranges;
  Interval k;
  const Ray ray = index_ray(params, sample.ray);
  if (!light_medium_interval(params, ray, &k) || sample.distance <= k.begin)
    return 0.0f;
  *samples += (uint)params->light_steps;
  return march_optical_depth(grid, ray, k.begin, sample.distance, params->light_steps);
#else
  (void)grid;
  (void)samples;
  return map_optical_depth(params, map, ranges, sample);
#endif
}

/* One work-item a pixel of a tile; the launch's offset places the tile in the frame.
   radiance     adds this light's single scattering (eq. 4), RGB
   light_seen   adds light transmittance times opacity, RGB, and the opacity
   samples      adds the density samples taken */
__kernel void view_pass(__constant const Params *params, __global const float *voxels,
                        __global const MapStorage *map, __global const float2 *ranges,
                        __global float4 *radiance, __global float4 *light_seen, __global uint *samples)
{
  const int2 pixel = (int2)((int)get_global_id(0), (int)get_global_id(1));
  const Ray ray = camera_ray(params, pixel);
  const Ray ray_in_grid = index_ray(params, ray);
  Interval medium = {0.0f, INFINITY};
  if (!medium_clip(params, ray_in_grid, &medium))
    return;
  Interval lit = medium;
  if (!light_clip(params, ray, &lit))
    return;

  const Grid grid = padded_grid(params, voxels);
  const float3 sigma_t = vload3(0, params->sigma_t);
  const float3 albedo = vload3(0, params->albedo);
  const int steps = params->view_steps;

  /* What lies between the camera and the light's cone dims all that follows. */
  const float before = (lit.begin - medium.begin) / (medium.end - medium.begin);
  const int steps_before = (int)ceil((float)steps * before);
  float view_depth = 0.0f;
  if (steps_before > 0)
    view_depth = march_optical_depth(grid, ray_in_grid, medium.begin, lit.begin, steps_before);
  uint taken = (uint)(steps_before + steps);

  Warp warp = {1.0f, 1.0f};
  if (params->projective)
    warp = projective_warp(light_projective_depth(params, ray_at(ray, lit.begin)),
                           light_projective_depth(params, ray_at(ray, lit.end)), params->max_stretch);

  float3 sum = (float3)(0.0f);
  float4 seen = (float4)(0.0f);
  float step_begin = lit.begin;
  for (int n = 0; n < steps; ++n) {
    const float t = lerp(lit.begin, lit.end, warp_fraction(warp, ((float)n + 0.5f) / (float)steps));
    const float step_end = lerp(lit.begin, lit.end, warp_fraction(warp, (float)(n + 1) / (float)steps));
    const float density = density_at(grid, ray_at(ray_in_grid, t));
    const float step_depth = fmin(density * (step_end - step_begin), TFM_MAX_OPTICAL_DEPTH);
    step_begin = step_end;
    if (!(step_depth > 0.0f))
      continue;

    const LightSample sample = light_at(params, ray_at(ray, t));
    const float light_depth = light_optical_depth(params, grid, map, ranges, sample, &taken);
    const float3 light_transmittance = exp(-sigma_t * light_depth);
    /* Constant density along the step integrates exactly: sigma_s/sigma_t (1 - e^(-sigma_t D d)). */
    const float3 opacity = exp(-sigma_t * view_depth) * opacity_of_rgb(sigma_t * step_depth);
    const float phase = phase_eval(params, -dot(sample.ray.direction, ray.direction));
    sum += albedo * opacity * phase * sample.radiance * light_transmittance;

    const float weight = (opacity.x + opacity.y + opacity.z) / 3.0f;
    seen += (float4)(weight * light_transmittance, weight);
    view_depth = fmin(view_depth + step_depth, TFM_MAX_OPTICAL_DEPTH);
  }

  const size_t i = pixel_index(params, pixel);
  radiance[i] += (float4)(sum, 0.0f);
  light_seen[i] += seen;
  samples[i] += taken;
}
