/* What lies along the camera rays, whatever the lights: the transmittance of TFM eq. 5, depth, and eq. 7's ambient light.
   Requires: what camera_sums.h does. */
#ifndef TFM_SEE_H
#define TFM_SEE_H

#include "view/camera_sums.h"

#if TFM_GRIDS
/* The stretch that holds grids, in equal steps. Bodies of constant density add to it what lies along each step. */
TFM_INLINE void see_grids(VIEW view, MEDIUM media, BODY bodies, const Grids *grid, const MediaOnRay *on_ray,
                          Interval part, Ints active, CameraSums *sums)
{
  if (!any_lane(active))
    return;
  const Walk walk =
      walk_from(grid, &on_ray->in_grids, part.begin, part.end - part.begin, no_warp(), 0, ints(view->steps), active);
  Ints alive = active & is_visible(view, &sums->ray);
  Ints read = ints(0);
  Steps list = no_steps();
  while (any_lane(alive) && find_steps(grid, &walk, alive, 0, &list)) {
    Amounts step[MOST_STEPS];
    for (int k = 0; k < list.count; ++k) {
      const Place place = place_of(&walk, list.n[k]);
      step[k] = along_step(densities_at(grid, &walk, &list, k, place.t, &read), place.length, active);
#if TFM_BODIES
      if (any_lane(active))
        add_bodies(bodies, &on_ray->bodies, place.t - 0.5f * place.length, place.t + 0.5f * place.length, &step[k]);
#else
      (void)bodies;
#endif
    }
    for (int k = 0; k < list.count; ++k) {
      Floats opacity[TFM_CHANNELS];
      const Floats weight = camera_ray_step(media, &sums->ray, &step[k], opacity);
      camera_sums_step(media, sums, &step[k], place_of(&walk, list.n[k]).t, opacity, weight);
    }
    alive = active & is_visible(view, &sums->ray);
  }
  sums->samples += active ? read : ints(0);
}
#endif

#if TFM_BODIES
/* A stretch without grids. */
TFM_INLINE void see_bodies(VIEW view, MEDIUM media, BODY bodies, const MediaOnRay *on_ray, Interval part, Interval whole,
                           Ints active, CameraSums *sums)
{
#if TFM_GRIDS == 0 && TFM_BODIES == 1
  /* One body's mean distance is known. */
  const Ints steps = active ? ints(1) : ints(0);
  (void)view;
  (void)whole;
#else
  const Ints steps = active ? steps_of_stretch(part, whole, view->steps) : ints(0);
#endif
  const int most = -least_int(-steps);
  const Floats length = (part.end - part.begin) / TO_FLOATS(steps > 0 ? steps : ints(1));
  for (int n = 0; n < most; ++n) {
    const Ints here = n < steps;
    const Floats begin = part.begin + (float)n * length;
    Amounts step = no_amounts();
    add_bodies(bodies, &on_ray->bodies, begin, here ? begin + length : begin, &step);
    Floats opacity[TFM_CHANNELS], mean = floats(0.0f);
    Floats depth[TFM_CHANNELS];
    for (int c = 0; c < TFM_CHANNELS; ++c)
      depth[c] = extinguished(media, &step, c);
    const Floats weight = camera_ray_step(media, &sums->ray, &step, opacity);
    for (int c = 0; c < TFM_CHANNELS; ++c)
      mean += opacity[c] * mean_distance(depth[c], length) * (1.0f / TFM_CHANNELS);
    camera_sums_step(media, sums, &step, begin, opacity, weight);
    sums->distance_sum += mean;
  }
}
#endif

/* The whole of the rays. */
#if TFM_GRIDS
TFM_INLINE CameraSums see_media(VIEW view, MEDIUM media, BODY bodies, const Grids *padded, const MediaOnRay *on_ray)
#else
TFM_INLINE CameraSums see_media(VIEW view, MEDIUM media, BODY bodies, const MediaOnRay *on_ray)
#endif
{
  CameraSums sums = camera_sums_begin(media, on_ray->meets);
#if TFM_BODIES
  const Interval whole = on_ray->all;
  /* Beyond nothing is seen, and steps that reach farther would be too long. */
  Interval visible = whole;
  visible.end = least(whole.end, whole.begin + view->end);
#endif
#if TFM_BODIES == 0
  see_grids(view, media, bodies, padded, on_ray, on_ray->grids, on_ray->meets, &sums);
#elif TFM_GRIDS == 0 && TFM_BODIES == 1
  see_bodies(view, media, bodies, on_ray, whole, whole, on_ray->meets, &sums);
#else
  Interval stretch[STRETCHES];
  split_at_grids(on_ray, visible, stretch);
  for (int i = 0; i < STRETCHES; ++i) {
    const Ints active = on_ray->meets & (stretch[i].begin < stretch[i].end);
#if TFM_GRIDS
    if (i == 1)
      see_grids(view, media, bodies, padded, on_ray, stretch[i], active, &sums);
    else
#endif
      see_bodies(view, media, bodies, on_ray, stretch[i], visible, active, &sums);
  }
  if (any_lane(on_ray->meets & (visible.end < whole.end)))
    add_bodies(bodies, &on_ray->bodies, greatest(visible.end, whole.begin), whole.end, &sums.total);
#endif
  return sums;
}

#endif
