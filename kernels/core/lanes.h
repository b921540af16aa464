/* Explicit SIMD in plain OpenCL C: one work-item carries TFM_LANES rays. That is one ray on a GPU, whose hardware
   groups work-items, and on a CPU as many as fit one of its vector registers: 4, 8 or 16. The same source serves all
   cases, since operators, ternaries and conversions mean the same for scalars and vectors. Functions neither take nor return a
   vector wider than Floats, because how such a vector is passed depends on the processor that the compiler assumes.
   Masks are the results of comparisons; combine them with & | ! and select with ?:. Hot loops call no built-in
   functions: on a CPU, drivers compile these as real calls, which spill every register.
   Requires: TFM_LANES 1, 4, 8 or 16. TFM_NO_INLINE is for tools that interpret the compiled code. */
#ifndef TFM_LANES_H
#define TFM_LANES_H

#ifdef TFM_NO_INLINE
#define TFM_INLINE static
#else
#define TFM_INLINE static inline __attribute__((always_inline))
#endif

/* Bring what p points at near. OpenCL's prefetch() does nothing in PoCL. */
#if TFM_LANES > 1 && (defined(__x86_64__) || defined(__aarch64__))
#define PREFETCH(p) __builtin_prefetch(p)
#endif

#if TFM_LANES == 1
typedef float Floats;
typedef int Ints;
#define AS_FLOATS as_float
#define AS_INTS as_int
#define TO_FLOATS convert_float
#define TO_INTS convert_int
/* One expression per lane: OP(a, b, component). */
#define FOR_LANES(OP, a, b) OP(a, b, )
#define LANE(v, s) (v)
/* The lanes form a tile of TILE_WIDTH x TILE_HEIGHT texels or pixels. */
#define TILE_WIDTH 1
#define TILE_HEIGHT 1
#define LANE_X 0
#define LANE_Y 0
#elif TFM_LANES == 4
typedef float4 Floats;
typedef int4 Ints;
#define AS_FLOATS as_float4
#define AS_INTS as_int4
#define TO_FLOATS convert_float4
#define TO_INTS convert_int4
#define FOR_LANES(OP, a, b) (OP(a, b, s0), OP(a, b, s1), OP(a, b, s2), OP(a, b, s3))
#define LANE(v, s) ((v).s)
#define TILE_WIDTH 2
#define TILE_HEIGHT 2
#define LANE_X ((int4)(0, 1, 0, 1))
#define LANE_Y ((int4)(0, 0, 1, 1))
#elif TFM_LANES == 8
typedef float8 Floats;
typedef int8 Ints;
#define AS_FLOATS as_float8
#define AS_INTS as_int8
#define TO_FLOATS convert_float8
#define TO_INTS convert_int8
#define FOR_LANES(OP, a, b) \
  (OP(a, b, s0), OP(a, b, s1), OP(a, b, s2), OP(a, b, s3), OP(a, b, s4), OP(a, b, s5), OP(a, b, s6), OP(a, b, s7))
#define LANE(v, s) ((v).s)
#define TILE_WIDTH 4
#define TILE_HEIGHT 2
#define LANE_X ((int8)(0, 1, 2, 3, 0, 1, 2, 3))
#define LANE_Y ((int8)(0, 0, 0, 0, 1, 1, 1, 1))
#elif TFM_LANES == 16
typedef float16 Floats;
typedef int16 Ints;
#define AS_FLOATS as_float16
#define AS_INTS as_int16
#define TO_FLOATS convert_float16
#define TO_INTS convert_int16
#define FOR_LANES(OP, a, b) \
  (OP(a, b, s0), OP(a, b, s1), OP(a, b, s2), OP(a, b, s3), OP(a, b, s4), OP(a, b, s5), OP(a, b, s6), OP(a, b, s7), \
   OP(a, b, s8), OP(a, b, s9), OP(a, b, sa), OP(a, b, sb), OP(a, b, sc), OP(a, b, sd), OP(a, b, se), OP(a, b, sf))
#define LANE(v, s) ((v).s)
#define TILE_WIDTH 4
#define TILE_HEIGHT 4
#define LANE_X ((int16)(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3))
#define LANE_Y ((int16)(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3))
#else
#error "TFM_LANES must be 1, 4, 8 or 16"
#endif

/* The lanes as an array, for code outside the hot loops. */
typedef union {
  Floats lanes;
  float lane[TFM_LANES];
} FloatArray;

typedef union {
  Ints lanes;
  int lane[TFM_LANES];
} IntArray;

TFM_INLINE Floats floats(float x)
{
  return (Floats)(x);
}

TFM_INLINE Ints ints(int x)
{
  return (Ints)(x);
}

/* If a is NaN, the result is b. */
TFM_INLINE Floats least(Floats a, Floats b)
{
  return a < b ? a : b;
}

