/* What lies along camera rays, whatever the lights: the transmittance of TFM eq. 5, depth, eq. 7's ambient light,
   and what the media emit.
   Requires: what camera_sums.h does; TFM_LATTICE, 1 where light is read from a lattice on the way, with what lattice.h
   requires, 2 where it is what later orders scatter, or what is scattered of emission, with what orders.h requires, 3 where
   it is what is scattered of light from all around, with what surroundings.h requires: of these headers, one in whose lattice
   light is so smooth that two steps share a value defines LATTICE_OF_BOTH_STEPS;
   TFM_DEEP, 1 where deep samples are made on the way, 2 where they are given the ambient light and what media emit. */
#ifndef TFM_SEE_H
#define TFM_SEE_H

#include "view/camera_sums.h"
#ifndef TFM_LATTICE
#define TFM_LATTICE 0
#endif
#if TFM_LATTICE == 1
#include "view/lattice.h"
#elif TFM_LATTICE == 2
#include "view/orders.h"
#elif TFM_LATTICE == 3
#include "view/surroundings.h"
#endif
#ifndef TFM_DEEP
#define TFM_DEEP 0
#endif
#if TFM_LATTICE
#define WAY_PARAMETERS , LATTICE lattice, LightSums *lit
#define WAY_ARGUMENTS , lattice, lit
#elif TFM_DEEP == 2
#define WAY_PARAMETERS , DeepColours *deep
#define WAY_ARGUMENTS , deep
#elif TFM_DEEP
#include "view/deep.h"
#define WAY_PARAMETERS , DeepRay *deep
#define WAY_ARGUMENTS , deep
#else
#define WAY_PARAMETERS
#define WAY_ARGUMENTS
#endif

#if TFM_LATTICE && TFM_DEEP_COLOURS
/* Light so far, which each step adds to: what it adds goes to the sample there. */
TFM_INLINE void light_so_far(const LightSums *lit, Floats *colour)
{
  for (int c = 0; c < 3; ++c) {
    colour[c] = lit->colour[c];
#if TFM_LIGHT_LAYERS && defined(TFM_LATTICE_APART)
    for (int i = 0; i < TFM_LATTICE_APART; ++i)
      colour[c] += lit->apart[i][c];
#endif
  }
}
#define LIT_STEP(t, lit, value, media, step, opacity, weight)    \
  do {                                                           \
    Floats lit_before[3], lit_after[3];                          \
    light_so_far(lit, lit_before);                               \
    LATTICE_STEP(lit, value, media, step, opacity, weight);      \
    light_so_far(lit, lit_after);                                \
    for (int lit_c = 0; lit_c < 3; ++lit_c)                      \
      lit_after[lit_c] -= lit_before[lit_c];                     \
    deep_add(&(lit)->deep, t, lit_after);                        \
  } while (0)
#elif TFM_LATTICE
#define LIT_STEP(t, lit, value, media, step, opacity, weight) LATTICE_STEP(lit, value, media, step, opacity, weight)
#endif

#if TFM_DEEP == 2
/* What a step sends to the camera without lights: camera_sums_step and camera_sums_end, for each by itself.
   after: the ray behind it, which took its opacity. */
TFM_INLINE void deep_add_own(DeepColours *deep, const Scene *scene, const CameraRay *after, const Amounts *step, Floats t,
                             const Floats *opacity)
{
  MEDIUM media = scene->media;
  Floats adds[3];
  for (int c = 0; c < 3; ++c) {
    const Floats taken = opacity[TFM_CHANNELS == 3 ? c : 0];
    adds[c] = scene->view->ambient[c] * taken * albedo_of(media, step, c);
#if TFM_EMISSION
    add_emission(media, after, step, opacity, c, &adds[c]);
#endif
  }
  (void)after;
  deep_add(deep, t, adds);
}
#endif

#if TFM_GRIDS
/* The stretch that holds grids, in equal steps. Bodies of constant density add to it what lies along each step.
   as_many: all rays have as many steps. */
