/* Single scattering of lights along camera rays: TFM algorithm 1 with section 4.2, eq. 4. With TFM_METHOD_DUAL the
   reduced intensity is marched instead of looked up: the reference; every other line is shared.
   Includes expected before: a light header, and those of the phase functions.
   Requires: what reduced_intensity.h and camera_sums.h do; TFM_PHASE(medium, mu, fibres), the medium's phase function;
   TFM_SHARED 1 where lights reach all of every ray and are sampled in the world: they share the samples of the camera's rays;
   TFM_AROUND 1 where those serve light from all around, too, which points know: with what surroundings.h does. */
#ifndef TFM_SCATTER_H
#define TFM_SCATTER_H

#include "core/sampling.h"
#include "core/quadrature.h"
#include "light/batch.h"
#include "light/stretch.h"
#include "phase/phase.h"
#include "view/camera_sums.h"
#ifndef TFM_AROUND
#define TFM_AROUND 0
#endif
#if TFM_AROUND
#include "view/surroundings.h"
#define AROUND_PARAMETER , LATTICE around, int lights_around, int layer_around
#define AROUND , around, lights_around, layer_around
#else
#define AROUND_PARAMETER
#define AROUND
#endif

/* How a light arrives at a sample. */
typedef struct {
#if TFM_MEDIA == 1
  Floats phase;
#endif
#if TFM_MEDIA > 1 || HAS_OCTAVES
  Floats mu; /* cosine between its travel and the direction to the camera */
  MEDIUM media; /* with the phase functions for this light */
#endif
#if TFM_MEDIA > 1
#if TFM_TANGENTS
  FibreAngles fibres;
#endif
#endif
  Floats strength;
  Floats visible; /* the part of it that no solid stops */
#if TFM_TEXTURE
  Floats tint[3];
#endif
  LightPath path;
} LightArrival;

#if TFM_TANGENTS
/* How strands whose tangents have these sums lie between a light's travel, in its space, and a camera ray. */
TFM_INLINE FibreAngles angles_at(LIGHT light, Vec3 travel, Ray ray, const Floats *tangents)
{
  if (!tangents)
    return no_strands();
  return fibre_angles(tangents, transform_vector(light->world_from_light, travel),
                      scale3(floats(-1.0f), ray.direction));
}
#endif

/* tangents: sums of those of the strands there, 0 where there are none. inside: bits of the bodies that the sample is known
   to lie in. is_lit: no solid is in the way. */
TFM_INLINE LightArrival light_arrival(const Scene *scene, const Lights *lights, LIGHT light, Ray ray, Ray light_space_ray,
                                      Floats t, Floats thin, const Floats *tangents, int inside, int is_lit)
{
  const LightBuffers *buffers = lights->buffers;
  const LightSample sample = light_at(light, ray_at(light_space_ray, t));
  LightArrival arrival;
  const Floats mu = -dot3(sample.direction, light_space_ray.direction);
#if TFM_TANGENTS
  const FibreAngles fibres = angles_at(light, sample.direction, ray, tangents);
#else
  (void)tangents;
#endif
#if TFM_MEDIA == 1
  arrival.phase = PHASE_OF(scene->media + TFM_MEDIA * light->spread, mu, &fibres);
#elif TFM_TANGENTS
  arrival.fibres = fibres;
#endif
#if TFM_MEDIA > 1 || HAS_OCTAVES
  arrival.mu = mu;
  arrival.media = scene->media + TFM_MEDIA * light->spread;
#endif
  arrival.strength = sample.strength;
  arrival.visible = is_lit ? floats(1.0f) : light_visibility(light, buffers->shadow, sample);
#if TFM_TEXTURE
  light_tint(light, buffers, sample, arrival.tint);
#endif
#if TFM_THIN
  /* What is thin does not shade itself. */
  LightSample before = sample;
  const Floats back = least(thin * light->bias, greatest(sample.distance, floats(0.0f)));
  const Vec3 travel = transform_vector(light->world_from_light, sample.direction), at = ray_at(ray, t);
  before.distance -= back;
  arrival.path = light_path(scene, light, buffers, vec3(at.x - back * travel.x, at.y - back * travel.y, at.z - back * travel.z),
                            before, inside, lights->many);
#else
  (void)thin;
  arrival.path = light_path(scene, light, buffers, ray_at(ray, t), sample, inside, lights->many);
#endif
  return arrival;
}

