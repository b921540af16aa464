/* How a camera ray fades on its way through the media, and when the rest of it no longer matters.
   Requires: TFM_CHANNELS, 3 for RGB or 1 where all three colours have the same extinction; TFM_GRIDS; TFM_BODIES; what
   amounts.h, and with them walk.h and homogeneous.h, do. */
#ifndef TFM_CAMERA_RAY_H
#define TFM_CAMERA_RAY_H

#include "body/amounts.h"
#if TFM_GRIDS
#include "body/walk.h"
#endif
#if TFM_BODIES
#include "body/homogeneous.h"
#endif

#if TFM_CHANNELS != 1 && TFM_CHANNELS != 3
#error "TFM_CHANNELS must be 1 or 3"
#endif

/* The media, as what marches through them needs them. */
typedef struct {
  VIEW view;
  MEDIUM media;
  BODY bodies;
  GRID grids;
#if TFM_GRIDS
  const Grids *padded;
#endif
} Scene;

/* Declares a Scene of a kernel's arguments; x, y: the pixels that its rays belong to. */
#if TFM_GRIDS
#define SCENE(name, x, y)     \
  PADDED_GRIDS(padded, x, y); \
  const Scene name = {view, media, bodies, grids, &padded}
#else
#define SCENE(name, x, y) const Scene name = {view, media, bodies, grids}
#endif

/* What of a scene's media lies along the rays of a tile. */
typedef struct {
#if TFM_GRIDS
  GridRay in_grids;
#endif
  Interval grids; /* from the first to the last of the grids' bounds */
  Ints meets_grids;
#if TFM_BODIES
  BodiesOnRay bodies;
#endif
  Interval all; /* from the first to the last of all bodies */
  Ints meets;   /* mask: there is any */
} MediaOnRay;

/* interval: of the rays that are active; a ray through a medium without an end ends where view->end says. */
TFM_INLINE MediaOnRay media_on_ray(VIEW view, GRID grids, BODY bodies, Ray ray, Interval interval, Ints active)
{
  MediaOnRay media;
  media.grids = interval;
#if TFM_GRIDS
  media.in_grids = index_ray(grids, ray);
  media.meets_grids = active & grids_clip(grids, &media.in_grids, &media.grids);
#else
  (void)grids;
  media.meets_grids = ints(0);
#endif
#if TFM_BODIES
  interval.end = least(interval.end, floats(TFM_FAR));
  const Ints meets_bodies = active & bodies_on_ray(bodies, ray, interval, &media.bodies, &media.all);
  media.meets = meets_bodies | media.meets_grids;
  media.all.begin = meets_bodies ? media.all.begin : floats(INFINITY);
  media.all.end = meets_bodies ? media.all.end : floats(-INFINITY);
  media.all.begin = media.meets_grids ? least(media.all.begin, media.grids.begin) : media.all.begin;
  media.all.end = media.meets_grids ? greatest(media.all.end, media.grids.end) : media.all.end;
#else
  (void)bodies;
  (void)view;
  media.all = media.grids;
  media.meets = media.meets_grids;
#endif
  return media;
}

/* Three stretches of an interval of a ray: before, between and behind the grids' bounds. */
#define STRETCHES 3

TFM_INLINE void split_at_grids(const MediaOnRay *media, Interval interval, Interval *stretch)
{
  const Floats first = greatest(media->grids.begin, interval.begin), last = least(media->grids.end, interval.end);
  const Ints meets = media->meets_grids & (first < last);
  stretch[0].begin = interval.begin;
  stretch[0].end = meets ? first : interval.end;
  stretch[1].begin = stretch[0].end;
  stretch[1].end = meets ? last : interval.end;
  stretch[2].begin = stretch[1].end;
  stretch[2].end = interval.end;
}

/* Steps of a stretch without grids: its share of those of the whole. */
TFM_INLINE Ints steps_of_stretch(Interval stretch, Interval whole, int steps)
{
  const Floats length = stretch.end - stretch.begin;
  const Ints share = rounded_up(clamp_to(length / (whole.end - whole.begin), 1.0f) * (float)steps);
  return length > 0.0f ? (share > 1 ? share : ints(1)) : ints(0);
}

