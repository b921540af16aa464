/* The image that colours a light. */
#ifndef TFM_TEXTURE_H
#define TFM_TEXTURE_H

#include "lanes.h"

/* Bilinear between texels' centres, clamped at the edges. Row 0 is the image's top, at v = 1, as in memory; column 0 is
   at u = 0. width * height < 2^31. */
TFM_INLINE void texture_at(__global const float4 *texture, int width, int height, Floats u, Floats v, Floats rgb[3])
{
  const Floats x = least(greatest(u * (float)width - 0.5f, floats(0.0f)), floats((float)(width - 1)));
  const Floats y = least(greatest((1.0f - v) * (float)height - 0.5f, floats(0.0f)), floats((float)(height - 1)));
  const Ints left = TO_INTS(x), top = TO_INTS(y);
  IntArray texel, right, below;
  FloatArray in_x, in_y, red, green, blue;
  texel.lanes = top * width + left;
  right.lanes = left < width - 1 ? ints(1) : ints(0);
  below.lanes = top < height - 1 ? ints(width) : ints(0);
  in_x.lanes = x - TO_FLOATS(left);
  in_y.lanes = y - TO_FLOATS(top);
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    __global const float4 *upper = texture + texel.lane[lane];
    __global const float4 *lower = upper + below.lane[lane];
    const float4 above = upper[0] + in_x.lane[lane] * (upper[right.lane[lane]] - upper[0]);
    const float4 under = lower[0] + in_x.lane[lane] * (lower[right.lane[lane]] - lower[0]);
    const float4 colour = above + in_y.lane[lane] * (under - above);
    red.lane[lane] = colour.x;
    green.lane[lane] = colour.y;
    blue.lane[lane] = colour.z;
  }
  rgb[0] = red.lanes;
  rgb[1] = green.lanes;
  rgb[2] = blue.lanes;
}

#endif
