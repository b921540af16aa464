/* Rays, intervals on them, affine transforms, and the box of the medium. */
#ifndef TFM_RAY_H
#define TFM_RAY_H

/* Points origin + t direction. In the world the direction is a unit vector; transformed to another frame
   it need not be, so that t stays the distance in the world. */
typedef struct {
  float3 origin;
  float3 direction;
} Ray;

typedef struct {
  float begin;
  float end;
} Interval;

/* a_from_b: 3x4, row major. */
inline float3 transform_vector(__constant const float *a_from_b, float3 v)
{
  return (float3)(a_from_b[0] * v.x + a_from_b[1] * v.y + a_from_b[2] * v.z,
                  a_from_b[4] * v.x + a_from_b[5] * v.y + a_from_b[6] * v.z,
                  a_from_b[8] * v.x + a_from_b[9] * v.y + a_from_b[10] * v.z);
}

inline float3 transform_point(__constant const float *a_from_b, float3 p)
{
  return transform_vector(a_from_b, p) + (float3)(a_from_b[3], a_from_b[7], a_from_b[11]);
}

inline Ray transform_ray(__constant const float *a_from_b, Ray ray)
{
  Ray moved;
  moved.origin = transform_point(a_from_b, ray.origin);
  moved.direction = transform_vector(a_from_b, ray.direction);
  return moved;
}

/* Some CPU drivers do not inline mix(): it halved the speed of a trilinear sample. */
inline float lerp(float a, float b, float t)
{
  return a + t * (b - a);
}

inline float3 ray_at(Ray ray, float t)
{
  return ray.origin + t * ray.direction;
}

/* Clip an interval of one axis to 0 <= origin + t direction <= upper. */
inline void slab_clip(float origin, float direction, float upper, Interval *interval)
{
  if (direction == 0.0f) {
    /* Parallel: all or nothing. Dividing would give 0 * inf on the boundary. */
    if (origin < 0.0f || origin > upper)
      interval->end = -INFINITY;
    return;
  }
  const float t0 = -origin / direction;
  const float t1 = (upper - origin) / direction;
  interval->begin = fmax(interval->begin, fmin(t0, t1));
  interval->end = fmin(interval->end, fmax(t0, t1));
}

/* Clip an interval to the box [0, upper]; 0 when nothing is left. */
inline int box_clip(Ray ray, float3 upper, Interval *interval)
{
  slab_clip(ray.origin.x, ray.direction.x, upper.x, interval);
  slab_clip(ray.origin.y, ray.direction.y, upper.y, interval);
  slab_clip(ray.origin.z, ray.direction.z, upper.z, interval);
  return interval->begin < interval->end;
}

#endif
