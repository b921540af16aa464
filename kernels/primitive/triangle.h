/* Triangles of one opacity: leaves, paper, veils. One that is smaller than a few texels covers a part of them, in
   proportion to its area as the ray sees it.
   shape: from the first corner to the two others, opacity, 1 / the extinction that it is meant for. profile: 1 where it is
   small, and its centre is that of the corners; else that is the first corner. */
#ifndef TFM_TRIANGLE_H
#define TFM_TRIANGLE_H

#include "primitive/crossing.h"

/* The integral over a disc of radius 1 of (9 / 2 pi) (1 - b^2)^(7/2) is 1. */
#define PEAK_DISC (4.5f * M_1_PI_F)

TFM_INLINE Vec3 cross3(Vec3 a, Vec3 b)
{
  return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

/* The lanes whose ray, of a unit direction, crosses the triangle. */
TFM_INLINE Ints triangle_crossing(PRIMITIVE triangle, float4 ball, Ray ray, Crossing *crossing)
{
  const Vec3 first = uniform_vec3(triangle->shape), second = uniform_vec3(triangle->shape + 3);
  const Vec3 from = vec3(ray.origin.x - ball.x, ray.origin.y - ball.y, ray.origin.z - ball.z);
  const Vec3 normal = cross3(first, second);
  const Floats facing = dot3(normal, ray.direction);
  Floats covered = floats(1.0f), t;
  Ints crosses;
  if (PRIMITIVE_PROFILE(triangle)) {
    t = -dot3(from, ray.direction);
    const Vec3 beside = vec3(from.x + t * ray.direction.x, from.y + t * ray.direction.y, from.z + t * ray.direction.z);
    const float inverse = 1.0f / (ball.w * ball.w);
    const Floats x = 1.0f - inverse * dot3(beside, beside);
    crosses = x > 0.0f;
    const Floats root = root_of(x);
    covered = (0.5f * PEAK_DISC) * inverse * magnitude_of(facing) * x * x * x * root;
  } else {
    /* Moeller, Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", JGT 1997. */
    const Ints is_seen = magnitude_of(facing) > 1e-30f;
    const Floats inverse = 1.0f / (is_seen ? facing : floats(1.0f));
    const Vec3 turned = cross3(from, ray.direction);
    const Floats u = -dot3(turned, second) * inverse, v = dot3(turned, first) * inverse;
    t = -dot3(from, normal) * inverse;
    crosses = is_seen & (u >= 0.0f) & (v >= 0.0f) & (u + v < 1.0f);
  }
  cross_at(t, ball.w * 1e-4f, triangle->shape[7] * depth_of_opacity(triangle->shape[6] * covered), crossing);
  return crosses;
}

TFM_INLINE Floats triangle_part(PRIMITIVE triangle, const Crossing *crossing, Floats t)
{
  (void)triangle;
  return crossing->weight * place_in(crossing, t);
}

/* None. */
TFM_INLINE Vec3 triangle_tangent(PRIMITIVE triangle, const Crossing *crossing)
{
  (void)triangle;
  (void)crossing;
  return vec3(floats(0.0f), floats(0.0f), floats(0.0f));
}

/* As of point_seen. */
TFM_INLINE float triangle_seen(SOURCE source, SET set, const Eye *eye, __global Primitive *seen, float4 *ball)
{
  float middle[3], farthest = 0.0f;
  float squares[3] = {0.0f, 0.0f, 0.0f};
  for (int axis = 0; axis < 3; ++axis) {
    const float a = source->a[axis], b = source->b[axis], c = source->c[axis], m = (a + b + c) / 3.0f;
    middle[axis] = m;
    seen->shape[axis] = b - a;
    seen->shape[3 + axis] = c - a;
    squares[0] += (a - m) * (a - m);
    squares[1] += (b - m) * (b - m);
    squares[2] += (c - m) * (c - m);
  }
  for (int corner = 0; corner < 3; ++corner)
    farthest = squares[corner] > farthest ? squares[corner] : farthest;
  farthest = sqrt(farthest);
  const float narrowest = LEAST_TEXELS * texel_at(eye, middle);
  const int is_small = farthest < narrowest;
  seen->shape[6] = 1.0f - exp(-set->extinction * source->amount);
  seen->shape[7] = 1.0f / set->extinction;
  /* The ball around the first corner is larger than that around the middle. A disc is wide enough for its middle to be
     covered no more than once. */
  __global const float *u = seen->shape, *v = seen->shape + 3;
  const float x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
  const float area = 0.5f * sqrt(x * x + y * y + z * z);
  const float reach = is_small ? fmax(narrowest, sqrt(PEAK_DISC * area)) : 2.0f * farthest;
  *ball = is_small ? (float4)(middle[0], middle[1], middle[2], reach)
                   : (float4)(source->a[0], source->a[1], source->a[2], reach);
  seen->traits = SHAPE_TRAITS(1, is_small);
  return 1.0f;
}

#endif