TFM_INLINE void see_grids(const Scene *scene, const MediaOnRay *on_ray, Interval part, Ints steps, int as_many,
                          Ints active, CameraSums *sums WAY_PARAMETERS)
{
  active &= steps > 0;
  if (!any_lane(active))
    return;
  VIEW view = scene->view;
  MEDIUM media = scene->media;
  const Walk walk = walk_of_camera(scene, on_ray, part.begin, part.end - part.begin, no_warp(), 0, steps, active);
  Ints alive = active & is_visible(view, &sums->ray);
  Ints read = ints(0);
  Steps list = no_steps();
#if TFM_LATTICE && defined(LATTICE_OF_BOTH_STEPS)
  LatticeValue held = lattice_begin();
  int held_of = -1;
#endif
  while (any_lane(alive) && find_steps(scene->padded, &walk, alive, 0, &list)) {
    Amounts step[MOST_STEPS];
    for (int k = 0; k < list.count; ++k) {
      const Place place = place_of(&walk, list.n[k]);
      const Ints here = as_many ? active : active & (list.n[k] < walk.steps);
      step[k] = along_step(densities_at(scene->padded, &walk, &list, k, place.t, &read), place.length, here);
#if TFM_BODIES
      const Floats to_end = here ? 0.5f * place.length : floats(0.0f);
      add_bodies(scene->bodies, &on_ray->bodies, place.t - to_end, place.t + to_end, &step[k]);
#endif
    }
#if TFM_LATTICE && defined(LATTICE_OF_BOTH_STEPS)
    LatticeValue light[MOST_STEPS];
    for (int k = 0; k < list.count; ++k) {
      if (any_lane(any_amount(&step[k])))
        LATTICE_OF_BOTH_STEPS(lattice, &walk, list.n[k], &held, &held_of);
      light[k] = held; /* weighs nothing without any amount */
    }
#elif TFM_LATTICE
    LatticeValue light[MOST_STEPS];
    for (int k = 0; k < list.count; ++k)
      light[k] = any_lane(any_amount(&step[k])) ? LATTICE_AT(lattice, &walk, &list, k, place_of(&walk, list.n[k]).t)
                                                : lattice_begin();
#endif
    for (int k = 0; k < list.count; ++k) {
      Floats opacity[TFM_CHANNELS];
      const Floats weight = camera_ray_step(media, &sums->ray, &step[k], opacity);
#if TFM_LATTICE
      LIT_STEP(place_of(&walk, list.n[k]).t, lit, &light[k], media, &step[k], opacity, weight);
#endif
      camera_sums_step(media, sums, &sums->ray, &step[k], place_of(&walk, list.n[k]).t, opacity, weight);
#if TFM_DEEP == 2
      deep_add_own(deep, scene, &sums->ray, &step[k], place_of(&walk, list.n[k]).t, opacity);
#elif TFM_DEEP
      const Place place = place_of(&walk, list.n[k]);
      const Floats to_end = 0.5f * place.length;
      deep_step(deep, media, &sums->total, &step[k], place.t - to_end, place.t + to_end,
                active & (list.n[k] < walk.steps));
#endif
    }
    alive = active & is_visible(view, &sums->ray);
  }
  sums->samples += active ? read : ints(0);
}
#endif