/* What a step scatters of the light that arrives, over its opacity, without the albedo where that is the same
   everywhere, and without what is left of it. */
TFM_INLINE Floats source_of(MEDIUM media, const Amounts *step, const LightArrival *arrival, int colour)
{
#if TFM_MEDIA == 1
  (void)media;
  (void)step;
  (void)colour;
  Floats source = arrival->phase * arrival->strength;
#else
  Floats scattered = floats(0.0f);
  for (int m = 0; m < TFM_MEDIA; ++m)
    scattered += media[m].sigma_s[colour] * step->of[m][AMOUNT_OF(colour)] *
                 PHASE_OF(&arrival->media[m], arrival->mu, &arrival->fibres);
  const Floats extinct = extinguished(media, step, colour);
  Floats source = extinct > 0.0f ? arrival->strength * scattered / extinct : floats(0.0f);
#endif
#if TFM_TEXTURE
  source *= arrival->tint[colour];
#endif
  return source;
}

/* What a light's sums lack. */
TFM_INLINE float colour_of_light(MEDIUM media, LIGHT light, int colour)
{
#if TFM_MEDIA == 1
  return media->albedo[colour] * light->intensity[colour];
#else
  (void)media;
  return light->intensity[colour];
#endif
}

#if HAS_OCTAVES
/* The same of all octaves but the first, of what is left of them. way: optical depth of the light's. */
TFM_INLINE Floats later_source_of(MEDIUM media, const Amounts *step, const LightArrival *arrival, int colour, Floats way)
{
#if TFM_MEDIA == 1
  (void)media;
  (void)step;
  (void)colour;
  Floats source = arrival->strength * later_octaves(arrival->media, arrival->mu, way);
#else
  Floats scattered = floats(0.0f);
  for (int m = 0; m < TFM_MEDIA; ++m)
    scattered += media[m].sigma_s[colour] * step->of[m][AMOUNT_OF(colour)] *
                 later_octaves(&arrival->media[m], arrival->mu, way);
  const Floats extinct = extinguished(media, step, colour);
  Floats source = extinct > 0.0f ? arrival->strength * scattered / extinct : floats(0.0f);
#endif
#if TFM_TEXTURE
  source *= arrival->tint[colour];
#endif
  return source;
}
#endif

/* What one light adds to rays, without its colour. */
typedef struct {
  Floats of[TFM_CHANNELS];
#if HAS_OCTAVES
  Floats later[TFM_CHANNELS]; /* as of LightSums */
#endif
} LightSum;

TFM_INLINE LightSum light_sum_begin(void)
{
  LightSum sum;
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    sum.of[c] = floats(0.0f);
#if HAS_OCTAVES
    sum.later[c] = floats(0.0f);
#endif
  }
  return sum;
}

/* Adds a light's sums, which lack its colour. */
TFM_INLINE void add_light(MEDIUM media, LIGHT light, const LightSum *sum, LightSums *sums)
{
#if TFM_LIGHT_LAYERS
  Floats adds[3];
#endif
  for (int c = 0; c < 3; ++c) {
    const float colour = colour_of_light(media, light, c);
    sums->colour[c] += colour * sum->of[TFM_CHANNELS == 3 ? c : 0];
#if HAS_OCTAVES
    sums->later[c] += colour * sum->later[TFM_CHANNELS == 3 ? c : 0];
#endif
#if TFM_LIGHT_LAYERS
    adds[c] = colour * sum->of[TFM_CHANNELS == 3 ? c : 0];
#if HAS_OCTAVES
    adds[c] += colour * sums->on_ray[c] * sum->later[TFM_CHANNELS == 3 ? c : 0];
#endif
#endif
  }
#if TFM_LIGHT_LAYERS
  add_to_layer(&sums->layers, light->layer, adds);
#endif
}

