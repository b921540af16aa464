/* Trigonometric moments of the distribution of optical depth along a ray: c_0 is the total, and c_(2m-1) + i c_(2m) the
   integral of e^(i m pi v) d tau. The optical depth before a point is estimated as in "Moment-Based Order-Independent
   Transparency" (Muenstermann, Krumpen, Klein, Peters 2018), except for the way in which roots are found and weighted,
   and for the zone in which weights wrap around (trigonometric_moments.py). Of the distributions on the circle with these
   moments, we take the one with the fewest nodes that has a node at the point. The estimate is the weight of the nodes
   before the point and a share of the point's own.

   What their shaders do with complex numbers is done with real ones here. The moments are turned so that the point is at
   the angle 0. In place of the Toeplitz matrix there is that of the products of cos(k a) and sin(k a), where a is the
   angle and k = M/2, M/2 - 1 ... above or at 0. They span e^(-i M a / 2) times the powers of e^(i a), and the change of
   basis is unitary, but for a factor of the function 1: the condition is the same with a fourth of the multiplications.
   The kernel K(0, a), whose roots are the other nodes, is a real combination of them. With t = cot(a / 2) it is a polynomial
   of t of degree M, divided by (1 + t^2)^(M/2): its roots are all real, the point itself is at infinity, and the leading
   coefficient is K(0, 0), which is never 0. From 0 to 2 pi of the angle, t falls from infinity to minus infinity.
   Requires: the same as projection.h; TFM_N_COEFF 5, 7 or 9. */
#ifndef TFM_BASIS_H
#define TFM_BASIS_H

#define TFM_BASIS_OWN_STATE
#include "../map/projection.h"

#if TFM_N_COEFF == 5 || TFM_N_COEFF == 7 || TFM_N_COEFF == 9
#define ORDER ((TFM_N_COEFF - 1) / 2) /* M, number of complex moments besides c_0 */
#else
#error "the basis of trigonometric moments has 5, 7 or 9 coefficients"
#endif

/* Share of the point's own weight that counts as lying before it (trigonometric_moments.py explains the value). */
#define POINT_SHARE 0.375f

/* Share of an even distribution on the circle, all of whose moments are 0, that is mixed in, so that rounding cannot make
   the Toeplitz matrix singular (trigonometric_moments.py explains the values). */
#if TFM_STORAGE_BITS == 32
#define BIAS (ORDER == 2 ? 4e-7f : ORDER == 3 ? 8e-6f : 1.5e-5f)
#elif TFM_STORAGE_BITS == 16
#define BIAS (ORDER == 2 ? 1.2e-3f : 1.5e-3f)
#else
#define BIAS (ORDER == 2 ? 2e-3f : ORDER == 3 ? 5e-3f : 2e-2f)
#endif

/* Laguerre's iterations for a root. Where density is in few places two roots lie close together, and 4 are too few; a
   sixth changes nothing. */
#define LAGUERRE_STEPS 5

typedef struct {
  Floats sum[TFM_N_COEFF];
#if TFM_OWN_DEPTH
  Floats in_places[TFM_N_COEFF]; /* of what does not fill a step */
#endif
} BasisState;

TFM_INLINE void basis_begin(BasisState *state)
{
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->sum[j] = floats(0.0f);
#if TFM_OWN_DEPTH
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->in_places[j] = floats(0.0f);
#endif
}

/* e^(i m pi u) for m = 1 ... M as pairs, u in [0, 1]. */
TFM_INLINE void circle_powers(Floats u, Floats *powers)
{
  powers[0] = cos_pi(u);
  powers[1] = sin_pi(u);
#pragma unroll
  for (int m = 1; m < ORDER; ++m) {
    powers[2 * m] = powers[2 * m - 2] * powers[0] - powers[2 * m - 1] * powers[1];
    powers[2 * m + 1] = powers[2 * m - 2] * powers[1] + powers[2 * m - 1] * powers[0];
  }
}

TFM_INLINE void basis_steps(MAP map, __global const float *table, BasisState *state,
                            const LightSteps *steps, int most)
{
  (void)map;
  (void)table;
  for (int k = 0; k < steps->count; ++k) {
    const Floats depth = steps->depth[k];
    Floats powers[TFM_N_COEFF - 1];
    circle_powers(floats(((float)steps->n[k] + 0.5f) / (float)most), powers);
    state->sum[0] += depth;
#pragma unroll
    for (int j = 1; j < TFM_N_COEFF; ++j)
      state->sum[j] += powers[j - 1] * depth;
  }
}