#if TFM_GRIDS
/* Steps of a stretch of grids: its share of those of all of them. */
TFM_INLINE Ints steps_in_grids(const MediaOnRay *media, Interval stretch, int steps)
{
  const Interval all = media->grids;
  const Ints some = media->meets_grids & (stretch.begin < stretch.end);
  const Floats share = some ? (stretch.end - stretch.begin) / (all.end - all.begin) : floats(0.0f);
  return rounded_up(clamp_to(share, 1.0f) * (float)steps);
}

/* A walk of camera rays: where there are bodies of constant density too, every step has something. */
TFM_INLINE Walk walk_of_camera(const Scene *scene, const MediaOnRay *on_ray, Floats begin, Floats length, Warp warp,
                               int warped, Ints steps, Ints active)
{
  Walk walk = walk_from(scene->padded, &on_ray->in_grids, begin, length, warp, warped, steps, active);
  walk.skip = TFM_BODIES ? 0 : walk.skip;
  return walk;
}
#endif

/* A camera ray, from the camera on. */
typedef struct {
  Floats through[TFM_CHANNELS]; /* transmittance so far of the colours that are extinguished at all */
} CameraRay;

/* A colour that nothing extinguishes is scattered by nothing either: it starts at 0, so that it keeps no ray
   alive, but where it is emitted. */
TFM_INLINE CameraRay camera_ray_begin(MEDIUM media, Ints active)
{
  CameraRay state;
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    float most = 0.0f;
    for (int m = 0; m < TFM_MEDIA; ++m)
      most = media[m].sigma_t[c] > most ? media[m].sigma_t[c] : most;
#if TFM_EMISSION
    for (int m = 0; m < TFM_MEDIA; ++m)
      for (int k = 0; k < 3; ++k)
        if (TFM_CHANNELS == 1 || k == c)
          most = media[m].emission[k] > most ? media[m].emission[k] : most;
#endif
    state.through[c] = most > 0.0f ? (active ? floats(1.0f) : floats(0.0f)) : floats(0.0f);
  }
  return state;
}

/* The rays of which more than the cutoff is left in some colour. */
TFM_INLINE Ints is_visible(VIEW view, const CameraRay *state)
{
  Floats most = state->through[0];
  for (int c = 1; c < TFM_CHANNELS; ++c)
    most = greatest(most, state->through[c]);
  return most > view->cutoff;
}

/* A step takes its opacity from the ray. Constant density along the step integrates exactly: T (1 - e^(-sigma_t D d)).
   Returns the mean over the colours. */
TFM_INLINE Floats camera_ray_step(MEDIUM media, CameraRay *state, const Amounts *step, Floats *opacity)
{
  Floats mean = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    const Exp2 e = exp_of_minus(extinguished(media, step, c));
    opacity[c] = state->through[c] * ((1.0f - e.scale) - e.scale * e.part);
    state->through[c] *= e.scale + e.scale * e.part;
    mean += opacity[c] * (1.0f / TFM_CHANNELS);
  }
  return mean;
}

/* Adds amounts, each up to the largest. */
TFM_INLINE void add_amounts(Amounts *sum, const Amounts *step)
{
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      sum->of[m][c] = least(sum->of[m][c] + step->of[m][c], floats(TFM_MAX_OPTICAL_DEPTH));
}

/* What is met along a step of some density. */
TFM_INLINE Amounts along_step(Amounts density, Floats length, Ints counts)
{
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      density.of[m][c] = counts ? least(density.of[m][c] * length, floats(TFM_MAX_OPTICAL_DEPTH)) : floats(0.0f);
  return density;
}

/* Whether there is anything, in each lane. */
TFM_INLINE Ints any_amount(const Amounts *amounts)
{
  Ints any = amounts->of[0][0] > 0.0f;
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      any |= amounts->of[m][c] > 0.0f;
  return any;
}

#endif
