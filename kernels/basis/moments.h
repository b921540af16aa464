/* Power moments of the distribution of optical depth along a ray: c_0 is the total, and c_j the integral of x^j d tau
   with x = 2 v - 1. The optical depth before a point is estimated as in "Moment-Based Order-Independent Transparency"
   (Muenstermann, Krumpen, Klein, Peters 2018), except for the way in which roots are found and weighted. Of all
   distributions on the whole line with these moments, we take the one with the fewest nodes that has a node at the
   point (Hamburger's problem). The weight of the nodes before the point bounds that of every such distribution from
   below; adding the point's own node bounds it from above. The estimate lies in between: it adds a share of the
   point's own weight.
   Requires: the same as projection.h; TFM_N_COEFF 5 or 7. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_OWN_STATE
#include "../map/projection.h"

#if TFM_N_COEFF == 5
#define ORDER 2 /* half the number of moments */
#elif TFM_N_COEFF == 7
#define ORDER 3
#else
#error "the basis of moments has 5 or 7 coefficients"
#endif

/* Share of the point's own weight that counts as lying before it (moments.py explains the value). */
#define POINT_SHARE 0.4f

/* Share of a well-conditioned distribution that is mixed into the moments, so that rounding cannot make the Hankel
   matrix singular. The values for float32 are the published ones. */
#if TFM_STORAGE_BITS == 32
#define BIAS (ORDER == 2 ? 5e-7f : 5e-6f)
#elif TFM_STORAGE_BITS == 16
#define BIAS (ORDER == 2 ? 5e-5f : 1e-4f)
#else
#define BIAS (ORDER == 2 ? 2e-3f : 5e-3f)
#endif

/* Place of the roots of degenerate polynomials: nodes this far away have no weight. */
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
    /* The mean of x^j from begin to end is the sum over i of begin^i end^(j - i), divided by j + 1. */
    float sum = 1.0f, power = 1.0f;
    state->sum[0] += depth;
    for (int j = 1; j < TFM_N_COEFF; ++j) {
      power *= begin;
      sum = end * sum + power;
      state->sum[j] += (sum / (float)(j + 1)) * depth;
    }
  }
}

#if TFM_OWN_DEPTH
/* Adds an optical depth that lies at v. */
TFM_INLINE void basis_deposit(__global const float *table, BasisState *state, Floats v, Floats depth)
{
  (void)table;
  const Floats x = 2.0f * v - 1.0f;
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    state->sum[j] += depth;
    depth *= x;
  }
}
#endif

TFM_INLINE void basis_finish(MAP map, __global const float *table, Ints active,
                             const BasisState *state, int most, Floats *c)
{
  (void)map;
  (void)table;
  (void)most;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    c[j] = active ? state->sum[j] : floats(0.0f);
}

/* Factors L D L^T of the Hankel matrix of the moments, H_ij = b_(i + j). */
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
        /* Rounding may have made this 0 or negative. */
        h.inverse[j] = 1.0f / greatest(sum, floats(0.01f * BIAS));
      }
      else {
        products[i][j] = sum;
        h.l[i][j] = sum * h.inverse[j];
      }
    }
  return h;
}

/* L^-1 (1, x, x^2 ...): values of the monic orthogonal polynomials. */
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

/* Weight of a node at x: the largest that any distribution with these moments can have there. */
TFM_INLINE Floats weight_at(const Hankel *h, Floats x)
{
  Floats p[ORDER + 1];
  orthogonal(h, x, p);
  Floats sum = floats(1.0f);
  for (int i = 1; i <= ORDER; ++i)
    sum += p[i] * p[i] * h->inverse[i];
  return 1.0f / sum;
}

/* x / y with y kept away from 0; the result is clamped to +-FAR_AWAY. */
TFM_INLINE Floats quotient(Floats x, Floats y)
{
  const Floats tiny = floats(1e-30f);
  const Floats safe = y < 0.0f ? least(y, -tiny) : greatest(y, tiny);
  return least(greatest(x / safe, floats(-FAR_AWAY)), floats(FAR_AWAY));
}

/* Both roots of a x^2 + b x + c, which must be real. */
TFM_INLINE void quadratic_roots(Floats a, Floats b, Floats c, Floats *roots)
{
  const Floats root = root_of(greatest(b * b - 4.0f * a * c, floats(0.0f)));
  const Floats q = -0.5f * (b + (b < 0.0f ? -root : root));
  roots[0] = quotient(q, a);
  roots[1] = quotient(c, q);
}

#if ORDER == 3
/* Roots of a x^3 + b x^2 + c x + d, which must all be real. The outermost one comes from t = cos(acos(y) / 3), the
   root above 1/2 of 4 t^3 - 3 t = y; the other two from the remaining quadratic. */
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
  /* Newton's method; t lies between sqrt(3)/2 and 1, and the first guess is close to linear interpolation. */
  Floats t = 0.866025404f + 0.15f * part;
  for (int i = 0; i < 3; ++i)
    t -= (t * (4.0f * t * t - 3.0f) - part) / (12.0f * t * t - 3.0f);
  const Floats outermost = centre + 2.0f * spread * (y < 0.0f ? -t : t);
  roots[0] = outermost;
  /* Divide by x - outermost: from the highest power downwards if the root is small, else from the lowest upwards. */
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
  /* Moments of a normalised distribution, biased as published. */
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

  /* The other nodes are the roots z of the kernel (1, x, x^2 ...) H^-1 (1, z, z^2 ...)^T. */
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
