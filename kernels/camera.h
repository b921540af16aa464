/* The pinhole camera and the pixels it renders. */
#ifndef TFM_CAMERA_H
#define TFM_CAMERA_H

#include "ray.h"

/* World ray through a pixel's centre; pixel (0, 0) is the top left one. */
inline Ray camera_ray(__constant const Params *params, int2 pixel)
{
  const float x = 2.0f * ((float)pixel.x + 0.5f) / (float)params->image_size[0] - 1.0f;
  const float y = 1.0f - 2.0f * ((float)pixel.y + 0.5f) / (float)params->image_size[1];
  Ray ray;
  ray.origin = vload3(0, params->camera_position);
  ray.direction = normalize(vload3(0, params->camera_forward) + x * vload3(0, params->camera_right) +
                            y * vload3(0, params->camera_up));
  return ray;
}

/* Position in buffers that hold the crop. */
inline size_t pixel_index(__constant const Params *params, int2 pixel)
{
  const int width = params->crop[2] - params->crop[0];
  return (size_t)(pixel.y - params->crop[1]) * (size_t)width + (size_t)(pixel.x - params->crop[0]);
}

#endif
