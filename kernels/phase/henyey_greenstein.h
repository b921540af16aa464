/* Henyey and Greenstein (1941): (1 - g^2) / (4 pi (1 + g^2 - 2 g mu)^(3/2)). params->phase = g.
   The base is written (1 - |g|)^2 + 2 |g| (1 -+ mu), which does not cancel at the peak. */
#ifndef TFM_PHASE_H
#define TFM_PHASE_H

/* mu: cosine between the light's travel and the direction to the camera; 1 is forward. */
inline float phase_eval(__constant const Params *params, float mu)
{
  const float g = params->phase[0];
  const float size = fabs(g);
  const float off_peak = fmax(1.0f - copysign(1.0f, g) * mu, 0.0f);
  const float base = (1.0f - size) * (1.0f - size) + 2.0f * size * off_peak;
  return 0.25f * M_1_PI_F * (1.0f - g * g) / (base * sqrt(base));
}

#endif
