/* Single scattering of lights along camera rays: TFM algorithm 1 with section 4.2, eq. 4. With TFM_METHOD_DUAL the
   reduced intensity is marched instead of looked up: the reference; every other line is shared.
   Includes expected before: a light header, and those of the phase functions.
   Requires: what reduced_intensity.h and camera_sums.h do; TFM_PHASE(medium, mu), the medium's phase function; TFM_SHARED
   1 where lights reach all of every ray and are sampled in the world: they share the samples of the camera's rays. */
#ifndef TFM_SCATTER_H
#define TFM_SCATTER_H

#include "core/sampling.h"
#include "light/batch.h"
#include "view/camera_sums.h"

/* What is summed over the lights. */
typedef struct {
  Floats colour[3];          /* radiance towards the camera */
  Floats seen[TFM_CHANNELS]; /* the part of the light that arrives, times opacity */
  Floats seen_opacity;
  Ints samples;
} LightSums;

TFM_INLINE LightSums light_sums_begin(void)
{
  LightSums sums;
  for (int c = 0; c < 3; ++c)
    sums.colour[c] = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums.seen[c] = floats(0.0f);
  sums.seen_opacity = floats(0.0f);
  sums.samples = ints(0);
  return sums;
}

/* How a light arrives at a sample. */
typedef struct {
#if TFM_MEDIA == 1
  Floats source; /* phase function times strength */
#else
  Floats mu; /* cosine between its travel and the direction to the camera */
  Floats strength;
#endif
  Floats visible; /* the part of it that no solid stops */
#if TFM_TEXTURE
  Floats tint[3];
#endif
  LightPath path;
} LightArrival;

TFM_INLINE LightArrival light_arrival(const Scene *scene, const Lights *lights, LIGHT light, Ray ray, Ray light_space_ray,
                                      Floats t, int inside)
{
  const LightBuffers *buffers = lights->buffers;
  const LightSample sample = light_at(light, ray_at(light_space_ray, t));
  LightArrival arrival;
  const Floats mu = -dot3(sample.direction, light_space_ray.direction);
#if TFM_MEDIA == 1
  arrival.source = TFM_PHASE(scene->media, mu) * sample.strength;
#else
  arrival.mu = mu;
  arrival.strength = sample.strength;
#endif
  arrival.visible = light_visibility(light, buffers->shadow, sample);
#if TFM_TEXTURE
  light_tint(light, buffers, sample, arrival.tint);
#endif
  arrival.path = light_path(scene, light, buffers, ray_at(ray, t), sample, inside, lights->many);
  return arrival;
}

/* What a step scatters of the light that arrives, over its opacity, without the albedo where that is the same
   everywhere. */
TFM_INLINE Floats source_of(MEDIUM media, const Amounts *step, const LightArrival *arrival, int colour)
{
#if TFM_MEDIA == 1
  (void)media;
  (void)step;
  (void)colour;
  return arrival->source;
#else
  Floats scattered = floats(0.0f);
  for (int m = 0; m < TFM_MEDIA; ++m)
    scattered += media[m].sigma_s[colour] * step->of[m][AMOUNT_OF(colour)] * TFM_PHASE(&media[m], arrival->mu);
  const Floats extinct = extinguished(media, step, colour);
  return extinct > 0.0f ? arrival->strength * scattered / extinct : floats(0.0f);
#endif
}

/* Adds a light's sums, which lack its colour. */
TFM_INLINE void add_light(MEDIUM media, LIGHT light, const Floats *sum, LightSums *sums)
{
  for (int c = 0; c < 3; ++c)
#if TFM_MEDIA == 1
    sums->colour[c] += media->albedo[c] * light->intensity[c] * sum[TFM_CHANNELS == 3 ? c : 0];
#else
    sums->colour[c] += light->intensity[c] * sum[c];
#endif
}

#if TFM_SHARED
#define LIGHTS_OF_MARCH(lights) (lights)->count
#else
#define LIGHTS_OF_MARCH(lights) 1

/* Where samples of a stretch lie: uniform in the projective space of the light that they are for, or in the world. */
TFM_INLINE Warp warp_of(VIEW view, LIGHT light, Ray ray, Floats begin, Floats length)
{
  if (!view->projective)
    return no_warp();
  return projective_warp(light_projective_depth(light, ray_at(ray, begin)),
                         light_projective_depth(light, ray_at(ray, begin + length)), view->max_stretch);
}
#endif

