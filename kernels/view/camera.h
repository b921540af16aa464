/* The pinhole camera and the pixels it renders. */
#ifndef TFM_CAMERA_H
#define TFM_CAMERA_H

#include "core/ray.h"
#include "core/store.h"

/* One pixel a lane: a tile of the frame. Tiles are cut from the frame's corner, whatever is rendered of it, and all
   their pixels are marched: a crop shows what the whole frame would, to the last bit. Where rays are listed, pixels are
   places in the list's buffers, and their rays pass anywhere. */
typedef struct {
  Ints x, y;
  Floats at_x, at_y; /* where the ray passes through the frame, in pixels from its corner */
  Ints inside;       /* the frame */
  Ints wanted;       /* by the launch */
} Pixels;

/* Positions in buffers that hold the crop, of the pixels that are wanted. */
TFM_INLINE Ints pixel_index(VIEW view, Pixels pixels)
{
  return (pixels.y - view->crop[1]) * (view->crop[2] - view->crop[0]) + (pixels.x - view->crop[0]);
}

/* How much haze leaves of solids at these distances; 0 beyond all. */
TFM_INLINE Floats seen_through_haze(VIEW view, Floats distance)
{
  return distance < MAXFLOAT ? transmittance_of(view->haze * distance) : floats(0.0f);
}

/* Of every kernel with camera rays. */
#define PLACES __global const float2 *places

/* The tile of this work-item; launches cover the crop in windows x0, y0, x1, y1.
   places  of the rays of listed pixels; negative: there is none */
TFM_INLINE Pixels tile_pixels(VIEW view, PLACES, int4 window)
{
  Pixels pixels;
  pixels.x = window.x / TILE_WIDTH * TILE_WIDTH + (int)get_global_id(0) * TILE_WIDTH + LANE_X;
  pixels.y = window.y / TILE_HEIGHT * TILE_HEIGHT + (int)get_global_id(1) * TILE_HEIGHT + LANE_Y;
  pixels.inside = (pixels.x < view->image_size[0]) & (pixels.y < view->image_size[1]);
  pixels.wanted = (pixels.x >= window.x) & (pixels.y >= window.y) & (pixels.x < window.z) & (pixels.y < window.w);
  pixels.at_x = TO_FLOATS(pixels.x) + 0.5f;
  pixels.at_y = TO_FLOATS(pixels.y) + 0.5f;
  if (view->listed) {
    load_float2(places, pixel_index(view, pixels), pixels.wanted, -1.0f, &pixels.at_x, &pixels.at_y);
    pixels.wanted &= pixels.at_x >= 0.0f;
    pixels.inside = pixels.wanted;
  }
  return pixels;
}

/* World rays through the pixels' centres, unless they are listed; pixel (0, 0) is the top left one. */
TFM_INLINE Ray camera_rays(VIEW view, Pixels pixels)
{
  const Floats x = 2.0f * pixels.at_x / (float)view->image_size[0] - 1.0f;
  const Floats y = 1.0f - 2.0f * pixels.at_y / (float)view->image_size[1];
  const Vec3 forward = uniform_vec3(view->forward);
  const Vec3 right = uniform_vec3(view->right);
  const Vec3 up = uniform_vec3(view->up);
  Ray ray;
  ray.origin = uniform_vec3(view->position);
  ray.direction = unit3(vec3(forward.x + x * right.x + y * up.x, forward.y + x * right.y + y * up.y,
                             forward.z + x * right.z + y * up.z));
  return ray;
}

/* From points on, straight away from the camera. */
TFM_INLINE Ray rays_beyond(VIEW view, Vec3 point)
{
  const Vec3 away = vec3(point.x - view->position[0], point.y - view->position[1], point.z - view->position[2]);
  Ray ray;
  ray.origin = point;
  ray.direction = scale3(reciprocal_sqrt(greatest(dot3(away, away), floats(FLT_MIN))), away);
  return ray;
}

/* Bounds, in pixels, of where the image shows a ball. */
TFM_INLINE void image_bounds(VIEW view, Vec3 centre, Floats reach, Floats *low, Floats *high)
{
  const Vec3 p = vec3(centre.x - view->position[0], centre.y - view->position[1], centre.z - view->position[2]);
  const Vec3 right = uniform_vec3(view->right), up = uniform_vec3(view->up);
  const Floats wide = dot3(right, right), high_up = dot3(up, up), z = dot3(p, uniform_vec3(view->forward));
  const Floats per_right = reciprocal_sqrt(wide), per_up = reciprocal_sqrt(high_up);
  Floats lowest, highest;
  slope_bounds(dot3(p, right) * per_right, z, reach, &lowest, &highest);
  const Floats half_width = 0.5f * (float)view->image_size[0], half_height = 0.5f * (float)view->image_size[1];
  low[0] = half_width * (1.0f + lowest * per_right);
  high[0] = half_width * (1.0f + highest * per_right);
  slope_bounds(dot3(p, up) * per_up, z, reach, &lowest, &highest);
  low[1] = half_height * (1.0f - highest * per_up);
  high[1] = half_height * (1.0f - lowest * per_up);
}

/* Distances of the solids that the pixels show: the fourth number of what the crop's buffer holds. */
TFM_INLINE Floats solid_distance(VIEW view, __global const float4 *solid, Pixels pixels)
{
  Floats shown[4];
  load_float4(solid, pixel_index(view, pixels), pixels.wanted & pixels.inside, INFINITY, shown);
  return shown[3];
}

#endif
