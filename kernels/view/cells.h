/* Density in the cube around each point of a lattice (view/orders.h), from samples that are evenly spread in it.
   Includes expected before: the headers of the bodies' kinds. Requires: what view/camera_ray.h and view/orders.h do. */
#ifndef TFM_CELLS_H
#define TFM_CELLS_H

#include "view/camera_ray.h"
#include "view/orders.h"

/* From a cube's middle to its sample number x, y, z, the width of whose part of the cube this is too. */
TFM_INLINE Vec3 sample_of_cell(ORDERS orders, Vec3 centre, int x, int y, int z)
{
  const float part = orders->spacing / (float)orders->samples, first = 0.5f * (part - orders->spacing);
  return vec3(centre.x + (first + (float)x * part), centre.y + (first + (float)y * part),
              centre.z + (first + (float)z * part));
}

#if TFM_GRIDS && TFM_VOXEL_GRIDS
/* What grids hold at a point; 0 outside. */
TFM_INLINE void add_grids(GRID grids, const Grids *padded, Vec3 point, Amounts *amounts)
{
  for (int i = 0; i < TFM_VOXEL_GRIDS; ++i) {
    const Extent *extent = &padded->of[i];
    const Vec3 in_grid = transform_point(grids[i].index_from_world, point), inside = point_in_grid(extent, in_grid);
    const Ints is_inside = (in_grid.x == inside.x) & (in_grid.y == inside.y) & (in_grid.z == inside.z);
    const Ints found = records_at(extent, inside), records = (is_inside & (found > 0)) ? found : ints(0);
    if (!any_lane(records > 0))
      continue;
    for (int c = 0; c < TFM_VOXEL_CHANNELS; ++c)
      if (COUNTS_CHANNEL(*extent, c))
        amounts->of[TFM_MEDIUM_OF_GRID(i)][AMOUNT_OF(c)] +=
            records > 0 ? density_apart(padded, i, records, inside, c) : floats(0.0f);
  }
}
#endif

#if TFM_PRIMITIVES
/* What primitives hold in cubes: TFM_AMOUNTS of each medium, numbers of all points each. */
#define DEPOSITED_ARGUMENT , __global const float *deposited
#define DEPOSITED_IN(orders, points) deposited_in(orders, deposited, points)
TFM_INLINE Amounts deposited_in(ORDERS orders, __global const float *deposited, const Points *points)
{
  const size_t count = (size_t)orders->size[0] * orders->size[1] * orders->size[2];
  Amounts amounts;
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      amounts.of[m][c] = gather_floats(deposited + (size_t)(m * TFM_AMOUNTS + c) * count, points->number);
  return amounts;
}
#else
#define DEPOSITED_ARGUMENT
#define DEPOSITED_IN(orders, points) no_amounts()
#endif

/* Density at a sample: of bodies of constant density its mean along its part of the cube. deposited: in all of that */
TFM_INLINE Amounts density_at(const Scene *scene, ORDERS orders, Vec3 point, const Amounts *deposited)
{
  Amounts density = *deposited;
#if TFM_GRIDS && TFM_VOXEL_GRIDS
  add_grids(scene->grids, scene->padded, point, &density);
#endif
#if TFM_BODIES
  const float part = orders->spacing / (float)orders->samples;
  Ray ray;
  ray.origin = vec3(point.x - 0.5f * part, point.y, point.z);
  ray.direction = vec3(floats(1.0f), floats(0.0f), floats(0.0f));
  const Interval along = {floats(0.0f), floats(part)};
  BodiesOnRay on_ray;
  Interval hull;
  bodies_on_ray(scene->bodies, ray, along, &on_ray, &hull);
  Amounts met = no_amounts();
  add_bodies(scene->bodies, &on_ray, along.begin, along.end, &met);
  for (int m = 0; m < TFM_MEDIA; ++m)
    for (int c = 0; c < TFM_AMOUNTS; ++c)
      density.of[m][c] += met.of[m][c] * (1.0f / part);
#else
  (void)orders;
#endif
  return density;
}

#define EACH_SAMPLE(orders)                       \
  for (int k = 0; k < (orders)->samples; ++k)     \
    for (int j = 0; j < (orders)->samples; ++j)   \
      for (int i = 0; i < (orders)->samples; ++i)

#endif
