/* Test-only kernel around TFM_PHASE. Includes expected before: the headers that it names. */
#include "items.h"
#include "phase/phase.h"

/* [count] to [count, media], without strands. */
__kernel void call_phase(MEDIUM media, __global const float *mus, __global float *found, int of_media, int count)
{
  GUARD;
  const Floats mu = load(mus, 1, 0, count);
#if TFM_TANGENTS
  const FibreAngles fibres = no_strands();
#endif
  for (int m = 0; m < of_media; ++m)
    store(found, of_media, m, count, PHASE_OF(&media[m], mu, &fibres));
}
