/* Henyey and Greenstein (1941): (1 - g^2) / (4 pi (1 + g^2 - 2 g mu)^(3/2)). params->phase = g. */
#ifndef TFM_PHASE_H
#define TFM_PHASE_H

/* mu: cosine between the light's travel and the direction to the camera; 1 is forward. */
inline float phase_eval(__constant const Params *params, float mu)
{
  const float g = params->phase[0];
  /* = (1 - g)^2 at mu = 1; rounding must not make it 0 or negative. */
  const float base = fmax(1.0f + g * g - 2.0f * g * mu, (1.0f - fabs(g)) * (1.0f - fabs(g)));
  return 0.25f * M_1_PI_F * (1.0f - g * g) / (base * sqrt(base));
}

#endif
