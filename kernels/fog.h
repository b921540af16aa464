/* Media of constant density: what lies between two points is known in closed form (TFM eq. 5).
   The medium's middle is the origin of the device's world.
   Requires: TFM_MEDIUM 1: a box, 2: a ball, 3: all of space; Params. */
#ifndef TFM_FOG_H
#define TFM_FOG_H

#include "light/sample.h"

#if TFM_MEDIUM != 1 && TFM_MEDIUM != 2 && TFM_MEDIUM != 3
#error "TFM_MEDIUM must be 1, 2 or 3"
#endif

/* Stands for infinity: times an extinction of 0 it is still 0. */
#define FOG_FAR 1e30f

/* Per world unit; products of large densities and coefficients stay finite. */
TFM_INLINE float fog_extinction(PARAMS params, int channel)
{
  const float extinction = params->sigma_t[channel] * params->medium_density;
  return extinction < 1e30f ? extinction : 1e30f;
}

#if TFM_MEDIUM == 1
/* To -half <= origin + t direction <= half. */
TFM_INLINE void fog_slab(Floats origin, Floats direction, float half_size, Interval *interval)
{
  const Floats inverse = inverse_of(direction);
  const Floats t0 = (-half_size - origin) * inverse, t1 = (half_size - origin) * inverse;
  interval->begin = greatest(interval->begin, least(t0, t1));
  interval->end = least(interval->end, greatest(t0, t1));
}
#endif

/* Clip an interval of a world ray of unit direction to the medium; the lanes in which something is left. */
TFM_INLINE Ints fog_clip(PARAMS params, Ray ray, Interval *interval)
{
#if TFM_MEDIUM == 1
  fog_slab(ray.origin.x, ray.direction.x, params->medium_half[0], interval);
  fog_slab(ray.origin.y, ray.direction.y, params->medium_half[1], interval);
  fog_slab(ray.origin.z, ray.direction.z, params->medium_half[2], interval);
#elif TFM_MEDIUM == 2
  /* From the ray's point nearest to the middle, where the terms do not cancel. */
  const Floats shift = -dot3(ray.origin, ray.direction);
  const Vec3 nearest = ray_at(ray, shift);
  const Floats square = params->medium_half[0] * params->medium_half[0] - dot3(nearest, nearest);
  const Floats half_chord = sqrt(greatest(square, floats(0.0f)));
  interval->begin = greatest(interval->begin, shift - half_chord);
  interval->end = square > 0.0f ? least(interval->end, shift + half_chord) : floats(-INFINITY);
#else
  (void)params;
  (void)ray;
#endif
  return interval->begin < interval->end;
}

/* How far the light has travelled through the medium when it arrives at a point at a distance; inside: the point is
   in the medium. */
TFM_INLINE Floats fog_light_way(PARAMS params, Floats distance, Vec3 point, int inside)
{
#if TFM_MEDIUM == 3
  (void)params;
  (void)point;
  (void)inside;
  return distance;
#else
  if (inside & params->light_in_medium)
    return distance;
  const Ray ray = light_ray_to(params, point);
#if TFM_MEDIUM == 1
  if (inside) {
    /* It enters by the last of the faces that it crosses from outside. */
    const Floats origins[3] = {ray.origin.x, ray.origin.y, ray.origin.z};
    const Floats directions[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
    Floats entry = floats(0.0f);
#pragma unroll
    for (int axis = 0; axis < 3; ++axis) {
      const float half_size = params->medium_half[axis];
      const Floats size = AS_FLOATS(AS_INTS(origins[axis]) & 0x7fffffff);
      const Ints outside = size > half_size;
      if (any_lane(outside)) {
        const Floats signed_size = origins[axis] < 0.0f ? -directions[axis] : directions[axis];
        entry = greatest(entry, outside ? (half_size - size) / signed_size : floats(0.0f));
      }
    }
    return distance * greatest(1.0f - entry, floats(0.0f));
  }
#endif
  const Floats inverse = reciprocal_sqrt(dot3(ray.direction, ray.direction));
  const Ray unit_ray = {ray.origin, scale3(inverse, ray.direction)};
  Interval part = {floats(0.0f), distance};
  const Ints passes = fog_clip(params, unit_ray, &part);
  return passes ? part.end - part.begin : floats(0.0f);
#endif
}

/* Mean distance from where a segment begins to where its opacity is, by the opacity: 1 / e - length T / (1 - T). */
TFM_INLINE Floats fog_mean_distance(float extinction, Floats length)
{
  const Floats x = extinction * length;
  const Floats x2 = x * x;
  /* Series of 1 / x - 1 / (e^x - 1), to 2e-8 of the length. */
  const Floats series =
      0.5f - x * (1.0f / 12 - x2 * (1.0f / 720 - x2 * (1.0f / 30240 - x2 * (1.0f / 1209600 - x2 * (1.0f / 47900160)))));
  const float path = extinction > 0.0f ? 1.0f / extinction : 0.0f;
  return x < 1.0f ? length * series : path - length * transmittance_of(x) / opacity_of(x);
}

#endif
