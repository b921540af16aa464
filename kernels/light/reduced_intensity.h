/* The reduced intensity (TFM eq. 3): what is left of a light at a point after solids and media, from the maps or, with
   TFM_METHOD_DUAL, by marching to the light: the reference.
   Includes expected before: a basis and a light header.
   Requires: what they, map/lookup.h, shadow.h, walk.h and homogeneous.h do; TFM_METHOD_DUAL 0 or 1; TFM_TEXTURE 0 or 1;
   TFM_FIELDS, the fields that every light has a map of, 0 without grids; TFM_SHOW_RESIDUAL, 1 where the maps hold their
   own errors, to be seen instead. */
#ifndef TFM_REDUCED_INTENSITY_H
#define TFM_REDUCED_INTENSITY_H

#include "light/shadow.h"
#include "view/camera_ray.h"
#if TFM_TEXTURE
#include "core/texture.h"
#endif

#ifndef TFM_METHOD_DUAL
#error "TFM_METHOD_DUAL must be 0 or 1"
#endif
#ifndef TFM_SHOW_RESIDUAL
#define TFM_SHOW_RESIDUAL 0
#endif
#define READS_MAPS (TFM_FIELDS && !TFM_METHOD_DUAL)
#define MEETS_PRIMITIVES (TFM_PRIMITIVES && TFM_METHOD_DUAL)
#if READS_MAPS
#include "map/lookup.h"
#endif

/* What kernels take to find it. shadow: distances of solids; texture: RGB, what the light's intensity is multiplied
   by. Neither is read without TFM_SHADOW, TFM_TEXTURE. */
#if READS_MAPS
#define LIGHT_ARGUMENTS MAP_ARGUMENTS, __global const float *shadow, __global const float4 *texture
#define LIGHT_BUFFERS(buffers) const LightBuffers buffers = {MAP_BUFFERS, shadow, texture}
#elif MEETS_PRIMITIVES
/* Which primitives the light's rays meet, as in primitive/lists.h; bins of one light after those of another. */
#define LIGHT_ARGUMENTS                                                                               \
  PRIMITIVE light_primitives, __global const float4 *light_balls, __global const int *light_starts,   \
      __global const int *light_members, int4 light_bins, __global const float *shadow,               \
      __global const float4 *texture
#define LIGHT_BUFFERS(buffers)                                                                                           \
  const LightBuffers buffers = {{light_primitives, light_balls, light_starts, light_members, light_bins, ints(-1)}, \
                                shadow, texture}
#else
#define LIGHT_ARGUMENTS __global const float *shadow, __global const float4 *texture
#define LIGHT_BUFFERS(buffers) const LightBuffers buffers = {shadow, texture}
#endif

typedef struct {
#if READS_MAPS
  Maps maps;
#elif MEETS_PRIMITIVES
  Lists lists;
#endif
  __global const float *shadow;
  __global const float4 *texture;
} LightBuffers;

/* Where the optical depths between the light and a point are to be found. */
typedef struct {
#if READS_MAPS
  MapPlace place[TFM_FIELDS];
#else
  Vec3 point;
  Floats distance;
#endif
#if MEETS_PRIMITIVES
  Ints bin;
#endif
#if TFM_BODIES
  Floats ways[TFM_BODIES]; /* of the light through those of constant density */
#endif
} LightPath;

/* inside: bits of the bodies that the point is known to lie in. is_far: the maps are hardly in the cache, and not read at
   once. */
TFM_INLINE LightPath light_path(const Scene *scene, LIGHT light, const LightBuffers *buffers, Vec3 point,
                                LightSample sample, int inside, int is_far)
{
  LightPath path;
#if READS_MAPS
  for (int k = 0; k < TFM_FIELDS; ++k) {
    MAP map = buffers->maps.of + light->first_map + k;
    path.place[k] = map_place(scene->grids, light, &buffers->maps, map, point, sample);
    if (is_far)
      map_prefetch(&buffers->maps, map, path.place[k]);
  }
#else
  (void)buffers;
  (void)is_far;
  path.point = point;
  path.distance = sample.distance;
#endif
#if MEETS_PRIMITIVES
  /* The light's texels are as many as bins have, all of which are whole: both are powers of two. */
  const int4 bins = buffers->lists.bins;
  const Ints bin = bin_of(bins, rounded_down(sample.u * (float)(bins.x << bins.z)),
                          rounded_down(sample.v * (float)(bins.y << bins.z)));
  path.bin = bin >= 0 ? bin + light->first_bin : bin;
#endif
#if TFM_BODIES
  ways_to_light(scene->bodies, light_ray_to(light, point), sample.distance, light->inside_bodies, inside,
                path.ways);
#else
  (void)scene;
  (void)inside;
#endif
  return path;
}

