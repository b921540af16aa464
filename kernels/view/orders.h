/* The lattice on which light is scattered again and again: points in equal distances along the world's axes. What all
   later orders scatter is read from it along camera rays, in the place of lattice.h.
   Requires: TFM_CHANNELS, the extinctions that it knows, and TFM_ORDER_COLOURS, those of light: 1 or 3; what frame.h and
   walk.h do, the latter where there are grids.
   With TFM_ORDER_MEDIA, which is 0 else, there are so many media, the first ones, and `orders` points to a struct of each.
   What they scatter in the camera's pass is then known apart: TFM_ORDER_COLOURS is three times as much, unless all of
   them scatter light alike. */
#ifndef TFM_ORDERS_H
#define TFM_ORDERS_H

#include "core/ray.h"
#include "view/frame.h"
#ifndef TFM_ORDER_MEDIA
#define TFM_ORDER_MEDIA 0
#endif
/* How many things points know apart. */
#define APART_MEDIA (TFM_ORDER_MEDIA ? TFM_ORDER_MEDIA : 1)
/* Where points have one number for three, all light is of one colour, of which there is most. */
#define COLOUR_OF(rgb, c) (TFM_ORDER_COLOURS == 3 ? (rgb)[c] : fmax(fmax((rgb)[0], (rgb)[1]), (rgb)[2]))

/* Numbers of points lie in memory with some 0 around them, so that what passes by the lattice reads them: row by row,
   and, for light that goes mainly along x, once more in rows along y. Each extinction and colour is by itself. */
#define PAD (TFM_LANES + 1)

TFM_INLINE int padded_size(ORDERS orders)
{
  return (orders->size[0] + 2 * PAD) * (orders->size[1] + 2) * (orders->size[2] + 2);
}

TFM_INLINE int turned_size(ORDERS orders)
{
  return (orders->size[1] + 2 * PAD) * (orders->size[0] + 2) * (orders->size[2] + 2);
}

/* Some points, a lane each: those from the item-th TFM_LANES on. */
typedef struct {
  Ints number; /* 0 in lanes that are not wanted */
  Ints wanted;
  Ints place[3]; /* along x, y, z */
  Ints at;       /* where their numbers are */
  int first;     /* the same of the first, where they are neighbours in a row; 0 elsewhere */
  Ints turned;   /* where these are in rows along y */
} Points;

TFM_INLINE Points points_of(ORDERS orders, int item)
{
  const int nx = orders->size[0], ny = orders->size[1], nz = orders->size[2];
  const Ints number = item * TFM_LANES + LANE_Y * TILE_WIDTH + LANE_X;
  Points points;
  points.wanted = number < nx * ny * nz;
  points.number = points.wanted ? number : ints(0);
  const Ints x = points.number % nx, y = points.number / nx % ny, z = points.number / (nx * ny);
  points.place[0] = x;
  points.place[1] = y;
  points.place[2] = z;
  points.at = ((z + 1) * (ny + 2) + y + 1) * (nx + 2 * PAD) + x + PAD;
  const int x0 = item * TFM_LANES % nx, row0 = item * TFM_LANES / nx;
  points.first = x0 + TFM_LANES <= nx && row0 < ny * nz
                     ? ((row0 / ny + 1) * (ny + 2) + row0 % ny + 1) * (nx + 2 * PAD) + x0 + PAD
                     : 0;
  points.turned = ((z + 1) * (nx + 2) + x + 1) * (ny + 2 * PAD) + y + PAD;
  return points;
}

/* The same of those in a box of points, in chunks of its rows, of which there is an item-th. low: the first of them along
   x, y, z; count: their numbers */
TFM_INLINE Points points_in(ORDERS orders, int4 low, int4 count, int item)
{
  const int nx = orders->size[0], ny = orders->size[1], chunks = (count.x + TFM_LANES - 1) / TFM_LANES;
  const int x0 = item % chunks * TFM_LANES, y = low.y + item / chunks % count.y, z = low.z + item / chunks / count.y;
  const int row = ((z + 1) * (ny + 2) + y + 1) * (nx + 2 * PAD) + PAD;
  const Ints x = x0 + LANE_Y * TILE_WIDTH + LANE_X;
  Points points;
  points.wanted = x < count.x;
  points.place[0] = points.wanted ? low.x + x : ints(0);
  points.place[1] = points.wanted ? ints(y) : ints(0);
  points.place[2] = points.wanted ? ints(z) : ints(0);
  points.number = (points.place[2] * ny + points.place[1]) * nx + points.place[0];
  points.at = points.wanted ? row + points.place[0] : ints(((ny + 2) + 1) * (nx + 2 * PAD) + PAD);
  points.first = x0 + TFM_LANES <= count.x ? row + low.x + x0 : 0;
  points.turned = ((points.place[2] + 1) * (nx + 2) + points.place[0] + 1) * (ny + 2 * PAD) + points.place[1] + PAD;
  return points;
}

