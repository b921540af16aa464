/* Power moments of where a ray's optical depth lies: c_0, all of it, and c_j, the sum of x^j d tau with x = 2 v - 1.
   What lies before a point is estimated as published for "Moment-Based Order-Independent Transparency" (Muenstermann,
   Krumpen, Klein, Peters 2018), up to how roots are found and weighed: of all distributions with these moments, on
   the whole line, the one with the fewest nodes of which one is the point (Hamburger's problem). The nodes before the
   point are less than any such distribution has there, those up to it as much or more; a share of the point's own
   weight lies in between.
   Requires: what projection.h does, TFM_N_COEFF 5 or 7. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_OWN_STATE
#include "../map/projection.h"

#if TFM_N_COEFF == 5
#define ORDER 2 /* half the number of moments */
#elif TFM_N_COEFF == 7
#define ORDER 3
#else
#error "moments are 5 or 7 numbers"
#endif

/* Of the point's own weight (moments.py tells why). */
#define POINT_SHARE 0.4f

/* The moments are mixed with so much of those of a distribution that is far from having fewer nodes, against what
   rounding leaves of it. For float32 as published. */
#if TFM_STORAGE_BITS == 32
#define BIAS (ORDER == 2 ? 5e-7f : 5e-6f)
#elif TFM_STORAGE_BITS == 16
#define BIAS (ORDER == 2 ? 5e-5f : 1e-4f)
#else
#define BIAS (ORDER == 2 ? 2e-3f : 5e-3f)
#endif

/* Roots of what vanishes are put here, where they weigh nothing. */
#define FAR_AWAY 1e4f

typedef struct {
  Floats sum[TFM_N_COEFF];
} BasisState;

TFM_INLINE void basis_begin(BasisState *state)
{
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->sum[j] = floats(0.0f);
}

TFM_INLINE void basis_steps(MAP map, __global const float *table, BasisState *state,
                            const LightSteps *steps, int most)
{
  (void)map;
  (void)table;
  for (int k = 0; k < steps->count; ++k) {
    const Floats depth = steps->depth[k];
    const float begin = (float)(2 * steps->n[k] - most) / (float)most;
    const float end = (float)(2 * steps->n[k] + 2 - most) / (float)most;
    /* The mean of x^j from begin to end is the sum of begin^i end^(j - i) over i, over j + 1. */
    float sum = 1.0f, power = 1.0f;
    state->sum[0] += depth;
    for (int j = 1; j < TFM_N_COEFF; ++j) {
      power *= begin;
      sum = end * sum + power;
      state->sum[j] += (sum / (float)(j + 1)) * depth;
    }
  }
}

TFM_INLINE void basis_finish(MAP map, __global const float *table, Ints active,
                             const BasisState *state, int most, Floats *c)
{
  (void)map;
  (void)table;
  (void)most;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    c[j] = active ? state->sum[j] : floats(0.0f);
}

/* Hankel's matrix of the moments, b_(i + j), as L D L^T. */
typedef struct {
  Floats l[ORDER + 1][ORDER + 1]; /* below the diagonal */
  Floats inverse[ORDER + 1];      /* of D */
} Hankel;

TFM_INLINE Hankel factors_of(const Floats *b)
{
  Hankel h;
  Floats products[ORDER + 1][ORDER + 1]; /* L D */
  h.inverse[0] = floats(1.0f);
  for (int i = 0; i <= ORDER; ++i)
    products[i][0] = h.l[i][0] = b[i];
  for (int j = 1; j <= ORDER; ++j)
    for (int i = j; i <= ORDER; ++i) {
      Floats sum = b[i + j];
      for (int k = 0; k < j; ++k)
        sum -= products[i][k] * h.l[j][k];
      if (i == j) {
        /* What rounding made of 0 or less. */
        h.inverse[j] = 1.0f / greatest(sum, floats(0.01f * BIAS));
      }
      else {
        products[i][j] = sum;
        h.l[i][j] = sum * h.inverse[j];
      }
    }
  return h;
}

/* L^-1 (1, x, x^2 ...): values of the orthogonal polynomials, leading coefficient 1. */
TFM_INLINE void orthogonal(const Hankel *h, Floats x, Floats *p)
{
  Floats power = floats(1.0f);
  for (int i = 0; i <= ORDER; ++i) {
    p[i] = power;
    for (int k = 0; k < i; ++k)
      p[i] -= h->l[i][k] * p[k];
    power *= x;
  }
}

/* The weight of a node at x: the most that a distribution with these moments can have there. */
TFM_INLINE Floats weight_at(const Hankel *h, Floats x)
{
  Floats p[ORDER + 1];
  orthogonal(h, x, p);
  Floats sum = floats(1.0f);
  for (int i = 1; i <= ORDER; ++i)
    sum += p[i] * p[i] * h->inverse[i];
  return 1.0f / sum;
}

TFM_INLINE Floats root_of(Floats x)
{
  return x * reciprocal_sqrt(greatest(x, floats(FLT_MIN)));
}

