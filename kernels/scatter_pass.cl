/* Scatter pass: what the media scatter towards the camera of any number of lights of one kind.
   Includes expected before: a basis and a light header, those of the phase functions and of the bodies' kinds.
   Requires: what scatter.h does. */
#include "view/scatter.h"
#include "view/see.h"

/* Where there are but primitives, any steps hold exactly what lies in them: those of the only light serve the camera too, if
   it reaches them all. */
#if TFM_GRIDS && TFM_VOXEL_GRIDS == 0 && TFM_BODIES == 0
#define EXACT_STEPS 1
#else
#define EXACT_STEPS 0
#endif

/* Light from all around is seen from the same samples. */
#if TFM_AROUND
#if !TFM_SHARED || TFM_BODIES
#error "TFM_AROUND needs TFM_SHARED, and no TFM_BODIES"
#endif
#define AROUND_ARGUMENTS , ORDERS orders, __global const float *scattered, int surrounding, int surrounding_layer
#else
#define AROUND_ARGUMENTS
#endif

/* solid            normal and distance of the solid that a pixel shows, INFINITY without (with TFM_SHADOW only)
   FRAME_ARGUMENTS  as of frame_store, where sees_camera is not 0, of the first launch: what lies along a ray is in the
                    cache already, and lights that share its samples need no march of their own; as of frame_add else
   serves_camera    1: there are but primitives and one light, which reaches them all
   scattered        of surroundings_view, for so many `surrounding` lights of one layer (with TFM_AROUND only)
   window           x0, y0, x1, y1 of the pixels of this launch */
__kernel void scatter_pass(VIEW view, PLACES, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                           __global const int *starts, __global const int *touching, __global const float4 *solid,
                           __global const float4 *albedo, FRAME_ARGUMENTS, int sees_camera, int serves_camera,
                           int4 blocks AROUND_ARGUMENTS, int4 window)
{
  const Pixels pixels = tile_pixels(view, places, window);
  LIGHT_BUFFERS(buffers);
  const Lights here = lights_of_block(lights, starts, touching, blocks, window, &buffers);
  const int sees_more = sees_camera | TFM_AROUND;
  if (!any_lane(pixels.wanted) || (here.count == 0 && !sees_more))
    return;
  const Ray ray = camera_rays(view, pixels);
  const Interval seen = before_solids(view, solid, pixels);
  const MediaOnRay on_ray = media_on_ray(view, grids, bodies, ray, seen, pixels.inside);
  SCENE(scene, TO_INTS(pixels.at_x), TO_INTS(pixels.at_y));
  LightSums sums = light_sums_begin();
  FRAME(frame);
#if TFM_LIGHT_LAYERS
  sums.layers = light_layers_of(view, added, pixels);
#if HAS_OCTAVES
  /* The camera has been here before. */
  load_through(&frame, view, pixels, sums.on_ray);
  for (int c = 0; c < 3; ++c)
    sums.on_ray[c] = octaves_on_ray(view, sums.on_ray[c]);
#endif
#endif
#if TFM_DEEP_COLOURS
  sums.deep = DEEP_COLOURS(view, ray, pixels);
#endif
#if TFM_SHARED
  (void)serves_camera;
  const CameraSums none = camera_sums_begin(media, on_ray.meets);
#if TFM_BODIES
  if (here.count > 0)
    scatter_lights(&scene, &here, ray, &on_ray, on_ray.all, on_ray.meets, &none, &sums, 0);
#else
  CameraSums camera = none;
#if TFM_AROUND
  const OrdersOnRay points = orders_on_ray(orders, scattered, ray);
#define AND_AROUND , &points, surrounding, surrounding_layer
#else
#define AND_AROUND
#endif
  scatter_lights(&scene, &here, ray, &on_ray, on_ray.all, on_ray.meets, &none, &sums,
                 sees_camera ? &camera : 0 AND_AROUND);
#endif
#else
  CameraSums camera = camera_sums_begin(media, on_ray.meets);
  Ints is_seen = ints(0);
  for (int k = 0; k < here.count; ++k) {
    const Lights one = {lights, here.numbers + k, 1, here.many, &buffers};
    Interval lit = on_ray.all, before = on_ray.all;
    const Ints active = on_ray.meets & light_clip(lights + here.numbers[k], ray, &lit);
    if (!any_lane(active))
      continue;
    before.end = view->paper_attenuation ? before.begin : lit.begin;
    const CameraSums dimmed = see_media(&scene, &on_ray, before, 1, active);
    if (EXACT_STEPS && serves_camera)
      is_seen = active;
    scatter_lights(&scene, &one, ray, &on_ray, lit, active, &dimmed, &sums, any_lane(is_seen) ? &camera : 0);
  }
#endif
  if (sees_camera) {
#if TFM_SHARED && TFM_BODIES
    const CameraSums camera = see_media(&scene, &on_ray, on_ray.all, 0, on_ray.meets);
#elif !TFM_SHARED
    const Ints unseen = on_ray.meets & !is_seen;
    if (any_lane(unseen)) {
      const CameraSums others = see_media(&scene, &on_ray, on_ray.all, 0, unseen);
      camera = camera_sums_of(is_seen, &camera, &others);
    }
#endif
    sums.samples += camera.samples;
    const Seen met = camera_sums_end(view, media, &camera, on_ray.meets, seen.end, pixels, albedo);
#if HAS_OCTAVES
    add_octaves(view, met.through, &sums);
#endif
    frame_store(&frame, view, pixels, &met, &sums);
  } else {
#if HAS_OCTAVES
    Floats through[3];
    load_through(&frame, view, pixels, through);
    add_octaves(view, through, &sums);
#endif
    frame_add(&frame, view, pixels, &sums);
  }
}
