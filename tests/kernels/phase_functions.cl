/* Test-only kernel around TFM_PHASE. Includes expected before: the headers that it names. */
#include "items.h"

/* [count] to [count, media]. */
__kernel void call_phase(MEDIUM media, __global const float *mus, __global float *found, int of_media, int count)
{
  GUARD;
  const Floats mu = load(mus, 1, 0, count);
  for (int m = 0; m < of_media; ++m)
    store(found, of_media, m, count, TFM_PHASE(&media[m], mu));
}