#if TFM_AROUND
/* Adds what the samples saw of light from all around. */
TFM_INLINE void add_around(const LightSums *of_points, int layer, LightSums *sums)
{
#if TFM_LIGHT_LAYERS
  Floats adds[3];
#else
  (void)layer;
#endif
  for (int c = 0; c < 3; ++c) {
    sums->colour[c] += of_points->colour[c];
#if HAS_OCTAVES
    sums->later[c] += of_points->later[c];
#endif
#if TFM_LIGHT_LAYERS
    adds[c] = of_points->colour[c];
#if HAS_OCTAVES
    adds[c] += sums->on_ray[c] * of_points->later[c];
#endif
#endif
  }
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums->seen[c] += of_points->seen[c];
  sums->seen_opacity += of_points->seen_opacity;
#if TFM_LIGHT_LAYERS
  add_to_layer(&sums->layers, layer, adds);
#endif
}
#endif

#if TFM_DEEP_COLOURS
/* Of a step. */
TFM_INLINE void add_deep(MEDIUM media, LIGHT light, const Floats *sum, Floats t, LightSums *sums)
{
  Floats adds[3];
  for (int c = 0; c < 3; ++c)
    adds[c] = colour_of_light(media, light, c) * sum[TFM_CHANNELS == 3 ? c : 0];
  deep_add(&sums->deep, t, adds);
}
#endif

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
   colour, which bodies of constant density need. camera: also takes the samples, where it is not 0. around: what points know
   of light from all around, the sum of so many lights, which is kept by itself in a layer (with TFM_LIGHT_LAYERS only). */
TFM_INLINE void scatter_in_grids(const Scene *scene, const Lights *lights, Ray ray, const MediaOnRay *on_ray, Interval part,
                                 Ints active, CameraRay *state, Floats *depth, LightSums *sums,
                                 CameraSums *camera AROUND_PARAMETER)
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
#if TFM_AROUND
  LatticeValue radiances = lattice_begin();
  int of_steps = -1;
  LightSums of_points = light_sums_begin();
#endif
#if !TFM_SHARED
  /* In the order of the steps, so that those that are left out leave no trace in its rounding. */
  LightSum sum = light_sum_begin();
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
        camera_sums_step(media, camera, state, &step[k], place_of(&walk, list.n[k]).t, opacities[k], weights[k]);
    }
#if TFM_AROUND
    for (int k = 0; k < count; ++k) {
      of_both_steps(around, &walk, list.n[k], &radiances, &of_steps);
#if TFM_DEEP_COLOURS
      Floats adds[3];
      for (int c = 0; c < 3; ++c)
        adds[c] = -of_points.colour[c];
#endif
      surroundings_step(&of_points, &radiances, lights_around, media, &step[k], opacities[k], weights[k]);
#if TFM_DEEP_COLOURS
      for (int c = 0; c < 3; ++c)
        adds[c] += of_points.colour[c];
      deep_add(&sums->deep, place_of(&walk, list.n[k]).t, adds);
#endif
    }
