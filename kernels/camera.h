/* The pinhole camera and the pixels it renders. */
#ifndef TFM_CAMERA_H
#define TFM_CAMERA_H

#include "ray.h"

/* One pixel a lane: a tile of the frame. Tiles are cut from the frame's corner, whatever is rendered of it, and all
   their pixels are marched: a crop shows what the whole frame would, to the last bit. */
typedef struct {
  Ints x, y;
  Ints inside; /* the frame */
  Ints wanted; /* by the launch */
} Pixels;

/* The tile of this work-item; launches cover the crop in windows x0, y0, x1, y1. */
TFM_INLINE Pixels tile_pixels(PARAMS params, int4 window)
{
  Pixels pixels;
  pixels.x = window.x / TILE_WIDTH * TILE_WIDTH + (int)get_global_id(0) * TILE_WIDTH + LANE_X;
  pixels.y = window.y / TILE_HEIGHT * TILE_HEIGHT + (int)get_global_id(1) * TILE_HEIGHT + LANE_Y;
  pixels.inside = (pixels.x < params->image_size[0]) & (pixels.y < params->image_size[1]);
  pixels.wanted = (pixels.x >= window.x) & (pixels.y >= window.y) & (pixels.x < window.z) & (pixels.y < window.w);
  return pixels;
}

/* World rays through the pixels' centres; pixel (0, 0) is the top left one. */
TFM_INLINE Ray camera_rays(PARAMS params, Pixels pixels)
{
  const Floats x = 2.0f * (TO_FLOATS(pixels.x) + 0.5f) / (float)params->image_size[0] - 1.0f;
  const Floats y = 1.0f - 2.0f * (TO_FLOATS(pixels.y) + 0.5f) / (float)params->image_size[1];
  const Vec3 forward = uniform_vec3(params->camera_forward);
  const Vec3 right = uniform_vec3(params->camera_right);
  const Vec3 up = uniform_vec3(params->camera_up);
  Ray ray;
  ray.origin = uniform_vec3(params->camera_position);
  ray.direction = unit3(vec3(forward.x + x * right.x + y * up.x, forward.y + x * right.y + y * up.y,
                             forward.z + x * right.z + y * up.z));
  return ray;
}

/* Position in buffers that hold the crop. */
TFM_INLINE size_t pixel_index(PARAMS params, int x, int y)
{
  const int width = params->crop[2] - params->crop[0];
  return (size_t)(y - params->crop[1]) * (size_t)width + (size_t)(x - params->crop[0]);
}

/* Distances of the solids that the pixels show: the fourth number of what the crop's buffer holds. */
TFM_INLINE Floats solid_distance(PARAMS params, __global const float4 *solid, Pixels pixels)
{
  FloatArray distance;
  IntArray x, y, wanted;
  x.lanes = pixels.x;
  y.lanes = pixels.y;
  wanted.lanes = pixels.wanted ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane)
    distance.lane[lane] =
        wanted.lane[lane] ? solid[pixel_index(params, x.lane[lane], y.lane[lane])].w : INFINITY;
  return distance.lanes;
}

#endif