/* The item-th few of the points that are listed, a lane each. */
TFM_INLINE Points listed_points(ORDERS orders, __global const int *listed, int count, int item)
{
  const int nx = orders->size[0], ny = orders->size[1];
  const Ints n = item * TFM_LANES + LANE_Y * TILE_WIDTH + LANE_X;
  Points points;
  points.wanted = n < count;
  points.number = gather_ints(listed, points.wanted ? n : ints(0));
  points.place[0] = points.number % nx;
  points.place[1] = points.number / nx % ny;
  points.place[2] = points.number / (nx * ny);
  points.at = points.turned = ints(0);
  points.first = 0;
  return points;
}

TFM_INLINE Vec3 position_of(ORDERS orders, const Points *points)
{
  return vec3(orders->origin[0] + orders->spacing * TO_FLOATS(points->place[0]),
              orders->origin[1] + orders->spacing * TO_FLOATS(points->place[1]),
              orders->origin[2] + orders->spacing * TO_FLOATS(points->place[2]));
}

/* Lanes that are neighbours in memory, wherever they begin. */
typedef Floats FloatRow __attribute__((aligned(4)));
#define ROW(p) (*(__global const FloatRow *)(p))

/* Of points, one number each. */
TFM_INLINE Floats numbers_at(__global const float *numbers, const Points *points)
{
  return points->first ? ROW(numbers + points->first) : gather_floats(numbers, points->at);
}

/* From a point to the camera, of length 1. */
TFM_INLINE Vec3 way_to_camera(VIEW view, Vec3 point)
{
  const Vec3 way = vec3(view->position[0] - point.x, view->position[1] - point.y, view->position[2] - point.z);
  return scale3(reciprocal_sqrt(greatest(dot3(way, way), floats(FLT_MIN))), way);
}

/* Where the rays of a direction cross a plane. */
typedef struct {
  int whole; /* by how many points they are shifted */
  float part; /* and by which part of a distance more */
} Shift;

TFM_INLINE Shift shift_of(float slope, int plane)
{
  const float shift = slope * (float)plane;
  Shift found;
  found.whole = (int)shift;
  found.whole -= (float)found.whole > shift;
  found.part = shift - (float)found.whole;
  return found;
}

/* Mean of what four neighbours hold: of two rows, from a column on. */
TFM_INLINE Floats between_rows(__global const float *lower, int row, float right, float up)
{
  __global const float *upper = lower + row;
  const Floats low = ROW(lower) + right * (ROW(lower + 1) - ROW(lower));
  const Floats high = ROW(upper) + right * (ROW(upper + 1) - ROW(upper));
  return low + up * (high - low);
}

/* A camera ray among the points. */
typedef struct {
  __global const float *numbers; /* the sum over the orders, TFM_ORDER_COLOURS of each point */
  ORDERS orders;
  Ray ray; /* in distances between points, from the first one */
} OrdersOnRay;
#define LATTICE const OrdersOnRay *
#ifdef TFM_ORDER_SURROUNDINGS
#define LATTICE_AT(lattice, walk, steps, k, t) radiances_of(lattice_at(lattice, t))
#else
#define LATTICE_AT(lattice, walk, steps, k, t) lattice_at(lattice, t)
#endif

TFM_INLINE OrdersOnRay orders_on_ray(ORDERS orders, __global const float *numbers, Ray ray)
{
  const float inverse = 1.0f / orders->spacing;
  OrdersOnRay on_ray;
  on_ray.numbers = numbers;
  on_ray.orders = orders;
  on_ray.ray.origin = scale3(floats(inverse), vec3(ray.origin.x - orders->origin[0], ray.origin.y - orders->origin[1],
                                                   ray.origin.z - orders->origin[2]));
  on_ray.ray.direction = scale3(floats(inverse), ray.direction);
  return on_ray;
}

typedef struct {
  Floats of[TFM_ORDER_COLOURS];
} LatticeValue;

TFM_INLINE LatticeValue lattice_begin(void)
{
  LatticeValue value;
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    value.of[c] = floats(0.0f);
  return value;
}

/* Where a coordinate lies: the lower of two neighbours, and the weight of the upper. */
TFM_INLINE Ints between_points(Floats x, int size, Floats *weight)
{
  const Floats inside = clamp_to(x, (float)(size - 1));
  const Ints low = TO_INTS(inside), last = ints(size - 2);
  const Ints bounded = low < last ? low : last;
  *weight = inside - TO_FLOATS(bounded);
  return bounded;
}

#if TFM_LANES > 1
/* Points along each axis that the lanes of a tile share: their numbers are then read once for all lanes. In straight code,
   where points beyond the lanes weigh 0, as in window_sum. */
#define MOST_TOGETHER 3

/* Linear weights of a row of points. x: positions relative to the first. */
TFM_INLINE void weights_together(Floats x, Floats *weight)
{
#pragma unroll
  for (int i = 0; i < MOST_TOGETHER; ++i)
    weight[i] = greatest(least(x - (float)(i - 1), (float)(i + 1) - x), floats(0.0f));
}

