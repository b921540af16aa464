/* A ball. size[0]: its radius. */
#ifndef TFM_BODY_SPHERE_H
#define TFM_BODY_SPHERE_H

#include "core/ray.h"

TFM_INLINE Ints sphere_body_clip(BODY body, Ray ray, Interval *interval)
{
  Ray from_centre;
  from_centre.origin = vec3(ray.origin.x - body->centre[0], ray.origin.y - body->centre[1], ray.origin.z - body->centre[2]);
  from_centre.direction = ray.direction;
  /* From the ray's point nearest to the centre, where the terms do not cancel. */
  const Floats inverse = 1.0f / dot3(ray.direction, ray.direction);
  const Floats shift = -dot3(from_centre.origin, ray.direction) * inverse;
  const Vec3 nearest = ray_at(from_centre, shift);
  const Floats square = body->size[0] * body->size[0] - dot3(nearest, nearest);
  const Floats half_chord = sqrt(greatest(square * inverse, floats(0.0f)));
  interval->begin = greatest(interval->begin, shift - half_chord);
  interval->end = square > 0.0f ? least(interval->end, shift + half_chord) : floats(-INFINITY);
  return interval->begin < interval->end;
}

TFM_INLINE Floats sphere_body_entry(BODY body, Ray ray)
{
  Interval within = {floats(0.0f), floats(1.0f)};
  return sphere_body_clip(body, ray, &within) ? within.begin : floats(1.0f);
}

/* Not where light grazes it, and that is not told from elsewhere. */
TFM_INLINE Ints sphere_body_is_smooth(BODY body, Ray first, Ray last, float ratio)
{
  (void)body;
  (void)first;
  (void)last;
  (void)ratio;
  return ints(0);
}

#endif
