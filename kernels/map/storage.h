/* A transmittance function map in memory: n coefficients per texel, in three types of storage, interpolated between
   texels. How a lane's coefficients come together is all here; the look-up reads as the paper does (lookup.h).
   Requires: TFM_N_COEFF; TFM_STORAGE_BITS 32, 16 or 8; a basis header. */
#ifndef TFM_MAP_STORAGE_H
#define TFM_MAP_STORAGE_H

#include "core/texels.h"

/* Vectors of coefficients in memory are aligned like their elements only. */
#if TFM_STORAGE_BITS == 32
typedef float MapStorage;
typedef float2 Stored2 __attribute__((aligned(4)));
typedef float4 Stored4 __attribute__((aligned(4)));
typedef float8 Stored8 __attribute__((aligned(4)));
typedef float16 Stored16 __attribute__((aligned(4)));
#elif TFM_STORAGE_BITS == 16
typedef ushort MapStorage;
typedef ushort2 Stored2 __attribute__((aligned(2)));
typedef ushort4 Stored4 __attribute__((aligned(2)));
typedef ushort8 Stored8 __attribute__((aligned(2)));
typedef ushort16 Stored16 __attribute__((aligned(2)));
#elif TFM_STORAGE_BITS == 8
typedef uchar MapStorage;
typedef uchar2 Stored2 __attribute__((aligned(1)));
typedef uchar4 Stored4 __attribute__((aligned(1)));
typedef uchar8 Stored8 __attribute__((aligned(1)));
typedef uchar16 Stored16 __attribute__((aligned(1)));
#else
#error "TFM_STORAGE_BITS must be 32, 16 or 8"
#endif
typedef MapStorage Stored1;
typedef float Loaded1;
typedef float2 Loaded2;
typedef float4 Loaded4;
typedef float8 Loaded8;
typedef float2 Unaligned2 __attribute__((aligned(4)));
typedef float4 Unaligned4 __attribute__((aligned(4)));
typedef float8 Unaligned8 __attribute__((aligned(4)));
typedef float16 Unaligned16 __attribute__((aligned(4)));

#if TFM_STORAGE_BITS == 32
#define DECODE(k, stored) (stored)
#elif TFM_STORAGE_BITS == 16
/* The bits of a half, shifted into place, are a float that is too small by a factor of 2^112. Coefficients are
   finite. */
#define SHIFTED_(k, bits) as_float##k((((bits) & 0x7fff) << 13) | (((bits) & 0x8000) << 16))
#define DECODE_(k, bits) (0x1p112f * SHIFTED_(k, bits))
#define as_float1 as_float
#define convert_uint1 convert_uint
#define DECODE(k, stored) DECODE_(k, convert_uint##k(stored))
#else
/* As a fraction of the coefficient's range. */
#define convert_float1 convert_float
#define DECODE(k, stored) convert_float##k(stored)
#endif

/* k coefficients of one lane, interpolated between four texels. */
#define BILINEAR(k)                                                                                           \
  TFM_INLINE Loaded##k bilinear##k(__global const MapStorage *low, int dx, int dy, float fx, float fy)        \
  {                                                                                                           \
    const Loaded##k low_low = DECODE(k, *(__global const Stored##k *)low);                                    \
    const Loaded##k low_high = DECODE(k, *(__global const Stored##k *)(low + dx));                            \
    const Loaded##k high_low = DECODE(k, *(__global const Stored##k *)(low + dy));                            \
    const Loaded##k high_high = DECODE(k, *(__global const Stored##k *)(low + dy + dx));                      \
    const Loaded##k lower = low_low + fx * (low_high - low_low);                                              \
    const Loaded##k upper = high_low + fx * (high_high - high_low);                                           \
    return lower + fy * (upper - lower);                                                                      \
  }
