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

/* Where a ray crosses the plane of the face towards its origin, where that lies before the slab. */
TFM_INLINE Floats box_face(Floats origin, Floats direction, float half_size)
{
  const Floats before = magnitude_of(origin) - half_size;
  return any_lane(before > 0.0f) ? before / magnitude_of(direction) : floats(0.0f);
}

TFM_INLINE Vec3 box_faces(BODY body, Ray ray)
{
  return vec3(box_face(ray.origin.x - body->centre[0], ray.direction.x, body->size[0]),
              box_face(ray.origin.y - body->centre[1], ray.direction.y, body->size[1]),
              box_face(ray.origin.z - body->centre[2], ray.direction.z, body->size[2]));
}

TFM_INLINE Floats box_body_entry(BODY body, Ray ray)
{
  const Vec3 faces = box_faces(body, ray);
  return clamp_to(greatest(greatest(faces.x, faces.y), faces.z), 1.0f);
}

/* By one face at both ends, and hence in between; it is not close to the light. */
TFM_INLINE Ints box_enters_by(Floats face, Floats other, Floats another, Floats face_end, Floats other_end,
                              Floats another_end, float ratio)
{
  return (face >= other) & (face >= another) & (face_end >= other_end) & (face_end >= another_end) &
         (face * ratio >= face_end) & (face_end * ratio >= face);
}

TFM_INLINE Ints box_body_is_smooth(BODY body, Ray first, Ray last, float ratio)
{
  const Vec3 a = box_faces(body, first), b = box_faces(body, last);
  const Floats entry_a = greatest(greatest(a.x, a.y), a.z), entry_b = greatest(greatest(b.x, b.y), b.z);
  const Ints within = (entry_a <= 0.0f) & (entry_b <= 0.0f);
  return within | box_enters_by(a.x, a.y, a.z, b.x, b.y, b.z, ratio) | box_enters_by(a.y, a.z, a.x, b.y, b.z, b.x, ratio) |
         box_enters_by(a.z, a.x, a.y, b.z, b.x, b.y, ratio);
}

#endif