#endif
#endif
    for (int i = 0; i < LIGHTS_OF_MARCH(lights); ++i) {
#if TFM_SHARED
      LIGHT light = lights->of + lights->numbers[i];
      const Ray light_space_ray = ray_in_light(light, ray);
#endif
      LightArrival arrival[MOST_STEPS];
      Floats arrives[MOST_STEPS][TFM_CHANNELS];
      for (int k = 0; k < count; ++k) {
#if TFM_THIN
        Floats thin;
        const Floats t = lit_place(&walk, &list, list.n[k], &step[k], &thin);
#else
        const Floats thin = floats(0.0f), t = place_of(&walk, list.n[k]).t;
#endif
        arrival[k] = light_arrival(scene, lights, light, ray, light_space_ray, t, thin, TANGENTS_OF(&list, list.n[k]), 0, 0);
      }
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
        LightSum sum = light_sum_begin();
#else
        Floats opacity[TFM_CHANNELS];
        const Floats weight = take_step(media, state, &step[k], depth, opacity);
        if (camera)
          camera_sums_step(media, camera, state, &step[k], place_of(&walk, list.n[k]).t, opacity, weight);
#endif
#if TFM_DEEP_COLOURS
        Floats adds[TFM_CHANNELS];
#endif
        for (int c = 0; c < TFM_CHANNELS; ++c) {
          const Floats left = reduced(arrives[k][c]) * arrival[k].visible;
          const Floats adds_here = opacity[c] * left * source_of(media, &step[k], &arrival[k], c);
          sum.of[c] += adds_here;
#if HAS_OCTAVES
          sum.later[c] += opacity[c] * arrival[k].visible * later_source_of(media, &step[k], &arrival[k], c, arrives[k][c]);
#endif
          sums->seen[c] += weight * left;
#if TFM_DEEP_COLOURS
          adds[c] = adds_here;
#endif
        }
        sums->seen_opacity += weight;
#if TFM_DEEP_COLOURS
        add_deep(media, light, adds, place_of(&walk, list.n[k]).t, sums);
#endif
#if TFM_SHARED
        add_light(media, light, &sum, sums);
#endif
      }
    }
    alive = active & is_visible(view, state);
  }
#if !TFM_SHARED
  add_light(media, light, &sum, sums);
#endif
#if TFM_AROUND
  add_around(&of_points, layer_around, sums);
#endif
  sums->samples += active ? read : ints(0);
  if (camera)
    camera->ray = *state;
}
#endif

#if TFM_BODIES
/* The only body there is: a sample is in it. */
#define ALONE (TFM_GRIDS == 0 && TFM_BODIES == 1)
/* Where light may arrive smoothly. */
#define SUMS_FEW (ALONE && !TFM_TEXTURE)
/* Values that are worked out side by side, so that none waits for another. */
#if TFM_LANES == 1
#define MOST_VALUES 1
#else
#define MOST_VALUES 8
#endif
/* Optical depth of a step up to which twice_sinh serves. */
#define THIN_STEP 1.0f

/* 2 sinh(x) for x in [0, 1/2]: its series, to 2e-9 of it. */
TFM_INLINE Floats twice_sinh(Floats x)
{
  const Floats x2 = x * x;
  return 2.0f * x * (1.0f + x2 * (1.0f / 6 + x2 * (1.0f / 120 + x2 * (1.0f / 5040))));
}

/* A stretch of the rays of a tile without grids, in steps. */
typedef struct {
  Floats begin, length;
  Ints steps, active;
  int most; /* steps of any ray */
  int thin; /* mask: every step is thin */
  float densest; /* largest extinction of any colour, per world unit */
  Warp warp;
} BodySteps;

/* Step n; without grids all rays have as many, and n need not be whole. */
TFM_INLINE WarpedStep step_in_bodies(const BodySteps *steps, float n)
{
#if TFM_GRIDS == 0
  return warped_step(steps->warp, n, (float)steps->most);
#else
  return warped_step_of_lanes(steps->warp, (int)n, TO_FLOATS(steps->steps > 0 ? steps->steps : ints(1)));
#endif
}

/* Where step n begins, and the one before it ends. */
TFM_INLINE Floats end_of_steps(const BodySteps *steps, int n)
{
#if TFM_GRIDS == 0
  return warp_cut(steps->warp, floats((float)n), floats((float)(steps->most - n)));
#else
  const Ints all = steps->steps > 0 ? steps->steps : ints(1), before = n < all ? ints(n) : all;
  return warp_cut(steps->warp, TO_FLOATS(before), TO_FLOATS(all - before));
#endif
}

/* What the bodies hold between two places, as parts of the stretch. */
TFM_INLINE Amounts amounts_in_bodies(const Scene *scene, const MediaOnRay *on_ray, const BodySteps *steps, Floats begin,
                                     Floats length)
{
  Amounts amounts = no_amounts();
#if ALONE
  (void)on_ray;
  (void)begin;
  for (int c = 0; c < TFM_AMOUNTS; ++c)
    amounts.of[0][c] = least(scene->bodies->density * (steps->length * length), floats(TFM_MAX_OPTICAL_DEPTH));
#else
  const Floats first = steps->begin + steps->length * begin;
  add_bodies(scene->bodies, &on_ray->bodies, first, first + steps->length * length, &amounts);
#endif
  return amounts;
}

