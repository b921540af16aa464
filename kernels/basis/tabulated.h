/* Functions known by their values: modes[TABULATED_CELLS + 1][n] at equal distances over [0, 1], linear in between.
   Requires: what projection.h does. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_TABULATED
#include "../map/projection.h"

/* Which values a position lies between. */
typedef struct {
  Ints row;
  Floats part;
} TablePlace;

TFM_INLINE TablePlace table_place(Floats v)
{
  TablePlace place;
  const Floats x = v * (float)TABULATED_CELLS;
  const Ints row = TO_INTS(x);
  place.row = row < TABULATED_CELLS - 1 ? row : ints(TABULATED_CELLS - 1);
  place.part = x - TO_FLOATS(place.row);
  return place;
}

#endif
