/* How a camera ray fades on its way through the medium, and when the rest of it no longer matters.
   Requires: TFM_CHANNELS, 3 for RGB or 1 where all three colours have the same extinction. */
#ifndef TFM_ABSORPTION_H
#define TFM_ABSORPTION_H

#include "walk.h"

#if TFM_CHANNELS != 1 && TFM_CHANNELS != 3
#error "TFM_CHANNELS must be 1 or 3"
#endif

/* A camera ray in the medium, from the camera on. */
typedef struct {
  Floats through[TFM_CHANNELS]; /* transmittance so far of the colours that the medium extinguishes */
  Floats optical_depth;         /* of the density */
  Floats distance_sum;          /* of the distances, weighed by opacity */
  Floats opacity_sum;           /* mean over the colours */
  Ints samples;                 /* densities read */
} CameraRay;

/* A colour that nothing extinguishes is scattered by nothing either: it starts at 0, so that it keeps no ray
   alive. */
TFM_INLINE CameraRay camera_ray_begin(PARAMS params, Ints active)
{
  CameraRay state;
  for (int c = 0; c < TFM_CHANNELS; ++c)
    state.through[c] = params->sigma_t[c] > 0.0f ? (active ? floats(1.0f) : floats(0.0f)) : floats(0.0f);
  state.optical_depth = floats(0.0f);
  state.distance_sum = floats(0.0f);
  state.opacity_sum = floats(0.0f);
  state.samples = ints(0);
  return state;
}

/* The rays of which more than the cutoff is left in some colour. */
TFM_INLINE Ints is_visible(PARAMS params, const CameraRay *state)
{
  Floats most = state->through[0];
  for (int c = 1; c < TFM_CHANNELS; ++c)
    most = greatest(most, state->through[c]);
  return most > params->cutoff;
}

/* A step at distance t takes its opacity from the ray. Constant density along the step integrates exactly:
   T (1 - e^(-sigma_t D d)). Returns the mean over the colours. */
TFM_INLINE Floats camera_ray_step(PARAMS params, CameraRay *state, Floats step_depth, Floats t,
                                  Floats *opacity)
{
  Floats mean = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    const Exp2 e = exp_of_minus(params->sigma_t[c] * step_depth);
    opacity[c] = state->through[c] * ((1.0f - e.scale) - e.scale * e.part);
    state->through[c] *= e.scale + e.scale * e.part;
    mean += opacity[c] * (1.0f / TFM_CHANNELS);
  }
  state->optical_depth = least(state->optical_depth + step_depth, floats(TFM_MAX_OPTICAL_DEPTH));
  state->distance_sum += mean * t;
  state->opacity_sum += mean;
  return mean;
}

/* March a part of the camera ray on which no light is gathered: `steps` midpoints from begin to end.
   Not inlined: the view pass calls it twice a tile, and would take twice as long to compile. */
static __attribute__((noinline)) void march_unlit(PARAMS params, const Grid *grid, const GridRay *ray,
                                                  Interval part, Ints steps, Ints active, CameraRay *state)
{
  active &= steps > 0;
  if (!any_lane(active))
    return;
  const Walk walk = walk_from(grid, ray, part.begin, part.end - part.begin, no_warp(), 0, steps, active);
  Ints alive = active & is_visible(params, state);
  Ints read = ints(0);
  Steps list = no_steps();
  while (any_lane(alive) && find_steps(grid, &walk, alive, 0, &list)) {
    Floats density[MOST_STEPS];
    for (int k = 0; k < list.count; ++k)
      density[k] = density_at(grid, &walk, &list, k, place_of(&walk, list.n[k]).t, &read);
    for (int k = 0; k < list.count; ++k) {
      Floats opacity[TFM_CHANNELS];
      const Place place = place_of(&walk, list.n[k]);
      const Floats depth = least(density[k] * place.length, floats(TFM_MAX_OPTICAL_DEPTH));
      camera_ray_step(params, state, list.n[k] < walk.steps ? depth : floats(0.0f), place.t, opacity);
    }
    alive = active & is_visible(params, state);
  }
  state->samples += active ? read : ints(0);
}

#endif
