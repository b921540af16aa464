/* Fournier and Forand (1994), in the form of Fournier and Jonasz (1999): with s = sin^2(theta / 2), delta = s delta_180,
   a = 1 - delta, E = (delta^-nu - 1) / a and R = (E - nu delta^-nu) / a it is
     ((R - E) / s - R) / 4 pi + c (3 mu^2 - 1),
   and within FORWARD_DISK of its pole at s = 0 the mean over that disk. medium->phase = delta_180, nu in (-1, 0), c, the mean.
   Around a = 0, where E and R are differences of what is almost the same, they are power series in a. */
#ifndef TFM_PHASE_FOURNIER_FORAND_H
#define TFM_PHASE_FOURNIER_FORAND_H

#include "../core/fast_math.h"

#define NEAR_ONE 0.33f   /* of |a| */
#define SERIES_TERMS 12  /* of which the last is 1e-7 of the first at most */

/* mu: cosine between the light's direction of travel and the direction to the camera; 1 is forward scattering. */
TFM_INLINE Floats fournier_forand(MEDIUM medium, Floats mu)
{
  const float nu = medium->phase[1];
  const Floats own_s = 0.5f - 0.5f * mu;
  const Floats s = greatest(own_s, floats(FORWARD_DISK));
  const Floats delta = medium->phase[0] * s;
  const Floats a = 1.0f - delta;
  const Ints is_near = magnitude_of(a) < NEAR_ONE;
  const Ints is_below = delta < 1.0f;

  const Floats t = -nu * magnitude_of(log_of(delta));
  const Floats left = transmittance_of(t), lost = opacity_of(t);
  const Floats inverse = 1.0f / left;
  const Floats power = is_below ? left : inverse; /* delta^-nu */
  const Floats over = 1.0f / (is_near ? floats(1.0f) : a);
  const Floats e = (is_below ? -lost : lost * inverse) * over;
  const Floats r = (e - nu * power) * over;
  const Floats r_less_e = (delta * e - nu * power) * over;

  Floats e_series = floats(0.0f), r_series = floats(0.0f), a_power = floats(1.0f);
  float term = nu; /* (nu)_k / k! */
  for (int k = 1; k <= SERIES_TERMS; ++k) {
    e_series += term * a_power;
    r_series += term * (1.0f - nu) * ((float)k / (float)(k + 1)) * a_power;
    a_power *= a;
    term *= (nu + (float)k) / (float)(k + 1);
  }
  const Floats bulk = (is_near ? r_series - e_series : r_less_e) / s - (is_near ? r_series : r);
  const Floats outside = 0.25f * M_1_PI_F * bulk + medium->phase[2] * (3.0f * mu * mu - 1.0f);
  return own_s < FORWARD_DISK ? floats(medium->phase[3]) : outside;
}

#endif
