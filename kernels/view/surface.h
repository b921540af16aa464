/* What pixels show of solids (a G-buffer), and how it reflects light: Lambert's law (TFM section 4.1).
   Requires: what camera.h and a light header do. */
#ifndef TFM_SURFACE_H
#define TFM_SURFACE_H

#include "view/camera.h"
#include "light/sample.h"

typedef struct {
  Vec3 point, normal; /* world; the normal is towards the camera */
  Floats distance;    /* from the camera; INFINITY without a solid */
  Floats albedo[3];   /* as far as haze lets it be seen */
  Ints shown; /* mask: there is one */
} Surface;

/* solid: normal and distance of each pixel of the crop; albedo: RGB. ray: the pixels'. */
TFM_INLINE Surface surface_at(VIEW view, __global const float4 *solid, __global const float4 *albedo, Ray ray,
                              Pixels pixels)
{
  const Ints index = pixel_index(view, pixels), wanted = pixels.wanted & pixels.inside;
  Floats shown[4], reflects[4];
  load_float4(solid, index, wanted, INFINITY, shown);
  load_float4(albedo, index, wanted, 0.0f, reflects);
  Surface surface;
  surface.shown = shown[3] < MAXFLOAT;
  surface.distance = shown[3];
  surface.point = ray_at(ray, surface.shown ? shown[3] : floats(0.0f));
  surface.normal = vec3(shown[0], shown[1], shown[2]);
  const Floats clear = seen_through_haze(view, surface.distance);
  for (int c = 0; c < 3; ++c)
    surface.albedo[c] = clear * reflects[c];
  return surface;
}

/* Radiance towards the camera over albedo and the light's intensity, without medium and other solids; 0 where the
   light does not reach the surface's side. */
TFM_INLINE Floats surface_reflects(LIGHT light, const Surface *surface, LightSample sample)
{
  const Floats cosine = -dot3(sample.direction, transform_vector(light->light_from_world, surface->normal));
  const Ints lit =
      surface->shown & (cosine > 0.0f) & (sample.strength > 0.0f) & light_reaches(light, surface->point);
  return lit ? M_1_PI_F * sample.strength * cosine : floats(0.0f);
}

#endif