#if SUMS_FEW
/* Whether what a light adds in some steps from n on is smooth: the sum of a few values.
   begin, end: where on the rays; clearance: what the rule for them needs. */
TFM_INLINE int is_smooth_in_bodies(const Scene *scene, LIGHT light, Ray ray, const BodySteps *steps, int n, int count,
                                   Floats begin, Floats end, LightSpan span, float clearance)
{
  const float first = (float)n, last = (float)(n + count), all = (float)steps->most, ratio = clear_ratio(clearance);
  const Floats at_first = first * steps->warp.begin + (all - first) * steps->warp.end;
  const Floats at_last = last * steps->warp.begin + (all - last) * steps->warp.end;
  const Floats length = end - begin;
  const Floats apart = 0.5f * clearance * length;
  Ints smooth = (span.clear >= apart * apart) & (steps->densest * length <= 1.0f) &
                (at_first <= ratio * at_last) & (at_last <= ratio * at_first);
  if (!(light->inside_bodies & 1))
    smooth &= TFM_BODY_IS_SMOOTH(scene->bodies, light_ray_to(light, ray_at(ray, begin)),
                                 light_ray_to(light, ray_at(ray, end)), ratio);
  return !any_lane(steps->active & !smooth);
}
#endif

/* What a light adds to the rays of a tile in a step. */
typedef struct {
  Floats before[TFM_CHANNELS];  /* optical depth up to where the step counts from */
  Floats opacity[TFM_CHANNELS]; /* of the step, as if nothing were before it */
  Floats way[TFM_CHANNELS];     /* optical depth of the light's way */
  Floats source[TFM_CHANNELS];
#if HAS_OCTAVES
  Floats later[TFM_CHANNELS]; /* source of all octaves but the first */
#endif
  Floats visible;
} StepLight;

/* counts: how often the step does. is_lit: no solid is in the way. */
TFM_INLINE StepLight light_of_step(const Scene *scene, const Lights *lights, LIGHT light, Ray ray, Ray light_space_ray,
                                   const MediaOnRay *on_ray, const BodySteps *steps, const Floats *depth, int n,
                                   WarpedStep placed, float counts, int is_lit, Ints *samples)
{
  MEDIUM media = scene->media;
#if TFM_GRIDS == 0
  (void)n;
  const Ints here = steps->active; /* all have as many, and the others no length */
  const Floats length = placed.length;
#else
  const Ints here = n < steps->steps;
  const Floats length = here ? placed.length : floats(0.0f);
#endif
  const Amounts step = amounts_in_bodies(scene, on_ray, steps, placed.begin, length);
  const Amounts until = amounts_in_bodies(scene, on_ray, steps, floats(0.0f), placed.begin);
  const LightArrival arrival = light_arrival(scene, lights, light, ray, light_space_ray,
                                             steps->begin + steps->length * placed.middle, floats(0.0f), 0, ALONE ? ~0 : 0, is_lit);
  StepLight found;
  light_optical_depths(scene, light, lights->buffers, &arrival.path, here, samples, found.way);
  found.visible = arrival.visible;
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    /* A thin step, seen from its middle, is e^(-x) 2 sinh(depth / 2); any other, from its begin, 1 - e^(-depth). */
    const Floats taken = least(extinguished(media, &step, c), floats(TFM_MAX_OPTICAL_DEPTH));
    found.before[c] = least(depth[c] + extinguished(media, &until, c), floats(TFM_MAX_OPTICAL_DEPTH)) +
                      (steps->thin ? 0.5f * taken : floats(0.0f));
    found.opacity[c] = counts * (steps->thin ? twice_sinh(0.5f * taken) : opacity_of(taken));
    found.source[c] = source_of(media, &step, &arrival, c);
#if HAS_OCTAVES
    found.later[c] = later_source_of(media, &step, &arrival, c, found.way[c]);
#endif
  }
  return found;
}