/* x / y with y kept from 0, within reach. */
TFM_INLINE Floats quotient(Floats x, Floats y)
{
  const Floats tiny = floats(1e-30f);
  const Floats safe = y < 0.0f ? least(y, -tiny) : greatest(y, tiny);
  return least(greatest(x / safe, floats(-FAR_AWAY)), floats(FAR_AWAY));
}

/* Both roots of a x^2 + b x + c, if they are real. */
TFM_INLINE void quadratic_roots(Floats a, Floats b, Floats c, Floats *roots)
{
  const Floats root = root_of(greatest(b * b - 4.0f * a * c, floats(0.0f)));
  const Floats q = -0.5f * (b + (b < 0.0f ? -root : root));
  roots[0] = quotient(q, a);
  roots[1] = quotient(c, q);
}

#if ORDER == 3
/* The roots of a x^3 + b x^2 + c x + d, all real: the outermost one by t = cos(acos(y) / 3), the root above 1/2 of
   4 t^3 - 3 t = y, then a quadratic. */
TFM_INLINE void cubic_roots(Floats a, Floats b, Floats c, Floats d, Floats *roots)
{
  Floats size = a < 0.0f ? -a : a;
  size = greatest(size, greatest(b, -b));
  size = greatest(size, greatest(c, -c));
  size = greatest(size, greatest(d, -d));
  const Floats scale = 1.0f / greatest(size, floats(FLT_MIN));
  a *= scale;
  b *= scale;
  c *= scale;
  d *= scale;
  a = a < 0.0f ? least(a, floats(-1e-4f)) : greatest(a, floats(1e-4f));
  const Floats inverse = 1.0f / a;
  const Floats centre = (-1.0f / 3.0f) * b * inverse;
  /* x = centre + s: s^3 - 3 p s - 2 q = 0. */
  const Floats p = greatest(centre * centre - (1.0f / 3.0f) * c * inverse, floats(1e-12f));
  const Floats q = centre * centre * centre - 0.5f * inverse * (c * centre + d);
  const Floats spread = root_of(p);
  const Floats y = quotient(q, p * spread);
  const Floats part = least(greatest(y, -y), floats(1.0f));
  /* Newton's method from the tangent to a chord: t lies between sqrt(3)/2 and 1. */
  Floats t = 0.866025404f + 0.15f * part;
  for (int i = 0; i < 3; ++i)
    t -= (t * (4.0f * t * t - 3.0f) - part) / (12.0f * t * t - 3.0f);
  const Floats outermost = centre + 2.0f * spread * (y < 0.0f ? -t : t);
  roots[0] = outermost;
  /* Divide by x - outermost: from the highest power down where the root is small, else from the lowest one up. */
  const Floats far = outermost * outermost * outermost * a;
  const Ints large = (far < 0.0f ? -far : far) > (d < 0.0f ? -d : d);
  const Floats over = 1.0f / (large ? outermost : floats(1.0f));
  const Floats up_0 = -d * over, up_1 = (up_0 - c) * over;
  const Floats down_1 = b + a * outermost, down_0 = c + down_1 * outermost;
  quadratic_roots(a, large ? up_1 : down_1, large ? up_0 : down_0, roots + 1);
}
#endif

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  /* Moments of a distribution that sums to 1, biased as published. */
#if ORDER == 2
  const float apart[5] = {1.0f, 0.0f, 0.375f, 0.0f, 0.375f};
#else
  const float apart[7] = {1.0f, 0.0f, 0.48f, 0.0f, 0.451f, 0.0f, 0.45f};
#endif
  const Ints some = c[0] > FLT_MIN;
  const Floats inverse = (1.0f - BIAS) / (some ? c[0] : floats(1.0f));
  Floats b[TFM_N_COEFF];
  b[0] = floats(1.0f);
  for (int j = 1; j < TFM_N_COEFF; ++j)
    b[j] = BIAS * apart[j] + inverse * c[j];
  const Hankel h = factors_of(b);

  /* The other nodes are the roots of the kernel (1, x, x^2 ...) H^-1 (1, z, z^2 ...)^T. */
  const Floats x = 2.0f * v - 1.0f;
  Floats p[ORDER + 1], dual[ORDER + 1], roots[ORDER];
  orthogonal(&h, x, p);
  for (int i = ORDER; i >= 0; --i) {
    Floats sum = p[i] * h.inverse[i];
    for (int k = i + 1; k <= ORDER; ++k)
      sum -= h.l[k][i] * dual[k];
    dual[i] = sum;
  }
#if ORDER == 2
  quadratic_roots(dual[2], dual[1], dual[0], roots);
#else
  cubic_roots(dual[3], dual[2], dual[1], dual[0], roots);
#endif
  Floats before = POINT_SHARE * weight_at(&h, x);
  for (int i = 0; i < ORDER; ++i)
    before += roots[i] < x ? weight_at(&h, roots[i]) : floats(0.0f);
  const Floats depth = map->number_unit * c[0] * least(before, floats(1.0f));
  return some ? least(depth, floats(TFM_MAX_OPTICAL_DEPTH)) : floats(0.0f);
}

#endif