#if TFM_GRIDS
/* A step takes its opacity from the ray; depth: as of scatter_in_grids. Returns the mean over the colours. */
TFM_INLINE Floats take_step(MEDIUM media, CameraRay *state, const Amounts *step, Floats *depth, Floats *opacity)
{
#if TFM_BODIES
  for (int c = 0; c < TFM_CHANNELS; ++c)
    depth[c] = least(depth[c] + extinguished(media, step, c), floats(TFM_MAX_OPTICAL_DEPTH));
#else
  (void)depth;
#endif
  return camera_ray_step(media, state, step, opacity);
}

/* The stretch of a ray that holds grids: their density is read step by step. depth: optical depth so far, of each
   colour, which bodies of constant density need. camera: also takes the samples, where it is not 0. */
TFM_INLINE void scatter_in_grids(const Scene *scene, const Lights *lights, Ray ray, const MediaOnRay *on_ray, Interval part,
                                 Ints active, CameraRay *state, Floats *depth, LightSums *sums, CameraSums *camera)
{
  if (!any_lane(active))
    return;
  VIEW view = scene->view;
  MEDIUM media = scene->media;
  const Floats begin = active ? part.begin : floats(0.0f);
  const Floats length = active ? part.end - part.begin : floats(0.0f);
#if !TFM_SHARED
  LIGHT light = lights->of + lights->numbers[0];
  const Ray light_space_ray = ray_in_light(light, ray);
  const Warp warp = warp_of(view, light, ray, begin, length);
#else
  const Warp warp = no_warp();
#endif
  const Walk walk = walk_of_camera(scene, on_ray, begin, length, warp, !TFM_SHARED, ints(view->steps), active);
  Ints alive = active & is_visible(view, state);
  Ints read = ints(0);
  Steps list = no_steps();
#if TFM_BODIES
  Floats step_begin = begin;
#endif
#if !TFM_SHARED
  /* In the order of the steps, so that those that are left out leave no trace in its rounding. */
  Floats sum[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sum[c] = floats(0.0f);
#endif
  while (any_lane(alive) && find_steps(scene->padded, &walk, alive, 0, &list)) {
    Amounts step[MOST_STEPS];
    int count = 0;
    for (int k = 0; k < list.count; ++k) {
      const Place place = place_of(&walk, list.n[k]);
      Amounts met = along_step(densities_at(scene->padded, &walk, &list, k, place.t, &read), place.length, active);
#if TFM_BODIES
      /* No step is left out here. */
      add_bodies(scene->bodies, &on_ray->bodies, step_begin, active ? step_begin + place.length : step_begin, &met);
      step_begin += place.length;
#endif
      step[count] = met;
      list.n[count] = list.n[k];
      count += any_lane(any_amount(&met));
    }
#if TFM_SHARED
    /* All lights take what the steps take from the ray; one alone takes it when it is summed. */
    Floats opacities[MOST_STEPS][TFM_CHANNELS], weights[MOST_STEPS];
    for (int k = 0; k < count; ++k) {
      weights[k] = take_step(media, state, &step[k], depth, opacities[k]);
      if (camera)
        camera_sums_step(media, camera, &step[k], place_of(&walk, list.n[k]).t, opacities[k], weights[k]);
    }
#else
    (void)camera;
#endif
    for (int i = 0; i < LIGHTS_OF_MARCH(lights); ++i) {
#if TFM_SHARED
      LIGHT light = lights->of + lights->numbers[i];
      const Ray light_space_ray = ray_in_light(light, ray);
#endif
      LightArrival arrival[MOST_STEPS];
      Floats arrives[MOST_STEPS][TFM_CHANNELS];
      for (int k = 0; k < count; ++k)
        arrival[k] = light_arrival(scene, lights, light, ray, light_space_ray, place_of(&walk, list.n[k]).t, 0);
      for (int k = 0; k < count; ++k) {
        if (any_lane(arrival[k].visible > 0.0f))
          light_optical_depths(scene, light, lights->buffers, &arrival[k].path, any_amount(&step[k]), &sums->samples,
                               arrives[k]);
        else
          for (int c = 0; c < TFM_CHANNELS; ++c)
            arrives[k][c] = floats(0.0f);
      }
      for (int k = 0; k < count; ++k) {
#if TFM_SHARED
        const Floats *opacity = opacities[k];
        const Floats weight = weights[k];
        Floats sum[TFM_CHANNELS];
        for (int c = 0; c < TFM_CHANNELS; ++c)
          sum[c] = floats(0.0f);
#else
        Floats opacity[TFM_CHANNELS];
        const Floats weight = take_step(media, state, &step[k], depth, opacity);
#endif
        for (int c = 0; c < TFM_CHANNELS; ++c) {
          const Floats left = reduced(arrives[k][c]) * arrival[k].visible;
          Floats source = source_of(media, &step[k], &arrival[k], c);
#if TFM_TEXTURE
          source *= arrival[k].tint[c];
#endif
          sum[c] += opacity[c] * left * source;
          sums->seen[c] += weight * left;
        }
        sums->seen_opacity += weight;
#if TFM_SHARED
        add_light(media, light, sum, sums);
#endif
      }
    }
    alive = active & is_visible(view, state);
  }
#if !TFM_SHARED
  add_light(media, light, sum, sums);
#endif
  sums->samples += active ? read : ints(0);
}
#endif

#if TFM_BODIES
#if TFM_CHANNELS == 1
/* Optical depth of a step up to which twice_sinh serves. */
#define THIN_STEP 1.0f

/* 2 sinh(x) for x in [0, 1/2]: its series, to 2e-9 of it. */
TFM_INLINE Floats twice_sinh(Floats x)
{
  const Floats x2 = x * x;
  return 2.0f * x * (1.0f + x2 * (1.0f / 6 + x2 * (1.0f / 120 + x2 * (1.0f / 5040))));
}
#endif

/* The only body there is: a sample is in it. */
#define ALONE (TFM_GRIDS == 0 && TFM_BODIES == 1)

/* A stretch of a ray without grids: the media are known in closed form. What a step of a camera ray is worth is the
   difference of the transmittance at its ends. */
TFM_INLINE void scatter_in_bodies(const Scene *scene, const Lights *lights, Ray ray, const MediaOnRay *on_ray, Interval part,
                                  Ints steps, Ints active, CameraRay *state, Floats *depth, LightSums *sums)
{
  if (!any_lane(active))
    return;
  VIEW view = scene->view;
  MEDIUM media = scene->media;
  const Floats begin = active ? part.begin : floats(0.0f);
  const Floats length = active ? part.end - part.begin : floats(0.0f);
  steps = active ? steps : ints(0);
  const int most = -least_int(-steps);
#if !TFM_SHARED
  LIGHT light = lights->of + lights->numbers[0];
  const Ray light_space_ray = ray_in_light(light, ray);
  const Warp warp = warp_of(view, light, ray, begin, length);
#else
  (void)view;
  const Warp warp = no_warp();
#endif
#if TFM_CHANNELS == 1
  /* A step is at most so many mean ones long. */
  const Floats stretch = greatest(warp.begin / warp.end, warp.end / warp.begin);
  float densest = 0.0f;
  for (int i = 0; i < TFM_BODIES; ++i)
    densest += body_extinction(media, scene->bodies, i, 0);
  const int thin =
      greatest_float(active ? stretch * length * densest - THIN_STEP * TO_FLOATS(steps) : floats(-1.0f)) <= 0.0f;
#endif
  Floats step_begin = begin, before[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    before[c] = depth[c];
#if !TFM_SHARED
  Floats sum[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sum[c] = floats(0.0f);
#endif
  for (int n = 0; n < most; ++n) {
#if TFM_GRIDS == 0
    const Ints here = active; /* all have as many, and the others no length */
    const WarpedStep placed = warped_step(warp, n, most);
    const Floats step_length = length * placed.length;
#else
    const Ints here = n < steps;
    const WarpedStep placed = warped_step_of_lanes(warp, n, TO_FLOATS(steps > 0 ? steps : ints(1)));
    const Floats step_length = here ? length * placed.length : floats(0.0f);
#endif
    const Floats t = begin + length * placed.middle;
    Amounts step = no_amounts();
#if ALONE
    const Floats amount = least(scene->bodies->density * step_length, floats(TFM_MAX_OPTICAL_DEPTH));
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      step.of[0][c] = amount;
#else
    add_bodies(scene->bodies, &on_ray->bodies, step_begin, step_begin + step_length, &step);
    step_begin += step_length;
#endif
    Floats taken[TFM_CHANNELS], opacity[TFM_CHANNELS];
    for (int c = 0; c < TFM_CHANNELS; ++c)
#if ALONE
      taken[c] = least(body_extinction(media, scene->bodies, 0, c) * step_length, floats(TFM_MAX_OPTICAL_DEPTH));
#else
      taken[c] = least(extinguished(media, &step, c), floats(TFM_MAX_OPTICAL_DEPTH));
#endif
#if TFM_CHANNELS == 1
    opacity[0] = floats(0.0f);
    if (!thin)
      camera_ray_step(media, state, &step, opacity);
    /* One exponential for the way there and back: e^(-x) 2 sinh(depth / 2) with x at the step's middle. */
    const Floats middle = depth[0] + 0.5f * taken[0], thin_opacity = twice_sinh(0.5f * taken[0]);
#else
    const Floats weight = camera_ray_step(media, state, &step, opacity);
#endif
    for (int i = 0; i < LIGHTS_OF_MARCH(lights); ++i) {
#if TFM_SHARED
      LIGHT light = lights->of + lights->numbers[i];
      const Ray light_space_ray = ray_in_light(light, ray);
#endif
      const LightArrival arrival = light_arrival(scene, lights, light, ray, light_space_ray, t, ALONE ? ~0 : 0);
      Floats way[TFM_CHANNELS];
#if TFM_SHARED
      Floats sum[TFM_CHANNELS];
      for (int c = 0; c < TFM_CHANNELS; ++c)
        sum[c] = floats(0.0f);
#endif
      light_optical_depths(scene, light, lights->buffers, &arrival.path, here, &sums->samples, way);
      for (int c = 0; c < TFM_CHANNELS; ++c) {
        Floats source = source_of(media, &step, &arrival, c);
#if TFM_TEXTURE
        source *= arrival.tint[c];
#endif
#if TFM_CHANNELS == 1
#if TFM_SHOW_RESIDUAL
        const Floats seen = thin ? transmittance_of(middle) * thin_opacity : opacity[c];
        const Floats arrives = arrival.visible * seen * way[c];
#else
        const Floats arrives = arrival.visible * (thin ? transmittance_of(middle + way[c]) * thin_opacity
                                                       : transmittance_of(way[c]) * opacity[c]);
#endif
        sum[c] += arrives * source;
        sums->seen[c] += arrives;
#else
        const Floats left = reduced(way[c]) * arrival.visible;
        sum[c] += opacity[c] * left * source;
        sums->seen[c] += weight * left;
#endif
      }
#if TFM_SHARED
      add_light(media, light, sum, sums);
#endif
    }
    for (int c = 0; c < TFM_CHANNELS; ++c)
      depth[c] = least(depth[c] + taken[c], floats(TFM_MAX_OPTICAL_DEPTH));
  }
  sums->samples += steps * LIGHTS_OF_MARCH(lights);
#if !TFM_SHARED
  add_light(media, light, sum, sums);
#endif
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    const Floats met = depth[c] - before[c];
    sums->seen_opacity += ((float)lights->count / TFM_CHANNELS) *
                          (active ? transmittance_of(before[c]) * opacity_of(met) : floats(0.0f));
#if TFM_CHANNELS == 1
    if (thin)
      state->through[c] *= transmittance_of(met);
#endif
  }
#if ALONE
  (void)on_ray;
  (void)step_begin;
#endif
}
#endif

/* Adds what some lights, of which there is one where they do not share samples, scatter along a part of the rays of a
   tile.
   before  what lies between the camera and that part: it dims all that follows; not so in the paper's algorithm 1
   camera  also takes the samples, where it is not 0 */
TFM_INLINE void scatter_lights(const Scene *scene, const Lights *lights, Ray ray, const MediaOnRay *on_ray, Interval lit,
                               Ints active, const CameraSums *before, LightSums *sums, CameraSums *camera)
{
  CameraRay state = before->ray;
  Floats depth[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    depth[c] = least(extinguished(scene->media, &before->total, c), floats(TFM_MAX_OPTICAL_DEPTH));
  sums->samples += before->samples;
#if TFM_BODIES == 0
  scatter_in_grids(scene, lights, ray, on_ray, lit, active, &state, depth, sums, camera);
#else
  VIEW view = scene->view;
  (void)camera;
  /* Where nothing is left of the ray no sample is worth taking. */
  lit.end = least(lit.end, (view->paper_attenuation ? lit.begin : on_ray->all.begin) + view->end);
  active &= lit.begin < lit.end;
#if TFM_GRIDS == 0
  scatter_in_bodies(scene, lights, ray, on_ray, lit, ints(view->steps), active, &state, depth, sums);
#else
  Interval stretch[STRETCHES];
  split_at_grids(on_ray, lit, stretch);
  for (int i = 0; i < STRETCHES; ++i) {
    const Ints here = active & is_visible(view, &state) & (stretch[i].begin < stretch[i].end);
    if (i == 1)
      scatter_in_grids(scene, lights, ray, on_ray, stretch[i], here, &state, depth, sums, 0);
    else
      scatter_in_bodies(scene, lights, ray, on_ray, stretch[i], steps_of_stretch(stretch[i], lit, view->steps), here,
                        &state, depth, sums);
  }
#endif
#endif
}

#endif
