/* The reduced intensity (TFM eq. 3): what is left of a light at a point after solids and the medium, from the map or,
   with TFM_METHOD_DUAL, by marching to the light: the reference.
   Includes expected before: Params, a basis and a light header.
   Requires: what they, map.h, shadow.h and volume.h do; TFM_METHOD_DUAL 0 or 1; TFM_TEXTURE 0 or 1. */
#ifndef TFM_REDUCED_INTENSITY_H
#define TFM_REDUCED_INTENSITY_H

#include "map.h"
#include "shadow.h"
#include "walk.h"
#if TFM_TEXTURE
#include "texture.h"
#endif

#ifndef TFM_METHOD_DUAL
#error "TFM_METHOD_DUAL must be 0 or 1"
#endif

/* What kernels take to find it. shadow: distances of solids; texture: RGB, what the light's intensity is multiplied
   by. Neither is read without TFM_SHADOW, TFM_TEXTURE. */
#define LIGHT_ARGUMENTS                                                                                        \
  __global const MapStorage *map, __global const float2 *ranges, __global const float4 *field,                 \
      __global const float *modes, __global const float *shadow, __global const float4 *texture

typedef struct {
  __global const MapStorage *map;
  __global const float2 *ranges;
  __global const float4 *field;
  __global const float *modes;
  __global const float *shadow;
  __global const float4 *texture;
} LightBuffers;

#define LIGHT_BUFFERS(buffers) const LightBuffers buffers = {map, ranges, field, modes, shadow, texture}

/* Where the optical depth between the light and a point is to be found. */
typedef struct {
#if TFM_METHOD_DUAL
  Vec3 point;
  Floats distance;
#else
  MapPlace place;
#endif
} LightPath;

TFM_INLINE LightPath light_path(PARAMS params, const LightBuffers *buffers, Vec3 point, LightSample light)
{
  LightPath path;
#if TFM_METHOD_DUAL
  (void)params;
  (void)buffers;
  path.point = point;
  path.distance = light.distance;
#else
  path.place = map_place(params, buffers->field, point, light);
#endif
  return path;
}

/* Optical depth of the density between the light and a point, in lanes that are wanted.
   samples: counts the densities read. */
TFM_INLINE Floats light_optical_depth(PARAMS params, const Grid *grid, const LightBuffers *buffers,
                                      const LightPath *path, Ints wanted, Ints *samples)
{
#if TFM_METHOD_DUAL
  (void)buffers;
  const GridRay ray = index_ray(params, light_ray_to(params, path->point));
  Interval k;
  const Ints lit = wanted & light_medium_interval(params, &ray, &k) & (k.begin < 1.0f);
  return path->distance * march_optical_depth(grid, &ray, k.begin, least(k.end, floats(1.0f)), params->light_steps,
                                              lit, samples);
#else
  (void)grid;
  (void)wanted;
  (void)samples;
  return map_optical_depth(params, buffers->map, buffers->ranges, buffers->modes, path->place);
#endif
}

/* What the light's texture multiplies its intensity by. */
TFM_INLINE void light_tint(PARAMS params, const LightBuffers *buffers, LightSample light, Floats *tint)
{
#if TFM_TEXTURE
  texture_at(buffers->texture + params->first_texel, params->texture_size[0], params->texture_size[1],
             light.texture_u, light.texture_v, tint);
#else
  (void)params;
  (void)buffers;
  (void)light;
  tint[0] = tint[1] = tint[2] = floats(1.0f);
#endif
}

#endif
