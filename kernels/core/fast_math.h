/* Elementary functions for all lanes without calls; errors of a few half-ulps, with bounds in tests/kernels. */
#ifndef TFM_FAST_MATH_H
#define TFM_FAST_MATH_H

#include "lanes.h"

/* 2^x = scale + scale * part and 2^x - 1 = (scale - 1) + scale * part, the latter without cancellation. */
typedef struct {
  Floats scale;
  Floats part;
} Exp2;

/* For x in [-126, 126]. part is the Taylor series of 2^f - 1 for f in [-1/2, 1/2], with an error of 5e-9. */
TFM_INLINE Exp2 exp2_split(Floats x)
{
  /* Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the low bits. */
  const Floats shifted = x + 12582912.0f;
  const Floats f = x - (shifted - 12582912.0f);
  Exp2 e;
  e.scale = AS_FLOATS((AS_INTS(shifted) << 23) + 0x3f800000);
  e.part = f * (0.693147181f + f * (0.240226507f + f * (0.0555041087f + f * (0.00961812911f +
           f * (0.00133335581f + f * (0.000154035304f + f * 0.0000152527338f))))));
  return e;
}

#define TFM_LOG2_E 1.44269504f

/* e^-t and 1 - e^-t for t >= 0; beyond t = 87 they are 2^-126 and 1. Since the multiple of t is rounded, the error of
   e^-t is about 1.2 t half-ulps, and that of 1 - e^-t a few. */
TFM_INLINE Exp2 exp_of_minus(Floats t)
{
  return exp2_split(greatest(t * -TFM_LOG2_E, floats(-126.0f)));
}

TFM_INLINE Floats transmittance_of(Floats optical_depth)
{
  const Exp2 e = exp_of_minus(optical_depth);
  return e.scale + e.scale * e.part;
}

TFM_INLINE Floats opacity_of(Floats optical_depth)
{
  const Exp2 e = exp_of_minus(optical_depth);
  return (1.0f - e.scale) - e.scale * e.part;
}

/* 2^x; beyond 126 either way it stays the same. */
TFM_INLINE Floats exp2_of(Floats x)
{
  const Exp2 e = exp2_split(least(greatest(x, floats(-126.0f)), floats(126.0f)));
  return e.scale + e.scale * e.part;
}

/* Natural logarithm of positive normal numbers (Cephes logf). */
TFM_INLINE Floats log_of(Floats x)
{
  const Ints bits = AS_INTS(x) - 0x3f3504f3; /* brings the mantissa into [sqrt(1/2), sqrt(2)) */
  const Floats exponent = TO_FLOATS(bits >> 23);
  const Floats r = AS_FLOATS((bits & 0x7fffff) + 0x3f3504f3) - 1.0f;
  const Floats r2 = r * r;
  const Floats series = r * (3.3333331174e-1f + r * (-2.4999993993e-1f + r * (2.0000714765e-1f +
                        r * (-1.6668057665e-1f + r * (1.4249322787e-1f + r * (-1.2420140846e-1f +
                        r * (1.1676998740e-1f + r * (-1.1514610310e-1f + r * 7.0376836292e-2f))))))));
  return exponent * 0.693147181f + (r + r2 * (series - 0.5f));
}

/* cos(pi u) for u in [0, 1]: Taylor series of sin(pi (1/2 - u)), with an error of 1e-9. */
TFM_INLINE Floats cos_pi(Floats u)
{
  const Floats x = 0.5f - u;
  const Floats x2 = x * x;
  return x * (3.14159265f + x2 * (-5.16771278f + x2 * (2.55016404f + x2 * (-0.599264529f +
         x2 * (0.0821458866f + x2 * (-0.00737043094f + x2 * 0.000466302806f))))));
}

/* sin(pi u) for u in [0, 1], with an error of 1e-9; symmetric about 1/2, so that both ends are 0 up to rounding. */
TFM_INLINE Floats sin_pi(Floats u)
{
  const Floats x = u < 0.5f ? u : 1.0f - u;
  const Floats x2 = x * x;
  return x * (3.14159265f + x2 * (-5.16771278f + x2 * (2.55016404f + x2 * (-0.599264529f +
         x2 * (0.0821458866f + x2 * (-0.00737043094f + x2 * 0.000466302806f))))));
}

/* Arctangent of x >= 0, with an error of 3e-8 (Abramowitz and Stegun 4.4.49). */
TFM_INLINE Floats arctangent_of(Floats x)
{
  const Ints steep = x > 1.0f;
  const Floats q = steep ? 1.0f / x : x;
  const Floats q2 = q * q;
  const Floats angle = q * (1.0f + q2 * (-0.3333314528f + q2 * (0.1999355085f + q2 * (-0.1420889944f +
                       q2 * (0.1065626393f + q2 * (-0.0752896400f + q2 * (0.0429096138f +
                       q2 * (-0.0161657367f + q2 * 0.0028662257f))))))));
  return steep ? 1.57079633f - angle : angle;
}

TFM_INLINE Floats magnitude_of(Floats x)
{
  return AS_FLOATS(AS_INTS(x) & 0x7fffffff);
}

/* 1 / sqrt(x) for x > 0; a large finite number for x = 0. */
TFM_INLINE Floats reciprocal_sqrt(Floats x)
{
  Floats y = AS_FLOATS(0x5f375a86 - (AS_INTS(x) >> 1));
  y = y * (1.5f - 0.5f * x * y * y);
  y = y * (1.5f - 0.5f * x * y * y);
  return y * (1.5f - 0.5f * x * y * y);
}

/* Square root; below 0 it is any number below 0. */
TFM_INLINE Floats root_of(Floats x)
{
  return x * reciprocal_sqrt(greatest(x, floats(FLT_MIN)));
}

#endif
