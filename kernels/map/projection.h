/* From the steps of a light ray to the numbers of its texel, for every basis whose target is a sum of functions
   (TFM eq. 8-10 with f = T^(1/alpha), tau or sigma; FOM eq. 1-3).

   L2: every number is a linear functional of the target, which changes only where there is density. Summed by
   parts over M steps, (1/M) sum_n f_n a_j(v_n) = sum_n (f_n - f_(n-1)) S_j(n) with S_j(n) = (1/M) sum_(k >= n) a_j(v_k):
   empty steps cost nothing.

   Visibility: least squares of the target with the weight of the light that a step loses, w = D T^2 dv (to first
   order the squared error of T, where there is density to light), normalised, and a uniform share s. Within a
   step of constant density the integral of w is (T_begin^2 - T_end^2) / 2.

   table  for the march's number of steps M: L2: [M][n], S (or a, where the target is the extinction, which is not
          summed by parts). visibility: the products B_i B_j (i >= j) averaged over the steps, then [M] rows of S[n],
          B[n] and B_i B_j. Products come in whole SUMS_BLOCKs.
   Requires: TFM_N_COEFF; TFM_TARGET, one of the three below; TFM_FIT 0 (L2) or 1 (visibility); TFM_OWN_DEPTH, 1 where
   primitives are not marched (own_depth.h). */
#ifndef TFM_PROJECTION_H
#define TFM_PROJECTION_H

#include "../body/walk.h"

#define PRODUCTS (TFM_N_COEFF * (TFM_N_COEFF + 1) / 2)
#define WHOLE_PRODUCTS ((PRODUCTS + SUMS_BLOCK - 1) / SUMS_BLOCK * SUMS_BLOCK)

/* Steps of the march, in order: all with density, and the one after each. */
typedef struct {
  int count;
  int n[MOST_STEPS];         /* their numbers */
  Floats before[MOST_STEPS]; /* optical depth of the density up to the step */
  Floats depth[MOST_STEPS];  /* and along it */
} LightSteps;

/* The coefficients of a ray that meets nothing, T = 1: 0, but for the series of f itself whose first function is 1. */
TFM_INLINE float clear_coefficient(int j)
{
#if TFM_TARGET == TARGET_TRANSMITTANCE && defined(TFM_BASIS_HAS_ONE)
  return j == 0 ? 1.0f : 0.0f;
#else
  (void)j;
  return 0.0f;
#endif
}

#ifndef TFM_BASIS_OWN_STATE

/* Of few coefficients, what the loops below work on stays in registers. */
#if TFM_N_COEFF <= 8
#define UNROLL_IF_FEW _Pragma("unroll")
#else
#define UNROLL_IF_FEW
#endif

typedef struct {
  Floats sum[TFM_N_COEFF];
  Floats value; /* of the target in the step before: 1 - f, which keeps its digits in thin media, or tau */
#if TFM_FIT
  Floats weighted[TFM_N_COEFF]; /* sums of w f B */
  Floats gram[WHOLE_PRODUCTS];  /* sums of w B_i B_j */
  Floats weight;
  Floats left; /* T^2 before the next step */
#endif
} BasisState;

TFM_INLINE void basis_begin(BasisState *state)
{
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->sum[j] = floats(0.0f);
  state->value = floats(0.0f);
#if TFM_FIT
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->weighted[j] = floats(0.0f);
  for (int j = 0; j < WHOLE_PRODUCTS; ++j)
    state->gram[j] = floats(0.0f);
  state->weight = floats(0.0f);
  state->left = floats(1.0f);
#endif
}

TFM_INLINE Floats target_value(MAP map, Floats optical_depth)
{
#if TFM_TARGET == TARGET_TRANSMITTANCE
  return opacity_of(optical_depth * map->inverse_weighting);
#else
  (void)map;
  return optical_depth;
#endif
}

#if TFM_FIT
#define TABLE_HEAD WHOLE_PRODUCTS
#define TABLE_ROW (2 * TFM_N_COEFF + WHOLE_PRODUCTS)
/* The weight of a step; for f = T^(1/alpha) an error counts (alpha / f)^2 times. lost: the part of T^2 that the step
   takes; left: T^2 before the next step. */
