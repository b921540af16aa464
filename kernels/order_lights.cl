/* What lights bring to the points of a lattice (view/orders.h), and no scattering yet: the mean over all directions of
   the radiance that arrives. It is that of the cube around a point, weighed by the density: as much is scattered as without
   a lattice, however fast light falls off.
   Includes expected before: a basis and a light header, and those of the bodies' kinds. Requires: what
   light/reduced_intensity.h and view/cells.h do. */
#include "core/store.h"
#include "light/reduced_intensity.h"
#include "view/cells.h"

#define INVERSE_SPHERE 0.0795774715f /* 1 / 4 pi */
#define LEAST_WEIGHT 1e-6f           /* as an optical depth of the distance between points: where there is no density */

/* light   of the points, adds to
   number  of the light among those given
   items   first of this launch and end */
__kernel void order_lights(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                           ORDERS orders, __global float *light, int number, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  if (!any_lane(points.wanted))
    return;
  SCENE(scene, ints(-1), ints(-1));
  LIGHT_BUFFERS(buffers);
  LIGHT from = lights + number;
  const Vec3 centre = position_of(orders, &points);
  const float least_weight = LEAST_WEIGHT / orders->spacing;
  Floats sum[TFM_ORDER_COLOURS], weight[TFM_CHANNELS];
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    sum[c] = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    weight[c] = floats(0.0f);
  EACH_SAMPLE(orders) {
    const Vec3 point = sample_of_cell(orders, centre, i, j, k);
    Floats here[TFM_CHANNELS];
    extinction_at(&scene, orders, point, here);
    for (int c = 0; c < TFM_CHANNELS; ++c) {
      here[c] += least_weight;
      weight[c] += here[c];
    }
    const LightSample sample = light_at(from, point_in_light(from, point));
    const Ints lit = points.wanted & (sample.strength > 0.0f);
    if (!any_lane(lit))
      continue;
    const LightPath path = light_path(&scene, from, &buffers, point, sample, 0, 0);
    Floats depth[TFM_CHANNELS], tint[3];
    Ints samples = ints(0);
    light_optical_depths(&scene, from, &buffers, &path, lit, &samples, depth);
    light_tint(from, &buffers, sample, tint);
    const Floats arrives = lit ? sample.strength * light_visibility(from, shadow, sample) : floats(0.0f);
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
      const int channel = TFM_CHANNELS == 3 ? c : 0;
      sum[c] += tint[c] * here[channel] * arrives * transmittance_of(depth[channel]);
    }
  }
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
#if TFM_ORDER_COLOURS == 3
    const float intensity = from->intensity[c];
#else
    /* Of one colour, of which there is most. */
    const float intensity = fmax(fmax(from->intensity[0], from->intensity[1]), from->intensity[2]);
#endif
    __global float *numbers = light + (size_t)c * padded_size(orders);
    const Floats more = INVERSE_SPHERE * intensity * sum[c] / weight[TFM_CHANNELS == 3 ? c : 0];
    store_floats(numbers, points.at, points.wanted, gather_floats(numbers, points.at) + more);
  }
}
