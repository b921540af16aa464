/* Fog pass: TFM algorithm 1 with section 4.2 in a medium of constant density, for any number of lights of one kind at
   once. No density is read and no map: the reduced intensity is eq. 5, and what a step of a camera ray is worth is the
   difference of the transmittance at its ends.
   Includes expected before: Params, a light and a phase header.
   Requires: what they, fog.h and shadow.h do; TFM_CHANNELS, 3 for RGB or 1 where all colours have the same
   extinction; TFM_TEXTURE 0 or 1. */
#include "camera.h"
#include "fog.h"
#include "sampling.h"
#include "shadow.h"
#include "surface.h"
#if TFM_TEXTURE
#include "texture.h"
#endif

#if TFM_CHANNELS != 1 && TFM_CHANNELS != 3
#error "TFM_CHANNELS must be 1 or 3"
#endif

/* The part of a camera ray in the medium, up to a solid. */
TFM_INLINE Ints fog_seen(PARAMS params, Ray ray, __global const float4 *solid, Pixels pixels, Interval *medium)
{
  medium->begin = floats(0.0f);
  medium->end = floats(FOG_FAR);
#if TFM_SHADOW
  medium->end = least(solid_distance(params, solid, pixels), medium->end);
#else
  (void)solid;
#endif
  return pixels.inside & fog_clip(params, ray, medium);
}

TFM_INLINE void fog_tint(PARAMS params, __global const float4 *texture, LightSample light, Floats *tint)
{
#if TFM_TEXTURE
  texture_at(texture + params->first_texel, params->texture_size[0], params->texture_size[1], light.texture_u,
             light.texture_v, tint);
#else
  (void)params;
  (void)texture;
  (void)light;
  tint[0] = tint[1] = tint[2] = floats(1.0f);
#endif
}

/* What the camera sees of the medium, whatever the lights.
   transmittance  out: RGB of the whole camera ray, and the opacity-weighted mean distance (0 without a medium)
   solid          normal and distance of the solid that a pixel shows (with TFM_SHADOW only)
   window         x0, y0, x1, y1 of the pixels of this launch */
__kernel void fog_camera(PARAMS params, __global const float4 *solid, __global float4 *transmittance, int4 window)
{
  const Pixels pixels = tile_pixels(params, window);
  if (!any_lane(pixels.wanted))
    return;
  const Ray ray = camera_rays(params, pixels);
  Interval medium;
  const Ints in_medium = fog_seen(params, ray, solid, pixels, &medium);
  const Floats begin = in_medium ? medium.begin : floats(0.0f);
  const Floats length = in_medium ? medium.end - medium.begin : floats(0.0f);
  Floats distance_sum = floats(0.0f), opacity_sum = floats(0.0f);
  FloatArray through[3], distance;
  for (int c = 0; c < 3; ++c) {
    const float extinction = fog_extinction(params, c);
    const Floats opacity = opacity_of(extinction * length);
    through[c].lanes = transmittance_of(extinction * length);
    distance_sum += opacity * (begin + fog_mean_distance(extinction, length));
    opacity_sum += opacity;
  }
  distance.lanes = opacity_sum > 0.0f ? distance_sum / opacity_sum : floats(0.0f);
  IntArray x, y, wanted;
  x.lanes = pixels.x;
  y.lanes = pixels.y;
  wanted.lanes = pixels.wanted ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane)
    if (wanted.lane[lane])
      transmittance[pixel_index(params, x.lane[lane], y.lane[lane])] =
          (float4)(through[0].lane[lane], through[1].lane[lane], through[2].lane[lane], distance.lane[lane]);
}

/* What is summed over the lights. */
typedef struct {
  Floats colour[3];
  Floats seen[TFM_CHANNELS]; /* the part of the light that arrives, times opacity */
  Floats seen_opacity;
  Ints samples;
} FogSums;

#if TFM_CHANNELS == 1
/* Optical depth of a step up to which twice_sinh serves. */
#define THIN_STEP 1.0f

/* 2 sinh(x) for x in [0, 1/2]: its series, to 2e-9 of it. */
TFM_INLINE Floats twice_sinh(Floats x)
{
  const Floats x2 = x * x;
  return 2.0f * x * (1.0f + x2 * (1.0f / 6 + x2 * (1.0f / 120 + x2 * (1.0f / 5040))));
}
#endif

/* Opacity of a step whose middle lies at an optical depth: e^-(middle - half) - e^-(middle + half). */
TFM_INLINE Floats step_opacity(Floats middle, Floats half_depth)
{
  return transmittance_of(greatest(middle - half_depth, floats(0.0f))) * opacity_of(2.0f * half_depth);
}