TFM_INLINE void add_step_light(const StepLight *step, LightSums *sums, LightSum *sum)
{
#if TFM_CHANNELS == 1 && !HAS_OCTAVES
#if TFM_SHOW_RESIDUAL
  const Floats left = transmittance_of(step->before[0]) * step->way[0];
#else
  const Floats left = transmittance_of(step->before[0] + step->way[0]); /* one exponential for the way there and back */
#endif
  const Floats arrives = step->opacity[0] * left * step->visible;
  sum->of[0] += arrives * step->source[0];
  sums->seen[0] += arrives;
#else
  Floats opacity[TFM_CHANNELS], weight = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    opacity[c] = transmittance_of(step->before[c]) * step->opacity[c];
    weight += opacity[c] * (1.0f / TFM_CHANNELS);
  }
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    const Floats left = reduced(step->way[c]) * step->visible;
    sum->of[c] += opacity[c] * left * step->source[c];
#if HAS_OCTAVES
    sum->later[c] += opacity[c] * step->visible * step->later[c];
#endif
    sums->seen[c] += weight * left;
  }
#endif
}

/* One light along a stretch without grids; its sum lacks its colour. Steps are taken together as long as they are all
   lit or all dark. */
TFM_INLINE void scatter_light_in_bodies(const Scene *scene, const Lights *lights, LIGHT light, Ray ray,
                                        const MediaOnRay *on_ray, const BodySteps *steps, const Floats *depth,
                                        LightSums *sums, LightSum *sum)
{
  const Ray light_space_ray = ray_in_light(light, ray);
  const Vec3 from = light_space_ray.origin;
  const float reach = greatest_float(steps->active ? magnitude_of(from.x) + magnitude_of(from.y) + magnitude_of(from.z) +
                                                         steps->begin + steps->length
                                                   : floats(0.0f));
  int apart = 0; /* the step up to which only few are taken together */
  StretchEnd first = stretch_end(light, light_space_ray, steps->begin);
  for (int n = 0; n < steps->most;) {
    const int is_long = n >= apart && n + LONG_POINTS <= steps->most;
    const int most = is_long ? LONG_POINTS : SHORT_POINTS, left = steps->most - n, count = left < most ? left : most;
    const StretchEnd last =
        stretch_end(light, light_space_ray, steps->begin + steps->length * end_of_steps(steps, n + count));
    const LitStretch stretch =
        lit_stretch(light, lights->buffers->shadow, light_space_ray, &first, &last, steps->active, reach);
    if (is_long && !stretch.lit && !stretch.dark) {
      apart = n + LONG_POINTS;
      continue;
    }
    int values = stretch.dark ? 0 : count;
    int rule = -1; /* where the rule that serves begins */
#if SUMS_FEW
    if (stretch.lit && count == most &&
        is_smooth_in_bodies(scene, light, ray, steps, n, count, first.t, last.t, stretch.span,
                            is_long ? LONG_CLEARANCE : SHORT_CLEARANCE)) {
      rule = is_long ? 0 : LONG_NODES;
      values = is_long ? LONG_NODES : SHORT_NODES;
    }
#endif
    for (int begin = 0; begin < values; begin += MOST_VALUES) {
      const int some = values - begin < MOST_VALUES ? values - begin : MOST_VALUES;
      WarpedStep placed[MOST_VALUES];
      StepLight step[MOST_VALUES];
      for (int k = 0; k < some; ++k)
        placed[k] = step_in_bodies(steps, (float)n + (rule < 0 ? (float)(begin + k) : gauss_nodes[rule + begin + k]));
      for (int k = 0; k < some; ++k)
        step[k] = light_of_step(scene, lights, light, ray, light_space_ray, on_ray, steps, depth, n + begin + k,
                                placed[k], rule < 0 ? 1.0f : gauss_weights[rule + begin + k], stretch.lit,
                                &sums->samples);
      for (int k = 0; k < some; ++k) {
#if TFM_DEEP_COLOURS
        Floats adds[TFM_CHANNELS];
        for (int c = 0; c < TFM_CHANNELS; ++c)
          adds[c] = -sum->of[c];
#endif
        add_step_light(&step[k], sums, sum);
#if TFM_DEEP_COLOURS
        for (int c = 0; c < TFM_CHANNELS; ++c)
          adds[c] += sum->of[c];
        add_deep(scene->media, light, adds, steps->begin + steps->length * placed[k].middle, sums);
#endif
      }
    }
    n += count;
    first = last;
  }
}

