/* Spot light: a cone of light from a point.
   light_shape = tan(half angle), half angle (radians), blend, 1 / reach. Light space: the apex at the origin, the
   centre of the map along +z; cone_from_light rotates the axis of the cone to z.
   Requires: the header of its chart, included before. */
#ifndef TFM_LIGHT_SPOT_H
#define TFM_LIGHT_SPOT_H

#include "sample.h"

TFM_INLINE Vec3 spot_position(LIGHT light)
{
  return vec3(floats(light->world_from_light[3]), floats(light->world_from_light[7]),
              floats(light->world_from_light[11]));
}

/* Rotate to the space whose z is the axis of the cone. */
TFM_INLINE Vec3 in_cone(LIGHT light, Vec3 light_space)
{
  return transform_vector(light->cone_from_light, light_space);
}

TFM_INLINE Ray light_texel_ray(LIGHT light, Floats u, Floats v)
{
  Ray ray;
  ray.origin = spot_position(light);
  ray.direction = unit3(transform_vector(light->world_from_light, chart_direction(light, u, v)));
  return ray;
}

/* The light's ray through a point; its parameter is 0 at the light and 1 at the point. */
TFM_INLINE Ray light_ray_to(LIGHT light, Vec3 point)
{
  Ray ray;
  ray.origin = spot_position(light);
  ray.direction = vec3(point.x - ray.origin.x, point.y - ray.origin.y, point.z - ray.origin.z);
  return ray;
}

TFM_INLINE Floats light_projective_depth(LIGHT light, Vec3 point)
{
  return greatest(in_cone(light, transform_point(light->light_from_world, point)).z, floats(0.0f));
}

TFM_INLINE Ints light_reaches(LIGHT light, Vec3 point)
{
  const Vec3 p = in_cone(light, transform_point(light->light_from_world, point));
  return (p.z > 0.0f) & (sqrt(p.x * p.x + p.y * p.y) <= light->shape[0] * p.z) &
         in_reach(light, dot3(p, p));
}

/* Intersection of a ray with the solid cone x^2 + y^2 <= k^2 z^2, z >= 0. The cone is convex, so this is one interval.
   A t^2 + 2 B t + C <= 0 holds on both nappes; the signs of A and of the axial component select ours. */
TFM_INLINE Ints light_clip(LIGHT light, Ray world_ray, Interval *interval)
{
  const float k2 = light->shape[0] * light->shape[0];
  const Ray light_space = transform_ray(light->light_from_world, world_ray);
  const Ray ray = {in_cone(light, light_space.origin), in_cone(light, light_space.direction)};
  /* Measured from the point of the ray nearest to the apex, to avoid cancellation. */
  const Vec3 d = ray.direction;
  const Floats shift = -dot3(ray.origin, d);
  const Vec3 o = ray_at(ray, shift);
  const Floats a = d.x * d.x + d.y * d.y - k2 * d.z * d.z;
  const Floats b = o.x * d.x + o.y * d.y - k2 * o.z * d.z;
  const Floats c = o.x * o.x + o.y * o.y - k2 * o.z * o.z;
  /* B^2 - A C by Lagrange's identity for the quadratic form diag(1, 1, -k^2); n = o x d. */
  const Floats nx = o.y * d.z - o.z * d.y, ny = o.z * d.x - o.x * d.z, nz = o.x * d.y - o.y * d.x;
  const Floats discriminant = k2 * (nx * nx + ny * ny) - nz * nz;
  const Ints shallow = a > 0.0f; /* the ray crosses the surface of one nappe twice, or not at all */
  /* Both roots without cancellation; q = 0 only if both are 0. */
  const Floats q = -(b + copysign(sqrt(greatest(discriminant, floats(0.0f))), b));
  const Ints meet = q == 0.0f;
  const Floats near_root = meet ? floats(0.0f) : c / q;
  /* If the ray is parallel to the surface (a = 0), one of the roots, on our nappe or the other, is infinite. */
  const Floats far_root = meet ? floats(0.0f) : a == 0.0f ? copysign(floats(INFINITY), -q) : q / a;
  const Floats first = least(near_root, far_root), last = greatest(near_root, far_root);
  /* A ray steeper than the surface has one root on each nappe; ours is the one further along +z. */
  const Ints rising = d.z > 0.0f;
  const Floats begin = shallow ? first : rising ? last : floats(-INFINITY);
  const Floats end = shallow ? last : rising ? floats(INFINITY) : first;
  const Ints other_nappe = shallow & ((discriminant < 0.0f) | (o.z + 0.5f * (first + last) * d.z < 0.0f));
  interval->begin = greatest(interval->begin, begin + shift);
  interval->end = other_nappe ? floats(-INFINITY) : least(interval->end, end + shift);
  reach_clip(light, o, shift, interval);
  return interval->begin < interval->end;
}

