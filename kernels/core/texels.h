/* Positions between the texels of a square map. */
#ifndef TFM_TEXELS_H
#define TFM_TEXELS_H

#include "ray.h"

/* Which texels a map position lies between. */
typedef struct {
  Ints texel; /* lower left one */
  Floats fx, fy;
} MapPosition;

TFM_INLINE MapPosition map_position(int res, Floats u, Floats v)
{
  const float last = (float)(res - 1);
  const Floats x = clamp_to(u * (float)res - 0.5f, last);
  const Floats y = clamp_to(v * (float)res - 0.5f, last);
  /* The last texel is reached as a full step from the one before it. */
  const int last_low = res > 1 ? res - 2 : 0;
  const Ints ix = TO_INTS(x), iy = TO_INTS(y);
  const Ints low_x = ix < last_low ? ix : ints(last_low);
  const Ints low_y = iy < last_low ? iy : ints(last_low);
  MapPosition position;
  position.texel = low_y * res + low_x;
  position.fx = x - TO_FLOATS(low_x);
  position.fy = y - TO_FLOATS(low_y);
  return position;
}

#endif