TFM_INLINE Floats visibility(MAP map, Floats before, Floats lost, Floats *left)
{
#if TFM_TARGET == TARGET_TRANSMITTANCE
  (void)left;
  const float extinction = map->reference_extinction;
  const float rate = extinction > map->inverse_weighting ? extinction - map->inverse_weighting : 0.0f;
  return transmittance_of(2.0f * rate * before) * lost;
#else
  (void)map;
  (void)before;
  const Floats weight = *left * lost;
  *left -= weight;
  return weight;
#endif
}
#else
#define TABLE_HEAD 0
#define TABLE_ROW TFM_N_COEFF
#endif

/* Adds factor[k] * rows[k][j] to `count` sums, as many at a time as registers hold; in the steps' order, so that a step
   that weighs nothing leaves no trace in the sums' rounding. */
TFM_INLINE void add_steps(Floats *sums, int count, const Floats *factor, __global const float *const *rows, int column)
{
  for (int first = 0; first < count; first += SUMS_BLOCK) {
    Floats sum[SUMS_BLOCK];
#pragma unroll
    for (int j = 0; j < SUMS_BLOCK; ++j)
      if (first + j < count)
        sum[j] = sums[first + j];
#pragma unroll
    for (int k = 0; k < MOST_STEPS; ++k)
#pragma unroll
      for (int j = 0; j < SUMS_BLOCK; ++j)
        if (first + j < count)
          sum[j] += factor[k] * rows[k][column + first + j];
#pragma unroll
    for (int j = 0; j < SUMS_BLOCK; ++j)
      if (first + j < count)
        sums[first + j] = sum[j];
  }
}

TFM_INLINE void basis_steps(MAP map, __global const float *table, BasisState *state, const LightSteps *steps, int most)
{
  (void)most;
  __global const float *rows[MOST_STEPS];
  Floats factor[MOST_STEPS];
#if TFM_FIT
  Floats weight[MOST_STEPS], weighted[MOST_STEPS], lost[MOST_STEPS];
  /* Of all that there is room for: straight code has its constants in registers. */
  const float twice = 2.0f * map->reference_extinction;
#pragma unroll
  for (int k = 0; k < MOST_STEPS; ++k)
    lost[k] = opacity_of(twice * (k < steps->count ? steps->depth[k] : floats(0.0f)));
#endif
  /* In one loop, as each step has to wait for the one before it. */
  for (int k = 0; k < steps->count; ++k) {
    rows[k] = table + TABLE_HEAD + steps->n[k] * TABLE_ROW;
#if TFM_TARGET == TARGET_EXTINCTION && !TFM_FIT
    factor[k] = steps->depth[k];
#else
    const Floats value = target_value(map, steps->before[k] + 0.5f * steps->depth[k]);
    factor[k] = value - state->value;
    state->value = value;
#endif
#if TFM_FIT
    weight[k] = visibility(map, steps->before[k], lost[k], &state->left);
    state->weight += weight[k];
    weighted[k] = weight[k] * value;
#endif
  }
  /* Always as many terms, so that the sums below are straight: what is not there weighs nothing. */
  for (int k = steps->count; k < MOST_STEPS; ++k) {
    rows[k] = rows[0];
    factor[k] = floats(0.0f);
#if TFM_FIT
    weight[k] = weighted[k] = floats(0.0f);
#endif
  }
  add_steps(state->sum, TFM_N_COEFF, factor, rows, 0);
#if TFM_FIT
  add_steps(state->weighted, TFM_N_COEFF, weighted, rows, TFM_N_COEFF);
  add_steps(state->gram, WHOLE_PRODUCTS, weight, rows, 2 * TFM_N_COEFF);
#endif
}

#if TFM_OWN_DEPTH
/* Adds an optical depth that lies at v. table: [OWN_DEPTH_ROWS][n], as of a march of so many steps; no fit. */
TFM_INLINE void basis_deposit(__global const float *table, BasisState *state, Floats v, Floats depth)
{
  /* Rows stand for the middles of the steps. */
  const Floats place = v * (float)OWN_DEPTH_ROWS - 0.5f;
  const Ints row = TO_INTS(clamp_to(place, (float)(OWN_DEPTH_ROWS - 2)));
  const Floats behind = depth * (place - TO_FLOATS(row)), near = depth - behind;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    state->sum[j] += near * gather_floats(table, TFM_N_COEFF * row + j) +
                     behind * gather_floats(table, TFM_N_COEFF * (row + 1) + j);
}
#endif