/* 1 inside the cone, falling smoothly to 0 at its edge over the outer fraction `blend` of the half angle.
   tangent: tangent of the angle to the axis. */
TFM_INLINE Floats spot_edge(LIGHT light, Floats tangent)
{
  const float cone = light->shape[1];
  const float blend = light->shape[2];
  const Floats angle = arctangent_of(tangent);
  const Floats t = least(greatest((cone - angle) * (1.0f / (cone * blend)), floats(0.0f)), floats(1.0f));
  return t * t * (3.0f - 2.0f * t);
}

TFM_INLINE LightSample light_at(LIGHT light, Vec3 p)
{
  const Floats square = dot3(p, p);
  const Floats inverse = reciprocal_sqrt(square);
  /* At the apex itself any direction will do. */
  const Ints apart = square > 0.0f;
  LightSample sample;
  sample.direction = vec3(p.x * inverse, p.y * inverse, apart ? p.z * inverse : floats(1.0f));
  sample.distance = square * inverse;
  chart_position(light, p, &sample.u, &sample.v);
  sample.strength = light_falloff(light, inverse) * light_window(light, square);
  sample.texture_u = sample.texture_v = floats(0.5f);
#if TFM_TEXTURE
  const int needs_angles = 1;
#else
  const int needs_angles = light->shape[2] > 0.0f;
#endif
  if (needs_angles) {
    const Vec3 q = in_cone(light, p);
    /* Inside the cone z is not much smaller than x and y. */
    const Floats away = 1.0f / (apart ? q.z : floats(1.0f));
    const float scale = 0.5f / light->shape[0];
    const Floats x = q.x * away, y = q.y * away;
    sample.texture_u = 0.5f + x * scale;
    sample.texture_v = 0.5f + y * scale;
    if (light->shape[2] > 0.0f) {
      const Floats off = x * x + y * y;
      sample.strength *= spot_edge(light, off * reciprocal_sqrt(off));
    }
  }
  return sample;
}

/* Whether a point lies where the cone's edge does not dim the light: a convex region. */
TFM_INLINE Ints is_inside_edge(LIGHT light, Vec3 p)
{
  const Vec3 q = in_cone(light, p);
  const Floats away = 1.0f / q.z, off = (q.x * q.x + q.y * q.y) * away * away;
  const Floats edge = spot_edge(light, off * reciprocal_sqrt(off));
  return (q.z > 0.0f) & (edge >= 1.0f);
}

/* Bounds of u and v over the rays that meet a ball in light space. */
TFM_INLINE void light_bounds(LIGHT light, Vec3 p, Floats reach, Floats *low, Floats *high)
{
  chart_bounds(light, p, reach, low, high);
}

TFM_INLINE Floats light_square(Vec3 p)
{
  return dot3(p, p);
}

TFM_INLINE LightSpan light_span(LIGHT light, Ray ray, Interval part, Vec3 first, Vec3 last, float rounding, float texel)
{
  const float moves = rounding * chart_slope(light) / texel;
  LightSpan span;
  span.nearest = span.clear = nearest_to_origin(ray, part);
  if (light->shape[2] > 0.0f)
    span.clear = is_inside_edge(light, first) & is_inside_edge(light, last) ? span.nearest : floats(0.0f);
  span.is_straight = chart_is_straight(first, last, rounding) & (span.nearest >= moves * moves);
  return span;
}

#endif
