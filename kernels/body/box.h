/* A box along the world's axes. size: half of its edges. */
#ifndef TFM_BODY_BOX_H
#define TFM_BODY_BOX_H

#include "core/ray.h"

TFM_INLINE void box_slab(Floats origin, Floats direction, float half_size, Interval *interval)
{
  const Floats inverse = inverse_of(direction);
  const Floats t0 = (-half_size - origin) * inverse, t1 = (half_size - origin) * inverse;
  interval->begin = greatest(interval->begin, least(t0, t1));
  interval->end = least(interval->end, greatest(t0, t1));
}

TFM_INLINE Ints box_body_clip(BODY body, Ray ray, Interval *interval)
{
  box_slab(ray.origin.x - body->centre[0], ray.direction.x, body->size[0], interval);
  box_slab(ray.origin.y - body->centre[1], ray.direction.y, body->size[1], interval);
  box_slab(ray.origin.z - body->centre[2], ray.direction.z, body->size[2], interval);
  return interval->begin < interval->end;
}

#endif
