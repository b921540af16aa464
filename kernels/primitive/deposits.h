/* What primitives leave along the rays of a march: the optical depth of their density goes to the steps that they lie in,
   by its exact integral between the steps' ends (of an opacity FOM eq. 4), before anything else sees the steps.
   Includes expected before: the headers of the primitives' kinds. Requires: TFM_PRIMITIVE_CROSSING(primitive, ball, ray,
   crossing), TFM_PRIMITIVE_PART(primitive, crossing, t) and TFM_PRIMITIVE_TANGENT(primitive, crossing), each one of
   theirs. */
#ifndef TFM_DEPOSITS_H
#define TFM_DEPOSITS_H

#include "primitive/near.h"
#if TFM_TANGENTS
#include "phase/fibres.h"
#endif

/* Steps that one look through the lists serves. */
#define DEPOSIT_STEPS 128

typedef struct {
  int first, end;                                   /* of the steps that they speak of */
  uint marks[DEPOSIT_STEPS / 32];                   /* bits: steps in which anything lies */
  Floats edge[DEPOSIT_STEPS + 1];                   /* ray parameters of the steps' ends */
  Floats of[DEPOSIT_STEPS][TFM_MEDIA][TFM_AMOUNTS]; /* optical depth of the density in each */
#if TFM_THIN
  Floats thin[DEPOSIT_STEPS];  /* of that what is crossed in one place */
  Floats place[DEPOSIT_STEPS]; /* the ray parameters of these places, weighted by it */
#endif
#if TFM_TANGENTS
  Floats tangents[DEPOSIT_STEPS][TANGENTS]; /* of the strands, weighted by that */
#endif
} Deposits;

TFM_INLINE int is_marked(const Deposits *deposits, int n)
{
  const int i = n - deposits->first;
  return n < deposits->end && (deposits->marks[i >> 5] >> (i & 31) & 1u);
}

/* The next step from n on in which anything lies; `until` where none does. */
TFM_INLINE int next_marked(const Deposits *deposits, int n, int until)
{
  while (n < until && !is_marked(deposits, n))
    ++n;
  return n;
}

/* Leaves a primitive in the steps from low to high, of the rays that cross it. */
TFM_INLINE void deposit(PRIMITIVE primitive, const Crossing *crossing, Ints crosses, int low, int high, Deposits *deposits)
{
  const int medium = TFM_MEDIA > 1 ? PRIMITIVE_MEDIUM(primitive) : 0;
#if TFM_TANGENTS
  Floats products[TANGENTS];
  tangent_products(TFM_PRIMITIVE_TANGENT(primitive, crossing), products);
#endif
  Floats before = TFM_PRIMITIVE_PART(primitive, crossing, deposits->edge[low - deposits->first]);
  for (int n = low; n <= high; ++n) {
    const int i = n - deposits->first;
    const Floats behind = TFM_PRIMITIVE_PART(primitive, crossing, deposits->edge[i + 1]);
    const Floats part = crosses ? greatest(behind - before, floats(0.0f)) : floats(0.0f);
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      deposits->of[i][medium][c] += primitive->amount[c] * part;
#if TFM_THIN
    if (PRIMITIVE_IS_THIN(primitive)) {
      Floats held = floats(0.0f);
      for (int c = 0; c < TFM_AMOUNTS; ++c)
        held += primitive->amount[c] * part;
      deposits->thin[i] += held;
      deposits->place[i] += held * crossing->t;
    }
#endif
#if TFM_TANGENTS
    for (int k = 0; k < TANGENTS; ++k)
      deposits->tangents[i][k] += products[k] * part;
#endif
    deposits->marks[i >> 5] |= 1u << (i & 31);
    before = behind;
  }
}

#endif
