/* What pixels show of solids (a G-buffer), and how it reflects light: Lambert's law (TFM section 4.1).
   Requires: what camera.h and a light header do. */
#ifndef TFM_SURFACE_H
#define TFM_SURFACE_H

#include "camera.h"
#include "light/sample.h"

typedef struct {
  Vec3 point, normal; /* world; the normal is towards the camera */
  Floats distance;    /* from the camera; INFINITY without a solid */
  Floats albedo[3];
  Ints shown; /* mask: there is one */
} Surface;

/* solid: normal and distance of each pixel of the crop; albedo: RGB. ray: the pixels'. */
TFM_INLINE Surface surface_at(PARAMS params, __global const float4 *solid, __global const float4 *albedo, Ray ray,
                              Pixels pixels)
{
  FloatArray normal[3], distance, reflects[3];
  IntArray x, y, wanted;
  x.lanes = pixels.x;
  y.lanes = pixels.y;
  wanted.lanes = (pixels.wanted & pixels.inside) ? ints(1) : ints(0);
  for (int lane = 0; lane < TFM_LANES; ++lane) {
    const size_t i = wanted.lane[lane] ? pixel_index(params, x.lane[lane], y.lane[lane]) : 0;
    const float4 surface = solid[i], colour = albedo[i];
    distance.lane[lane] = wanted.lane[lane] ? surface.w : INFINITY;
    normal[0].lane[lane] = surface.x;
    normal[1].lane[lane] = surface.y;
    normal[2].lane[lane] = surface.z;
    reflects[0].lane[lane] = colour.x;
    reflects[1].lane[lane] = colour.y;
    reflects[2].lane[lane] = colour.z;
  }
  Surface surface;
  surface.shown = distance.lanes < MAXFLOAT;
  surface.distance = distance.lanes;
  surface.point = ray_at(ray, surface.shown ? distance.lanes : floats(0.0f));
  surface.normal = vec3(normal[0].lanes, normal[1].lanes, normal[2].lanes);
  for (int c = 0; c < 3; ++c)
    surface.albedo[c] = reflects[c].lanes;
  return surface;
}

/* Radiance towards the camera over albedo and the light's intensity, without medium and other solids; 0 where the
   light does not reach the surface's side. */
TFM_INLINE Floats surface_reflects(PARAMS params, const Surface *surface, LightSample light)
{
  const Floats cosine = -dot3(light.direction, transform_vector(params->light_from_world, surface->normal));
  const Ints lit =
      surface->shown & (cosine > 0.0f) & (light.strength > 0.0f) & light_reaches(params, surface->point);
  return lit ? M_1_PI_F * light.strength * cosine : floats(0.0f);
}

#endif
