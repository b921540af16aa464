/* Real spherical harmonics, orthonormal: what the radiance at a point is known by where scattering has a lobe.
   Requires: TFM_ORDER_DEGREE, the last degree, 2 to 4. */
#ifndef TFM_HARMONICS_H
#define TFM_HARMONICS_H

#include "core/ray.h"

#define HARMONICS ((TFM_ORDER_DEGREE + 1) * (TFM_ORDER_DEGREE + 1))
/* DO for each, with its degree in l and its number in n; both are known when compiled. */
#define EACH_HARMONIC                            \
  for (int l = 0; l <= TFM_ORDER_DEGREE; ++l)    \
    for (int n = l * l; n < (l + 1) * (l + 1); ++n)

/* Of a unit vector; Y_lm at l^2 + l + m. */
TFM_INLINE void harmonics_of(Vec3 v, Floats *y)
{
  const Floats xx = v.x * v.x, yy = v.y * v.y, zz = v.z * v.z;
  y[0] = floats(0.282094792f);
  y[1] = 0.488602512f * v.y;
  y[2] = 0.488602512f * v.z;
  y[3] = 0.488602512f * v.x;
  y[4] = 1.09254843f * v.x * v.y;
  y[5] = 1.09254843f * v.y * v.z;
  y[6] = 0.315391565f * (3.0f * zz - 1.0f);
  y[7] = 1.09254843f * v.x * v.z;
  y[8] = 0.546274215f * (xx - yy);
#if TFM_ORDER_DEGREE > 2
  y[9] = 0.590043590f * v.y * (3.0f * xx - yy);
  y[10] = 2.89061144f * v.x * v.y * v.z;
  y[11] = 0.457045799f * v.y * (5.0f * zz - 1.0f);
  y[12] = 0.373176333f * v.z * (5.0f * zz - 3.0f);
  y[13] = 0.457045799f * v.x * (5.0f * zz - 1.0f);
  y[14] = 1.44530572f * v.z * (xx - yy);
  y[15] = 0.590043590f * v.x * (xx - 3.0f * yy);
#endif
#if TFM_ORDER_DEGREE > 3
  y[16] = 2.50334294f * v.x * v.y * (xx - yy);
  y[17] = 1.77013077f * v.y * v.z * (3.0f * xx - yy);
  y[18] = 0.946174696f * v.x * v.y * (7.0f * zz - 1.0f);
  y[19] = 0.669046544f * v.y * v.z * (7.0f * zz - 3.0f);
  y[20] = 0.105785547f * (zz * (35.0f * zz - 30.0f) + 3.0f);
  y[21] = 0.669046544f * v.x * v.z * (7.0f * zz - 3.0f);
  y[22] = 0.473087348f * (xx - yy) * (7.0f * zz - 1.0f);
  y[23] = 1.77013077f * v.x * v.z * (xx - 3.0f * yy);
  y[24] = 0.625835735f * (xx * (xx - 3.0f * yy) - yy * (3.0f * xx - yy));
#endif
}

#endif