TFM_INLINE void basis_finish(MAP map, __global const float *table, Ints active,
                             const BasisState *state, int most, Floats *c)
{
  (void)most;
#if TFM_FIT
  /* Normal equations by Cholesky's method, in place: row i of the lower triangle begins at i (i + 1) / 2. */
  const Ints seen = active & (state->weight > 0.0f);
  const float share = map->uniform_share;
  const Floats scale = seen ? (1.0f - share) / state->weight : floats(0.0f);
  Floats l[PRODUCTS];
  for (int j = 0; j < PRODUCTS; ++j)
    l[j] = scale * state->gram[j] + share * table[j];
  Floats trace = floats(0.0f);
  UNROLL_IF_FEW
  for (int i = 0; i < TFM_N_COEFF; ++i)
    trace += l[i * (i + 1) / 2 + i];
  const Floats ridge = (TFM_RIDGE / TFM_N_COEFF) * trace;
  Floats inverse[TFM_N_COEFF];
  UNROLL_IF_FEW
  for (int i = 0; i < TFM_N_COEFF; ++i) {
    const int row = i * (i + 1) / 2;
    UNROLL_IF_FEW
    for (int j = 0; j < i; ++j) {
      Floats sum = l[row + j];
      UNROLL_IF_FEW
      for (int k = 0; k < j; ++k)
        sum -= l[row + k] * l[j * (j + 1) / 2 + k];
      l[row + j] = sum * inverse[j];
    }
    Floats diagonal = l[row + i] + ridge;
    UNROLL_IF_FEW
    for (int k = 0; k < i; ++k)
      diagonal -= l[row + k] * l[row + k];
    inverse[i] = reciprocal_sqrt(greatest(diagonal, ridge));
  }
  UNROLL_IF_FEW
  for (int i = 0; i < TFM_N_COEFF; ++i) {
    Floats sum = scale * state->weighted[i] + share * state->sum[i];
    UNROLL_IF_FEW
    for (int k = 0; k < i; ++k)
      sum -= l[i * (i + 1) / 2 + k] * c[k];
    c[i] = sum * inverse[i];
  }
  UNROLL_IF_FEW
  for (int i = TFM_N_COEFF - 1; i >= 0; --i) {
    Floats sum = c[i];
    UNROLL_IF_FEW
    for (int k = i + 1; k < TFM_N_COEFF; ++k)
      sum -= l[k * (k + 1) / 2 + i] * c[k];
    c[i] = sum * inverse[i];
  }
#else
  (void)map;
  (void)table;
  for (int j = 0; j < TFM_N_COEFF; ++j)
    c[j] = state->sum[j];
#endif
  for (int j = 0; j < TFM_N_COEFF; ++j) {
#if TFM_TARGET == TARGET_TRANSMITTANCE && defined(TFM_BASIS_HAS_ONE)
    c[j] = clear_coefficient(j) - c[j]; /* of f instead of 1 - f */
#endif
    c[j] = active ? c[j] : floats(clear_coefficient(j));
  }
}

#endif

/* What a series means: f itself where the basis has the function 1, else 1 - f. A truncated series leaves [0, 1]:
   clamped before the power (eq. 20), where a negative value would come back as a bright ghost. */
TFM_INLINE Floats optical_depth_of_series(MAP map, Floats sum)
{
#if TFM_TARGET == TARGET_TRANSMITTANCE
#ifdef TFM_BASIS_HAS_ONE
  const Floats f = sum;
#else
  const Floats f = 1.0f - sum;
#endif
  return -map->density_weighting * log_of(least(greatest(f, floats(FLT_MIN)), floats(1.0f)));
#else
  return least(greatest(map->number_unit * sum, floats(0.0f)), floats(TFM_MAX_OPTICAL_DEPTH));
#endif
}

#endif
