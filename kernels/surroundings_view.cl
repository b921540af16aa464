/* What the media scatter towards the camera of the light from all around that arrives at points (view/surroundings.h).
   Includes expected before: a light header, and those of the phase functions. Requires: what they and view/surroundings.h
   do; TFM_PHASE. */
#include "core/store.h"
#include "phase/phase.h"
#include "light/sample.h"
#include "view/surroundings.h"

/* What the lights scatter towards the camera.
   depths     of points_depths
   sources    of each point that is listed, which of them says how deep its ways are
   these      places of the lights, of which there are `many`, among those that depths has
   scattered  out: as view/surroundings.h says */
__kernel void surroundings_view(VIEW view, MEDIUM media, LIGHT lights, ORDERS orders, __global const int *listed,
                                __global const float *depths, __global const int *sources, __global const int *these,
                                __global float *scattered, int count, int row, int many, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = listed_points(orders, listed, count, item);
  const Ray ray = rays_beyond(view, position_of(orders, &points));
  const Ints source = gather_ints(sources, item * TFM_LANES + LANE_Y * TILE_WIDTH + LANE_X);
#if TFM_TANGENTS
  const FibreAngles fibres = no_strands(); /* a lattice has none */
#endif
  Floats sums[TFM_ORDER_COLOURS];
  for (int n = 0; n < TFM_ORDER_COLOURS; ++n)
    sums[n] = floats(0.0f);
  for (int i = 0; i < many; ++i) {
    const int place = these[i];
    LIGHT from = lights + place;
    const Ray in_light = ray_in_light(from, ray);
    const LightSample sample = light_at(from, in_light.origin);
    const Floats mu = -dot3(sample.direction, in_light.direction);
    Floats depth[TFM_CHANNELS];
    for (int c = 0; c < TFM_CHANNELS; ++c) {
      depth[c] = gather_floats(depths + (size_t)(place * TFM_CHANNELS + c) * (size_t)row, source);
      sums[SURROUNDINGS_ARRIVE + c] += transmittance_of(depth[c]);
    }
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m) {
      MEDIUM medium = media + TFM_MEDIA * from->spread + m;
      const Floats phase = sample.strength * PHASE_OF(medium, mu, &fibres);
#if TFM_CHANNELS == 1
      const Floats first = phase * transmittance_of(depth[0]);
#if HAS_OCTAVES
      const Floats later = sample.strength * later_octaves(medium, mu, depth[0]);
#endif
#endif
      for (int c = 0; c < 3; ++c) {
#if TFM_CHANNELS == 3
        const Floats first = phase * transmittance_of(depth[c]);
#if HAS_OCTAVES
        const Floats later = sample.strength * later_octaves(medium, mu, depth[c]);
#endif
#endif
        sums[3 * m + c] += from->intensity[c] * first;
#if HAS_OCTAVES
        sums[SURROUNDINGS_LATER + 3 * m + c] += from->intensity[c] * later;
#endif
      }
    }
  }
  for (int n = 0; n < TFM_ORDER_COLOURS; ++n) {
    const Floats value =
        n < SURROUNDINGS_ARRIVE ? TFM_LOG2_E * log_of(greatest(sums[n], floats(FLT_MIN))) : sums[n];
    store_floats(scattered + n, points.number * TFM_ORDER_COLOURS, points.wanted, value);
  }
}