#if TFM_OWN_DEPTH
/* Adds an optical depth that lies at v. */
TFM_INLINE void basis_deposit(__global const float *table, BasisState *state, Floats v, Floats depth)
{
  (void)table;
  Floats powers[TFM_N_COEFF - 1];
  circle_powers(v, powers);
  state->in_places[0] += depth;
  for (int j = 1; j < TFM_N_COEFF; ++j)
    state->in_places[j] += powers[j - 1] * depth;
}
#endif

TFM_INLINE void basis_finish(MAP map, __global const float *table, Ints active,
                             const BasisState *state, int most, Floats *c)
{
  (void)map;
  (void)table;
  /* The mean of e^(i m a) over a step is that at its middle times sin(m h) / (m h), with the half step h of the angle. */
  const Floats half_step = floats(0.5f / (float)most);
  const Floats scale = 0.318309886f / half_step; /* 1 / h */
  const Floats twice = 2.0f * cos_pi(half_step);
  Floats sine_before = floats(0.0f), sine = sin_pi(half_step);
  c[0] = active ? state->sum[0] : floats(0.0f);
#pragma unroll
  for (int m = 1; m <= ORDER; ++m) {
    const Floats mean = sine * scale / (float)m;
    c[2 * m - 1] = active ? mean * state->sum[2 * m - 1] : floats(0.0f);
    c[2 * m] = active ? mean * state->sum[2 * m] : floats(0.0f);
    const Floats next = twice * sine - sine_before;
    sine_before = sine;
    sine = next;
  }
#if TFM_OWN_DEPTH
  for (int j = 0; j < TFM_N_COEFF; ++j)
    c[j] += active ? state->in_places[j] : floats(0.0f);
#endif
}

/* The functions in the order of their frequencies, cosine first; for even M the first is 1. Twice the frequency: */
#define FREQUENCY(i) (ORDER % 2 ? 2 * ((i) / 2) + 1 : 2 * (((i) + 1) / 2))
#define IS_SINE(i) (ORDER % 2 ? (i) % 2 == 1 : (i) > 0 && (i) % 2 == 0)

/* Factors L D L^T of twice the matrix of the functions' products, the mean of 2 f_i f_j. */
typedef struct {
  Floats l[ORDER + 1][ORDER + 1]; /* below the diagonal */
  Floats inverse[ORDER + 1];      /* of D */
} Toeplitz;

