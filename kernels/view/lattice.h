/* Light on a lattice: what all lights scatter towards the camera, and what of them arrives, known at the voxels of every
   block with density. In between both are linear, the former as a logarithm: as optical depth grows evenly where density
   is even, light falls off in equal factors. A camera ray then reads the same window for density and for any number of
   lights.
   Requires: what walk.h does; TFM_LATTICE_COLOURS, 1 where all lights have the colour that the kernel is told, else 3;
   TFM_LATTICE_APART, parts of the light that are known apart: 1 without TFM_LIGHT_LAYERS. */
#ifndef TFM_LATTICE_H
#define TFM_LATTICE_H

#include "body/walk.h"
#include "view/frame.h"

/* What a voxel of a record has: binary logarithms of the radiance over albedo and opacity, of each part of the light, and
   then once more of all octaves but the first; the mean over the lights of what arrives. */
#define LATTICE_FIRST (TFM_LATTICE_APART * TFM_LATTICE_COLOURS)
#define LATTICE_RADIANCES ((HAS_OCTAVES ? 2 : 1) * LATTICE_FIRST)
#define LATTICE_NUMBERS (LATTICE_RADIANCES + TFM_CHANNELS)

#define LATTICE __global const float *
#define LATTICE_AT(lattice, walk, steps, k, t) lattice_at(lattice, walk, steps, k, t)
#define LATTICE_STEP(sums, value, media, step, opacity, weight) lattice_step(sums, value, opacity, weight)

#if TFM_LIGHT_LAYERS
#define PART_OF_LIGHT(sums, i) (sums)->apart[i]
#define LATER_PART_OF_LIGHT(sums, i) (sums)->later_apart[i]
#else
#define PART_OF_LIGHT(sums, i) (sums)->colour
#define LATER_PART_OF_LIGHT(sums, i) (sums)->later
#endif

typedef struct {
  Floats of[LATTICE_NUMBERS];
} LatticeValue;

TFM_INLINE LatticeValue lattice_begin(void)
{
  LatticeValue value;
  for (int i = 0; i < LATTICE_NUMBERS; ++i)
    value.of[i] = floats(0.0f);
  return value;
}

#if SHARES_WINDOWS
/* Of all lanes from one window, as density_together. */
TFM_INLINE LatticeValue lattice_together(__global const float *lattice, const Window *window, Vec3 point)
{
  __global const float *start =
      lattice + ((size_t)window->record * RECORD_VOXELS + (size_t)window->first) * LATTICE_NUMBERS;
  const int nx = window->sizes & 255, ny = window->sizes >> 8 & 255, nz = window->sizes >> 16;
  const Tents weights = window_tents(window, point, nx, ny, nz, 0);
  const Floats *wx = weights.x, *wy = weights.y, *wz = weights.z;
  LatticeValue sum = lattice_begin();
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j) {
      const Floats weight = wz[k] * wy[j];
      __global const float *voxel = start + (k * RECORD_LAYER + j * RECORD_ROW) * LATTICE_NUMBERS;
#pragma unroll
      for (int n = 0; n < LATTICE_NUMBERS; ++n) {
        Floats row = wx[0] * voxel[n] + wx[1] * voxel[LATTICE_NUMBERS + n];
#pragma unroll
        for (int i = 2; i <= MOST_SHARED; ++i)
          if (i < nx)
            row += wx[i] * voxel[i * LATTICE_NUMBERS + n];
        sum.of[n] += weight * row;
      }
    }
  return sum;
}
#endif

/* Where every lane reads for itself, at points in a grid; records > 0. */
TFM_INLINE LatticeValue lattice_apart(__global const float *lattice, Ints record, Vec3 point)
{
  const Ints ix = TO_INTS(point.x), iy = TO_INTS(point.y), iz = TO_INTS(point.z);
  const Floats fx = point.x - TO_FLOATS(ix), fy = point.y - TO_FLOATS(iy), fz = point.z - TO_FLOATS(iz);
  const Ints at = (record * RECORD_VOXELS + (iz & (BLOCK_EDGE - 1)) * RECORD_LAYER + (iy & (BLOCK_EDGE - 1)) * RECORD_ROW +
                   (ix & (BLOCK_EDGE - 1))) * LATTICE_NUMBERS;
  LatticeValue sum = lattice_begin();
  for (int corner = 0; corner < 8; ++corner) {
    const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
    const Floats weight = (x ? fx : 1.0f - fx) * (y ? fy : 1.0f - fy) * (z ? fz : 1.0f - fz);
    __global const float *voxel = lattice + (z * RECORD_LAYER + y * RECORD_ROW + x) * LATTICE_NUMBERS;
    for (int n = 0; n < LATTICE_NUMBERS; ++n)
      sum.of[n] += weight * gather_floats(voxel + n, at);
  }
  return sum;
}

/* At the k-th of the steps, whose middle is at t; any number where there is no density. Where several grids have some,
   the last one's voxels know the light of all. */
TFM_INLINE LatticeValue lattice_at(__global const float *lattice, const Walk *walk, const Steps *steps, int k, Floats t)
{
#if SHARES_WINDOWS
  if (walk->together)
    return lattice_together(lattice, &steps->window[k], ray_at(walk->ray.of[0], t));
#endif
  (void)walk;
  (void)t;
  LatticeValue value = lattice_begin();
  for (int i = 0; i < TFM_GRIDS; ++i) {
    const Ints records = steps->records[k][i], has = records > 0;
    const LatticeValue here = lattice_apart(lattice, has ? records : ints(0), steps->point[k][i]);
    for (int n = 0; n < LATTICE_NUMBERS; ++n)
      value.of[n] = has ? here.of[n] : value.of[n];
  }
  return value;
}

/* Adds to a colour, over albedo, what logarithms of the radiance say. */
TFM_INLINE void add_radiance(const Floats *logarithms, const Floats *opacity, Floats *colour)
{
  Floats radiance[TFM_LATTICE_COLOURS];
  for (int c = 0; c < TFM_LATTICE_COLOURS; ++c)
    radiance[c] = exp2_of(logarithms[c]);
  for (int c = 0; c < 3; ++c)
    colour[c] += opacity[TFM_CHANNELS == 3 ? c : 0] * radiance[TFM_LATTICE_COLOURS == 3 ? c : 0];
}

/* A step took its opacity, of mean `weight`, from the ray; colours are then over albedo. */
TFM_INLINE void lattice_step(LightSums *sums, const LatticeValue *value, const Floats *opacity, Floats weight)
{
  for (int i = 0; i < TFM_LATTICE_APART; ++i) {
    add_radiance(value->of + i * TFM_LATTICE_COLOURS, opacity, PART_OF_LIGHT(sums, i));
#if HAS_OCTAVES
    add_radiance(value->of + LATTICE_FIRST + i * TFM_LATTICE_COLOURS, opacity, LATER_PART_OF_LIGHT(sums, i));
#endif
  }
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums->seen[c] += weight * value->of[LATTICE_RADIANCES + c];
  sums->seen_opacity += weight;
}

#endif
