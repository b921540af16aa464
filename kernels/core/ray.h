/* Rays, intervals on them, affine transforms and the box of the medium, for all lanes. */
#ifndef TFM_RAY_H
#define TFM_RAY_H

#include "fast_math.h"

typedef struct {
  Floats x, y, z;
} Vec3;

/* Points origin + t direction. In the world the direction is a unit vector; transformed to another frame
   it need not be, so that t stays the distance in the world. */
typedef struct {
  Vec3 origin;
  Vec3 direction;
} Ray;

typedef struct {
  Floats begin;
  Floats end;
} Interval;

TFM_INLINE Vec3 vec3(Floats x, Floats y, Floats z)
{
  Vec3 v;
  v.x = x;
  v.y = y;
  v.z = z;
  return v;
}

/* The same three numbers of the parameters in every lane. */
TFM_INLINE Vec3 uniform_vec3(__global const float *v)
{
  return vec3(floats(v[0]), floats(v[1]), floats(v[2]));
}

TFM_INLINE Floats dot3(Vec3 a, Vec3 b)
{
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

TFM_INLINE Vec3 scale3(Floats s, Vec3 v)
{
  return vec3(s * v.x, s * v.y, s * v.z);
}

TFM_INLINE Vec3 unit3(Vec3 v)
{
  return scale3(1.0f / sqrt(dot3(v, v)), v);
}

/* a_from_b: 3x4, row major. */
TFM_INLINE Vec3 transform_vector(__global const float *a_from_b, Vec3 v)
{
  return vec3(a_from_b[0] * v.x + a_from_b[1] * v.y + a_from_b[2] * v.z,
              a_from_b[4] * v.x + a_from_b[5] * v.y + a_from_b[6] * v.z,
              a_from_b[8] * v.x + a_from_b[9] * v.y + a_from_b[10] * v.z);
}

TFM_INLINE Vec3 transform_point(__global const float *a_from_b, Vec3 p)
{
  const Vec3 v = transform_vector(a_from_b, p);
  return vec3(v.x + a_from_b[3], v.y + a_from_b[7], v.z + a_from_b[11]);
}

TFM_INLINE Ray transform_ray(__global const float *a_from_b, Ray ray)
{
  Ray moved;
  moved.origin = transform_point(a_from_b, ray.origin);
  moved.direction = transform_vector(a_from_b, ray.direction);
  return moved;
}

TFM_INLINE Vec3 ray_at(Ray ray, Floats t)
{
  return vec3(ray.origin.x + t * ray.direction.x, ray.origin.y + t * ray.direction.y,
              ray.origin.z + t * ray.direction.z);
}

/* Into [0, upper]; NaN becomes 0. */
TFM_INLINE Floats clamp_to(Floats x, float upper)
{
  return least(greatest(x, floats(0.0f)), floats(upper));
}

/* 1 / direction, large but finite where that is 0. */
TFM_INLINE Floats inverse_of(Floats direction)
{
  const Ints flat = (direction < 1e-30f) & (direction > -1e-30f);
  return 1.0f / (flat ? floats(1e-30f) : direction);
}

/* Clip an interval of one axis to 0 <= origin + t direction <= upper. A ray along the slab is in it, or its
   intersection is beyond all others. */
TFM_INLINE void slab_clip(Floats origin, Floats direction, float upper, Interval *interval)
{
  const Floats inverse = inverse_of(direction);
  const Floats t0 = -origin * inverse;
  const Floats t1 = (upper - origin) * inverse;
  interval->begin = greatest(interval->begin, least(t0, t1));
  interval->end = least(interval->end, greatest(t0, t1));
}

/* Clip an interval to the box [0, upper]; the lanes in which something is left. */
TFM_INLINE Ints box_clip(Ray ray, const float *upper, Interval *interval)
{
  slab_clip(ray.origin.x, ray.direction.x, upper[0], interval);
  slab_clip(ray.origin.y, ray.direction.y, upper[1], interval);
  slab_clip(ray.origin.z, ray.direction.z, upper[2], interval);
  return interval->begin < interval->end;
}

/* Bounds of x / z over a ball around (x, z) of a plane, for what lies in front, z > 0; everything where it is partly behind,
   nothing, low > high, where it is all behind. */
TFM_INLINE void slope_bounds(Floats x, Floats z, Floats reach, Floats *low, Floats *high)
{
  const Ints ahead = z > reach, behind = z <= -reach;
  const Floats inverse = 1.0f / (ahead ? (z - reach) * (z + reach) : floats(1.0f));
  const Floats root = reach * sqrt(greatest(x * x + (z - reach) * (z + reach), floats(0.0f)));
  *low = ahead ? (x * z - root) * inverse : behind ? floats(INFINITY) : floats(-INFINITY);
  *high = ahead ? (x * z + root) * inverse : behind ? floats(-INFINITY) : floats(INFINITY);
}

#endif
