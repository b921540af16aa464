/* Light on a lattice (view/orders.h) where scattering has a lobe: the radiance at a point is known by its moments, the
   integrals of it times spherical harmonics, which scattering multiplies by those of the phase function. What of a lobe is
   narrower goes straight on (order_sweep.cl).
   Requires: what view/orders.h and view/harmonics.h do. */
#include "core/store.h"
#include "view/harmonics.h"
#include "view/orders.h"

/* Directions that are taken together, so that few numbers are read again for each; as many as there are is a multiple. */
#define BUNDLE 8

/* What of some directions arrives at the points of a row, a lane each, from the rays on either side of them.
   radiance  in rows along x; turned: of a direction along x
   row, layer  numbers from a row along x to the next, and from a layer */
TFM_INLINE Floats arriving(SWEEP sweep, __global const float *radiance, int turned, int x, int y, int z, int row, int layer)
{
  if (!turned) {
    const int plane = sweep->plane == layer ? z : y, m = sweep->backwards ? sweep->planes - 1 - plane : plane;
    const float part_x = shift_of(sweep->slope[0], m).part, part_y = shift_of(sweep->slope[1], m).part;
    /* The rays before a point lie a part of a distance after the point before it. */
    return between_rows(radiance - sweep->row - 1, sweep->row, 1.0f - part_x, 1.0f - part_y);
  }
  const Ints plane = x + LANE_Y * TILE_WIDTH + LANE_X;
  const Floats m = TO_FLOATS(sweep->backwards ? sweep->planes - 1 - plane : plane);
  const Floats along_y = sweep->slope[0] * m, along_z = sweep->slope[1] * m;
  const Floats part_y = along_y - TO_FLOATS(rounded_down(along_y)), part_z = along_z - TO_FLOATS(rounded_down(along_z));
  const Floats low = lerp(ROW(radiance - layer - row), ROW(radiance - layer), 1.0f - part_y);
  return lerp(low, lerp(ROW(radiance - row), ROW(radiance), 1.0f - part_y), 1.0f - part_z);
}

/* Sums what arrives at points, and scatters it into all directions. All is in rows along x.
   sweeps    those along y and z, of which there are `along`, then those along x
   radiance  of each direction and colour, what arrives; looked at where `arrives` is 1
   light     what arrives of lights by themselves, moments; out: 0
   total     moments; to which what arrives is added where `arrives` is 1
   shares    of several media, as order_shares finds them
   source    out where `scatters` is 1, of each direction and colour, over what is extinguished or, of several media, what
             is scattered; 0 around the points stays
   items     first of this launch and end */
__kernel void order_scatter(ORDERS orders, SWEEP sweeps, __global const float *radiance, __global float *light,
                            __global float *total, __global float *source, int along, int count, int arrives, int scatters
#if TFM_ORDER_MEDIA
                            , __global const float *shares
#endif
                            , int2 items)
{
  const int nx = orders->size[0], ny = orders->size[1], chunks = (nx + TFM_LANES - 1) / TFM_LANES;
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const int x = item % chunks * TFM_LANES, y = item / chunks % ny, z = item / chunks / ny;
  const int row = nx + 2 * PAD, layer = row * (ny + 2), size = padded_size(orders);
  const int at = (z + 1) * layer + (y + 1) * row + x + PAD;
  const Ints inside = LANE_Y * TILE_WIDTH + LANE_X < nx - x;
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    Floats moments[HARMONICS];
    for (int n = 0; n < HARMONICS; ++n) {
      __global float *of_light = light + (size_t)(n * TFM_ORDER_COLOURS + c) * size + at;
      moments[n] = ROW(of_light);
      *(__global FloatRow *)of_light = floats(0.0f);
    }
    if (arrives) {
      for (int first = 0; first < count; first += BUNDLE) {
        Floats here[BUNDLE];
        for (int k = 0; k < BUNDLE; ++k)
          here[k] = arriving(sweeps + first + k, radiance + (size_t)((first + k) * TFM_ORDER_COLOURS + c) * size + at,
                             first + k >= along, x, y, z, row, layer);
#pragma unroll
        for (int n = 0; n < HARMONICS; ++n) {
          Floats sum = moments[n];
          for (int k = 0; k < BUNDLE; ++k)
            sum += sweeps[first + k].weighted[n] * here[k];
          moments[n] = sum;
        }
      }
      for (int n = 0; n < HARMONICS; ++n) {
        __global float *all = total + (size_t)(n * TFM_ORDER_COLOURS + c) * size + at;
        *(__global FloatRow *)all = ROW(all) + moments[n];
      }
    }
    if (!scatters)
      continue;
#if TFM_ORDER_MEDIA
    Floats bent[TFM_ORDER_DEGREE + 1];
    for (int l = 0; l <= TFM_ORDER_DEGREE; ++l)
      bent[l] = floats(0.0f);
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m) {
      const Floats share = ROW(shares + (size_t)(3 * m + c) * size + at);
      for (int l = 0; l <= TFM_ORDER_DEGREE; ++l)
        bent[l] += orders[m].bent[l] * share;
    }
    EACH_HARMONIC
      moments[n] = inside ? bent[l] * moments[n] : floats(0.0f);
