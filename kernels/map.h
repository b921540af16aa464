/* The transmittance function map: n coefficients a texel, in three types of storage, looked up bilinearly.
   Requires: TFM_N_COEFF; TFM_STORAGE_BITS 32, 16 or 8. */
#ifndef TFM_MAP_H
#define TFM_MAP_H

#include "light/sample.h"
#include "volume.h"

#if TFM_STORAGE_BITS == 32
typedef float MapStorage;
#elif TFM_STORAGE_BITS == 16
typedef half MapStorage;
#elif TFM_STORAGE_BITS == 8
typedef uchar MapStorage;
#else
#error "TFM_STORAGE_BITS must be 32, 16 or 8"
#endif

/* ranges: for 8 bits the lowest value and the extent of every coefficient over the map. */
inline float map_load(__global const MapStorage *map, __global const float2 *ranges, size_t texel, int j)
{
  const size_t i = texel * (size_t)TFM_N_COEFF + (size_t)j;
#if TFM_STORAGE_BITS == 32
  (void)ranges;
  return map[i];
#elif TFM_STORAGE_BITS == 16
  (void)ranges;
  return vload_half(i, map);
#else
  return ranges[j].x + ranges[j].y * ((float)map[i] / 255.0f);
#endif
}

inline void map_store(__global MapStorage *map, __global const float2 *ranges, size_t texel, int j, float value)
{
  const size_t i = texel * (size_t)TFM_N_COEFF + (size_t)j;
#if TFM_STORAGE_BITS == 32
  (void)ranges;
  map[i] = value;
#elif TFM_STORAGE_BITS == 16
  (void)ranges;
  vstore_half(value, i, map);
#else
  const float extent = ranges[j].y > 0.0f ? ranges[j].y : 1.0f;
  map[i] = convert_uchar_sat_rte(255.0f * (value - ranges[j].x) / extent);
#endif
}

/* The part of a light ray that lies in the medium: from k_in, or the light itself, to k_out. */
inline int light_medium_interval(__constant const Params *params, Ray ray_in_index_space, Interval *k)
{
  k->begin = 0.0f;
  k->end = INFINITY;
  return medium_clip(params, ray_in_index_space, k);
}

/* Optical depth of the density between the light and a point, from the map. The range k_in..k_out is that of
   the point's own ray, so that interpolated texels agree on what u means. */
inline float map_optical_depth(__constant const Params *params, __global const MapStorage *map,
                               __global const float2 *ranges, LightSample sample)
{
  Interval k;
  if (!light_medium_interval(params, index_ray(params, sample.ray), &k))
    return 0.0f;
  const float u = clamp((sample.distance - k.begin) / (k.end - k.begin), 0.0f, 1.0f);
  const int res = params->map_res;
  const float2 texel = clamp(sample.uv * (float)res - 0.5f, 0.0f, (float)(res - 1));
  const int2 low = convert_int2(texel);
  const int2 high = min(low + 1, res - 1);
  const float2 f = texel - convert_float2(low);
  const size_t row_low = (size_t)low.y * (size_t)res;
  const size_t row_high = (size_t)high.y * (size_t)res;
  float coefficients[TFM_N_COEFF];
  for (int j = 0; j < TFM_N_COEFF; ++j) {
    const float lower = lerp(map_load(map, ranges, row_low + (size_t)low.x, j),
                             map_load(map, ranges, row_low + (size_t)high.x, j), f.x);
    const float upper = lerp(map_load(map, ranges, row_high + (size_t)low.x, j),
                             map_load(map, ranges, row_high + (size_t)high.x, j), f.x);
    coefficients[j] = lerp(lower, upper, f.y);
  }
  return basis_optical_depth(params, coefficients, u);
}

#endif
