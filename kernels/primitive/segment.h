/* Segments of strands: hair, fur, lines. A strand is a ribbon that faces every ray, of one opacity across its width. Where
   it is narrower than a few texels it covers a part of them: a strand of width w and opacity a that crosses a texel of
   width 1 takes w a of its light, T = 1 - w a, and lets it pass in proportion as (1 - b^2)^2 falls with the distance b
   from its axis. It is covered once at most: strands of nearly that width are widened further. Segments meet at the plane
   through their common end, so that a polyline has neither gaps nor overlaps but where it bends.
   shape: from one end to the other, radius at the first end, what it gains to the other, opacity, least radius,
   1 / the extinction that the opacity is meant for. */
#ifndef TFM_SEGMENT_H
#define TFM_SEGMENT_H

#include "primitive/crossing.h"

/* Radius, in texels, of a strand that is widened: sums over texels then differ by 1 %. At most LEAST_TEXELS. */
#define LEAST_STRAND 1.5f
/* Height of the profile across a widened strand over its mean: (15 / 16) (1 - b^2)^2 over 1 / 2. */
#define PEAK_STRAND 1.875f
/* Sine of the angle between a ray and a strand, squared, below which it looks along it. */
#define ALONG_STRAND 1e-8f
/* What the tangents at both ends have beside the direction of the segment, along one axis: 16 bits each, of BEND_UNIT. */
#define FIRST_BEND(bits) ((float)(short)((bits) & 0xffff))
#define SECOND_BEND(bits) ((float)((bits) >> 16))

/* The lanes whose ray, of a unit direction, crosses the segment. */
TFM_INLINE Ints segment_crossing(PRIMITIVE segment, float4 ball, Ray ray, Crossing *crossing)
{
  const Vec3 along = uniform_vec3(segment->shape);
  const Vec3 from = vec3(ball.x - ray.origin.x, ball.y - ray.origin.y, ball.z - ray.origin.z);
  const Vec3 d = ray.direction;
  const Floats away = dot3(from, d), slope = dot3(along, d);
  /* Across the ray: the axis is beside + u across, for u from -1/2 to 1/2. */
  const Vec3 beside = vec3(from.x - away * d.x, from.y - away * d.y, from.z - away * d.z);
  const Vec3 across = vec3(along.x - slope * d.x, along.y - slope * d.y, along.z - slope * d.z);
  const Floats square = dot3(across, across);
  const Ints is_along = square <= ALONG_STRAND * dot3(along, along);
  const Floats u = -dot3(beside, across) / (is_along ? floats(1.0f) : square);
  const Vec3 nearest = vec3(beside.x + u * across.x, beside.y + u * across.y, beside.z + u * across.z);
  const Floats distance = dot3(nearest, nearest);
  const Floats radius = segment->shape[3] + (u + 0.5f) * segment->shape[4], least_radius = floats(segment->shape[6]);
  const Ints is_narrow = radius < least_radius;
  /* Wide enough for the middle to be covered no more than once. */
  const Floats reach = is_narrow ? greatest(least_radius, PEAK_STRAND * radius) : radius;
  const Floats x = 1.0f - distance / (reach * reach);
  const Floats covered = is_narrow ? PEAK_STRAND * radius / reach * x * x : floats(1.0f);
  cross_at(away + u * slope, ball.w * 1e-3f, segment->shape[7] * depth_of_opacity(segment->shape[5] * covered),
           crossing);
  const Ints crosses = (x > 0.0f) & (u >= -0.5f) & (u < 0.5f) & !is_along;
  crossing->x = crosses ? u : floats(0.0f);
  return crosses;
}

TFM_INLINE Floats segment_part(PRIMITIVE segment, const Crossing *crossing, Floats t)
{
  (void)segment;
  return crossing->weight * place_in(crossing, t);
}

/* The tangent where the axis is crossed, of any length: from that at one end to that at the other. A strand that does not
   bend keeps the direction of its segments exactly. */
TFM_INLINE Vec3 segment_tangent(PRIMITIVE segment, const Crossing *crossing)
{
  const Vec3 along = uniform_vec3(segment->shape);
  const Floats inverse = reciprocal_sqrt(greatest(dot3(along, along), floats(FLT_MIN)));
  const Floats first = BEND_UNIT * (0.5f - crossing->x), second = BEND_UNIT * (0.5f + crossing->x);
  __global const int *bends = segment->bends;
  return vec3(inverse * along.x + first * FIRST_BEND(bends[0]) + second * SECOND_BEND(bends[0]),
              inverse * along.y + first * FIRST_BEND(bends[1]) + second * SECOND_BEND(bends[1]),
              inverse * along.z + first * FIRST_BEND(bends[2]) + second * SECOND_BEND(bends[2]));
}

/* As of point_seen. */
TFM_INLINE float segment_seen(SOURCE source, SET set, const Eye *eye, __global Primitive *seen, float4 *ball)
{
  float middle[3], square = 0.0f;
  for (int axis = 0; axis < 3; ++axis) {
    const float along = source->b[axis] - source->a[axis];
    middle[axis] = 0.5f * (source->a[axis] + source->b[axis]);
    seen->shape[axis] = along;
    square += along * along;
  }
  const float narrowest = LEAST_STRAND * texel_at(eye, middle);
  const float widest = source->radius[0] > source->radius[1] ? source->radius[0] : source->radius[1];
  seen->shape[3] = source->radius[0];
  seen->shape[4] = source->radius[1] - source->radius[0];
  seen->shape[5] = 1.0f - exp(-set->extinction * source->amount);
  seen->shape[6] = narrowest;
  seen->shape[7] = 1.0f / set->extinction;
  const float widened = PEAK_STRAND * (widest < narrowest ? widest : narrowest);
  const float reach = 0.5f * sqrt(square) + fmax(widest, fmax(narrowest, widened));
  *ball = (float4)(middle[0], middle[1], middle[2], reach);
  seen->traits = SHAPE_TRAITS(1, 0);
  for (int axis = 0; axis < 3; ++axis)
    seen->bends[axis] = as_int(source->c[axis]);
  return 1.0f;
}

#endif
