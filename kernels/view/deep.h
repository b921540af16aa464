/* Deep samples of camera rays: stretches of constant extinction, each with the opacity of what lies in it, that follow
   a ray's transmittance T to a tolerance. The line that is fitted is the optical depth -log T, which begins where the
   last sample ends; it is continued as long as one slope keeps T at all of its points within the tolerance (the swing
   filter of data compression), and then ends where T was last seen, as close to it as that slope may be. It is never
   deeper than the ray: what a sample lacks the next ones make up for, so that all together have the ray's opacity.
   Requires: what camera_ray.h does. */
#ifndef TFM_DEEP_H
#define TFM_DEEP_H

#include "view/camera_ray.h"
#include "view/deep_colours.h"

/* Optical depth that counts as opaque: of a sample with more of it float32's opacity, near 1, would not say how much. */
#define DEEP_MOST 10.0f
/* Optical depth between the points of a step at which T is looked at; between them a line that keeps to so much of the
   tolerance keeps to all of it. */
#define DEEP_STEP 0.5f
#define DEEP_KEPT 0.9f
/* By how much the transmittance of a whole ray may be off: as much as a march leaves, by default, where it ends. */
#define DEEP_WHOLE 1e-4f
typedef struct {
  float tolerance;
  Floats begin, depth;       /* of the sample that is being made: where, and the optical depth there */
  Floats low, high;          /* slopes that keep to the tolerance */
  Ints open;                 /* mask: it has any points */
  Ints full;                 /* mask: with colours, it has anything, which may only emit */
  Floats last, last_depth;   /* the last point: where, and the optical depth there as marched */
  Floats prior, prior_depth; /* the one before it */
  Floats per_distance;       /* Z of a distance along the ray */
  Ints count;                /* samples so far */
  Ints first, most, wanted;  /* where they are stored, and how many: none while they are counted */
  __global float *samples;
} DeepRay;

TFM_INLINE void deep_emit(DeepRay *deep, Ints here, Floats begin, Floats end, Floats opacity)
{
  const Ints stored = here & deep->wanted & (deep->count < deep->most);
  if (any_lane(stored)) {
    const Ints at = DEEP_NUMBERS * (deep->first + deep->count);
    store_floats(deep->samples, at, stored, begin * deep->per_distance);
    store_floats(deep->samples + 1, at, stored, end * deep->per_distance);
    store_floats(deep->samples + 2, at, stored, opacity);
  }
  deep->count += here ? ints(1) : ints(0);
}

/* What a sample up to a point adds to the optical depth, so that this is there as close to `depth` as may be. */
TFM_INLINE Floats deep_adds(const DeepRay *deep, Floats end, Floats depth)
{
  const Floats length = end - deep->begin;
  const Floats slope = greatest(least((depth - deep->depth) / length, deep->high), deep->low);
  return least(slope * length, floats(DEEP_MOST));
}

/* The sample ends, and the next begins. */
TFM_INLINE void deep_close(DeepRay *deep, Ints closes, Floats end, Floats adds)
{
  const Floats opacity = opacity_of(adds);
  deep_emit(deep, closes & ((opacity > 0.0f) | deep->full), deep->begin, end, opacity);
  deep->begin = closes ? end : deep->begin;
  deep->depth = closes ? deep->depth + adds : deep->depth;
  deep->open &= !closes;
  deep->full &= !closes;
}

/* The line goes on to a point, of the optical depth as marched. full: there is anything on the way to it. */
TFM_INLINE void deep_point(DeepRay *deep, Ints here, Floats t, Floats depth, Ints full)
{
  here &= t > deep->last;
  /* Where nothing is yet, nothing begins. */
  const Ints empty = here & !deep->open & !full & (depth <= deep->last_depth);
  deep->begin = empty ? t : deep->begin;
  const Ints goes_on = here & !empty;
  const Floats through = transmittance_of(depth), tolerance = floats(DEEP_KEPT * deep->tolerance);
  const Floats least_depth = least(-log_of(through + tolerance), depth);
  Floats inverse = 1.0f / (t - deep->begin);
  Floats low = (least_depth - deep->depth) * inverse, high = (depth - deep->depth) * inverse;
  const Ints breaks = goes_on & deep->open & ((low > deep->high) | (high < deep->low));
  if (any_lane(breaks)) {
    deep_close(deep, breaks, deep->last, deep_adds(deep, deep->last, deep->last_depth));
    inverse = 1.0f / (t - deep->begin);
    low = (least_depth - deep->depth) * inverse;
    high = (depth - deep->depth) * inverse;
  }
  low = greatest(low, floats(0.0f));
  high = greatest(high, low);
  deep->low = goes_on ? (deep->open ? greatest(deep->low, low) : low) : deep->low;
  deep->high = goes_on ? (deep->open ? least(deep->high, high) : high) : deep->high;
  deep->open |= goes_on;
  deep->full |= goes_on & full;
  deep->prior = here ? deep->last : deep->prior;
  deep->prior_depth = here ? deep->last_depth : deep->prior_depth;
  deep->last = here ? t : deep->last;
  deep->last_depth = here ? depth : deep->last_depth;
}

