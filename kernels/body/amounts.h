/* How much of each medium there is: its density, or the optical depth of that along a stretch (as of sigma_t = 1).
   Media are told apart, since each has a colour and a phase function of its own; so are red, green and blue where voxels
   have a colour. Light passes march one field of density at a time, and know of no media: there it is one number.
   Requires: TFM_MEDIA, at least 1; TFM_AMOUNTS, 1 or 3, that are kept of each; TFM_VOXEL_CHANNELS, 1 or 3, that a grid
   has; TFM_MEDIUM_OF_GRID(i) and TFM_MEDIUM_OF_BODY(i), constants; TFM_PRIMITIVES, 1 where there are any;
   TFM_TANGENTS, 1 where a phase function asks how strands lie; TFM_EMISSION, 1 where a medium emits light. */
#ifndef TFM_AMOUNTS_H
#define TFM_AMOUNTS_H

#include "core/ray.h"
#ifndef TFM_PRIMITIVES
#define TFM_PRIMITIVES 0
#endif
#ifndef TFM_THIN
#define TFM_THIN 0
#endif
#ifndef TFM_TANGENTS
#define TFM_TANGENTS 0
#endif
#ifndef TFM_EMISSION
#define TFM_EMISSION 0
#endif

/* Kernels take the same without grids. */
#if TFM_GRIDS == 0
#define GRID_ARGUMENTS GRID grids
#endif

/* The largest optical depth; it is finite so that its product with 0 is 0 instead of NaN. */
#define TFM_MAX_OPTICAL_DEPTH 1e30f

typedef struct {
  Floats of[TFM_MEDIA][TFM_AMOUNTS];
} Amounts;

/* Where a channel counts. */
#define AMOUNT_OF(c) (TFM_AMOUNTS == 1 ? 0 : (c))

/* A field may leave out some channels of a grid. */
#if TFM_VOXEL_CHANNELS == 1
#define COUNTS_CHANNEL(extent, c) 1
#else
#define COUNTS_CHANNEL(extent, c) ((extent).density_scale[c] > 0.0f)
#endif

TFM_INLINE Amounts no_amounts(void)
{
  Amounts none;
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      none.of[m][c] = floats(0.0f);
  return none;
}

/* Optical depth of one colour, by the media's extinction. */
TFM_INLINE Floats extinguished(MEDIUM media, const Amounts *amounts, int colour)
{
  Floats depth = media[0].sigma_t[colour] * amounts->of[0][AMOUNT_OF(colour)];
  for (int m = 1; m < TFM_MEDIA; ++m)
    depth += media[m].sigma_t[colour] * amounts->of[m][AMOUNT_OF(colour)];
  return depth;
}

#endif