#if TFM_BODIES
/* A stretch without grids. */
TFM_INLINE void see_bodies(const Scene *scene, const MediaOnRay *on_ray, Interval part, Ints steps,
                           CameraSums *sums WAY_PARAMETERS)
{
  MEDIUM media = scene->media;
  const int most = -least_int(-steps);
  const Floats length = (part.end - part.begin) / TO_FLOATS(steps > 0 ? steps : ints(1));
  for (int n = 0; n < most; ++n) {
    const Ints here = n < steps;
    const Floats begin = part.begin + (float)n * length;
    Amounts step = no_amounts();
    add_bodies(scene->bodies, &on_ray->bodies, begin, here ? begin + length : begin, &step);
    Floats opacity[TFM_CHANNELS], mean = floats(0.0f);
    Floats depth[TFM_CHANNELS];
    for (int c = 0; c < TFM_CHANNELS; ++c)
      depth[c] = extinguished(media, &step, c);
    const Floats weight = camera_ray_step(media, &sums->ray, &step, opacity);
    for (int c = 0; c < TFM_CHANNELS; ++c)
      mean += opacity[c] * mean_distance(depth[c], length) * (1.0f / TFM_CHANNELS);
#if TFM_LATTICE
    const LatticeValue light = LATTICE_AT(lattice, 0, 0, 0, begin + 0.5f * length);
    LIT_STEP(begin + 0.5f * length, lit, &light, media, &step, opacity, weight);
#endif
    camera_sums_step(media, sums, &sums->ray, &step, begin, opacity, weight);
    sums->distance_sum += mean;
#if TFM_DEEP == 2
    deep_add_own(deep, scene, &sums->ray, &step, begin + 0.5f * length, opacity);
#elif TFM_DEEP
    const Interval held = part_in_bodies(&on_ray->bodies, begin, begin + length);
    deep_step(deep, media, &sums->total, &step, held.begin, held.end, here);
#endif
  }
}
#endif

#if TFM_LATTICE != 1
/* A part of the rays, from where they meet the first of the media. only_dims: what it takes from the rays is wanted, not
   where. */
TFM_INLINE CameraSums see_media(const Scene *scene, const MediaOnRay *on_ray, Interval part, int only_dims,
                                Ints active WAY_PARAMETERS)
{
  const int steps = scene->view->steps;
  CameraSums sums = camera_sums_begin(scene->media, active);
  active &= part.begin < part.end;
#if TFM_BODIES == 0
  const Ints wanted = only_dims ? steps_in_grids(on_ray, part, steps) : ints(steps);
  see_grids(scene, on_ray, part, wanted, !only_dims, active, &sums WAY_ARGUMENTS);
#else
  /* Beyond nothing is seen, and steps that reach farther would be too long. */
  Interval visible = part;
  visible.end = least(part.end, part.begin + scene->view->end);
#if TFM_GRIDS == 0
  if (only_dims) {
    add_bodies(scene->bodies, &on_ray->bodies, part.begin, active ? part.end : part.begin, &sums.total);
    for (int c = 0; c < TFM_CHANNELS; ++c)
      sums.ray.through[c] *= transmittance_of(extinguished(scene->media, &sums.total, c));
    return sums;
  }
#if TFM_BODIES == 1 && !TFM_LATTICE
  const int at_once = 1; /* its mean distance is known */
  visible = part;
#else
  const int at_once = 0;
#endif
  see_bodies(scene, on_ray, visible, active ? ints(at_once ? 1 : steps) : ints(0), &sums WAY_ARGUMENTS);
#else
  Interval stretch[STRETCHES];
  split_at_grids(on_ray, visible, stretch);
  for (int i = 0; i < STRETCHES; ++i) {
    const Ints here = active & (stretch[i].begin < stretch[i].end);
    if (i == 1)
      see_grids(scene, on_ray, stretch[i], steps_in_grids(on_ray, stretch[i], steps), 0, here, &sums WAY_ARGUMENTS);
    else {
      const Ints wanted = only_dims ? ints(1) : steps_of_stretch(stretch[i], visible, steps);
      see_bodies(scene, on_ray, stretch[i], here ? wanted : ints(0), &sums WAY_ARGUMENTS);
    }
  }
#endif
  if (any_lane(active & (visible.end < part.end))) {
    add_bodies(scene->bodies, &on_ray->bodies, greatest(visible.end, part.begin), part.end, &sums.total);
#if TFM_DEEP == 1
    deep_step(deep, scene->media, &sums.total, &sums.total, greatest(visible.end, part.begin), part.end, active);
#endif
  }
#endif
  return sums;
}
#endif

#endif