#else
    EACH_HARMONIC
      moments[n] = inside ? orders->albedo[c] * orders->bent[l] * moments[n] : floats(0.0f);
#endif
    for (int first = 0; first < count; first += BUNDLE) {
      Floats sum[BUNDLE];
      for (int k = 0; k < BUNDLE; ++k)
        sum[k] = floats(0.0f);
#pragma unroll
      for (int n = 0; n < HARMONICS; ++n)
        for (int k = 0; k < BUNDLE; ++k)
          sum[k] += sweeps[first + k].harmonics[n] * moments[n];
      for (int k = 0; k < BUNDLE; ++k)
        *(__global FloatRow *)(source + (size_t)((first + k) * TFM_ORDER_COLOURS + c) * size + at) = sum[k];
    }
  }
}

#if TFM_ORDER_MEDIA
#define OF_NEIGHBOURS 1e-3f

/* Of what is scattered at points, each medium's share; where nothing is, that of their neighbours.
   of_media  as order_media finds it; shares: out, likewise
   items     first of this launch and end */
__kernel void order_shares(ORDERS orders, __global const float *of_media, __global float *shares, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  const int row = orders->size[0] + 2 * PAD, layer = row * (orders->size[1] + 2), size = padded_size(orders);
  for (int c = 0; c < 3; ++c) {
    Floats scatters[TFM_ORDER_MEDIA], all = floats(0.0f);
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m) {
      __global const float *of_medium = of_media + (size_t)(3 * m + c) * size;
      Floats near = floats(0.0f);
      for (int z = -1; z <= 1; ++z)
        for (int y = -1; y <= 1; ++y)
          for (int x = -1; x <= 1; ++x)
            near += gather_floats(of_medium, points.at + (z * layer + y * row + x));
      scatters[m] = gather_floats(of_medium, points.at) + OF_NEIGHBOURS * near;
      all += scatters[m];
    }
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m)
      store_floats(shares + (size_t)(3 * m + c) * size, points.at, points.wanted,
                   all > 0.0f ? scatters[m] / all : floats(0.0f));
  }
}
#endif

/* Writes numbers of points, and of those before the first, in the other kind of rows.
   of_x   0: they are in rows along y
   skip   numbers of each point along x that have none along y; count: those that have
   items  first of this launch and end */
