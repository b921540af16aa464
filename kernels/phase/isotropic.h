/* Isotropic phase function, 1 / 4 pi. */
#ifndef TFM_PHASE_H
#define TFM_PHASE_H

/* mu: cosine between the light's travel and the direction to the camera. */
inline float phase_eval(__constant const Params *params, float mu)
{
  (void)params;
  (void)mu;
  return 0.25f * M_1_PI_F;
}

#endif