/* Optical depths between the light and a point, of each colour, in lanes that are wanted.
   samples: counts the densities read. */
TFM_INLINE void light_optical_depths(const Scene *scene, LIGHT light, const LightBuffers *buffers, const LightPath *path,
                                     Ints wanted, Ints *samples, Floats *depth)
{
#if TFM_FIELDS && TFM_METHOD_DUAL
  (void)buffers;
  const GridRay ray = index_ray(scene->grids, light_ray_to(light, path->point));
  Interval k;
  const Ints lit = wanted & light_medium_interval(scene->grids, &ray, &k) & (k.begin < 1.0f);
#if TFM_VOXEL_GRIDS
  Amounts met = march_amounts(scene->padded, &ray, k.begin, least(k.end, floats(1.0f)), scene->view->light_steps,
                              path->distance, lit, samples);
#else
  Amounts met = no_amounts();
  (void)samples;
#endif
#if MEETS_PRIMITIVES
  Lists lists = buffers->lists;
  lists.bin = path->bin;
  add_primitives(&lists, ray.world, k.begin, least(k.end, floats(1.0f)), lit, &met);
#endif
  for (int c = 0; c < TFM_CHANNELS; ++c)
    depth[c] = extinguished(scene->media, &met, c);
#elif TFM_FIELDS
  (void)wanted;
  (void)samples;
  Floats of_field[TFM_FIELDS];
  for (int k = 0; k < TFM_FIELDS; ++k)
    of_field[k] = map_optical_depth(&buffers->maps, buffers->maps.of + light->first_map + k, path->place[k]);
  for (int c = 0; c < TFM_CHANNELS; ++c) {
    __global const float *extinction = scene->view->rgb_from_field + 3 * c;
#if TFM_SHOW_RESIDUAL
    /* Their mean, by what each field extinguishes. */
    float all = 0.0f;
    for (int k = 0; k < TFM_FIELDS; ++k)
      all += extinction[k];
    depth[c] = floats(0.0f);
    for (int k = 0; k < TFM_FIELDS; ++k)
      depth[c] += (all > 0.0f ? extinction[k] / all : 1.0f / TFM_FIELDS) * of_field[k];
#else
    depth[c] = extinction[0] * of_field[0];
    for (int k = 1; k < TFM_FIELDS; ++k)
      depth[c] += extinction[k] * of_field[k];
#endif
  }
#else
  (void)light;
  (void)buffers;
  (void)wanted;
  (void)samples;
  for (int c = 0; c < TFM_CHANNELS; ++c)
    depth[c] = floats(0.0f);
#endif
#if TFM_BODIES && !TFM_SHOW_RESIDUAL
  for (int i = 0; i < TFM_BODIES; ++i)
    for (int c = 0; c < TFM_CHANNELS; ++c)
      depth[c] += body_extinction(scene->media, scene->bodies, i, c) * path->ways[i];
#else
  (void)scene;
  (void)path;
#endif
}

/* What is left of the light after such a depth. */
TFM_INLINE Floats reduced(Floats depth)
{
#if TFM_SHOW_RESIDUAL
  return depth; /* which is the residual itself */
#else
  return transmittance_of(depth);
#endif
}

/* What the light's texture multiplies its intensity by. */
TFM_INLINE void light_tint(LIGHT light, const LightBuffers *buffers, LightSample sample, Floats *tint)
{
#if TFM_TEXTURE
  texture_at(buffers->texture + light->first_texel, light->texture_size[0], light->texture_size[1], sample.texture_u,
             sample.texture_v, tint);
#else
  (void)light;
  (void)buffers;
  (void)sample;
  tint[0] = tint[1] = tint[2] = floats(1.0f);
#endif
}

#endif
