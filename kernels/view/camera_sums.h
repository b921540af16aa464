/* What the camera sees of the media whatever the lights: transmittance, depth, ambient light, and what they emit.
   Requires: what camera_ray.h does; TFM_SHADOW, 0 without solids. */
#ifndef TFM_CAMERA_SUMS_H
#define TFM_CAMERA_SUMS_H

#include "view/camera_ray.h"
#include "view/frame.h"

/* What of their rays lies before the solids that pixels show. */
TFM_INLINE Interval before_solids(VIEW view, __global const float4 *solid, Pixels pixels)
{
  Interval seen = {floats(0.0f), floats(INFINITY)};
#if TFM_SHADOW
  seen.end = solid_distance(view, solid, pixels);
#else
  (void)view;
  (void)solid;
  (void)pixels;
#endif
  return seen;
}

typedef struct {
  CameraRay ray;
  Amounts total;        /* of the whole ray */
  Floats distance_sum;  /* of the distances, weighed by opacity */
  Floats opacity_sum;   /* mean over the colours */
#if TFM_MEDIA > 1
  Floats scattered[3];  /* opacity times albedo, RGB */
#if TFM_EMISSION
  Floats emitted[3];    /* radiance at the camera, RGB */
#endif
#endif
  Ints samples;         /* densities read */
} CameraSums;

TFM_INLINE CameraSums camera_sums_begin(MEDIUM media, Ints active)
{
  CameraSums sums;
  sums.ray = camera_ray_begin(media, active);
  sums.total = no_amounts();
  sums.distance_sum = sums.opacity_sum = floats(0.0f);
#if TFM_MEDIA > 1
  for (int c = 0; c < 3; ++c)
    sums.scattered[c] = floats(0.0f);
#if TFM_EMISSION
  for (int c = 0; c < 3; ++c)
    sums.emitted[c] = floats(0.0f);
#endif
#endif
  sums.samples = ints(0);
  return sums;
}

/* The part of what a step extinguishes that it scatters. */
TFM_INLINE Floats albedo_of(MEDIUM media, const Amounts *step, int colour)
{
  Floats scattered = floats(0.0f);
  for (int m = 0; m < TFM_MEDIA; ++m)
    scattered += media[m].sigma_s[colour] * step->of[m][AMOUNT_OF(colour)];
  const Floats extinct = extinguished(media, step, colour);
  return extinct > 0.0f ? scattered / extinct : floats(0.0f);
}

#if TFM_EMISSION
/* Optical depth up to which a stretch dims nothing that float32 could tell. */
#define LEAST_DEPTH 1e-20f

/* What a step emits towards the camera, of one colour. Constant density along it integrates exactly:
   T emission D (1 - e^(-sigma_t D d)) / (sigma_t D). after: the ray behind the step, which took its opacity. */
TFM_INLINE void add_emission(MEDIUM media, const CameraRay *after, const Amounts *step, const Floats *opacity, int colour,
                             Floats *emitted)
{
  const int channel = TFM_CHANNELS == 3 ? colour : 0;
  const Floats depth = extinguished(media, step, colour);
  const Floats mean = depth > LEAST_DEPTH ? opacity[channel] / greatest(depth, floats(LEAST_DEPTH)) : after->through[channel];
  for (int m = 0; m < TFM_MEDIA; ++m)
    *emitted += media[m].emission[colour] * (mean * step->of[m][AMOUNT_OF(colour)]);
}
#endif

/* A step at distance t took its opacity, of mean `weight`, from the ray, which is then as `after` says. */
TFM_INLINE void camera_sums_step(MEDIUM media, CameraSums *sums, const CameraRay *after, const Amounts *step, Floats t,
                                 const Floats *opacity, Floats weight)
{
  add_amounts(&sums->total, step);
  sums->distance_sum += weight * t;
  sums->opacity_sum += weight;
#if TFM_MEDIA > 1
  for (int c = 0; c < 3; ++c)
    sums->scattered[c] += opacity[TFM_CHANNELS == 3 ? c : 0] * albedo_of(media, step, c);
#if TFM_EMISSION
  for (int c = 0; c < 3; ++c)
    add_emission(media, after, step, opacity, c, &sums->emitted[c]);
#else
  (void)after;
#endif
#else
  (void)media;
  (void)after;
  (void)opacity;
#endif
}

