/* Spot light: a cone from a point, mapped on the square around it.
   light_shape = tan(half angle), half angle (radians), blend. Light space: apex at 0, axis along +z. */
#ifndef TFM_LIGHT_SPOT_H
#define TFM_LIGHT_SPOT_H

#include "light/sample.h"

inline float3 spot_position(__constant const Params *params)
{
  return (float3)(params->world_from_light[3], params->world_from_light[7], params->world_from_light[11]);
}

inline Ray light_texel_ray(__constant const Params *params, float2 uv)
{
  const float2 tangent = (2.0f * uv - 1.0f) * params->light_shape[0];
  Ray ray;
  ray.origin = spot_position(params);
  ray.direction = normalize(transform_vector(params->world_from_light, (float3)(tangent, 1.0f)));
  return ray;
}

inline float light_projective_depth(__constant const Params *params, float3 point)
{
  return fmax(transform_point(params->light_from_world, point).z, 0.0f);
}

inline int light_reaches(__constant const Params *params, float3 point)
{
  const float3 p = transform_point(params->light_from_world, point);
  return p.z > 0.0f && length(p.xy) <= params->light_shape[0] * p.z;
}

/* Intersection of a ray with the solid cone x^2 + y^2 <= k^2 z^2, z >= 0: one interval, as it is convex.
   A t^2 + 2 B t + C <= 0 holds on both nappes; the sign of A and of the axis component pick ours. */
inline int light_clip(__constant const Params *params, Ray world_ray, Interval *interval)
{
  const float k2 = params->light_shape[0] * params->light_shape[0];
  const Ray ray = transform_ray(params->light_from_world, world_ray);
  /* Measured from the point of the ray nearest to the apex, where the terms do not cancel. */
  const float shift = -dot(ray.origin, ray.direction);
  const float3 o = ray_at(ray, shift);
  const float3 d = ray.direction;
  const float a = d.x * d.x + d.y * d.y - k2 * d.z * d.z;
  const float b = o.x * d.x + o.y * d.y - k2 * o.z * d.z;
  const float c = o.x * o.x + o.y * o.y - k2 * o.z * o.z;
  /* B^2 - A C, by Lagrange's identity for the form diag(1, 1, -k^2). */
  const float3 n = cross(o, d);
  const float discriminant = k2 * (n.x * n.x + n.y * n.y) - n.z * n.z;
  if (a > 0.0f && discriminant < 0.0f)
    return 0;
  /* Both roots without cancellation; q = 0 only when they meet at t = 0. */
  const float q = -(b + copysign(sqrt(fmax(discriminant, 0.0f)), b));
  const float near_root = q == 0.0f ? 0.0f : c / q;
  float begin, end;
  if (a > 0.0f) {
    const float far_root = q / a;
    begin = fmin(near_root, far_root);
    end = fmax(near_root, far_root);
    if (o.z + 0.5f * (begin + end) * d.z < 0.0f)
      return 0;
  } else {
    /* Steeper than the side: one root on each nappe; ours is the one further along +z. Parallel to the side
       (a = 0) one of the roots, ours or the other nappe's, has gone to infinity. */
    const float far_root = q == 0.0f ? 0.0f : a < 0.0f ? q / a : copysign(INFINITY, -q);
    begin = d.z > 0.0f ? fmax(near_root, far_root) : -INFINITY;
    end = d.z > 0.0f ? INFINITY : fmin(near_root, far_root);
  }
  interval->begin = fmax(interval->begin, begin + shift);
  interval->end = fmin(interval->end, end + shift);
  return interval->begin < interval->end;
}

/* 1 inside the cone, falling to 0 at its side over the outer blend of the half angle. */
inline float spot_edge(__constant const Params *params, float3 p)
{
  const float cone = params->light_shape[1];
  const float blend = params->light_shape[2];
  if (blend <= 0.0f)
    return 1.0f;
  const float angle = atan2(length(p.xy), p.z);
  return smoothstep(0.0f, 1.0f, (cone - angle) / (cone * blend));
}

inline LightSample light_at(__constant const Params *params, float3 point)
{
  const float3 p = transform_point(params->light_from_world, point);
  LightSample sample;
  sample.ray.origin = spot_position(params);
  sample.distance = length(p);
  /* At the apex itself any direction serves. */
  const float3 unit = sample.distance > 0.0f ? p / sample.distance : (float3)(0.0f, 0.0f, 1.0f);
  sample.ray.direction = transform_vector(params->world_from_light, unit);
  const float2 tangent = unit.xy / fmax(unit.z, 1e-6f);
  sample.uv = 0.5f + 0.5f * tangent / params->light_shape[0];
  sample.radiance = vload3(0, params->light_intensity) * light_falloff(params, sample.distance) *
                    spot_edge(params, unit);
  return sample;
}

#endif
