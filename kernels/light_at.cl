/* What lights bring to any points.
   Includes expected before: a basis and a light header, and those of the bodies' kinds. Requires: what
   light/reduced_intensity.h does. */
#include "core/store.h"
#include "light/reduced_intensity.h"

#define LEAST_WEIGHT 1e-20f /* of a light that is off: what is left of it is known all the same */

/* A work-item takes as many points as there are lanes.
   points  x of all, then y, then z
   sums    RGB of what arrives, then RGB of the parts of it that are left, by their weights, then these: adds to, of each
           all points
   number  of the light among those given
   count   of points
   items   first of this launch and end */
__kernel void light_at_points(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                              __global const float *points, __global float *sums, int number, int count, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Ints n = item * TFM_LANES + LANE_Y * TILE_WIDTH + LANE_X;
  const Ints wanted = n < count, at = wanted ? n : ints(0);
  const Vec3 point =
      vec3(gather_floats(points, at), gather_floats(points + count, at), gather_floats(points + 2 * (size_t)count, at));
  SCENE(scene, ints(-1), ints(-1));
  LIGHT_BUFFERS(buffers);
  LIGHT light = lights + number;
  const LightSample sample = light_at(light, point_in_light(light, point));
  const Ints lit = wanted & light_reaches(light, point) & (sample.strength > 0.0f);
  if (!any_lane(lit))
    return;
  const LightPath path = light_path(&scene, light, &buffers, point, sample, 0, 0);
  Floats depth[TFM_CHANNELS], tint[3];
  Ints samples = ints(0);
  light_optical_depths(&scene, light, &buffers, &path, lit, &samples, depth);
  light_tint(light, &buffers, sample, tint);
  const Floats visible = light_visibility(light, shadow, sample);
  Floats largest = floats(LEAST_WEIGHT);
  for (int c = 0; c < 3; ++c)
    largest = greatest(largest, light->intensity[c] * tint[c]);
  const Floats weight = largest * sample.strength;
  for (int c = 0; c < 3; ++c) {
    const Floats left = visible * transmittance_of(depth[TFM_CHANNELS == 3 ? c : 0]);
    __global float *arrives = sums + (size_t)c * count, *weighted = sums + (size_t)(3 + c) * count;
    store_floats(arrives, at, lit, gather_floats(arrives, at) + light->intensity[c] * tint[c] * sample.strength * left);
    store_floats(weighted, at, lit, gather_floats(weighted, at) + weight * left);
  }
  __global float *weights = sums + 6 * (size_t)count;
  store_floats(weights, at, lit, gather_floats(weights, at) + weight);
}