/* Single scattering (eq. 4) of one light along the part of a ray that it reaches. */
TFM_INLINE void fog_scatter(PARAMS params, __global const float *shadow, __global const float4 *texture, Ray ray,
                            Interval medium, Interval lit, Ints active, FogSums *sums)
{
  const int steps = params->view_steps;
  const Floats before = active ? lit.begin - medium.begin : floats(0.0f);
  /* A ray ends where nothing is left of it, and all its samples lie before that. */
  const Floats dimmed = params->paper_attenuation ? floats(0.0f) : before;
  const Floats rest = params->medium_visible - dimmed;
  active &= rest > 0.0f;
  if (!any_lane(active))
    return;
  const Floats begin = active ? lit.begin : floats(0.0f);
  const Floats length = active ? least(lit.end - lit.begin, rest) : floats(0.0f);
  Warp warp = no_warp();
  if (params->projective)
    warp = projective_warp(light_projective_depth(params, ray_at(ray, begin)),
                           light_projective_depth(params, ray_at(ray, begin + length)), params->max_stretch);
  float extinction[TFM_CHANNELS];
  Floats sum[TFM_CHANNELS], seen[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    extinction[c] = fog_extinction(params, c);
    sum[c] = seen[c] = floats(0.0f);
  }
#if TFM_CHANNELS == 1
  /* A step is at most so many mean ones long. */
  const Floats stretch = greatest(warp.begin / warp.end, warp.end / warp.begin);
  const int thin =
      greatest_float(active ? stretch * length : floats(0.0f)) * extinction[0] <= THIN_STEP * (float)steps;
#endif
  const Ray light_space_ray = ray_in_light(params, ray);
  for (int n = 0; n < steps; ++n) {
    const WarpedStep step = warped_step(warp, n, steps);
    const Floats along = length * step.middle, step_length = length * step.length;
    const LightSample light = light_at(params, ray_at(light_space_ray, begin + along));
    const Floats source = phase_eval(params, -dot3(light.direction, light_space_ray.direction)) * light.strength;
    const Floats visible = light_visibility(params, shadow, light);
    const Floats way = fog_light_way(params, light.distance, ray_at(ray, begin + along), 1);
#if TFM_TEXTURE
    Floats tint[3];
    fog_tint(params, texture, light, tint);
#else
    (void)texture;
#endif
    Floats opacity[TFM_CHANNELS], arrives[TFM_CHANNELS], weight = floats(0.0f);
    for (int c = 0; c < TFM_CHANNELS; ++c) {
      /* The part of the camera ray that the step takes: e^(-x) 2 sinh(extinction step / 2) with x at its middle. */
      const Floats half_depth = (0.5f * extinction[c]) * step_length;
#if TFM_CHANNELS == 1
      /* One exponential for the way there and back. */
      arrives[c] = visible;
      opacity[c] = thin ? transmittance_of(extinction[c] * (dimmed + along + way)) * twice_sinh(half_depth)
                        : transmittance_of(extinction[c] * way) * step_opacity(extinction[c] * (dimmed + along), half_depth);
#else
      arrives[c] = transmittance_of(extinction[c] * way) * visible;
      opacity[c] = step_opacity(extinction[c] * (dimmed + along), half_depth);
#endif
      weight += opacity[c] * (1.0f / TFM_CHANNELS);
#if TFM_TEXTURE
      sum[c] += opacity[c] * arrives[c] * source * tint[c];
#else
      sum[c] += opacity[c] * arrives[c] * source;
#endif
    }
    for (int c = 0; c < TFM_CHANNELS; ++c)
      seen[c] += weight * arrives[c];
  }
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    sum[c] = active ? sum[c] : floats(0.0f);
    sums->seen[c] += active ? seen[c] : floats(0.0f);
    sums->seen_opacity += (1.0f / TFM_CHANNELS) * (active ? transmittance_of(extinction[c] * dimmed) *
                                                                opacity_of(extinction[c] * length)
                                                          : floats(0.0f));
  }
  for (int c = 0; c < 3; ++c)
    sums->colour[c] += params->albedo[c] * params->light_intensity[c] * sum[TFM_CHANNELS == 3 ? c : 0];
  sums->samples += active ? ints(steps) : ints(0);
}

#if TFM_SHADOW
/* Lambert shading by one light. lit: 1 for each pixel of the light's rectangle where no other solid stops it. */
TFM_INLINE void fog_shade(PARAMS params, __global const float4 *texture, __global const uchar *lit, Pixels pixels,
                          const Surface *surface, const Floats *through, Floats lit_length, FogSums *sums)
{
  const int x0 = params->lit_pixels[0], y0 = params->lit_pixels[1];
  const int width = params->lit_pixels[2] - x0;
  Ints shaded = (pixels.x >= x0) & (pixels.y >= y0) & (pixels.x < params->lit_pixels[2]) & (pixels.y < params->lit_pixels[3]);
  if (!any_lane(shaded & surface->shown))
    return;
  const LightSample light = light_at(params, point_in_light(params, surface->point));
  const Floats reflects = surface_reflects(params, surface, light);
  shaded &= reflects > 0.0f;
  IntArray texel, wanted;
  texel.lanes = (pixels.y - y0) * width + pixels.x - x0;
  wanted.lanes = shaded ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane)
    wanted.lane[lane] = wanted.lane[lane] && lit[params->first_lit + texel.lane[lane]];
  shaded &= wanted.lanes != 0;
  if (!any_lane(shaded))
    return;
  Floats tint[3];
  fog_tint(params, texture, light, tint);
  const Floats way = fog_light_way(params, light.distance, surface->point, 0);
  const Floats reflected = shaded ? reflects : floats(0.0f);
  for (int c = 0; c < 3; ++c) {
    const float extinction = fog_extinction(params, c);
    /* Algorithm 1 dims what it sees only between the ends of the light's cone. */
    const Floats dimmed = params->paper_attenuation ? transmittance_of(extinction * lit_length) : through[c];
    sums->colour[c] += params->light_intensity[c] * tint[c] * surface->albedo[c] * reflected *
                       transmittance_of(extinction * way) * dimmed;
  }
}
#endif

