/* Where light that is sent along camera rays goes in a deep image: to the sample whose stretch it comes from.
   Requires: TFM_DEEP_COLOURS, 1 where there are such samples; what camera.h does. */
#ifndef TFM_DEEP_COLOURS_H
#define TFM_DEEP_COLOURS_H

#include "view/camera.h"

/* Numbers of a sample: Z, ZBack and opacity. */
#define DEEP_NUMBERS 3

#ifndef TFM_DEEP_COLOURS
#define TFM_DEEP_COLOURS 0
#endif

#if TFM_DEEP_COLOURS
/* What kernels take: of each pixel, where its samples begin, and how many there are; these, and RGB of each. */
#define AND_DEEP_ARGUMENTS                                                                                       \
  , __global const int *deep_firsts, __global const int *deep_counts, __global const float *deep_samples, \
      __global float *deep_colours
#define DEEP_COLOURS(view, ray, pixels) \
  deep_colours_of(view, ray, pixels, deep_firsts, deep_counts, deep_samples, deep_colours)

typedef struct {
  __global const float *samples;
  __global float *colours;
  IntArray first, last; /* of each ray's samples, those of media alone; none: last < first */
  IntArray at;          /* the one that was met last */
  Floats per_distance;  /* Z of a distance along the ray */
  float scale[3];       /* what is added is times that */
} DeepColours;

TFM_INLINE DeepColours deep_colours_of(VIEW view, Ray ray, Pixels pixels, __global const int *firsts,
                                       __global const int *counts, __global const float *samples,
                                       __global float *colours)
{
  DeepColours deep;
  IntArray index, wanted;
  index.lanes = pixel_index(view, pixels);
  wanted.lanes = pixels.wanted;
  deep.samples = samples;
  deep.colours = colours;
  deep.per_distance = dot3(ray.direction, uniform_vec3(view->forward));
  for (int c = 0; c < 3; ++c)
    deep.scale[c] = 1.0f;
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    const int first = wanted.lane[lane] ? firsts[index.lane[lane]] : 0;
    int last = wanted.lane[lane] ? first + counts[index.lane[lane]] - 1 : -1;
    /* A solid is no stretch. */
    if (last >= first && samples[DEEP_NUMBERS * last] == samples[DEEP_NUMBERS * last + 1])
      --last;
    deep.first.lane[lane] = deep.at.lane[lane] = first;
    deep.last.lane[lane] = last;
  }
  return deep;
}

/* Light from a distance along the rays: RGB at the camera. */
TFM_INLINE void deep_add(DeepColours *deep, Floats t, const Floats *colour)
{
  FloatArray z, adds[3];
  IntArray some;
  z.lanes = t * deep->per_distance;
  some.lanes = (colour[0] != 0.0f) | (colour[1] != 0.0f) | (colour[2] != 0.0f);
  for (int c = 0; c < 3; ++c)
    adds[c].lanes = deep->scale[c] * colour[c];
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    const int first = deep->first.lane[lane], last = deep->last.lane[lane];
    if (!some.lane[lane] || last < first)
      continue;
    int at = deep->at.lane[lane];
    while (at < last && deep->samples[DEEP_NUMBERS * at + 1] < z.lane[lane])
      ++at;
    while (at > first && deep->samples[DEEP_NUMBERS * (at - 1) + 1] >= z.lane[lane])
      --at;
    deep->at.lane[lane] = at;
    for (int c = 0; c < 3; ++c)
      deep->colours[3 * at + c] += adds[c].lane[lane];
  }
}
#else
#define AND_DEEP_ARGUMENTS
#endif

#endif
