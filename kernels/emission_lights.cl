/* What the lights of emission bring to the points of a lattice (view/orders.h), scattered towards the camera by each
   medium: over its albedo, as if it were alone.
   Includes expected before: a light header, and those of the phase functions. Requires: what they and view/orders.h do, with
   TFM_ORDER_MEDIA; TFM_PHASE. */
#include "core/store.h"
#include "phase/octaves.h"
#include "phase/phase.h"
#include "light/sample.h"
#include "view/orders.h"

/* lights  some of them, of which there are `many`
   listed  numbers of the points, of which there are `count`
   depths  of points_depths, of these lights; row: of each
   light   TFM_ORDER_COLOURS of each point: adds to their sums over the lights
   items   first of this launch and end */
__kernel void emission_lights(VIEW view, MEDIUM media, LIGHT lights, ORDERS orders, __global const int *listed,
                              __global const float *depths, __global float *light, int count, int row, int many, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = listed_points(orders, listed, count, item);
  const Ray ray = rays_beyond(view, position_of(orders, &points));
#if TFM_TANGENTS
  const FibreAngles fibres = no_strands(); /* a lattice has none */
#endif
  const Ints at = points.number * TFM_ORDER_COLOURS;
  Floats sums[TFM_ORDER_COLOURS];
  for (int n = 0; n < TFM_ORDER_COLOURS; ++n)
    sums[n] = gather_floats(light + n, at);
  for (int i = 0; i < many; ++i) {
    LIGHT from = lights + i;
    const Ray in_light = ray_in_light(from, ray);
    const LightSample sample = light_at(from, in_light.origin);
    const Floats mu = -dot3(sample.direction, in_light.direction);
    Floats depth[TFM_CHANNELS];
    for (int c = 0; c < TFM_CHANNELS; ++c)
      depth[c] = ROW(depths + (size_t)(i * TFM_CHANNELS + c) * (size_t)row + (size_t)(item * TFM_LANES));
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m) {
      const Floats phase = PHASE_OF(&media[m], mu, &fibres);
      for (int c = 0; c < 3; ++c) {
        const Floats way = depth[TFM_CHANNELS == 3 ? c : 0];
        Floats scattered = phase * transmittance_of(way);
#if HAS_OCTAVES
        scattered += OCTAVE_AT_POINTS * later_octaves(&media[m], mu, way);
#endif
        sums[3 * m + c] += from->intensity[c] * sample.strength * scattered;
      }
    }
  }
  for (int n = 0; n < TFM_ORDER_COLOURS; ++n)
    store_floats(light + n, at, points.wanted, sums[n]);
}