BILINEAR(1)
#if TFM_LANES > 1
BILINEAR(2)
BILINEAR(4)
#endif
#if TFM_LANES >= 8
#if TFM_N_COEFF == 8
/* Neighbours in x are adjacent in memory, so one load reads both. */
TFM_INLINE float8 bilinear8(__global const MapStorage *low, int dx, int dy, float fx, float fy)
{
  const Stored16 lower = *(__global const Stored16 *)low;
  const Stored16 upper = *(__global const Stored16 *)(low + dy);
  const float8 lower_left = DECODE(8, lower.lo), lower_right = DECODE(8, lower.hi);
  const float8 left = lower_left + fy * (DECODE(8, upper.lo) - lower_left);
  const float8 right = lower_right + fy * (DECODE(8, upper.hi) - lower_right);
  (void)dx;
  return left + fx * (right - left);
}
#else
BILINEAR(8)
#endif
#endif

/* The rows of k coefficients of all lanes are joined to vectors and transposed by splitting even from odd places. */
#if TFM_LANES > 1
#if TFM_LANES == 16
#define ROWS8(R) {(Floats)(R(s0), R(s1)), (Floats)(R(s2), R(s3)), (Floats)(R(s4), R(s5)), (Floats)(R(s6), R(s7)), \
                  (Floats)(R(s8), R(s9)), (Floats)(R(sa), R(sb)), (Floats)(R(sc), R(sd)), (Floats)(R(se), R(sf))}
#define ROWS4(R) {(Floats)(R(s0), R(s1), R(s2), R(s3)), (Floats)(R(s4), R(s5), R(s6), R(s7)), \
                  (Floats)(R(s8), R(s9), R(sa), R(sb)), (Floats)(R(sc), R(sd), R(se), R(sf))}
#define ROWS2(R) {(Floats)(R(s0), R(s1), R(s2), R(s3), R(s4), R(s5), R(s6), R(s7)), \
                  (Floats)(R(s8), R(s9), R(sa), R(sb), R(sc), R(sd), R(se), R(sf))}
#elif TFM_LANES == 8
#define ROWS8(R) {R(s0), R(s1), R(s2), R(s3), R(s4), R(s5), R(s6), R(s7)}
#define ROWS4(R) {(Floats)(R(s0), R(s1)), (Floats)(R(s2), R(s3)), (Floats)(R(s4), R(s5)), (Floats)(R(s6), R(s7))}
#define ROWS2(R) {(Floats)(R(s0), R(s1), R(s2), R(s3)), (Floats)(R(s4), R(s5), R(s6), R(s7))}
#else
#define ROWS4(R) {R(s0), R(s1), R(s2), R(s3)}
#define ROWS2(R) {(Floats)(R(s0), R(s1)), (Floats)(R(s2), R(s3))}
#endif
#define EVEN(a, b) ((Floats)((a).even, (b).even))
#define ODD(a, b) ((Floats)((a).odd, (b).odd))
/* Transpose rows of four: one vector for each place. */
#define TRANSPOSE4(r, c0, c1, c2, c3)                                                                         \
  do {                                                                                                        \
    const Floats e0 = EVEN(r[0], r[1]), e1 = EVEN(r[2], r[3]), o0 = ODD(r[0], r[1]), o1 = ODD(r[2], r[3]);    \
    c0 = EVEN(e0, e1);                                                                                        \
    c1 = EVEN(o0, o1);                                                                                        \
    c2 = ODD(e0, e1);                                                                                         \
    c3 = ODD(o0, o1);                                                                                         \
  } while (0)
/* The sum of every row, from its even and its odd places. */
#define HALVED(a, b) (EVEN(a, b) + ODD(a, b))
#endif

/* All coefficients at a map position.
   limits: for 8 bits the lowest value and the extent of every coefficient over the map. */
