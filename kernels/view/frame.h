/* The pixels' sums in memory: what the camera sees of the media whatever the lights, and what lights add.
   Requires: what phase/octaves.h does; TFM_CHANNELS; TFM_EMISSION, 1 where a medium emits light; TFM_LIGHT_LAYERS, 1 where
   what each light adds is kept by itself too; what deep_colours.h does. */
#ifndef TFM_FRAME_H
#define TFM_FRAME_H

#include "phase/octaves.h"
#include "view/camera.h"
#include "view/deep_colours.h"

#ifndef TFM_LIGHT_LAYERS
#define TFM_LIGHT_LAYERS 0
#endif

#if TFM_LIGHT_LAYERS
/* Where what each light adds to some pixels is kept: layers of the crop, one after the other. */
typedef struct {
  __global float4 *added;
  int size; /* pixels of a layer */
  Ints index, wanted;
} LightLayers;

TFM_INLINE LightLayers light_layers_of(VIEW view, __global float4 *added, Pixels pixels)
{
  LightLayers layers;
  layers.added = added;
  layers.size = (view->crop[2] - view->crop[0]) * (view->crop[3] - view->crop[1]);
  layers.index = pixel_index(view, pixels);
  layers.wanted = pixels.wanted;
  return layers;
}

TFM_INLINE void add_to_layer(const LightLayers *layers, int layer, const Floats *colour)
{
  add_float4(layers->added + (size_t)layer * (size_t)layers->size, layers->index, layers->wanted, colour[0], colour[1],
             colour[2], floats(0.0f));
}
#endif

/* What the camera sees whatever the lights. */
typedef struct {
  Floats through[3]; /* transmittance of the whole ray */
  Floats distance;   /* mean, weighed by opacity; 0 without a medium */
  Floats colour[3];  /* ambient light, and what the media emit */
  Floats alpha;      /* 1 - mean transmittance, and 1 on solids but holdouts */
#if TFM_EMISSION
  Floats emission[3]; /* the latter alone */
#endif
#if TFM_LIGHT_LAYERS
  Floats ambient[3]; /* the former alone */
#endif
} Seen;

/* What is summed over lights. */
typedef struct {
  Floats colour[3];          /* radiance towards the camera */
#if HAS_OCTAVES
  Floats later[3]; /* the same of all octaves but the first, without what there is of them on a ray */
#if TFM_LIGHT_LAYERS
  Floats on_ray[3]; /* which is known before then */
#endif
#endif
  Floats seen[TFM_CHANNELS]; /* the part of the light that arrives, times opacity */
  Floats seen_opacity;
  Ints samples;              /* densities read, and samples taken in closed form */
#if TFM_DEEP_COLOURS
  DeepColours deep; /* where that goes stretch by stretch */
#endif
#if TFM_LIGHT_LAYERS
  LightLayers layers; /* where that goes light by light */
#ifdef TFM_LATTICE_APART
  Floats apart[TFM_LATTICE_APART][3]; /* of each part of what a lattice holds, in the place of the colour */
#if HAS_OCTAVES
  Floats later_apart[TFM_LATTICE_APART][3];
#endif
#endif
#endif
} LightSums;

TFM_INLINE LightSums light_sums_begin(void)
{
  LightSums sums;
  for (int c = 0; c < 3; ++c)
    sums.colour[c] = floats(0.0f);
#if HAS_OCTAVES
  for (int c = 0; c < 3; ++c)
    sums.later[c] = floats(0.0f);
#endif
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums.seen[c] = floats(0.0f);
  sums.seen_opacity = floats(0.0f);
  sums.samples = ints(0);
#if TFM_LIGHT_LAYERS && defined(TFM_LATTICE_APART)
  for (int i = 0; i < TFM_LATTICE_APART; ++i)
    for (int c = 0; c < 3; ++c)
      sums.apart[i][c] = floats(0.0f);
#if HAS_OCTAVES
  for (int i = 0; i < TFM_LATTICE_APART; ++i)
    for (int c = 0; c < 3; ++c)
      sums.later_apart[i][c] = floats(0.0f);
#endif
#endif
  return sums;
}

