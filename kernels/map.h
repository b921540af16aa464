/* The transmittance function map: n coefficients per texel in one of three storage types. They describe the optical
   depth over the range of the texel's light ray.
   Requires: TFM_N_COEFF; TFM_STORAGE_BITS 32, 16 or 8; TFM_RANGE, 0: the range lies between the medium's bounds, 1: it
   comes from a field of ranges; TFM_LOOKUP, 0: interpolate the coefficients, 1: reconstruct tau at four texels and
   interpolate it, 2: reconstruct tau at one of the four texels, chosen at random; a basis header. */
#ifndef TFM_MAP_H
#define TFM_MAP_H

#include "light/sample.h"
#include "texels.h"
#include "volume.h"

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
   ranges: for 8-bit storage, the lowest value and the extent of every coefficient over the map. */
TFM_INLINE void map_coefficients(__global const MapStorage *map, __global const float2 *ranges, int res,
                                 MapPosition at, Floats *c)
{
  /* A map of one texel has no neighbours; their weight would be 0. */
  const int dx = res > 1 ? TFM_N_COEFF : 0;
  const int dy = res > 1 ? res * TFM_N_COEFF : 0;
  int j = 0;
#if TFM_LANES == 1
  for (; j < TFM_N_COEFF; ++j)
    c[j] = bilinear1(map + (size_t)at.texel * TFM_N_COEFF + j, dx, dy, at.fx, at.fy);
#else
#define TEXEL(s) (map + (size_t)LANE(at.texel, s) * TFM_N_COEFF + j)
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
    c[j] = ranges[j].x + ranges[j].y / 255.0f * c[j];
#else
  (void)ranges;
#endif
}

/* Store one coefficient. */
TFM_INLINE void map_store(__global MapStorage *map, __global const float2 *ranges, size_t i, int j, float value)
{
#if TFM_STORAGE_BITS == 32
  (void)ranges;
  map[i] = value;
#elif TFM_STORAGE_BITS == 16
  (void)ranges;
  vstore_half(value, i, (__global half *)map);
#else
  const float extent = ranges[j].y > 0.0f ? ranges[j].y : 1.0f;
  map[i] = convert_uchar_sat_rte(255.0f * (value - ranges[j].x) / extent);
#endif
}

