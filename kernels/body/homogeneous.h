/* Bodies of constant density, in closed form (TFM eq. 5).
   Includes expected before: the headers of the kinds.
   Requires: TFM_BODIES, their number, at least 1; TFM_BODY_CLIP(body, ray, interval), TFM_BODY_ENTRY(body, ray) and
   TFM_BODY_IS_SMOOTH(body, first, last, ratio), of the body's kind; what amounts.h does. */
#ifndef TFM_HOMOGENEOUS_H
#define TFM_HOMOGENEOUS_H

#include "body/amounts.h"

/* Stands for infinity: times a density of 0 it is still 0. */
#define TFM_FAR 1e20f

/* Where a ray is in each body. */
typedef struct {
  Interval within[TFM_BODIES];
} BodiesOnRay;

/* interval: of the ray. hull: out, from the first to the last of what lies in it; the lanes in which there is any. */
TFM_INLINE Ints bodies_on_ray(BODY bodies, Ray ray, Interval interval, BodiesOnRay *on_ray, Interval *hull)
{
  hull->begin = floats(INFINITY);
  hull->end = floats(-INFINITY);
  for (int i = 0; i < TFM_BODIES; ++i) {
    Interval part = interval;
    const Ints meets = TFM_BODY_CLIP(&bodies[i], ray, &part);
    on_ray->within[i].begin = meets ? part.begin : floats(0.0f);
    on_ray->within[i].end = meets ? part.end : floats(0.0f);
    hull->begin = meets ? least(hull->begin, part.begin) : hull->begin;
    hull->end = meets ? greatest(hull->end, part.end) : hull->end;
  }
  return hull->begin < hull->end;
}

/* Adds what a ray of unit direction meets of the bodies from begin to end. */
TFM_INLINE void add_bodies(BODY bodies, const BodiesOnRay *on_ray, Floats begin, Floats end, Amounts *amounts)
{
  for (int i = 0; i < TFM_BODIES; ++i) {
    const Floats overlap = least(end, on_ray->within[i].end) - greatest(begin, on_ray->within[i].begin);
    const Floats amount = least(bodies[i].density * greatest(overlap, floats(0.0f)), floats(TFM_MAX_OPTICAL_DEPTH));
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      amounts->of[TFM_MEDIUM_OF_BODY(i)][c] += amount;
  }
}

/* From the first to the last of the bodies between two places. */
TFM_INLINE Interval part_in_bodies(const BodiesOnRay *on_ray, Floats begin, Floats end)
{
  Interval part = {end, begin};
  for (int i = 0; i < TFM_BODIES; ++i) {
    const Floats first = greatest(begin, on_ray->within[i].begin), last = least(end, on_ray->within[i].end);
    part.begin = first < last ? least(part.begin, first) : part.begin;
    part.end = first < last ? greatest(part.end, last) : part.end;
  }
  return part;
}

/* Extinction of one colour in a body, per world unit. */
TFM_INLINE float body_extinction(MEDIUM media, BODY bodies, int i, int colour)
{
  const float extinction = bodies[i].density * media[TFM_MEDIUM_OF_BODY(i)].sigma_t[colour];
  return extinction < TFM_MAX_OPTICAL_DEPTH ? extinction : TFM_MAX_OPTICAL_DEPTH;
}

/* How far light travels through each body on its way to a point. ray: to the point, at parameter 1. from_inside,
   to_inside: bits of the bodies that the light and the point are known to lie in. */
TFM_INLINE void ways_to_light(BODY bodies, Ray ray, Floats distance, int from_inside, int to_inside, Floats *ways)
{
  for (int i = 0; i < TFM_BODIES; ++i) {
    ways[i] = distance;
    if (from_inside & to_inside & 1 << i)
      continue;
    if (to_inside & 1 << i) {
      ways[i] *= 1.0f - TFM_BODY_ENTRY(&bodies[i], ray);
      continue;
    }
    Interval within = {floats(0.0f), floats(1.0f)};
    const Ints meets = TFM_BODY_CLIP(&bodies[i], ray, &within);
    ways[i] *= meets ? within.end - within.begin : floats(0.0f);
  }
}

/* Mean distance from where a stretch of constant density begins to where its opacity is, weighed by the opacity:
   1 / e - length T / (1 - T) for an extinction e. */
TFM_INLINE Floats mean_distance(Floats optical_depth, Floats length)
{
  const Floats x = optical_depth;
  const Floats x2 = x * x;
  /* Series of 1 / x - 1 / (e^x - 1), to 2e-8. */
  const Floats series =
      0.5f - x * (1.0f / 12 - x2 * (1.0f / 720 - x2 * (1.0f / 30240 - x2 * (1.0f / 1209600 - x2 * (1.0f / 47900160)))));
  return length * (x < 1.0f ? series : 1.0f / greatest(x, floats(1.0f)) - transmittance_of(x) / opacity_of(x));
}

#endif
