/* How deep the ways are that lights come to the points of a lattice (view/orders.h): that stays while the camera moves.
   Includes expected before: a basis and a light header, and those of the bodies' kinds. Requires: what
   light/reduced_intensity.h and view/orders.h do. */
#include "core/store.h"
#include "light/reduced_intensity.h"
#include "view/orders.h"

#if TFM_GRIDS
/* The bricks along an axis that a point's neighbourhood reaches: the first and the last. */
TFM_INLINE void bricks_near(Floats at, Floats reach, int count, Ints *first, Ints *last)
{
  const Floats most = floats((float)(count * BRICK_EDGE) - 0.5f);
  const Floats low = greatest(least(at - reach, most), floats(0.0f)), high = greatest(least(at + reach, most), floats(0.0f));
  *first = TO_INTS(low) >> BRICK_SHIFT;
  *last = TO_INTS(high) >> BRICK_SHIFT;
}

/* Finds the points next to which grids may have density: only those are ever read where it is not 0.
   near   out: 1, or 0
   items  first of this launch and end */
__kernel void points_near_density(GRID grids, __global const int *bricks, ORDERS orders, __global uchar *near, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  const Vec3 point = position_of(orders, &points);
  Ints found = ints(0);
  for (int i = 0; i < TFM_VOXEL_GRIDS; ++i) {
    GRID grid = grids + i;
    __global const int *table = bricks + grid->first_brick;
    __global const float *m = grid->index_from_world;
    const Vec3 at = transform_point(m, point);
    const float reach = orders->spacing;
    Ints x, y, z, last_x, last_y, last_z;
    bricks_near(at.x, floats(reach * (fabs(m[0]) + fabs(m[1]) + fabs(m[2]))), grid->brick_count[0], &x, &last_x);
    bricks_near(at.y, floats(reach * (fabs(m[4]) + fabs(m[5]) + fabs(m[6]))), grid->brick_count[1], &y, &last_y);
    bricks_near(at.z, floats(reach * (fabs(m[8]) + fabs(m[9]) + fabs(m[10]))), grid->brick_count[2], &z, &last_z);
    const int wide = -least_int(x - last_x), high = -least_int(y - last_y), deep = -least_int(z - last_z);
    for (int k = 0; k <= deep; ++k)
      for (int j = 0; j <= high; ++j)
        for (int h = 0; h <= wide; ++h) {
          const Ints bx = x + h < last_x ? x + h : last_x, by = y + j < last_y ? y + j : last_y,
                     bz = z + k < last_z ? z + k : last_z;
          found |= gather_ints(table, (bz * grid->brick_count[1] + by) * grid->brick_count[0] + bx) > 0;
        }
  }
  IntArray is_near;
  is_near.lanes = found ? ints(1) : ints(0);
  const Ints number = points.number, wanted = points.wanted;
  EACH_WANTED_LANE(number, wanted)
    near[number_lanes.lane[lane]] = (uchar)is_near.lane[lane];
}
#endif

/* Looks a light up at the points that are listed.
   depths  out: of each light and colour, optical depths of the points in their order, `row` of them; what solids stop is
           as deep as need be
   number  of the light among those given; place: among all
   items   first of this launch and end */
__kernel void points_depths(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                            ORDERS orders, __global const int *listed, __global float *depths, int count, int row, int number,
                            int place, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = listed_points(orders, listed, count, item);
  const Vec3 point = position_of(orders, &points);
  SCENE(scene, ints(-1), ints(-1));
  LIGHT_BUFFERS(buffers);
  LIGHT from = lights + number;
  const LightSample sample = light_at(from, point_in_light(from, point));
  const LightPath path = light_path(&scene, from, &buffers, point, sample, 0, 0);
  Floats depth[TFM_CHANNELS];
  Ints samples = ints(0);
  light_optical_depths(&scene, from, &buffers, &path, points.wanted, &samples, depth);
  const Floats visible = light_visibility(from, shadow, sample);
  const Floats dimmed = visible < 1.0f ? -log_of(greatest(visible, floats(FLT_MIN))) : floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    *(__global FloatRow *)(depths + (size_t)(place * TFM_CHANNELS + c) * (size_t)row + (size_t)(item * TFM_LANES)) =
        visible > 0.0f ? depth[c] + dimmed : floats(TFM_MAX_OPTICAL_DEPTH);
}