/* A stretch of a ray without grids: the media are known in closed form. What a step of a camera ray is worth is the
   difference of the transmittance at its ends. */
TFM_INLINE void scatter_in_bodies(const Scene *scene, const Lights *lights, Ray ray, const MediaOnRay *on_ray, Interval part,
                                  Ints number, Ints active, CameraRay *state, Floats *depth, LightSums *sums)
{
  if (!any_lane(active))
    return;
  MEDIUM media = scene->media;
  BodySteps steps;
  steps.begin = active ? part.begin : floats(0.0f);
  steps.length = active ? part.end - part.begin : floats(0.0f);
  steps.steps = active ? number : ints(0);
  steps.active = active;
  steps.most = -least_int(-steps.steps);
#if TFM_SHARED
  steps.warp = no_warp();
#else
  steps.warp = warp_of(scene->view, lights->of + lights->numbers[0], ray, steps.begin, steps.length);
#endif
  /* A step is at most so many mean ones long. */
  const Floats stretch = greatest(steps.warp.begin / steps.warp.end, steps.warp.end / steps.warp.begin);
  steps.densest = 0.0f;
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    float all = 0.0f;
    for (int i = 0; i < TFM_BODIES; ++i)
      all += body_extinction(media, scene->bodies, i, c);
    steps.densest = all > steps.densest ? all : steps.densest;
  }
  steps.thin = greatest_float(active ? stretch * steps.length * steps.densest - THIN_STEP * TO_FLOATS(steps.steps)
                                     : floats(-1.0f)) <= 0.0f;
  for (int i = 0; i < lights->count; ++i) {
    LIGHT light = lights->of + lights->numbers[i];
    LightSum sum = light_sum_begin();
    scatter_light_in_bodies(scene, lights, light, ray, on_ray, &steps, depth, sums, &sum);
    add_light(media, light, &sum, sums);
  }
  sums->samples += steps.steps * lights->count;
  const Amounts all = amounts_in_bodies(scene, on_ray, &steps, floats(0.0f), floats(1.0f));
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    const Floats met = extinguished(media, &all, c);
    sums->seen_opacity += ((float)lights->count / TFM_CHANNELS) *
                          (active ? transmittance_of(depth[c]) * opacity_of(met) : floats(0.0f));
    depth[c] = least(depth[c] + met, floats(TFM_MAX_OPTICAL_DEPTH));
    state->through[c] *= transmittance_of(met);
  }
}
#endif

/* Adds what some lights, of which there is one where they do not share samples, scatter along a part of the rays of a
   tile.
   before  what lies between the camera and that part: it dims all that follows; not so in the paper's algorithm 1
   camera  also takes the samples, where it is not 0 */
TFM_INLINE void scatter_lights(const Scene *scene, const Lights *lights, Ray ray, const MediaOnRay *on_ray, Interval lit,
                               Ints active, const CameraSums *before, LightSums *sums, CameraSums *camera AROUND_PARAMETER)
{
  CameraRay state = before->ray;
  Floats depth[TFM_CHANNELS];
  for (int c = 0; c < TFM_CHANNELS; ++c)
    depth[c] = least(extinguished(scene->media, &before->total, c), floats(TFM_MAX_OPTICAL_DEPTH));
  sums->samples += before->samples;
#if TFM_BODIES == 0
  scatter_in_grids(scene, lights, ray, on_ray, lit, active, &state, depth, sums, camera AROUND);
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
