/* Test-only kernels around the phase function of strands. */
#include "items.h"
#include "phase/kajiya_kay.h"

/* Sums of tangents, the light's travel and the direction to the camera, [count, 12], to the sine of the light, the cosine of
   the mirror cone, and the phase function, [count, media]. */
__kernel void call_fibres(MEDIUM media, __global const float *ways, __global float *found, int of_media, int count)
{
  GUARD;
  Floats sums[TANGENTS];
  for (int k = 0; k < TANGENTS; ++k)
    sums[k] = load(ways, 12, k, count);
  const FibreAngles fibres = fibre_angles(sums, load3(ways, 12, 6, count), load3(ways, 12, 9, count));
  store(found, 2 + of_media, 0, count, fibres.light);
  store(found, 2 + of_media, 1, count, fibres.cosine);
  for (int m = 0; m < of_media; ++m)
    store(found, 2 + of_media, 2 + m, count, kajiya_kay(&media[m], &fibres));
}
