/* Tabulated functions: modes[TABULATED_CELLS + 1][n] holds their values at equidistant points of [0, 1], with linear
   interpolation in between.
   Requires: the same as projection.h. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_TABULATED
#include "../map/projection.h"

/* The table cell that contains a position. */
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
