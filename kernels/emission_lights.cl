/* What the lights of emission bring to the points of a lattice (view/orders.h), scattered towards the camera by each
   medium: over its albedo, as if it were alone.
   Includes expected before: a basis and a light header, and those of the phase functions and bodies' kinds. Requires: what
   light/reduced_intensity.h and view/orders.h do, with TFM_ORDER_MEDIA; TFM_PHASE. */
#include "core/store.h"
#include "light/reduced_intensity.h"
#include "phase/octaves.h"
#include "phase/phase.h"
#include "view/orders.h"

/* light   TFM_ORDER_COLOURS of each point: adds to, or begins, their sums over the lights
   number  of the light among those given: one after the other, as their maps would push each other out of the cache
   begins  1: the first light
   items   first of this launch and end */
__kernel void emission_lights(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                              ORDERS orders, __global float *light, int number, int begins, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  if (!any_lane(points.wanted))
    return;
  const Vec3 point = position_of(orders, &points);
  const Ray ray = rays_beyond(view, point);
  SCENE(scene, ints(-1), ints(-1));
  LIGHT_BUFFERS(buffers);

  LIGHT from = lights + number;
  const Ray in_light = ray_in_light(from, ray);
  const LightSample sample = light_at(from, in_light.origin);
  const LightPath path = light_path(&scene, from, &buffers, point, sample, 0, 0);
  Floats depth[TFM_CHANNELS];
  Ints samples = ints(0);
  light_optical_depths(&scene, from, &buffers, &path, points.wanted, &samples, depth);
#if TFM_TANGENTS
  const FibreAngles fibres = no_strands(); /* a lattice has none */
#endif
  const Floats mu = -dot3(sample.direction, in_light.direction);
  const Floats arrives = sample.strength * light_visibility(from, shadow, sample);
  const Ints at = points.number * TFM_ORDER_COLOURS;
  for (int m = 0; m < TFM_ORDER_MEDIA; ++m) {
    const Floats phase = PHASE_OF(&media[m], mu, &fibres);
    for (int c = 0; c < 3; ++c) {
      __global float *numbers = light + (3 * m + c);
      const Floats way = depth[TFM_CHANNELS == 3 ? c : 0];
      Floats scattered = phase * transmittance_of(way);
#if HAS_OCTAVES
      scattered += OCTAVE_AT_POINTS * later_octaves(&media[m], mu, way);
#endif
      Floats sum = from->intensity[c] * arrives * scattered;
      if (!begins)
        sum += gather_floats(numbers, at);
      store_floats(numbers, at, points.wanted, sum);
    }
  }
}
