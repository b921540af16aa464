/* How rays cross a primitive. What lies between the middle of that and a ray parameter t is an odd function of s, the way
   from the middle in units of the primitive's depth. */
#ifndef TFM_CROSSING_H
#define TFM_CROSSING_H

#include "core/ray.h"
#include "primitive/traits.h"

typedef struct {
  Floats t;        /* ray parameter at the middle */
  Floats reach;    /* ray parameter from there to either end */
  Floats inverse;  /* from the ray parameter to s */
  Floats x, root;  /* of a point how near the ray passes to its centre, of a segment where along it; largest s */
  Floats weight;   /* multiplies all */
} Crossing;

/* s at a ray parameter, no further than either end. */
TFM_INLINE Floats place_in(const Crossing *crossing, Floats t)
{
  return least(greatest((t - crossing->t) * crossing->inverse, -crossing->root), crossing->root);
}

/* A crossing at t, however shallow, of something that holds `depth` there. */
TFM_INLINE void cross_at(Floats t, float reach, Floats depth, Crossing *crossing)
{
  crossing->t = t;
  crossing->reach = floats(reach);
  crossing->inverse = floats(1.0f / reach);
  crossing->x = crossing->root = floats(1.0f);
  crossing->weight = 0.5f * depth;
}

/* Optical depth of what takes a part of the light. The part stays below 1: MOST_OPACITY is opaque. */
TFM_INLINE Floats depth_of_opacity(Floats opacity)
{
  return -log_of(1.0f - least(opacity, floats(MOST_OPACITY)));
}

/* How primitives are seen from somewhere. */
typedef struct {
  float origin[3];
  float base, slope; /* width of a texel at the origin, and what it gains per unit of distance */
} Eye;

TFM_INLINE float texel_at(const Eye *eye, const float *place)
{
  float square = 0.0f;
  for (int axis = 0; axis < 3; ++axis) {
    const float away = place[axis] - eye->origin[axis];
    square += away * away;
  }
  return eye->base + eye->slope * sqrt(square);
}

#endif
