/* How the strands in a step lie: the mean of t t^T over their unit tangents t, which is all that is kept of them; xx, yy, zz,
   xy, xz, yz. Of one strand it says all; of several, sines are root mean squares. */
#ifndef TFM_PHASE_FIBRES_H
#define TFM_PHASE_FIBRES_H

#include "core/ray.h"

#define TANGENTS 6

typedef struct {
  Floats light;  /* sine between the light's travel and the strands */
  Floats cosine; /* of the angle between the camera's direction and the cone of mirrored light */
  Ints any;      /* mask: there are strands */
} FibreAngles;

TFM_INLINE FibreAngles no_strands(void)
{
  FibreAngles angles;
  angles.light = angles.cosine = floats(0.0f);
  angles.any = ints(0);
  return angles;
}

/* t t^T of the unit vector along a tangent of any length; 0 of none. */
TFM_INLINE void tangent_products(Vec3 t, Floats *products)
{
  const Floats inverse = 1.0f / greatest(dot3(t, t), floats(FLT_MIN));
  products[0] = inverse * t.x * t.x;
  products[1] = inverse * t.y * t.y;
  products[2] = inverse * t.z * t.z;
  products[3] = inverse * t.x * t.y;
  products[4] = inverse * t.x * t.z;
  products[5] = inverse * t.y * t.z;
}

TFM_INLINE Floats along_tangents(const Floats *m, Vec3 a, Vec3 b)
{
  return m[0] * a.x * b.x + m[1] * a.y * b.y + m[2] * a.z * b.z + m[3] * (a.x * b.y + a.y * b.x) +
         m[4] * (a.x * b.z + a.z * b.x) + m[5] * (a.y * b.z + a.z * b.y);
}

TFM_INLINE Floats sine_of_square(Floats cosine_square)
{
  const Floats square = greatest(1.0f - cosine_square, floats(0.0f));
  return root_of(square);
}

/* sums: of weighted tangents, any weight. travel: of the light. to_camera: direction. */
TFM_INLINE FibreAngles fibre_angles(const Floats *sums, Vec3 travel, Vec3 to_camera)
{
  FibreAngles angles;
  const Floats trace = sums[0] + sums[1] + sums[2];
  angles.any = trace > 0.0f;
  const Floats inverse = 1.0f / (angles.any ? trace : floats(1.0f));
  Floats m[TANGENTS];
  for (int i = 0; i < TANGENTS; ++i)
    m[i] = inverse * sums[i];
  const Floats light = sine_of_square(along_tangents(m, travel, travel));
  const Floats view = sine_of_square(along_tangents(m, to_camera, to_camera));
  angles.cosine = along_tangents(m, travel, to_camera) + light * view;
  /* The mean sine is less than its root mean square: pi / 4 over sqrt(2 / 3) where strands lie in all directions. */
  const Floats alike = m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + 2.0f * (m[3] * m[3] + m[4] * m[4] + m[5] * m[5]);
  angles.light = light * (1.0f - (1.0f - 0.961912f) * 1.5f * greatest(1.0f - alike, floats(0.0f)));
  return angles;
}

#endif
