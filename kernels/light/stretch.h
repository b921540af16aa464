/* Which stretches of camera rays a light lights all along, or not at all: from bounds of the shadow map under them, so
   that only those in between look up every sample. Bounds of height fields and shadow maps in pyramids are due to Tevs,
   Ihrke, Seidel, "Maximum Mipmaps for Fast, Accurate, and Scalable Dynamic Height Field Rendering", I3D 2008, and Chen,
   Baran, Durand, Jarosz, "Real-Time Volumetric Shadows using 1D Min-Max Mipmaps", I3D 2011. These are not rectified: what
   they say holds for the very texels that samples would be compared with.
   Requires: what shadow.h does. */
#ifndef TFM_LIGHT_STRETCH_H
#define TFM_LIGHT_STRETCH_H

#include "light/shadow.h"

/* Coordinates in light space, and distances, as parts of how far they reach: some 30 half-ulps. */
#define STRETCH_ROUNDING 2e-6f

/* Where a stretch of the rays of a tile begins or ends. */
typedef struct {
  Floats t;
  Vec3 point;    /* in light space */
  Floats square; /* of the distance that light travels to it */
  Floats u, v;
} StretchEnd;

TFM_INLINE StretchEnd stretch_end(LIGHT light, Ray light_space_ray, Floats t)
{
  StretchEnd end;
  end.t = t;
  end.point = ray_at(light_space_ray, t);
  end.square = light_square(end.point);
  const LightSample sample = light_at(light, end.point);
  end.u = sample.u;
  end.v = sample.v;
  return end;
}

typedef struct {
  int lit;  /* 1: every sample in it passes its test of the shadow map */
  int dark; /* 1: none does, at any texel around */
  LightSpan span;
} LitStretch;

#if TFM_SHADOW
/* Least and largest distance in the shadow map in columns x0 to x1 and rows y0 to y1, and some around them. A level of
   the pyramid has entries at every 2^k texels of bounds of the next 4 * 2^k, k = 2, 3, ...; see
   tfm_cl/render/shadow_pyramid.py. */
TFM_INLINE TexelPair shadow_bounds(LIGHT light, __global const float *shadow, int x0, int y0, int x1, int y1)
{
  const int width = x1 - x0 > y1 - y0 ? x1 - x0 : y1 - y0;
  /* The least k with width <= 3 * 2^k. */
  const int fitting = ((as_int((float)width * (1.0f / 3)) - 1) >> 23) - 126;
  const int k = fitting > SHADOW_FIRST_LEVEL ? fitting : SHADOW_FIRST_LEVEL;
  const int size = light->shadow_bounds_res, here = size >> (k - SHADOW_FIRST_LEVEL);
  const int before = (size * size - here * here) / 3 * 4; /* entries of finer levels */
  const int entry = before + (y0 >> k) * here + (x0 >> k);
  return *(__global const TexelPair *)(shadow + light->first_shadow_bounds + 2 * entry);
}
#endif

/* ray: in light space; reach: how far its coordinates do. */
TFM_INLINE LitStretch lit_stretch(LIGHT light, __global const float *shadow, Ray ray, const StretchEnd *first,
                                  const StretchEnd *last, Ints active, float reach)
{
  const float rounding = STRETCH_ROUNDING * reach;
  const Interval part = {first->t, last->t};
  LitStretch stretch;
#if TFM_SHADOW == 0
  (void)shadow;
  (void)active;
  stretch.span = light_span(light, ray, part, first->point, last->point, rounding, 1.0f);
  stretch.lit = 1;
  stretch.dark = 0;
#else
  const float res = (float)light->shadow_res, most = res - 1.0f;
  stretch.span = light_span(light, ray, part, first->point, last->point, rounding, 1.0f / res);
  stretch.lit = stretch.dark = 0;
  if (any_lane(active & !stretch.span.is_straight))
    return stretch;
  const float nearest = least_float(active ? stretch.span.nearest : floats(MAXFLOAT));
  const float farthest = greatest_float(active ? greatest(first->square, last->square) : floats(0.0f));
  const float u0 = least_float(active ? least(first->u, last->u) : floats(1.0f));
  const float v0 = least_float(active ? least(first->v, last->v) : floats(1.0f));
  const float u1 = greatest_float(active ? greatest(first->u, last->u) : floats(0.0f));
  const float v1 = greatest_float(active ? greatest(first->v, last->v) : floats(0.0f));
  /* The texels around, and one more for what is rounded. */
#define TEXEL_OF(x) (int)((x) > 0.0f ? ((x) < most ? (x) : most) : 0.0f)
  const TexelPair bounds = shadow_bounds(light, shadow, TEXEL_OF(u0 * res - 2.5f), TEXEL_OF(v0 * res - 2.5f),
                                         TEXEL_OF(u1 * res + 2.5f), TEXEL_OF(v1 * res + 2.5f));
  const float least_solid = bounds.x - rounding, farthest_solid = bounds.y + rounding;
  stretch.lit = least_solid > 0.0f && least_solid * least_solid >= farthest;
  stretch.dark = farthest_solid * farthest_solid < nearest;
#endif
  return stretch;
}

#endif
