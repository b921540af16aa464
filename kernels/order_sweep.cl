/* One more order of scattering on a lattice (view/orders.h). For each direction a ray passes between the points of every
   plane across it, shifted by the same part of a distance wherever it is in the plane: rays never mix, so that nothing
   spreads sideways however far they go.
   Requires: what view/orders.h does; TFM_ORDER_LOBE, 1 where what is scattered differs by direction (order_moments.cl);
   TFM_ORDER_WALLS, 1 where rays meet solids. */
#include "core/store.h"
#include "view/orders.h"
#include "view/walls.h"

/* Rays along an axis are numbered by where they cross the first plane. All that cross a plane between the place before
   its first point and its last: the first of them, and their number. */
TFM_INLINE int2 rays_along(float slope, int size, int planes)
{
  const int last = shift_of(slope, planes - 1).whole;
  return (int2)(-1 - (last > 0 ? last : 0), size + 1 + (last > 0 ? last : -last));
}

/* Where the rays of a work-item, in neighbouring columns, cross the first plane: that of the first of them. */
typedef struct {
  int x, y;
  int wanted;
} FirstRay;

TFM_INLINE FirstRay first_ray(SWEEP sweep, int item)
{
  const int2 across = rays_along(sweep->slope[0], sweep->columns, sweep->planes);
  const int2 along = rays_along(sweep->slope[1], sweep->rows, sweep->planes);
  const int chunks = (across.y + TFM_LANES - 1) / TFM_LANES;
  FirstRay first;
  first.x = across.x + item % chunks * TFM_LANES;
  first.y = along.x + item / chunks;
  first.wanted = first.y < along.x + along.y;
  return first;
}

#define BETWEEN(numbers, c) between_rows((numbers) + (size_t)(c) * size + at, row, shift_x.part, shift_y.part)
#if TFM_ORDER_LOBE
#define LIGHT_OF(number) (light + (size_t)(number) * TFM_ORDER_COLOURS * size)
#else
#define LIGHT_OF(number) light
#endif
/* What is scattered over what is extinguished, where rays cross a plane: of light that arrives evenly, or the source of this
   direction, and what came this way before and goes straight on. */
#if TFM_ORDER_LOBE
#define SCATTERED_OF(c) (BETWEEN(of_sweep, c) + part[c] * ROW(out + (size_t)(c) * size + at))
#else
#define SCATTERED_OF(c) (part[c] * BETWEEN(of_sweep, c))
#endif

#if TFM_ORDER_MEDIA
/* The same of several media. */
typedef struct {
  Floats share;    /* of what is extinguished, what is scattered */
  Floats light;    /* what of that arrives, or its source in this direction */
  Floats straight; /* the part that goes straight on, and what came this way before */
  Floats before;
} Mixed;

TFM_INLINE Floats source_of(const Mixed *mixed, const Mixed *shares)
{
  return shares->share * mixed->light + (TFM_ORDER_LOBE ? shares->straight * mixed->before : floats(0.0f));
}
#endif

/* One work-item takes as many rays, in neighbouring columns, as there are lanes.
   extinction  of the points, in the rows that the sweeps have
   light     in the same rows: what arrives, or of each direction and colour what is scattered
   radiance  out, of each direction and colour: at each plane, shifted by part of a distance, what was scattered on the way;
             where there is a lobe, holds the same of the order before
   scattering  of several media, as order_media says, in the same rows
   rays      work-items that each direction takes, at most
   size      numbers that one extinction or colour has
   items     first of this launch and end */