/* re, im: moments of a distribution whose whole weight is 1, from 0 to M. */
TFM_INLINE Toeplitz factors_of(const Floats *re, const Floats *im)
{
  Toeplitz h;
  Floats products[ORDER + 1][ORDER + 1]; /* L D */
#pragma unroll
  for (int j = 0; j <= ORDER; ++j)
#pragma unroll
    for (int i = j; i <= ORDER; ++i) {
      /* Products of sines and cosines are sums of those at the sum and the difference of the frequencies. */
      const int high = (FREQUENCY(i) + FREQUENCY(j)) / 2, low = (FREQUENCY(i) - FREQUENCY(j)) / 2;
      Floats sum;
      if (IS_SINE(i))
        sum = IS_SINE(j) ? re[low] - re[high] : im[high] + im[low];
      else
        sum = IS_SINE(j) ? im[high] - im[low] : re[low] + re[high];
#pragma unroll
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

/* Solves L p = f. */
TFM_INLINE void orthogonal(const Toeplitz *h, const Floats *f, Floats *p)
{
#pragma unroll
  for (int i = 0; i <= ORDER; ++i) {
    p[i] = f[i];
#pragma unroll
    for (int k = 0; k < i; ++k)
      p[i] -= h->l[i][k] * p[k];
  }
}

/* The kernel at equal angles, of values by L. */
TFM_INLINE Floats squares_of(const Toeplitz *h, const Floats *p)
{
  Floats sum = floats(0.0f);
#pragma unroll
  for (int i = 0; i <= ORDER; ++i)
    sum += p[i] * p[i] * h->inverse[i];
  return sum;
}

/* Weight of a node at t: the largest that any distribution with these moments can have there. */
TFM_INLINE Floats weight_at(const Toeplitz *h, Floats t)
{
  const Floats whole = 1.0f + t * t;
  const Floats inverse = 1.0f / whole;
  const Floats cosine = (t * t - 1.0f) * inverse, sine = 2.0f * t * inverse; /* of a */
  Floats f[ORDER + 1], p[ORDER + 1];
#if ORDER == 3
  /* Of a / 2 and 3 a / 2, times the root of 1 + t^2. */
  const Floats square = whole;
  f[0] = t;
  f[1] = floats(1.0f);
  f[2] = t * cosine - sine;
  f[3] = t * sine + cosine;
#else
  const Floats square = floats(1.0f);
  f[0] = floats(1.0f);
  f[1] = cosine;
  f[2] = sine;
#if ORDER == 4
  f[3] = cosine * cosine - sine * sine;
  f[4] = 2.0f * cosine * sine;
#endif
#endif
  orthogonal(h, f, p);
  return 0.5f * square / squares_of(h, p);
}

/* x / y with y kept away from 0. */
TFM_INLINE Floats quotient(Floats x, Floats y)
{
  const Floats tiny = floats(1e-20f);
  return x / (y < 0.0f ? least(y, -tiny) : greatest(y, tiny));
}

/* Of the roots of t^n + p[0] t^(n-1) + ... + p[n-1], which must all be real: the outermost one on the side of 0 where
   their mean is. Laguerre's method begins at Samuelson's bound, which is its first step from infinity. It comes down to the
   root from outside, and triples the digits with each step. */
TFM_INLINE Floats outer_root(const Floats *p, int n)
{
  const float degree = (float)n;
  const Ints mirrored = p[0] > 0.0f;
  const Floats sign = mirrored ? floats(-1.0f) : floats(1.0f);
  const Floats mean = magnitude_of(p[0]) / degree;
  const Floats spread = (degree - 1.0f) * (degree - 1.0f) * mean * mean - 2.0f * (degree - 1.0f) / degree * p[1];
  Floats t = mean + root_of(greatest(spread, floats(0.0f)));
#pragma unroll
  for (int step = 0; step < LAGUERRE_STEPS; ++step) {
    Floats value = floats(1.0f), slope = floats(0.0f), bend = floats(0.0f); /* bend: half of the second derivative */
#pragma unroll
    for (int k = 0; k < n; ++k) {
      bend = bend * t + slope;
      slope = slope * t + value;
      value = value * t + (k % 2 ? p[k] : sign * p[k]);
    }
    const Floats under = (degree - 1.0f) * ((degree - 1.0f) * slope * slope - 2.0f * degree * value * bend);
    const Floats next = t - degree * quotient(value, slope + root_of(greatest(under, floats(0.0f))));
    t = least(greatest(next, mean), t);
  }
  return sign * t;
}

/* Divides such a polynomial by t - root: from the highest power downwards if the root is small, else from the lowest
   upwards, so that errors do not grow. */
TFM_INLINE void divide(const Floats *p, int n, Floats root, Floats *rest)
{
  Floats power = root;
#pragma unroll
  for (int k = 1; k < n; ++k)
    power *= root;
  const Ints large = magnitude_of(power) > magnitude_of(p[n - 1]);
  const Floats over = 1.0f / (large ? root : floats(1.0f));
  Floats up = floats(0.0f), down = floats(1.0f);
#pragma unroll
  for (int k = 0; k < n - 1; ++k) {
    down = down * root + p[k];
    rest[k] = down;
  }
#pragma unroll
  for (int k = n - 1; k > 0; --k) {
    up = (up - p[k]) * over;
    rest[k - 1] = large ? up : rest[k - 1];
  }
}

/* The roots of such a polynomial of degree M. */
TFM_INLINE void roots_of(const Floats *p, Floats *roots)
{
  Floats rest[ORDER];
  for (int k = 0; k < ORDER; ++k)
    rest[k] = p[k];
#pragma unroll
  for (int n = ORDER; n > 2; --n) {
    Floats whole[ORDER];
    for (int k = 0; k < n; ++k)
      whole[k] = rest[k];
    roots[n - 1] = outer_root(whole, n);
    divide(whole, n, roots[n - 1], rest);
  }
  const Floats root = root_of(greatest(rest[0] * rest[0] - 4.0f * rest[1], floats(0.0f)));
  const Floats q = -0.5f * (rest[0] + (rest[0] < 0.0f ? -root : root));
  roots[0] = q;
  roots[1] = quotient(rest[1], q);
#if ORDER > 2
  /* What divisions have rounded: a step of Newton's in the whole polynomial. A long one comes from a double root, whose
     place rounding decides anyway. */
#pragma unroll
  for (int i = 0; i < ORDER; ++i) {
    const Floats t = roots[i];
    Floats value = floats(1.0f), slope = floats(0.0f);
#pragma unroll
    for (int k = 0; k < ORDER; ++k) {
      slope = slope * t + value;
      value = value * t + p[k];
    }
    const Floats step = quotient(value, slope);
    roots[i] = magnitude_of(step) < 0.25f * (1.0f + magnitude_of(t)) ? t - step : t;
  }
#endif
}

/* Function of t that is below 0 where the angle, measured from the point, is beyond pi (turned - v). Its size is the sine
   of half the difference, times a factor that depends on t alone. */
TFM_INLINE Floats beyond(Floats v, float turned, Floats t)
{
  const Floats u = 0.5f * v + (1.0f - 0.5f * turned);
  return cos_pi(u) + t * sin_pi(u);
}

TFM_INLINE Floats basis_optical_depth(MAP map, __global const float *modes, const Floats *c,
                                      Floats v)
{
  (void)modes;
  /* Moments of a normalised distribution with a bias, turned so that the point is at 0. */
  const Ints some = c[0] > FLT_MIN;
  const Floats inverse = (1.0f - BIAS) / (some ? c[0] : floats(1.0f));
  Floats powers[TFM_N_COEFF - 1], re[ORDER + 1], im[ORDER + 1];
  circle_powers(v, powers);
  re[0] = floats(1.0f);
  im[0] = floats(0.0f);
#pragma unroll
  for (int m = 1; m <= ORDER; ++m) {
    const Floats x = inverse * c[2 * m - 1], y = inverse * c[2 * m];
    re[m] = x * powers[2 * m - 2] + y * powers[2 * m - 1];
    im[m] = y * powers[2 * m - 2] - x * powers[2 * m - 1];
  }
  const Toeplitz h = factors_of(re, im);

  /* K(0, a): the functions weighted by their values at 0, 1 of cosines, through the inverse matrix. */
  Floats f[ORDER + 1], p[ORDER + 1], dual[ORDER + 1], polynomial[ORDER], roots[ORDER];
#pragma unroll
  for (int i = 0; i <= ORDER; ++i)
    f[i] = floats(IS_SINE(i) ? 0.0f : 1.0f);
  orthogonal(&h, f, p);
#pragma unroll
  for (int i = ORDER; i >= 0; --i) {
    Floats sum = p[i] * h.inverse[i];
#pragma unroll
    for (int k = i + 1; k <= ORDER; ++k)
      sum -= h.l[k][i] * dual[k];
    dual[i] = sum;
  }
  const Floats own = 1.0f / squares_of(&h, p); /* leading coefficient of the polynomial, inverse */
#if ORDER == 2
  polynomial[0] = 2.0f * dual[2];
  polynomial[1] = dual[0] - dual[1];
#elif ORDER == 3
  polynomial[0] = dual[1] + 3.0f * dual[3];
  polynomial[1] = dual[0] - 3.0f * dual[2];
  polynomial[2] = dual[1] - dual[3];
#else
  polynomial[0] = 2.0f * dual[2] + 4.0f * dual[4];
  polynomial[1] = 2.0f * dual[0] - 6.0f * dual[3];
  polynomial[2] = 2.0f * dual[2] - 4.0f * dual[4];
  polynomial[3] = dual[0] - dual[1] + dual[3];
#endif
#pragma unroll
  for (int k = 0; k < ORDER; ++k)
    polynomial[k] *= own;
  roots_of(polynomial, roots);

  Floats before = floats(0.0f), nodes = floats(0.0f);
#pragma unroll
  for (int i = 0; i < ORDER; ++i) {
    /* None of a node in the first quarter of the zone is before the range, all of one in the last, and a part in
       between that rises with the angle. */
    const Floats first = beyond(v, 1.25f, roots[i]), last = beyond(v, 1.75f, roots[i]);
    const Ints within = (first < 0.0f) & (last > 0.0f);
    const Floats part = -first / (within ? last - first : floats(1.0f));
    const Floats share = within ? part : first < 0.0f ? floats(1.0f) : floats(0.0f);
    const Floats weight = weight_at(&h, roots[i]);
    nodes += weight;
    before += share * weight;
  }
  /* All weights are 1 together. Those of two nodes in nearly the same place depend on where rounding has left the roots. */
  const Floats of_point = least(0.5f * own, floats(1.0f));
  before = POINT_SHARE * of_point + (1.0f - of_point) * (before / nodes);
  const Floats depth = map->number_unit * c[0] * least(before, floats(1.0f));
  return some ? least(depth, floats(TFM_MAX_OPTICAL_DEPTH)) : floats(0.0f);
}

#endif