/* transmittance  RGB, and the distance
   radiance       RGB, and the alpha
   light_seen     RGB, and the opacity
   emission       RGB, and 0 (with TFM_EMISSION only)
   added          RGB of ambient light, then of each light, and 0 (with TFM_LIGHT_LAYERS only) */
typedef struct {
  __global float4 *transmittance, *radiance, *light_seen;
  __global uint *samples;
#if TFM_EMISSION
  __global float4 *emission;
#endif
#if TFM_LIGHT_LAYERS
  __global float4 *added;
#endif
} Frame;

/* What kernels that store a frame take, and the frame that this is. */
#if TFM_EMISSION
#define AND_EMISSION_ARGUMENT , __global float4 *emission
#define AND_EMISSION , emission
#else
#define AND_EMISSION_ARGUMENT
#define AND_EMISSION
#endif
#if TFM_LIGHT_LAYERS
#define AND_ADDED_ARGUMENT , __global float4 *added
#define AND_ADDED , added
#else
#define AND_ADDED_ARGUMENT
#define AND_ADDED
#endif
#define FRAME_ARGUMENTS                                                                  \
  __global float4 *transmittance, __global float4 *radiance, __global float4 *light_seen, \
      __global uint *samples AND_EMISSION_ARGUMENT AND_ADDED_ARGUMENT AND_DEEP_ARGUMENTS
#define FRAME(name) const Frame name = {transmittance, radiance, light_seen, samples AND_EMISSION AND_ADDED}

#if HAS_OCTAVES
/* What is left of rays whose first launch is done, RGB. */
TFM_INLINE void load_through(const Frame *frame, VIEW view, Pixels pixels, Floats *through)
{
  Floats stored[4];
  load_float4(frame->transmittance, pixel_index(view, pixels), pixels.wanted, 1.0f, stored);
  for (int c = 0; c < 3; ++c)
    through[c] = stored[c];
}

/* Adds the octaves to the first. */
TFM_INLINE void add_octaves(VIEW view, const Floats *through, LightSums *sums)
{
  for (int c = 0; c < 3; ++c)
    sums->colour[c] += octaves_on_ray(view, through[c]) * sums->later[c];
}
#endif

/* What is stored first. */
TFM_INLINE void frame_store(const Frame *frame, VIEW view, Pixels pixels, const Seen *seen, const LightSums *sums)
{
  const Ints index = pixel_index(view, pixels), wanted = pixels.wanted;
  store_float4(frame->transmittance, index, wanted, seen->through[0], seen->through[1], seen->through[2], seen->distance);
  store_float4(frame->radiance, index, wanted, seen->colour[0] + sums->colour[0], seen->colour[1] + sums->colour[1],
               seen->colour[2] + sums->colour[2], seen->alpha);
  store_float4(frame->light_seen, index, wanted, sums->seen[0], sums->seen[TFM_CHANNELS == 3 ? 1 : 0],
               sums->seen[TFM_CHANNELS == 3 ? 2 : 0], sums->seen_opacity);
  store_counts(frame->samples, index, wanted, sums->samples);
#if TFM_EMISSION
  store_float4(frame->emission, index, wanted, seen->emission[0], seen->emission[1], seen->emission[2], floats(0.0f));
#endif
#if TFM_LIGHT_LAYERS
  store_float4(frame->added, index, wanted, seen->ambient[0], seen->ambient[1], seen->ambient[2], floats(0.0f));
#endif
}

TFM_INLINE void frame_add(const Frame *frame, VIEW view, Pixels pixels, const LightSums *sums)
{
  const Ints index = pixel_index(view, pixels), wanted = pixels.wanted;
  add_float4(frame->radiance, index, wanted, sums->colour[0], sums->colour[1], sums->colour[2], floats(0.0f));
  add_float4(frame->light_seen, index, wanted, sums->seen[0], sums->seen[TFM_CHANNELS == 3 ? 1 : 0],
             sums->seen[TFM_CHANNELS == 3 ? 2 : 0], sums->seen_opacity);
  add_counts(frame->samples, index, wanted, sums->samples);
}

#endif