__kernel void order_sweep(ORDERS orders, SWEEP sweeps, __global const float *extinction, __global const float *light,
                          __global float *radiance, int rays, int size
#if TFM_ORDER_MEDIA
                          , __global const float *scattering
#endif
                          WALLS_ARGUMENTS, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const int number = item / rays;
  SWEEP sweep = sweeps + number;
  const float slope_x = sweep->slope[0], slope_y = sweep->slope[1], length = 0.5f * sweep->length;
  const int columns = sweep->columns, rows = sweep->rows, planes = sweep->planes, row = sweep->row;
  const FirstRay ray = first_ray(sweep, item % rays);
  if (!ray.wanted)
    return;
  __global float *out = radiance + (size_t)number * TFM_ORDER_COLOURS * size;
  __global const float *of_sweep = LIGHT_OF(number);
#if TFM_ORDER_MEDIA
  Mixed mixed[TFM_ORDER_COLOURS];
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    mixed[c].share = mixed[c].light = mixed[c].straight = mixed[c].before = floats(0.0f);
#else
  float part[TFM_ORDER_COLOURS];
#endif
  Floats radiances[TFM_ORDER_COLOURS], sources[TFM_ORDER_COLOURS], extinctions[TFM_CHANNELS];
  WALLS_OF(number, item % rays);
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
#if !TFM_ORDER_MEDIA
    part[c] = TFM_ORDER_LOBE ? orders->straight * orders->albedo[c] : orders->albedo[c];
#endif
    radiances[c] = sources[c] = floats(0.0f);
  }
  for (int c = 0; c < TFM_CHANNELS; ++c)
    extinctions[c] = floats(0.0f);
  for (int m = 0; m < planes; ++m) {
    const Shift shift_x = shift_of(slope_x, m), shift_y = shift_of(slope_y, m);
    const int x = ray.x + shift_x.whole, y = ray.y + shift_y.whole;
    if (x < -TFM_LANES || x >= columns || y < -1 || y >= rows)
      continue; /* outside nothing is scattered */
    const int plane = sweep->backwards ? planes - 1 - m : m;
    const int at = (plane + 1) * sweep->plane + (y + 1) * row + x + PAD;
    Floats depth[TFM_CHANNELS], most = floats(0.0f);
#if TFM_ORDER_MEDIA
    Floats before[TFM_CHANNELS];
    for (int c = 0; c < TFM_CHANNELS; ++c)
      before[c] = extinctions[c];
#endif
    for (int c = 0; c < TFM_CHANNELS; ++c) {
      const Floats here = between_rows(extinction + (size_t)c * size + at, row, shift_x.part, shift_y.part);
      depth[c] = length * (here + extinctions[c]);
      extinctions[c] = here;
      most = greatest(most, depth[c]);
    }
    BEFORE_WALLS(radiances, depth[TFM_CHANNELS == 3 ? c : 0] * sources[c]);
    if (any_lane(most > 0.0f)) {
      Floats through[TFM_CHANNELS], mean[TFM_CHANNELS];
      for (int c = 0; c < TFM_CHANNELS; ++c) {
        const Exp2 e = exp_of_minus(depth[c]);
        through[c] = e.scale + e.scale * e.part;
        mean[c] = depth[c] > 1e-6f ? ((1.0f - e.scale) - e.scale * e.part) / depth[c] : floats(1.0f);
      }
      for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
        const int channel = TFM_CHANNELS == 3 ? c : 0;
#if TFM_ORDER_MEDIA
        /* Where nothing is extinguished, shares are as at the step's other end. */
        const Floats extinct = extinctions[channel];
        Mixed now = mixed[c];
        now.share = extinct > 0.0f ? BETWEEN(scattering, c) / extinct : now.share;
        now.light = BETWEEN(of_sweep, c);
#if TFM_ORDER_LOBE
        now.straight = extinct > 0.0f ? BETWEEN(scattering, TFM_ORDER_COLOURS + c) / extinct : now.straight;
        now.before = ROW(out + (size_t)c * size + at);
#endif
        const Floats here = source_of(&now, &now);
        sources[c] = before[channel] > 0.0f ? sources[c] : source_of(&mixed[c], &now);
        mixed[c] = now;
#else
        const Floats here = SCATTERED_OF(c);
#endif
        /* What is scattered over what is extinguished, linear along the step. */
        radiances[c] = radiances[c] * through[channel] + sources[c] * (mean[channel] - through[channel]) +
                       here * (1.0f - mean[channel]);
        sources[c] = here;
      }
    } else
      for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
#if TFM_ORDER_MEDIA
        mixed[c].light = BETWEEN(of_sweep, c);
        mixed[c].before = TFM_ORDER_LOBE ? ROW(out + (size_t)c * size + at) : floats(0.0f);
        sources[c] = source_of(&mixed[c], &mixed[c]);
#else
        sources[c] = SCATTERED_OF(c);
#endif
      }
    MEET_WALLS(m, depth, depth[TFM_CHANNELS == 3 ? c : 0] * sources[c], radiances);
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
      *(__global FloatRow *)(out + (size_t)c * size + at) = radiances[c];
  }
}

/* Sweeps what media emit, which comes unscattered, as order_sweep does what is scattered.
   emitted   of the points, of each colour, per world unit, in the rows that the sweeps have
   radiance  out, of each direction and colour, likewise */
__kernel void order_emission(SWEEP sweeps, __global const float *extinction, __global const float *emitted,
                             __global float *radiance, int rays, int size WALLS_ARGUMENTS, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const int number = item / rays;
  SWEEP sweep = sweeps + number;
  const float length = 0.5f * sweep->length;
  const int planes = sweep->planes, row = sweep->row;
  const FirstRay ray = first_ray(sweep, item % rays);
  if (!ray.wanted)
    return;
  __global float *out = radiance + (size_t)number * TFM_ORDER_COLOURS * size;
  Floats radiances[TFM_ORDER_COLOURS], emits[TFM_ORDER_COLOURS], extinctions[TFM_CHANNELS];
  WALLS_OF(number, item % rays);
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    radiances[c] = emits[c] = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    extinctions[c] = floats(0.0f);
  for (int m = 0; m < planes; ++m) {
    const Shift shift_x = shift_of(sweep->slope[0], m), shift_y = shift_of(sweep->slope[1], m);
    const int x = ray.x + shift_x.whole, y = ray.y + shift_y.whole;
    if (x < -TFM_LANES || x >= sweep->columns || y < -1 || y >= sweep->rows)
      continue; /* outside nothing is emitted */
    const int plane = sweep->backwards ? planes - 1 - m : m;
    const int at = (plane + 1) * sweep->plane + (y + 1) * row + x + PAD;
    Floats depth[TFM_CHANNELS], through[TFM_CHANNELS], mean[TFM_CHANNELS];
    BEFORE_WALLS(radiances, 2.0f * length * emits[c]);
    for (int c = 0; c < TFM_CHANNELS; ++c) {
      const Floats here = BETWEEN(extinction, c);
      depth[c] = length * (here + extinctions[c]);
      const Exp2 e = exp_of_minus(depth[c]);
      through[c] = e.scale + e.scale * e.part;
      mean[c] = depth[c] > 1e-6f ? ((1.0f - e.scale) - e.scale * e.part) / depth[c] : floats(1.0f);
      extinctions[c] = here;
    }
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
      const int channel = TFM_CHANNELS == 3 ? c : 0;
      const Floats here = BETWEEN(emitted, c);
      /* Along the step both are as on average. */
      radiances[c] = radiances[c] * through[channel] + length * (emits[c] + here) * mean[channel];
      emits[c] = here;
    }
    MEET_WALLS(m, depth, 2.0f * length * emits[c], radiances);
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
      *(__global FloatRow *)(out + (size_t)c * size + at) = radiances[c];
  }
}

