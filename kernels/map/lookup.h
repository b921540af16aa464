/* Transmittance function maps: optical depth of a field's density between a light and a point, from the coefficients of
   the light ray's texel, over the range of the ray in which there is something to say.
   Requires: what storage.h and grid.h do; TFM_RANGE, 0: between the grids' bounds, 1: each ray's own; TFM_LOOKUP, 0:
   interpolate the coefficients, 1: reconstruct at four texels and interpolate tau, 2: one of the four, at random;
   TFM_SHOW_RESIDUAL, if 1, maps of residuals, which rays without a range have too; a light header. */
#ifndef TFM_MAP_LOOKUP_H
#define TFM_MAP_LOOKUP_H

#include "body/grid.h"
#include "light/sample.h"
#include "map/storage.h"

/* Any number of maps, one after the other.
   numbers  coefficients, [res, res, n] each
   limits   for 8 bits the lowest value and the extent of every coefficient
   ranges   of the light rays, [range_res, range_res] each: begin, end, slope, last
   modes    what each basis needs to evaluate its functions */
#define MAP_ARGUMENTS                                                                                          \
  MAP maps, __global const MapStorage *numbers, __global const float2 *limits, __global const float4 *ranges,  \
      __global const float *modes
#define MAP_BUFFERS                          \
  {                                          \
    maps, numbers, limits, ranges, modes     \
  }

typedef struct {
  MAP of;
  __global const MapStorage *numbers;
  __global const float2 *limits;
  __global const float4 *ranges;
  __global const float *modes;
} Maps;

TFM_INLINE __global const MapStorage *numbers_of(const Maps *maps, MAP map)
{
  return maps->numbers + (size_t)map->first_number * NUMBERS_UNIT;
}

/* The part of a light ray that the coefficients describe, as distances from the light. */
typedef struct {
  Floats begin, end;
  Floats slope; /* optical depth of the density per unit length between the end and the last density */
  Floats last;  /* where that is */
} RayRange;

#if TFM_RANGE
/* The ranges are coarser than the map and continuous, so that neighbouring texels speak of nearly the same range and
   their coefficients may be interpolated. */
TFM_INLINE RayRange map_range(MAP map, __global const float4 *ranges, Floats u, Floats v)
{
  const int res = map->range_res;
  __global const float4 *field = ranges + map->first_range;
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

/* Where a point is looked up: a position between texels, and v in the range of its light ray. */
typedef struct {
  MapPosition position;
  Floats v;
  Floats beyond; /* optical depth of the density beyond the end of the range */
  Ints hit;      /* mask: there may be density between the light and the point */
} MapPlace;

/* point: world. The range is that of the ray through the point itself, so that v means the same for all the texels that
   are interpolated. */
TFM_INLINE MapPlace map_place(GRID grids, LIGHT light, const Maps *maps, MAP map, Vec3 point, LightSample sample)
{
  MapPlace place;
#if TFM_RANGE
  (void)grids;
  (void)light;
  (void)point;
  const RayRange range = map_range(map, maps->ranges, sample.u, sample.v);
  const Floats from_begin = sample.distance - range.begin;
  place.v = clamp_to(from_begin / (range.end - range.begin), 1.0f);
  place.beyond = greatest(least(sample.distance, range.last) - range.end, floats(0.0f)) * range.slope;
  place.hit = from_begin > 0.0f;
#if !TFM_SHOW_RESIDUAL
  /* Texels without a range may hold anything (light_pass.cl covers no more than the others need). */
  place.hit &= range.begin < range.end;
#endif
#else
  (void)maps;
  const GridRay ray = index_ray(grids, light_ray_to(light, point));
  Interval k;
  place.hit = light_medium_interval(grids, &ray, &k);
  place.v = clamp_to((1.0f - k.begin) / (k.end - k.begin), 1.0f);
  place.beyond = floats(0.0f);
#endif
  /* Rays outside the map meet no medium. */
  place.hit &= (sample.u > -EDGE_MARGIN) & (sample.u < 1.0f + EDGE_MARGIN) & (sample.v > -EDGE_MARGIN) &
               (sample.v < 1.0f + EDGE_MARGIN);
  place.position = map_position(map->res, sample.u, sample.v);
  return place;
}

/* Asks for the coefficients around a place before they are needed: rays find them in no order that a cache expects. */
TFM_INLINE void map_prefetch(const Maps *maps, MAP map, MapPlace place)
{
#ifdef PREFETCH
  __global const MapStorage *numbers = numbers_of(maps, map);
  const int dy = map->res > 1 ? map->res * TFM_N_COEFF : 0;
  /* Two texels, side by side, from the first number to the last: often in two lines of the cache. */
#define TEXEL_NUMBER(s, j) (numbers + (size_t)LANE(place.position.texel, s) * TFM_N_COEFF + (j))
#define TEXEL_ROW(s, dy) (PREFETCH(TEXEL_NUMBER(s, dy)), PREFETCH(TEXEL_NUMBER(s, dy + 2 * TFM_N_COEFF - 1)))
#define TEXEL_ROWS(p, i, s) (TEXEL_ROW(s, 0), TEXEL_ROW(s, dy), 0)
  (void)(Ints)FOR_LANES(TEXEL_ROWS, 0, 0);
#undef TEXEL_ROWS
#undef TEXEL_ROW
#undef TEXEL_NUMBER
#else
  (void)maps;
  (void)map;
  (void)place;
#endif
}

/* Optical depth at v, of the coefficients at one position. */
TFM_INLINE Floats map_optical_depth_at(const Maps *maps, MAP map, MapPosition position, Floats v)
{
  __global const MapStorage *numbers = numbers_of(maps, map);
  __global const float2 *limits = maps->limits + map->first_limit;
  __global const float *modes = maps->modes + map->first_mode;
#ifdef TFM_BASIS_TABULATED
  return optical_depth_of_series(map, map_series(numbers, limits, map->res, position, modes, table_place(v)));
#else
  Floats coefficients[TFM_N_COEFF];
  map_coefficients(numbers, limits, map->res, position, coefficients);
  return basis_optical_depth(map, modes, coefficients, v);
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

/* Optical depth of the field between the light and a point, from the map. */
TFM_INLINE Floats map_optical_depth(const Maps *maps, MAP map, MapPlace place)
{
#if TFM_LOOKUP == 0
  const Floats optical_depth = map_optical_depth_at(maps, map, place.position, place.v);
#else
  const MapPosition at = place.position;
#if TFM_LOOKUP == 1
  Floats optical_depth = floats(0.0f);
  for (int corner = 0; corner < 4; ++corner) {
    const int right = corner & 1, upper = corner >> 1;
    const Floats weight = (right ? at.fx : 1.0f - at.fx) * (upper ? at.fy : 1.0f - at.fy);
    const MapPosition texel = map_corner(map->res, at, ints(-right), ints(-upper));
    optical_depth += weight * map_optical_depth_at(maps, map, texel, place.v);
  }
#else
  const Floats x = noise_of(AS_INTS(at.fx) ^ (AS_INTS(place.v) * 3));
  const Floats y = noise_of(AS_INTS(at.fy) ^ (AS_INTS(place.v) * 5));
  const MapPosition texel = map_corner(map->res, at, x < at.fx, y < at.fy);
  const Floats optical_depth = map_optical_depth_at(maps, map, texel, place.v);
#endif
#endif
  return place.hit ? optical_depth + place.beyond : floats(0.0f);
}

#endif