/* Optical depth of the mean of what is left of the colours. */
TFM_INLINE Floats deep_depth(MEDIUM media, const Amounts *total)
{
#if TFM_CHANNELS == 1
  return extinguished(media, total, 0);
#else
  Floats depth[3], thinnest, left = floats(0.0f);
  for (int c = 0; c < 3; ++c)
    depth[c] = extinguished(media, total, c);
  thinnest = least(least(depth[0], depth[1]), depth[2]);
  for (int c = 0; c < 3; ++c)
    left += transmittance_of(depth[c] - thinnest) * (1.0f / 3.0f);
  return thinnest - log_of(left);
#endif
}

/* A step of constant density from begin to end, up to which the media have the amounts `total`. */
TFM_INLINE void deep_step(DeepRay *deep, MEDIUM media, const Amounts *total, const Amounts *step, Floats begin, Floats end,
                          Ints here)
{
#if TFM_DEEP_COLOURS
  const Ints full = any_amount(step);
#else
  const Ints full = ints(0);
  (void)step;
#endif
  const Floats before = deep->last_depth;
  const Floats after = greatest(deep_depth(media, total), before);
  here &= (end > begin) & (before < DEEP_MOST);
  /* Steps without density may have been left out. */
  const Ints starts = here & !deep->open & (begin > deep->begin);
  deep->begin = starts ? begin : deep->begin;
  const Ints gap = here & (begin - deep->last > 0.25f * (end - begin));
  if (any_lane(gap))
    deep_point(deep, gap, begin, before, ints(0));
  const Floats adds = least(after, floats(DEEP_MOST)) - before;
  /* Nothing is seen beyond, however long the step is. */
  const Floats length = (end - begin) * (after > DEEP_MOST ? adds / (after - before) : floats(1.0f));
  const int parts = -least_int(here ? -rounded_up(adds * (1.0f / DEEP_STEP)) : ints(-1));
  for (int i = 1; i < parts; ++i)
    deep_point(deep, here, begin + length * ((float)i / (float)parts), before + adds * ((float)i / (float)parts), full);
  deep_point(deep, here, begin + length, before + adds, full);
}

/* samples: DEEP_NUMBERS each, of which `most` in each lane, from `first` on, are this ray's; 0 where they are counted. */
TFM_INLINE DeepRay deep_begin(VIEW view, Ray ray, float tolerance, __global float *samples, Ints first, Ints most, Ints wanted)
{
  DeepRay deep;
  deep.tolerance = tolerance;
  deep.begin = deep.depth = deep.low = deep.high = deep.last_depth = floats(0.0f);
  deep.last = deep.prior = deep.prior_depth = floats(0.0f);
  deep.open = deep.full = deep.count = ints(0);
  deep.per_distance = dot3(ray.direction, uniform_vec3(view->forward));
  deep.first = first;
  deep.most = most;
  deep.wanted = wanted;
  deep.samples = samples;
  return deep;
}

/* gone: rays of which the march counts nothing as left. solid: those that end at a solid, at a distance, of some opacity. */
TFM_INLINE void deep_end(DeepRay *deep, Ints gone, Ints solid, Floats distance, Floats opacity)
{
  const Ints ends = deep->open;
  const Floats whole = gone ? floats(DEEP_MOST) : deep->last_depth, adds = deep_adds(deep, deep->last, whole);
  const Floats missed = transmittance_of(deep->depth + adds) - transmittance_of(whole);
  /* The whole ray is to be right: its last step is a sample of its own where one line misses that. */
  const Ints splits = ends & (magnitude_of(missed) > DEEP_WHOLE) & (deep->prior > deep->begin);
  if (any_lane(splits)) {
    deep_close(deep, splits, deep->prior, deep_adds(deep, deep->prior, deep->prior_depth));
    const Floats rest = greatest(whole - deep->depth, floats(0.0f));
    deep_close(deep, splits, deep->last, least(rest, floats(DEEP_MOST)));
  }
  deep_close(deep, ends & !splits, deep->last, adds);
  deep_emit(deep, solid, distance, distance, opacity);
}

#endif
