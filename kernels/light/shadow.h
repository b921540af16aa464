/* Shadow maps: for every texel of a light's square the distance from the light to the nearest solid, INFINITY without
   one (Williams 1978; distances instead of depths, TFM section 4.1).
   Requires: TFM_SHADOW 0: no solids, 1: nearest texel, 2: percentage-closer filtering (Reeves et al. 1987) of the four
   texels around. */
#ifndef TFM_SHADOW_H
#define TFM_SHADOW_H

#include "light/sample.h"
#include "core/texels.h"

/* Vectors in memory need only their elements' alignment. */
typedef float2 TexelPair __attribute__((aligned(4)));

/* The part of the light that no solid keeps from a sample, [0, 1]. */
TFM_INLINE Floats light_visibility(LIGHT light, __global const float *shadow, LightSample sample)
{
#if TFM_SHADOW == 0
  (void)light;
  (void)shadow;
  (void)sample;
  return floats(1.0f);
#else
  const int res = light->shadow_res;
  const MapPosition at = map_position(res, sample.u, sample.v);
  __global const float *low = shadow + light->first_shadow;
  /* A map of one texel has no neighbours; what follows it is read and weighs nothing. */
  const int dy = res > 1 ? res : 0;
#if TFM_SHADOW == 1
  const int dx = res > 1 ? 1 : 0;
  const Ints nearest = at.texel + (at.fx > 0.5f ? ints(dx) : ints(0)) + (at.fy > 0.5f ? ints(dy) : ints(0));
  return gather_floats(low, nearest) >= sample.distance ? floats(1.0f) : floats(0.0f);
#else
  Floats low_low, low_high, high_low, high_high;
#define LOWER_PAIR(s) (*(__global const TexelPair *)(low + LANE(at.texel, s)))
#define UPPER_PAIR(s) (*(__global const TexelPair *)(low + dy + LANE(at.texel, s)))
  SPLIT_PAIRS(LOWER_PAIR, low_low, low_high);
  SPLIT_PAIRS(UPPER_PAIR, high_low, high_high);
#define LIT(solid) ((solid) >= sample.distance ? floats(1.0f) : floats(0.0f))
  return lerp(lerp(LIT(low_low), LIT(low_high), at.fx), lerp(LIT(high_low), LIT(high_high), at.fx), at.fy);
#endif
#endif
}

#endif