TFM_INLINE void map_coefficients(__global const MapStorage *numbers, __global const float2 *limits, int res,
                                 MapPosition at, Floats *c)
{
  /* A map of one texel has no neighbours; their weight would be 0. */
  const int dx = res > 1 ? TFM_N_COEFF : 0;
  const int dy = res > 1 ? res * TFM_N_COEFF : 0;
  int j = 0;
#if TFM_LANES == 1
  for (; j < TFM_N_COEFF; ++j)
    c[j] = bilinear1(numbers + (size_t)at.texel * TFM_N_COEFF + j, dx, dy, at.fx, at.fy);
#else
#define TEXEL(s) (numbers + (size_t)LANE(at.texel, s) * TFM_N_COEFF + j)
#define ROW8(s) bilinear8(TEXEL(s), dx, dy, LANE(at.fx, s), LANE(at.fy, s))
#define ROW4(s) bilinear4(TEXEL(s), dx, dy, LANE(at.fx, s), LANE(at.fy, s))
#define ROW2(s) bilinear2(TEXEL(s), dx, dy, LANE(at.fx, s), LANE(at.fy, s))
#define ROW1(p, i, s) bilinear1(TEXEL(s), dx, dy, LANE(at.fx, s), LANE(at.fy, s))
#if TFM_LANES >= 8
  for (; j + 8 <= TFM_N_COEFF; j += 8) {
    const Floats r[8] = ROWS8(ROW8);
    const Floats e0 = EVEN(r[0], r[1]), e1 = EVEN(r[2], r[3]), e2 = EVEN(r[4], r[5]), e3 = EVEN(r[6], r[7]);
    const Floats o0 = ODD(r[0], r[1]), o1 = ODD(r[2], r[3]), o2 = ODD(r[4], r[5]), o3 = ODD(r[6], r[7]);
    const Floats ee0 = EVEN(e0, e1), ee1 = EVEN(e2, e3), eo0 = ODD(e0, e1), eo1 = ODD(e2, e3);
    const Floats oe0 = EVEN(o0, o1), oe1 = EVEN(o2, o3), oo0 = ODD(o0, o1), oo1 = ODD(o2, o3);
    c[j] = EVEN(ee0, ee1);
    c[j + 1] = EVEN(oe0, oe1);
    c[j + 2] = EVEN(eo0, eo1);
    c[j + 3] = EVEN(oo0, oo1);
    c[j + 4] = ODD(ee0, ee1);
    c[j + 5] = ODD(oe0, oe1);
    c[j + 6] = ODD(eo0, eo1);
    c[j + 7] = ODD(oo0, oo1);
  }
#endif
  for (; j + 4 <= TFM_N_COEFF; j += 4) {
    const Floats r[4] = ROWS4(ROW4);
    TRANSPOSE4(r, c[j], c[j + 1], c[j + 2], c[j + 3]);
  }
#if TFM_N_COEFF & 2
  {
    const Floats r[2] = ROWS2(ROW2);
    c[j] = EVEN(r[0], r[1]);
    c[j + 1] = ODD(r[0], r[1]);
    j += 2;
  }
#endif
#if TFM_N_COEFF & 1
  c[j] = (Floats)FOR_LANES(ROW1, 0, 0);
#endif
#endif
#if TFM_STORAGE_BITS == 8
  for (j = 0; j < TFM_N_COEFF; ++j)
    c[j] = limits[j].x + limits[j].y / 255.0f * c[j];
#else
  (void)limits;
#endif
}

/* One coefficient to memory. */
TFM_INLINE void map_store(__global MapStorage *map, __global const float2 *limits, size_t i, int j, float value)
{
#if TFM_STORAGE_BITS == 32
  (void)limits;
  map[i] = value;
#elif TFM_STORAGE_BITS == 16
  (void)limits;
  vstore_half(value, i, (__global half *)map);
#else
  const float extent = limits[j].y > 0.0f ? limits[j].y : 1.0f;
  map[i] = convert_uchar_sat_rte(255.0f * (value - limits[j].x) / extent);
#endif
}