TFM_INLINE Floats greatest(Floats a, Floats b)
{
  return a > b ? a : b;
}

TFM_INLINE Floats lerp(Floats a, Floats b, Floats t)
{
  return a + t * (b - a);
}

/* Ceiling: the least integer >= x, for 0 <= x < 2^31. */
TFM_INLINE Ints rounded_up(Floats x)
{
  const Ints down = TO_INTS(x);
  return TO_FLOATS(down) < x ? down + 1 : down;
}

/* Floor: the greatest integer <= x, for |x| < 2^31. */
TFM_INLINE Ints rounded_down(Floats x)
{
  const Ints towards_zero = TO_INTS(x);
  return TO_FLOATS(towards_zero) > x ? towards_zero - 1 : towards_zero;
}

/* Reduce all lanes to one number by OP, halving the vector at each step. */
#if TFM_LANES == 1
#define FOLD_LANES(name, lanes, type, OP) \
  TFM_INLINE type name(lanes v)           \
  {                                       \
    return v;                             \
  }
#else
#if TFM_LANES == 4
#define FOUR_LANES(type, OP, v) const type##4 v4 = v
#elif TFM_LANES == 8
#define FOUR_LANES(type, OP, v) const type##4 v4 = OP((v).lo, (v).hi)
#else
#define FOUR_LANES(type, OP, v)          \
  const type##8 v8 = OP((v).lo, (v).hi); \
  const type##4 v4 = OP(v8.lo, v8.hi)
#endif
#define FOLD_LANES(name, lanes, type, OP) \
  TFM_INLINE type name(lanes v)           \
  {                                       \
    FOUR_LANES(type, OP, v);              \
    const type##2 v2 = OP(v4.lo, v4.hi);  \
    return OP(v2.lo, v2.hi);              \
  }
#endif
#define BITS_OF(a, b) ((a) | (b))
#define LEAST_OF(a, b) ((a) < (b) ? (a) : (b))
FOLD_LANES(or_of_lanes, Ints, int, BITS_OF)
FOLD_LANES(least_int, Ints, int, LEAST_OF)
FOLD_LANES(least_float, Floats, float, LEAST_OF)

TFM_INLINE float greatest_float(Floats v)
{
  return -least_float(-v);
}

TFM_INLINE int any_lane(Ints mask)
{
  return or_of_lanes(mask) != 0;
}

TFM_INLINE int all_lanes(Ints mask)
{
  return !any_lane(!mask);
}

/* pointer[index] in every lane. */
#define GATHER_ONE(p, i, s) (p)[LANE(i, s)]
TFM_INLINE Ints gather_ints(__global const int *p, Ints i)
{
  return (Ints)FOR_LANES(GATHER_ONE, p, i);
}

TFM_INLINE Floats gather_floats(__global const float *p, Ints i)
{
  return (Floats)FOR_LANES(GATHER_ONE, p, i);
}

/* Two floats per lane, PAIR(component), split into a vector of the first ones and a vector of the second ones. */
#if TFM_LANES == 1
#define SPLIT_PAIRS(PAIR, first, second) \
  do {                                   \
    const float2 pair = PAIR();          \
    first = pair.x;                      \
    second = pair.y;                     \
  } while (0)
#elif TFM_LANES == 4
#define SPLIT_PAIRS(PAIR, first, second)                                \
  do {                                                                  \
    const float8 pairs = (float8)(PAIR(s0), PAIR(s1), PAIR(s2), PAIR(s3)); \
    first = pairs.even;                                                 \
    second = pairs.odd;                                                 \
  } while (0)
#elif TFM_LANES == 8
#define SPLIT_PAIRS(PAIR, first, second)                                                                      \
  do {                                                                                                        \
    const float16 pairs = (float16)(PAIR(s0), PAIR(s1), PAIR(s2), PAIR(s3), PAIR(s4), PAIR(s5), PAIR(s6), PAIR(s7)); \
    first = pairs.even;                                                                                       \
    second = pairs.odd;                                                                                       \
  } while (0)
#else
#define SPLIT_PAIRS(PAIR, first, second)                                                                      \
  do {                                                                                                        \
    const float16 low_lanes = (float16)(PAIR(s0), PAIR(s1), PAIR(s2), PAIR(s3), PAIR(s4), PAIR(s5), PAIR(s6), PAIR(s7)); \
    const float16 high_lanes = (float16)(PAIR(s8), PAIR(s9), PAIR(sa), PAIR(sb), PAIR(sc), PAIR(sd), PAIR(se), PAIR(sf)); \
    first = (float16)(low_lanes.even, high_lanes.even);                                                                   \
    second = (float16)(low_lanes.odd, high_lanes.odd);                                                                    \
  } while (0)
#endif

#endif
