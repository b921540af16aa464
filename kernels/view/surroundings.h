/* Light from all around, as the sum of lights that are soft, on a lattice of points (view/orders.h): what they scatter
   towards the camera, which its rays interpolate. In between it is linear as a logarithm: as optical depth grows evenly
   where density is even, light falls off in equal factors.
   Requires: what view/orders.h does, with TFM_ORDER_MEDIA, but for TFM_ORDER_COLOURS; what phase/octaves.h does. */
#ifndef TFM_SURROUNDINGS_H
#define TFM_SURROUNDINGS_H

#include "phase/octaves.h"

/* What a point has: binary logarithms of the radiance towards the camera of each medium, RGB, over its albedo, and then
   once more of all octaves but the first; what of the lights arrives, summed over them. */
#define SURROUNDINGS_LATER (3 * TFM_ORDER_MEDIA)
#define SURROUNDINGS_ARRIVE ((HAS_OCTAVES ? 2 : 1) * SURROUNDINGS_LATER)
#define TFM_ORDER_COLOURS (SURROUNDINGS_ARRIVE + TFM_CHANNELS)
#define TFM_ORDER_SURROUNDINGS 1
#include "view/orders.h"

#ifdef TFM_AMOUNTS_H
#define LATTICE_STEP(sums, value, media, step, opacity, weight) \
  surroundings_step(sums, value, 1, media, step, opacity, weight)

/* Below which a logarithm is that of nothing: between points that have none, too. */
#define OF_NOTHING -125.0f

TFM_INLINE Floats radiance_of(Floats logarithm)
{
  return logarithm > OF_NOTHING ? exp2_of(logarithm) : floats(0.0f);
}

/* What points know, with radiances in the place of their logarithms. */
TFM_INLINE LatticeValue radiances_of(LatticeValue value)
{
  for (int n = 0; n < SURROUNDINGS_ARRIVE; ++n)
    value.of[n] = radiance_of(value.of[n]);
  return value;
}

/* What the media of a step scatter of radiances, over what it extinguishes. */
TFM_INLINE Floats scattered_of(MEDIUM media, const Amounts *step, const Floats *radiances, int colour)
{
#if TFM_MEDIA == 1
  (void)step;
  return media->albedo[colour] * radiances[colour];
#else
  Floats scattered = floats(0.0f);
  for (int m = 0; m < TFM_ORDER_MEDIA; ++m)
    scattered += media[m].sigma_s[colour] * step->of[m][AMOUNT_OF(colour)] * radiances[3 * m + colour];
  const Floats extinct = extinguished(media, step, colour);
  return extinct > 0.0f ? scattered / extinct : floats(0.0f);
#endif
}

/* What two steps of a ray take, the first of which has an even number: they are near, and light is smooth.
   radiances  of the last two, whose first is `of`; out: of these */
#define LATTICE_OF_BOTH_STEPS of_both_steps
TFM_INLINE void of_both_steps(LATTICE lattice, const Walk *walk, int n, LatticeValue *radiances, int *of)
{
  const int even = n & ~1;
  if (even != *of)
    *radiances = radiances_of(lattice_at(lattice, 0.5f * (place_of(walk, even).t + place_of(walk, even + 1).t)));
  *of = even;
}

/* A step took its opacity, of mean `weight`, from the ray. radiances: of radiances_of; lights: how many they are of. */
TFM_INLINE void surroundings_step(LightSums *sums, const LatticeValue *radiances, int lights, MEDIUM media, const Amounts *step,
                                  const Floats *opacity, Floats weight)
{
  for (int c = 0; c < 3; ++c) {
    const Floats taken = opacity[TFM_CHANNELS == 3 ? c : 0];
    sums->colour[c] += taken * scattered_of(media, step, radiances->of, c);
#if HAS_OCTAVES
    sums->later[c] += taken * scattered_of(media, step, radiances->of + SURROUNDINGS_LATER, c);
#endif
  }
  for (int c = 0; c < TFM_CHANNELS; ++c)
    sums->seen[c] += weight * radiances->of[SURROUNDINGS_ARRIVE + c];
  sums->seen_opacity += (float)lights * weight;
}
#endif

#endif