#ifdef TFM_BASIS_TABULATED
/* k coefficients of one lane, each multiplied by its function. */
#if TFM_STORAGE_BITS == 8
#define LOW1(limits) ((limits)[0].x)
#define EXTENT1(limits) ((limits)[0].y)
#define LOW2(limits) ((*(__global const Unaligned4 *)(limits)).even)
#define EXTENT2(limits) ((*(__global const Unaligned4 *)(limits)).odd)
#define LOW4(limits) ((*(__global const Unaligned8 *)(limits)).even)
#define EXTENT4(limits) ((*(__global const Unaligned8 *)(limits)).odd)
#define LOW8(limits) ((*(__global const Unaligned16 *)(limits)).even)
#define EXTENT8(limits) ((*(__global const Unaligned16 *)(limits)).odd)
#define UNSCALED(k, limits, number) (LOW##k(limits) + EXTENT##k(limits) * (1.0f / 255.0f) * (number))
#else
#define UNSCALED(k, limits, number) (number)
#endif
typedef float Unaligned1;
#define TERMS(k)                                                                                              \
  TFM_INLINE Loaded##k terms##k(__global const MapStorage *low, __global const float2 *limits, int dx, int dy, \
                                float fx, float fy, __global const float *modes, float part)                  \
  {                                                                                                           \
    const Loaded##k mode = *(__global const Unaligned##k *)modes;                                             \
    const Loaded##k next = *(__global const Unaligned##k *)(modes + TFM_N_COEFF);                             \
    (void)limits;                                                                                             \
    return UNSCALED(k, limits, bilinear##k(low, dx, dy, fx, fy)) * (mode + part * (next - mode));             \
  }
TERMS(1)
#if TFM_LANES > 1
TERMS(2)
TERMS(4)
#endif
#if TFM_LANES >= 8
TERMS(8)
#endif

/* The sum of the coefficients times the functions at place, without transposing the coefficients to lanes. */
TFM_INLINE Floats map_series(__global const MapStorage *numbers, __global const float2 *limits, int res, MapPosition at,
                             __global const float *modes, TablePlace place)
{
  const int dx = res > 1 ? TFM_N_COEFF : 0;
  const int dy = res > 1 ? res * TFM_N_COEFF : 0;
  Floats sum = floats(0.0f);
  int j = 0;
#define TERMS_OF(k, s)                                                                                         \
  terms##k(numbers + (size_t)LANE(at.texel, s) * TFM_N_COEFF + j, limits + j, dx, dy, LANE(at.fx, s), LANE(at.fy, s), \
           modes + LANE(place.row, s) * TFM_N_COEFF + j, LANE(place.part, s))
#if TFM_LANES == 1
  for (; j < TFM_N_COEFF; ++j)
    sum += TERMS_OF(1, );
#else
#define TERMS8(s) TERMS_OF(8, s)
#define TERMS4(s) TERMS_OF(4, s)
#define TERMS2(s) TERMS_OF(2, s)
#define TERMS1(p, i, s) TERMS_OF(1, s)
#if TFM_LANES >= 8
  for (; j + 8 <= TFM_N_COEFF; j += 8) {
    const Floats r[8] = ROWS8(TERMS8);
    sum += HALVED(HALVED(HALVED(r[0], r[1]), HALVED(r[2], r[3])), HALVED(HALVED(r[4], r[5]), HALVED(r[6], r[7])));
  }
#endif
  for (; j + 4 <= TFM_N_COEFF; j += 4) {
    const Floats r[4] = ROWS4(TERMS4);
    sum += HALVED(HALVED(r[0], r[1]), HALVED(r[2], r[3]));
  }
#if TFM_N_COEFF & 2
  {
    const Floats r[2] = ROWS2(TERMS2);
    sum += HALVED(r[0], r[1]);
    j += 2;
  }
#endif
#if TFM_N_COEFF & 1
  sum += (Floats)FOR_LANES(TERMS1, 0, 0);
#endif
#endif
  return sum;
}
#endif

#endif