/* lights      one for each light
   starts      of the lists of the blocks that the picture is cut into, row by row, and the end of the last
   touching    the numbers of the lights in these lists
   shadow      distances of solids, of all lights
   texture     RGB, of all lights
   solid       normal (world, unit, towards the camera) and distance of what each pixel shows; INFINITY without
   albedo      RGB of that
   lit         of all lights, for the pixels of their rectangles: 1 where no other solid stops the light
   radiance    adds single scattering, and what solids reflect, RGB
   light_seen  adds the part of the light that arrives times opacity, RGB, and the opacity
   samples     adds the samples taken
   blocks      column and row of the first block, blocks in a row, edge of a block in pixels: a multiple of a tile's
   window      x0, y0, x1, y1 of the pixels of this launch
   With TFM_SHADOW 0 shadow, solid, albedo and lit are not read, nor texture with TFM_TEXTURE 0. */
__kernel void fog_pass(PARAMS lights, __global const int *starts, __global const int *touching,
                       __global const float *shadow, __global const float4 *texture, __global const float4 *solid,
                       __global const float4 *albedo, __global const uchar *lit, __global float4 *radiance,
                       __global float4 *light_seen, __global uint *samples, int4 blocks, int4 window)
{
  const Pixels pixels = tile_pixels(lights, window);
  if (!any_lane(pixels.wanted))
    return;
  const int column = (window.x / TILE_WIDTH + (int)get_global_id(0)) * TILE_WIDTH / blocks.w - blocks.x;
  const int row = (window.y / TILE_HEIGHT + (int)get_global_id(1)) * TILE_HEIGHT / blocks.w - blocks.y;
  const int first = starts[row * blocks.z + column], end = starts[row * blocks.z + column + 1];
  if (first == end)
    return;
  const Ray ray = camera_rays(lights, pixels);
  Interval medium;
  const Ints in_medium = fog_seen(lights, ray, solid, pixels, &medium);
#if TFM_SHADOW
  const Floats medium_length = in_medium ? medium.end - medium.begin : floats(0.0f);
  const Surface surface = surface_at(lights, solid, albedo, ray, pixels);
  Floats through[3]; /* between the camera and the solid */
  for (int c = 0; c < 3; ++c)
    through[c] = transmittance_of(fog_extinction(lights, c) * medium_length);
#else
  (void)albedo;
  (void)lit;
#endif
  FogSums sums;
  for (int c = 0; c < 3; ++c)
    sums.colour[c] = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums.seen[c] = floats(0.0f);
  sums.seen_opacity = floats(0.0f);
  sums.samples = ints(0);
  for (int k = first; k < end; ++k) {
    PARAMS params = lights + touching[k];
    Interval reached = medium;
    const Ints active = in_medium & light_clip(params, ray, &reached);
    if (any_lane(active))
      fog_scatter(params, shadow, texture, ray, medium, reached, active, &sums);
#if TFM_SHADOW
    fog_shade(params, texture, lit, pixels, &surface, through, active ? reached.end - reached.begin : floats(0.0f), &sums);
#endif
  }
  FloatArray colour[3], light[3], seen_weight;
  for (int c = 0; c < 3; ++c) {
    colour[c].lanes = sums.colour[c];
    light[c].lanes = sums.seen[TFM_CHANNELS == 3 ? c : 0];
  }
  seen_weight.lanes = sums.seen_opacity;
  IntArray x, y, wanted, count;
  x.lanes = pixels.x;
  y.lanes = pixels.y;
  wanted.lanes = pixels.wanted ? ints(1) : ints(0);
  count.lanes = sums.samples;
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    if (!wanted.lane[lane])
      continue;
    const size_t i = pixel_index(lights, x.lane[lane], y.lane[lane]);
    radiance[i] += (float4)(colour[0].lane[lane], colour[1].lane[lane], colour[2].lane[lane], 0.0f);
    light_seen[i] += (float4)(light[0].lane[lane], light[1].lane[lane], light[2].lane[lane], seen_weight.lane[lane]);
    samples[i] += (uint)count.lane[lane];
  }
}
