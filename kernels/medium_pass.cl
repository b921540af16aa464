/* Medium pass: what the camera sees of the medium whatever its lights are: transmittance and depth.
   Includes expected before: Params. */
#include "camera.h"
#include "volume.h"

/* One work-item a pixel of a tile; the launch's offset places the tile in the frame.
   transmittance  out: RGB transmittance along the camera ray, and the opacity-weighted mean distance
                  (0 without a medium)
   samples        adds the density samples taken */
__kernel void medium_pass(__constant const Params *params, __global const float *voxels,
                          __global float4 *transmittance, __global uint *samples)
{
  const int2 pixel = (int2)((int)get_global_id(0), (int)get_global_id(1));
  const size_t i = pixel_index(params, pixel);
  transmittance[i] = (float4)(1.0f, 1.0f, 1.0f, 0.0f);
  const Ray ray = index_ray(params, camera_ray(params, pixel));
  Interval medium = {0.0f, INFINITY};
  if (!medium_clip(params, ray, &medium))
    return;

  const Grid grid = padded_grid(params, voxels);
  const float3 sigma_t = vload3(0, params->sigma_t);
  const int steps = params->view_steps;
  const float step = (medium.end - medium.begin) / (float)steps;
  float optical_depth = 0.0f, distance_sum = 0.0f, opacity_sum = 0.0f;
  for (int n = 0; n < steps; ++n) {
    const float t = medium.begin + ((float)n + 0.5f) * step;
    const float step_depth = fmin(step * density_at(grid, ray_at(ray, t)), TFM_MAX_OPTICAL_DEPTH);
    const float3 opacity = exp(-sigma_t * optical_depth) * opacity_of_rgb(sigma_t * step_depth);
    const float weight = (opacity.x + opacity.y + opacity.z) / 3.0f;
    distance_sum += weight * t;
    opacity_sum += weight;
    optical_depth = fmin(optical_depth + step_depth, TFM_MAX_OPTICAL_DEPTH);
  }
  const float distance = opacity_sum > 0.0f ? distance_sum / opacity_sum : 0.0f;
  transmittance[i] = (float4)(exp(-sigma_t * optical_depth), distance);
  samples[i] += (uint)steps;
}