/* Sums what arrives at points from the directions of a launch, which have the same rows.
   next    of the points, in these rows: adds to, or begins
   begins  1: the first directions
   items   first of this launch and end */
__kernel void order_gather(SWEEP sweeps, __global const float *radiance, __global float *next, int count, int size,
                           int begins, int2 items)
{
  const int columns = sweeps->columns, chunks = (columns + TFM_LANES - 1) / TFM_LANES;
  /* Rows and planes change places from sweep to sweep; what is further apart is called a layer here. */
  const int flat = sweeps->plane > sweeps->row;
  const int row = flat ? sweeps->row : sweeps->plane, layer = flat ? sweeps->plane : sweeps->row;
  const int rows = flat ? sweeps->rows : sweeps->planes;
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const int x = item % chunks * TFM_LANES, y = item / chunks % rows, z = item / chunks / rows;
  const int at = (z + 1) * layer + (y + 1) * row + x + PAD;
  Floats sum[TFM_ORDER_COLOURS];
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    sum[c] = begins ? floats(0.0f) : ROW(next + (size_t)c * size + at);
  for (int number = 0; number < count; ++number) {
    SWEEP sweep = sweeps + number;
    const int plane = sweep->plane == layer ? z : y, m = sweep->backwards ? sweep->planes - 1 - plane : plane;
    const float part_x = shift_of(sweep->slope[0], m).part, part_y = shift_of(sweep->slope[1], m).part;
    __global const float *from = radiance + (size_t)number * TFM_ORDER_COLOURS * size + at;
    /* The rays before a point lie a part of a distance after the point before it. */
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
      sum[c] += between_rows(from + (size_t)c * size - sweep->row - 1, sweep->row, 1.0f - part_x, 1.0f - part_y);
  }
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    *(__global FloatRow *)(next + (size_t)c * size + at) = sum[c];
}

/* next    of order_gather, from directions along y and z; turned_next: from those along x
   light   out: their mean
   total   to which that is added, of the points one after the other
   share   of each direction among all
   items   first of this launch and end */
__kernel void order_mean(ORDERS orders, __global const float *next, __global const float *turned_next,
                         __global float *light, __global float *total, float share, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    const Floats sum = gather_floats(next + (size_t)c * padded_size(orders), points.at) +
                       gather_floats(turned_next + (size_t)c * turned_size(orders), points.turned);
    store_floats(light + (size_t)c * padded_size(orders), points.at, points.wanted, share * sum);
    const Ints number = points.number * TFM_ORDER_COLOURS + c;
    store_floats(total, number, points.wanted, gather_floats(total, number) + share * sum);
  }
}

/* Writes numbers of points once more, in rows along y.
   count  of extinctions or colours
   items  first of this launch and end */
__kernel void order_turn(ORDERS orders, __global const float *numbers, __global float *turned, int count, int2 items)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_of(orders, item);
  for (int c = 0; c < count; ++c)
    store_floats(turned + (size_t)c * turned_size(orders), points.turned, points.wanted,
                 gather_floats(numbers + (size_t)c * padded_size(orders), points.at));
}

#if TFM_ORDER_WALLS
/* What patches of solids reflect of what arrives there. A work-item takes one.
   starts     of each patch, where its entries of `of_patches` begin, and the end
   of_patches numbers of the walls that light arrives at; shares: their shares of what patches receive
   arriving   of each colour of all walls; reflected: out, of each colour of all patches
   count      of walls */
__kernel void order_reflect(__global const int *starts, __global const int *of_patches, __global const float *shares,
                            __global const float *albedo, __global const float *arriving, __global float *reflected,
                            int patches, int count)
{
  const int patch = (int)get_global_id(0);
  if (patch >= patches)
    return;
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    float sum = 0.0f;
    for (int k = starts[patch]; k < starts[patch + 1]; ++k)
      sum += shares[k] * arriving[(size_t)c * count + of_patches[k]];
    reflected[(size_t)c * patches + patch] = albedo[(size_t)c * patches + patch] * sum;
  }
}
#endif