#ifdef TFM_BASIS_TABULATED
/* k coefficients of one lane, each multiplied by its function. */
#if TFM_STORAGE_BITS == 8
#define LOW1(ranges) ((ranges)[0].x)
#define EXTENT1(ranges) ((ranges)[0].y)
#define LOW2(ranges) ((*(__global const Unaligned4 *)(ranges)).even)
#define EXTENT2(ranges) ((*(__global const Unaligned4 *)(ranges)).odd)
#define LOW4(ranges) ((*(__global const Unaligned8 *)(ranges)).even)
#define EXTENT4(ranges) ((*(__global const Unaligned8 *)(ranges)).odd)
#define LOW8(ranges) ((*(__global const Unaligned16 *)(ranges)).even)
#define EXTENT8(ranges) ((*(__global const Unaligned16 *)(ranges)).odd)
#define UNSCALED(k, ranges, number) (LOW##k(ranges) + EXTENT##k(ranges) * (1.0f / 255.0f) * (number))
#else
#define UNSCALED(k, ranges, number) (number)
#endif
typedef float Unaligned1;
#define TERMS(k)                                                                                              \
  TFM_INLINE Loaded##k terms##k(__global const MapStorage *low, __global const float2 *ranges, int dx, int dy, \
                                float fx, float fy, __global const float *modes, float part)                  \
  {                                                                                                           \
    const Loaded##k mode = *(__global const Unaligned##k *)modes;                                             \
    const Loaded##k next = *(__global const Unaligned##k *)(modes + TFM_N_COEFF);                             \
    (void)ranges;                                                                                             \
    return UNSCALED(k, ranges, bilinear##k(low, dx, dy, fx, fy)) * (mode + part * (next - mode));             \
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
TFM_INLINE Floats map_series(__global const MapStorage *map, __global const float2 *ranges, int res, MapPosition at,
                             __global const float *modes, TablePlace place)
{
  const int dx = res > 1 ? TFM_N_COEFF : 0;
  const int dy = res > 1 ? res * TFM_N_COEFF : 0;
  Floats sum = floats(0.0f);
  int j = 0;
#define TERMS_OF(k, s)                                                                                         \
  terms##k(map + (size_t)LANE(at.texel, s) * TFM_N_COEFF + j, ranges + j, dx, dy, LANE(at.fx, s), LANE(at.fy, s), \
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

/* The part of a light ray within the medium: from k_in, or from the light if it is inside, to k_out. */
TFM_INLINE Ints light_medium_interval(PARAMS params, const GridRay *ray, Interval *k)
{
  k->begin = floats(0.0f);
  k->end = floats(INFINITY);
  return medium_clip(params, ray, k);
}

/* The part of a light ray that the coefficients describe, as distances from the light. */
typedef struct {
  Floats begin, end;
  Floats slope; /* optical depth of the density per unit length between the end and the last density */
  Floats last;  /* distance of the last density */
} RayRange;

#if TFM_RANGE
/* The field of ranges is coarser than the map and continuous. Neighbouring texels therefore have nearly the same range,
   and their coefficients may be interpolated. field: begin, end, slope, last. */
TFM_INLINE RayRange map_range(PARAMS params, __global const float4 *field, Floats u, Floats v)
{
  const int res = params->field_res;
  const MapPosition at = map_position(res, u, v);
  RayRange range;
#if TFM_LANES == 1
  __global const float4 *low = field + at.texel;
  const float4 lower = low[0] + at.fx * (low[1] - low[0]);
  const float4 upper = low[res] + at.fx * (low[res + 1] - low[res]);
  const float4 both = lower + at.fy * (upper - lower);
  range.begin = both.x;
  range.end = both.y;
  range.slope = both.z;
  range.last = both.w;
#else
#define RANGES_ROW(s, dy) (*(__global const Unaligned8 *)(field + LANE(at.texel, s) + dy))
#define RANGE_PAIR(s) (RANGES_ROW(s, 0) + LANE(at.fy, s) * (RANGES_ROW(s, res) - RANGES_ROW(s, 0)))
#define RANGE_ROW(s) (RANGE_PAIR(s).lo + LANE(at.fx, s) * (RANGE_PAIR(s).hi - RANGE_PAIR(s).lo))
  const Floats r[4] = ROWS4(RANGE_ROW);
  TRANSPOSE4(r, range.begin, range.end, range.slope, range.last);
#endif
  return range;
}
#endif

/* Fraction of the map's width: far more than the rounding error of positions on its edge. */
#define EDGE_MARGIN 1e-3f

/* Where a point is looked up: a position between texels, and v in the range of its light ray. */
typedef struct {
  MapPosition position;
  Floats v;
  Floats beyond; /* optical depth of the density beyond the end of the range */
  Ints hit;      /* mask: there may be density between the light and the point */
} MapPlace;

/* point: world. The range is that of the ray through the point itself, so that v means the same for all the texels that
   are interpolated. */
TFM_INLINE MapPlace map_place(PARAMS params, __global const float4 *field, Vec3 point, LightSample sample)
{
  MapPlace place;
#if TFM_RANGE
  (void)point;
  const RayRange range = map_range(params, field, sample.u, sample.v);
  const Floats from_begin = sample.distance - range.begin;
  place.v = clamp_to(from_begin / (range.end - range.begin), 1.0f);
  place.beyond = greatest(least(sample.distance, range.last) - range.end, floats(0.0f)) * range.slope;
  place.hit = from_begin > 0.0f;
#else
  (void)field;
  const GridRay ray = index_ray(params, light_ray_to(params, point));
  Interval k;
  place.hit = light_medium_interval(params, &ray, &k);
  place.v = clamp_to((1.0f - k.begin) / (k.end - k.begin), 1.0f);
  place.beyond = floats(0.0f);
#endif
  /* Rays outside the map meet no medium. */
  place.hit &= (sample.u > -EDGE_MARGIN) & (sample.u < 1.0f + EDGE_MARGIN) & (sample.v > -EDGE_MARGIN) &
               (sample.v < 1.0f + EDGE_MARGIN);
  place.position = map_position(params->map_res, sample.u, sample.v);
  return place;
}

/* Optical depth at v from the coefficients at one position. */
TFM_INLINE Floats map_optical_depth_at(PARAMS params, __global const MapStorage *map,
                                       __global const float2 *ranges, __global const float *modes,
                                       MapPosition position, Floats v)
{
#ifdef TFM_BASIS_TABULATED
  return optical_depth_of_series(params, map_series(map, ranges, params->map_res, position, modes, table_place(v)));
#else
  Floats coefficients[TFM_N_COEFF];
  map_coefficients(map, ranges, params->map_res, position, coefficients);
  return basis_optical_depth(params, modes, coefficients, v);
#endif
}

#if TFM_LOOKUP
/* One of the four texels around a position. */
TFM_INLINE MapPosition map_corner(int res, MapPosition at, Ints right, Ints upper)
{
  MapPosition corner;
  corner.texel = res > 1 ? at.texel + (right ? ints(1) : ints(0)) + (upper ? ints(res) : ints(0)) : at.texel;
  corner.fx = corner.fy = floats(0.0f);
  /* Its neighbours are read too, with weight 0. The last texel of a row or column has none, so it is addressed as the
     neighbour of the one before it. */
  const Ints x = corner.texel % res, y = corner.texel / res;
  const Ints last_x = (x == res - 1) & (res > 1 ? -1 : 0), last_y = (y == res - 1) & (res > 1 ? -1 : 0);
  corner.texel -= (last_x ? ints(1) : ints(0)) + (last_y ? ints(res) : ints(0));
  corner.fx = last_x ? floats(1.0f) : floats(0.0f);
  corner.fy = last_y ? floats(1.0f) : floats(0.0f);
  return corner;
}

/* A pseudo-random number in [0, 1) from bits that differ between samples (the integer hash lowbias32). */
TFM_INLINE Floats noise_of(Ints bits)
{
  bits ^= (bits >> 16) & 0xffff;
  bits *= 0x7feb352d;
  bits ^= (bits >> 15) & 0x1ffff;
  bits *= (int)0x846ca68b;
  bits ^= (bits >> 16) & 0xffff;
  return TO_FLOATS((bits >> 8) & 0xffffff) * (1.0f / 16777216.0f);
}
#endif

/* Look up the optical depth of the density between the light and a point. */
TFM_INLINE Floats map_optical_depth(PARAMS params, __global const MapStorage *map,
                                    __global const float2 *ranges, __global const float *modes, MapPlace place)
{
#if TFM_LOOKUP == 0
  const Floats optical_depth = map_optical_depth_at(params, map, ranges, modes, place.position, place.v);
#else
  const MapPosition at = place.position;
#if TFM_LOOKUP == 1
  Floats optical_depth = floats(0.0f);
  for (int corner = 0; corner < 4; ++corner) {
    const int right = corner & 1, upper = corner >> 1;
    const Floats weight = (right ? at.fx : 1.0f - at.fx) * (upper ? at.fy : 1.0f - at.fy);
    const MapPosition texel = map_corner(params->map_res, at, ints(-right), ints(-upper));
    optical_depth += weight * map_optical_depth_at(params, map, ranges, modes, texel, place.v);
  }
#else
  const Floats x = noise_of(AS_INTS(at.fx) ^ (AS_INTS(place.v) * 3));
  const Floats y = noise_of(AS_INTS(at.fy) ^ (AS_INTS(place.v) * 5));
  const MapPosition texel = map_corner(params->map_res, at, x < at.fx, y < at.fy);
  const Floats optical_depth = map_optical_depth_at(params, map, ranges, modes, texel, place.v);
#endif
#endif
  return place.hit ? optical_depth + place.beyond : floats(0.0f);
}

#endif
