/* Where the samples of a segment lie: uniform in the light's projective space, or in the world.
   TFM section 4.2. */
#ifndef TFM_SAMPLING_H
#define TFM_SAMPLING_H

/* Projective depths w of a segment's two ends; equal ones make the warp the identity. */
typedef struct {
  float begin;
  float end;
} Warp;

/* max_stretch bounds the ratio of the depths, and with it the longest step over the mean one: near the
   light's apex the ratio has no bound, and one step would swallow the far part of the ray. */
inline Warp projective_warp(float depth_begin, float depth_end, float max_stretch)
{
  const float deepest = fmax(depth_begin, depth_end);
  Warp warp;
  warp.begin = fmax(depth_begin, deepest / max_stretch);
  warp.end = fmax(depth_end, deepest / max_stretch);
  if (!(deepest > 0.0f))
    warp.begin = warp.end = 1.0f;
  return warp;
}

/* World-space fraction of the segment at fraction s of its projection: the perspective divide undone.
   t(0) = 0 and t(1) = 1 exactly, so that the steps' lengths sum to the segment's. */
inline float warp_fraction(Warp warp, float s)
{
  return s * warp.begin / (s * warp.begin + (1.0f - s) * warp.end);
}

#endif
