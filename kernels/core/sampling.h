/* Where the samples of a segment lie: uniform in the light's projective space, or in the world.
   TFM section 4.2. */
#ifndef TFM_SAMPLING_H
#define TFM_SAMPLING_H

#include "ray.h"

/* Projective depths w of a segment's two ends over the larger; equal ones make the warp the identity. */
typedef struct {
  Floats begin;
  Floats end;
} Warp;

TFM_INLINE Warp no_warp(void)
{
  Warp warp;
  warp.begin = warp.end = floats(1.0f);
  return warp;
}

/* max_stretch bounds the ratio of the depths, and with it the longest step over the mean one: near the
   light's apex the ratio has no bound, and one step would swallow the far part of the ray. */
TFM_INLINE Warp projective_warp(Floats depth_begin, Floats depth_end, float max_stretch)
{
  const Floats deepest = greatest(depth_begin, depth_end);
  const Ints flat = !(deepest > 0.0f);
  Warp warp;
  warp.begin = flat ? floats(1.0f) : greatest(depth_begin / deepest, floats(1.0f / max_stretch));
  warp.end = flat ? floats(1.0f) : greatest(depth_end / deepest, floats(1.0f / max_stretch));
  return warp;
}

/* World-space fraction of the segment where its projection is cut into parts: the perspective divide undone. */
TFM_INLINE Floats warp_cut(Warp warp, Floats before, Floats behind)
{
  return before * warp.begin / (before * warp.begin + behind * warp.end);
}

/* The same at fraction s of the projection. t(0) = 0 and t(1) = 1 exactly, so that the steps' lengths sum to the
   segment's. */
TFM_INLINE Floats warp_fraction(Warp warp, Floats s)
{
  return warp_cut(warp, s, 1.0f - s);
}

/* The fraction of the projection at a world-space fraction t: warp_fraction undone. */
TFM_INLINE Floats unwarp_fraction(Warp warp, Floats t)
{
  return t * warp.end / (t * warp.end + (1.0f - t) * warp.begin);
}

/* Step n of `steps` equal ones in the projection: where it begins, its middle and its length, as fractions of the
   segment. n need not be whole. */
typedef struct {
  Floats begin;
  Floats middle;
  Floats length;
} WarpedStep;

TFM_INLINE WarpedStep warped_step(Warp warp, float n, float steps)
{
  const float width = 1.0f / steps;
  /* Parts before and after the step's middle and its two ends: 1 - s would lose the digits that the warp enlarges. */
  const float s = (n + 0.5f) * width, rest = (steps - n - 0.5f) * width;
  const float begin = n * width, begin_rest = (steps - n) * width;
  const float end = (n + 1.0f) * width, end_rest = (steps - n - 1.0f) * width;
  /* warp_fraction's divisor there. */
  const Floats at_middle = s * warp.begin + rest * warp.end;
  const Floats at_begin = begin * warp.begin + begin_rest * warp.end;
  const Floats at_end = end * warp.begin + end_rest * warp.end;
  /* One division for all. */
  const Floats ends = at_begin * at_end;
  const Floats inverse = 1.0f / (at_middle * ends);
  WarpedStep step;
  step.begin = begin * warp.begin * (inverse * at_middle * at_end);
  step.middle = s * warp.begin * (inverse * ends);
  step.length = width * warp.begin * warp.end * (inverse * at_middle);
  return step;
}

/* The same where each lane has a number of steps of its own, at least 1. Lanes with fewer stay at their last one. */
TFM_INLINE WarpedStep warped_step_of_lanes(Warp warp, int n, Floats steps)
{
  const Floats width = 1.0f / steps, number = least(floats((float)n), steps - 1.0f);
  const Floats s = (number + 0.5f) * width, begin = number * width, end = (number + 1.0f) * width;
  const Floats rest = (steps - (number + 0.5f)) * width, begin_rest = (steps - number) * width,
               end_rest = (steps - (number + 1.0f)) * width;
  const Floats at_middle = s * warp.begin + rest * warp.end;
  const Floats at_begin = begin * warp.begin + begin_rest * warp.end, at_end = end * warp.begin + end_rest * warp.end;
  WarpedStep step;
  step.begin = begin * warp.begin / at_begin;
  step.middle = s * warp.begin / at_middle;
  step.length = width * warp.begin * warp.end / (at_begin * at_end);
  return step;
}

#endif