__kernel void order_cross(ORDERS orders, __global const float *numbers, __global float *crossed, int of_x, int skip,
                          int count, int2 items)
{
  /* Points along the rows that numbers are in, and along those that they are written to. */
  const int n = orders->size[of_x ? 0 : 1], m = orders->size[of_x ? 1 : 0];
  /* Neighbours read the same rows. */
  const int item = items.x + (int)get_global_id(0), chunks = (m + TFM_LANES - 1) / TFM_LANES;
  if (item >= items.y)
    return;
  const int i = item % (n + 1) - 1, j = item / (n + 1) % chunks * TFM_LANES, z = item / (n + 1) / chunks - 1;
  const Ints place = j + LANE_Y * TILE_WIDTH + LANE_X, inside = place < m;
  const Ints from = ((z + 1) * (m + 2) + (inside ? place : ints(0)) + 1) * (n + 2 * PAD) + i + PAD;
  const int to = ((z + 1) * (n + 2) + i + 1) * (m + 2 * PAD) + j + PAD;
  const int from_size = of_x ? padded_size(orders) : turned_size(orders);
  const int to_size = of_x ? turned_size(orders) : padded_size(orders);
  for (int k = 0; k < count; ++k)
    *(__global FloatRow *)(crossed + (size_t)(of_x ? k : skip + k) * to_size + to) =
        inside ? gather_floats(numbers + (size_t)(of_x ? skip + k : k) * from_size, from) : floats(0.0f);
}

/* Adds what of a light the later orders scatter to the camera beyond the moments, over albedo and opacity.
   beyond     as `lobes.beyond` makes it: by what was scattered, and by the cosine; of each medium in turn, for each spread
              of lights in turn
   arrived    of the light, as order_arrived finds it, `room` numbers each
   scattered  of the points one after the other, and there of each medium in turn; adds to
   spread     number of the light's
   low, count the points that the light may reach, as of points_in
   items      first of this launch and end */
__kernel void order_beyond(VIEW view, ORDERS orders, __global const float *beyond, __global const float *arrived,
                           __global float *scattered, int spread, int room, int4 low, int4 count, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_in(orders, low, count, item);
  __global const float *known = arrived + (size_t)item * TFM_LANES;
  Ints lit = ints(0);
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    lit |= ROW(known + (size_t)(3 + c) * room) > 0.0f;
  lit &= points.wanted;
  if (!any_lane(lit))
    return;
  const Vec3 way = vec3(ROW(known), ROW(known + room), ROW(known + 2 * (size_t)room));
  const Floats mu = dot3(way, way_to_camera(view, position_of(orders, &points)));
  Floats to_right, to_next;
  const Ints column = between_points(root_of(root_of(0.5f - 0.5f * mu)) * (float)(BEYOND_ANGLES - 1), BEYOND_ANGLES, &to_right);
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    const Floats left = ROW(known + (size_t)(3 + c) * room);
    const Ints row = between_points(ROW(known + (size_t)(3 + TFM_ORDER_COLOURS + c) * room), BEYOND_DEPTHS, &to_next);
    const Ints at = row * BEYOND_ANGLES + column;
    for (int m = 0; m < APART_MEDIA; ++m) {
      __global const float *table = beyond + (spread * APART_MEDIA + m) * BEYOND_DEPTHS * BEYOND_ANGLES;
      const Floats one = lerp(gather_floats(table, at), gather_floats(table + 1, at), to_right);
      const Floats next = lerp(gather_floats(table + BEYOND_ANGLES, at), gather_floats(table + BEYOND_ANGLES + 1, at), to_right);
      const Ints place = (points.number * APART_MEDIA + m) * TFM_ORDER_COLOURS + c;
      store_floats(scattered, place, lit, gather_floats(scattered, place) + left * lerp(one, next, to_next));
    }
  }
}

/* What all later orders scatter to the camera, over albedo and opacity; of each medium.
   total     moments of the points, in rows along x
   scattered as of order_beyond: holds what that found, which is added
   items     first of this launch and end */
__kernel void order_view(VIEW view, ORDERS orders, __global const float *total, __global float *scattered, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  Floats y[HARMONICS];
  harmonics_of(way_to_camera(view, position_of(orders, &points)), y);
  for (int m = 0; m < APART_MEDIA; ++m)
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
      const Ints number = (points.number * APART_MEDIA + m) * TFM_ORDER_COLOURS + c;
      Floats sum = gather_floats(scattered, number);
      EACH_HARMONIC
        sum += orders[m].seen[l] * y[n] *
               numbers_at(total + (size_t)(n * TFM_ORDER_COLOURS + c) * padded_size(orders), &points);
      /* Moments that end somewhere may leave less than nothing. */
      store_floats(scattered, number, points.wanted, greatest(sum, floats(0.0f)));
    }
}
