/* How light arrives at a point, for every kind of light. Light space is world space translated and rotated, so angles
   and distances are the same in both.
   Requires: TFM_INVERSE_SQUARE, 0, 1, or 2 where what shines are balls. */
#ifndef TFM_LIGHT_SAMPLE_H
#define TFM_LIGHT_SAMPLE_H

#include "../core/ray.h"

/* Transform a world point, or a world ray, to light space. */
TFM_INLINE Vec3 point_in_light(LIGHT light, Vec3 point)
{
  return transform_point(light->light_from_world, point);
}

TFM_INLINE Ray ray_in_light(LIGHT light, Ray ray)
{
  return transform_ray(light->light_from_world, ray);
}

typedef struct {
  Vec3 direction;  /* of travel: unit vector in light space */
  Floats distance; /* travelled, world units */
  Floats u, v;     /* position of the ray in the map, [0, 1]^2 */
  Floats strength; /* factor of the intensity due to falloff and cone edge, without the medium */
  Floats texture_u, texture_v; /* position in the light's texture (TFM_TEXTURE) */
} LightSample;

/* What is known of a stretch of a ray from its ends. */
typedef struct {
  Floats nearest;   /* the least distance that light travels to it, squared */
  Floats clear;     /* how light arrives is analytic, with no singularity nearer than that, squared; 0: it may have one */
  Ints is_straight; /* mask: u and v move along a segment, and by less than a texel for what coordinates are rounded by */
} LightSpan;

/* Both numbers are on the same side of 0, further than they are rounded by. */
TFM_INLINE Ints same_side(Floats a, Floats b, float rounding)
{
  return ((a > rounding) & (b > rounding)) | ((a < -rounding) & (b < -rounding));
}

/* The least distance of a ray's interval from the origin, squared. The direction is a unit vector. */
TFM_INLINE Floats nearest_to_origin(Ray ray, Interval part)
{
  const Vec3 p = ray_at(ray, least(greatest(-dot3(ray.origin, ray.direction), part.begin), part.end));
  return dot3(p, p);
}

/* How far positions in the plane of an octahedron move when a direction turns, at most: of n / (|x| + |y| + |z|) it is less
   than 1 + sqrt(3). */
#define CHART_TURN 2.74f

/* More than the angle at which a ball is seen from the light, radians; infinite from within it. square: its distance. */
TFM_INLINE Floats angle_of_ball(Floats square, Floats reach)
{
  const Ints outside = square > reach * reach;
  const Floats away = outside ? square - reach * reach : floats(1.0f);
  return outside ? reach * reciprocal_sqrt(away) : floats(INFINITY);
}

/* The value of u for points outside the map. */
#define CHART_OUTSIDE -1.0f
/* How far positions in the plane of a chart move per unit of length at distance 1, at most, where it is straight. */
#define CHART_SLOPE 16.0f

TFM_INLINE float chart_slope(LIGHT light)
{
  return CHART_SLOPE * (light->chart[0] > light->chart[1] ? light->chart[0] : light->chart[1]);
}

TFM_INLINE Floats light_falloff(LIGHT light, Floats inverse_distance)
{
#if TFM_INVERSE_SQUARE == 2
  /* The mean over an even ball, whose radius is the inverse of nearest_inverse (tfm_cl/scene/lights/base.py). */
  const float core = light->nearest_inverse;
  const Floats ratio = inverse_distance * (1.0f / core), outside = least(ratio * ratio, floats(1.0f));
  const Floats inside = 1.0f / greatest(ratio * ratio, floats(1.0f));
  const Floats beyond = outside * (1.0f + outside * (0.2f + 0.3f * outside * outside));
  const Floats within = 3.0f - inside * (1.0f + inside * (0.2f + 0.3f * inside * inside));
  return core * core * (ratio < 1.0f ? beyond : within);
#elif TFM_INVERSE_SQUARE
  const Floats nearest = least(inverse_distance, floats(light->nearest_inverse));
  return nearest * nearest;
#else
  (void)light;
  (void)inverse_distance;
  return floats(1.0f);
#endif
}

/* Lights with a position may have a finite reach: light_shape[3] is 1 / reach, or 0 if it is infinite. They fade out
   smoothly by the factor (1 - (d / reach)^4)^2 (Karis, "Real Shading in Unreal Engine 4", 2013).
   square: the distance squared. */
TFM_INLINE Floats light_window(LIGHT light, Floats square)
{
  const float inverse = light->shape[3];
  if (inverse <= 0.0f)
    return floats(1.0f);
  const Floats part = square * (inverse * inverse);
  const Floats window = greatest(1.0f - part * part, floats(0.0f));
  return window * window;
}

TFM_INLINE Ints in_reach(LIGHT light, Floats square)
{
  const float inverse = light->shape[3];
  return square * (inverse * inverse) < 1.0f;
}

/* Clip a ray to the sphere that a light with a finite reach can light. nearest: the point of the ray nearest to the
   light, at ray parameter shift. */
TFM_INLINE void reach_clip(LIGHT light, Vec3 nearest, Floats shift, Interval *interval)
{
  const float inverse = light->shape[3];
  if (inverse <= 0.0f)
    return;
  const float reach = 1.0f / inverse;
  const Floats square = reach * reach - dot3(nearest, nearest);
  const Floats half_chord = sqrt(greatest(square, floats(0.0f)));
  interval->begin = greatest(interval->begin, shift - half_chord);
  interval->end = square > 0.0f ? least(interval->end, shift + half_chord) : floats(-INFINITY);
}

#endif