/* The one in the lanes of a mask, the other in all others. */
TFM_INLINE CameraSums camera_sums_of(Ints mask, const CameraSums *one, const CameraSums *other)
{
  CameraSums sums = *other;
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums.ray.through[c] = mask ? one->ray.through[c] : other->ray.through[c];
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      sums.total.of[m][c] = mask ? one->total.of[m][c] : other->total.of[m][c];
  sums.distance_sum = mask ? one->distance_sum : other->distance_sum;
  sums.opacity_sum = mask ? one->opacity_sum : other->opacity_sum;
#if TFM_MEDIA > 1
  for (int c = 0; c < 3; ++c)
    sums.scattered[c] = mask ? one->scattered[c] : other->scattered[c];
#if TFM_EMISSION
  for (int c = 0; c < 3; ++c)
    sums.emitted[c] = mask ? one->emitted[c] : other->emitted[c];
#endif
#endif
  sums.samples = mask ? one->samples : other->samples;
  return sums;
}

#if TFM_EMISSION
/* What the media emit along whole rays towards the camera, of one colour. depth: their optical depth. */
TFM_INLINE Floats emission_of(MEDIUM media, const CameraSums *sums, Floats depth, int colour)
{
#if TFM_MEDIA > 1
  (void)media;
  (void)depth;
  return sums->emitted[colour];
#else
  /* Emission over extinction is the same everywhere: emission D T, integrated along a march, is (1 - T) times that. */
  const float inverse = media->sigma_t[colour] > 0.0f ? 1.0f / media->sigma_t[colour] : 0.0f;
  return media->emission[colour] * (depth > LEAST_DEPTH ? inverse * opacity_of(depth) : sums->total.of[0][AMOUNT_OF(colour)]);
#endif
}
#endif

/* Eq. 7, with the ambient light that arrives scattered or reflected, and what the media emit.
   end     of the rays: infinite where no solid is seen
   albedo  of the solids that the pixels show, 0 without, and 1 on holdouts (with TFM_SHADOW only) */
TFM_INLINE Seen camera_sums_end(VIEW view, MEDIUM media, const CameraSums *sums, Ints meets, Floats end, Pixels pixels,
                                __global const float4 *albedo)
{
  Seen seen;
#if TFM_GRIDS
  /* What the cutoff leaves of a march counts as nothing. */
  const Ints gone = meets & !is_visible(view, &sums->ray);
#else
  const Ints gone = ints(0);
  (void)meets;
#endif
  for (int c = 0; c < 3; ++c) {
    const Floats total = extinguished(media, &sums->total, c);
    const Floats depth = (gone & (total > 0.0f)) ? floats(TFM_MAX_OPTICAL_DEPTH) : total;
    seen.through[c] = transmittance_of(depth);
#if TFM_EMISSION
    seen.emission[c] = emission_of(media, sums, depth, c);
#endif
  }
  seen.distance = sums->opacity_sum > 0.0f ? sums->distance_sum / sums->opacity_sum : floats(0.0f);
  seen.alpha = 1.0f - (seen.through[0] + seen.through[1] + seen.through[2]) / 3.0f;
#if TFM_SHADOW
  Floats reflects[4];
  load_float4(albedo, pixel_index(view, pixels), pixels.wanted & pixels.inside, 0.0f, reflects);
  const Floats clear = seen_through_haze(view, end);
  const Ints hides = (end < INFINITY) & (reflects[3] == 0.0f);
  seen.alpha = hides ? 1.0f - (1.0f - seen.alpha) * (1.0f - clear) : seen.alpha;
#else
  (void)end;
  (void)pixels;
  (void)albedo;
#endif
  for (int c = 0; c < 3; ++c) {
#if TFM_MEDIA > 1
    seen.colour[c] = sums->scattered[c];
#else
    /* The albedo is the same everywhere, so that the integral of sigma_s T along a march is this too. */
    seen.colour[c] = media->albedo[c] * (1.0f - seen.through[c]);
#endif
#if TFM_SHADOW
    seen.colour[c] += seen.through[c] * clear * reflects[c];
#endif
    seen.colour[c] *= view->ambient[c];
#if TFM_LIGHT_LAYERS
    seen.ambient[c] = seen.colour[c];
#endif
#if TFM_EMISSION
    seen.colour[c] += seen.emission[c];
#endif
  }
  return seen;
}

#endif