/* The lowest of the lanes' points along an axis; -1 where they share too few, or there are too few. */
TFM_INLINE int first_together(Ints low, int size)
{
  const int first = least_int(low), last = -least_int(-low) + 1, end = size - MOST_TOGETHER;
  return last - first < MOST_TOGETHER ? (first < end ? first : end) : -1;
}

/* Of all lanes, from the points that begin there; point: where they are, inside the lattice. */
TFM_INLINE LatticeValue lattice_together(LATTICE lattice, int x, int y, int z, Vec3 point)
{
  ORDERS orders = lattice->orders;
  const int row = orders->size[0], layer = row * orders->size[1];
  __global const float *first = lattice->numbers + (size_t)(z * layer + y * row + x) * TFM_ORDER_COLOURS;
  Floats wx[MOST_TOGETHER], wy[MOST_TOGETHER], wz[MOST_TOGETHER];
  weights_together(point.x - (float)x, wx);
  weights_together(point.y - (float)y, wy);
  weights_together(point.z - (float)z, wz);
  LatticeValue sum = lattice_begin();
#pragma unroll
  for (int k = 0; k < MOST_TOGETHER; ++k)
#pragma unroll
    for (int j = 0; j < MOST_TOGETHER; ++j) {
      const Floats weight = wz[k] * wy[j];
      __global const float *numbers = first + (size_t)(k * layer + j * row) * TFM_ORDER_COLOURS;
#pragma unroll
      for (int i = 0; i < MOST_TOGETHER; ++i) {
        const Floats of_point = weight * wx[i];
#pragma unroll
        for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
          sum.of[c] += of_point * numbers[i * TFM_ORDER_COLOURS + c];
      }
    }
  return sum;
}
#endif

/* At distance t: linear between the points. */
TFM_INLINE LatticeValue lattice_at(LATTICE lattice, Floats t)
{
  ORDERS orders = lattice->orders;
  const Vec3 point = ray_at(lattice->ray, t);
  Floats fx, fy, fz;
  const Ints ix = between_points(point.x, orders->size[0], &fx), iy = between_points(point.y, orders->size[1], &fy),
             iz = between_points(point.z, orders->size[2], &fz);
  const int row = orders->size[0], layer = row * orders->size[1];
#if TFM_LANES > 1
  const int x = first_together(ix, orders->size[0]), y = first_together(iy, orders->size[1]),
            z = first_together(iz, orders->size[2]);
  if ((x | y | z) >= 0)
    return lattice_together(lattice, x, y, z, vec3(TO_FLOATS(ix) + fx, TO_FLOATS(iy) + fy, TO_FLOATS(iz) + fz));
#endif
  const Ints at = (iz * layer + iy * row + ix) * TFM_ORDER_COLOURS;
  LatticeValue value = lattice_begin();
  for (int corner = 0; corner < 8; ++corner) {
    const int right = corner & 1, up = corner >> 1 & 1, back = corner >> 2;
    const Floats weight = (right ? fx : 1.0f - fx) * (up ? fy : 1.0f - fy) * (back ? fz : 1.0f - fz);
    __global const float *point_numbers = lattice->numbers + (back * layer + up * row + right) * TFM_ORDER_COLOURS;
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
      value.of[c] += weight * gather_floats(point_numbers + c, at);
  }
  return value;
}

#ifdef TFM_ORDER_SURROUNDINGS
/* view/surroundings.h says what a step takes. */
#elif TFM_ORDER_MEDIA
#ifdef TFM_AMOUNTS_H
/* A step took its opacity from the ray: each medium scatters its part of that. */
#define LATTICE_STEP(sums, value, media, step, opacity, weight) lattice_step(sums, value, media, step, opacity)
TFM_INLINE void lattice_step(LightSums *sums, const LatticeValue *value, MEDIUM media, const Amounts *step,
                             const Floats *opacity)
{
  for (int c = 0; c < 3; ++c) {
    Floats scattered = floats(0.0f);
    for (int m = 0; m < TFM_ORDER_MEDIA; ++m)
      scattered += media[m].sigma_s[c] * step->of[m][AMOUNT_OF(c)] * value->of[TFM_ORDER_COLOURS == 3 ? c : 3 * m + c];
    const Floats extinct = extinguished(media, step, c);
    sums->colour[c] += extinct > 0.0f ? opacity[TFM_CHANNELS == 3 ? c : 0] * scattered / extinct : floats(0.0f);
  }
}
#endif
#else
#define LATTICE_STEP(sums, value, media, step, opacity, weight) lattice_step(sums, value, opacity)
/* A step took its opacity from the ray; colours are then over albedo. */
TFM_INLINE void lattice_step(LightSums *sums, const LatticeValue *value, const Floats *opacity)
{
  for (int c = 0; c < 3; ++c)
    sums->colour[c] += opacity[TFM_CHANNELS == 3 ? c : 0] * value->of[TFM_ORDER_COLOURS == 3 ? c : 0];
}
#endif

#endif
