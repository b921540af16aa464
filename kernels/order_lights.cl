/* What lights bring to the points of a lattice (view/orders.h).
   Includes expected before: a basis and a light header, and those of the bodies' kinds. Requires: what
   light/reduced_intensity.h and view/cells.h do; TFM_ORDER_DEGREE, 0 where light is scattered evenly, else that of
   view/harmonics.h; with that and TFM_ORDER_MEDIA, what of the media scatters on the way of light is told apart;
   TFM_ORDER_WALLS, 1 where solids reflect it. */
#include "core/store.h"
#include "light/reduced_intensity.h"
#include "view/cells.h"
#if TFM_ORDER_DEGREE
#include "view/harmonics.h"
#endif

#define INVERSE_SPHERE 0.0795774715f /* 1 / 4 pi */
#define LEAST_WEIGHT 1e-6f           /* as an optical depth of the distance between points: where there is no density */

/* Of several media, their coefficients of something on a light's way in the place of extinction: of what they scatter, or of
   what of that goes straight on. */
#define TELLS_APART (TFM_ORDER_MEDIA && TFM_ORDER_DEGREE)
#if TELLS_APART
#define OF_WAY_ARGUMENTS , VIEW way_view, MEDIUM way_media
#if TFM_GRIDS
#define OF_WAY(scene) const Scene of_way = {way_view, way_media, (scene).bodies, (scene).grids, (scene).padded}
#else
#define OF_WAY(scene) const Scene of_way = {way_view, way_media, (scene).bodies, (scene).grids}
#endif
#else
#define OF_WAY_ARGUMENTS
#define OF_WAY(scene) const Scene of_way = scene
#endif

/* A light at a point, without its intensity. */
typedef struct {
  Floats strength; /* 0 where none arrives */
  Floats tint[3];
  Floats depth[TFM_CHANNELS]; /* optical, of the way to it */
#if TELLS_APART
  Floats of_way[TFM_CHANNELS]; /* the same of the other coefficients */
#endif
} Arrival;

TFM_INLINE Arrival arrival_at(const Scene *scene, const Scene *of_way, LIGHT from, const LightBuffers *buffers, Vec3 point,
                              Ints wanted)
{
  Arrival arrival;
  const LightSample sample = light_at(from, point_in_light(from, point));
  const Ints lit = wanted & (sample.strength > 0.0f) & light_reaches(from, point);
  arrival.strength = floats(0.0f);
  if (!any_lane(lit))
    return arrival;
  const LightPath path = light_path(scene, from, buffers, point, sample, 0, 0);
  Ints samples = ints(0);
  light_optical_depths(scene, from, buffers, &path, lit, &samples, arrival.depth);
#if TELLS_APART
  light_optical_depths(of_way, from, buffers, &path, lit, &samples, arrival.of_way);
#else
  (void)of_way;
#endif
  light_tint(from, buffers, sample, arrival.tint);
  arrival.strength = lit ? sample.strength * light_visibility(from, buffers->shadow, sample) : floats(0.0f);
  return arrival;
}

/* In which it goes, in the world. */
TFM_INLINE Vec3 way_of_light(LIGHT from, Vec3 point)
{
  return transform_vector(from->world_from_light, light_at(from, point_in_light(from, point)).direction);
}

/* Of a light's colour that arrives: what was scattered straight on so many times, of what there was. */
TFM_INLINE Floats left_after(ORDERS orders, const Arrival *arrival, int c, int times, float log_factorial)
{
  const int channel = TFM_CHANNELS == 3 ? c : 0;
  const Floats depth = arrival->depth[channel];
  if (times == 0)
    return transmittance_of(depth);
#if TELLS_APART
  const Floats straight = arrival->of_way[channel];
#else
  const Floats straight = orders->straight * orders->albedo[c] * depth;
#endif
  const Floats chance = (float)times * log_of(greatest(straight, floats(FLT_MIN))) - log_factorial;
  return transmittance_of(greatest(depth - chance, floats(0.0f)));
}

/* Adds what no lattice has scattered yet: the mean over all directions of the radiance that arrives, or, where scattering
   has a lobe, its moments. It is that of the cube around a point, weighed by the density: as much is scattered as without a
   lattice, however fast light falls off.
   light   of the points, adds to
   number  of the light among those given
   times   that it was scattered straight on; log_factorial: logarithm of times!
   way_view, way_media  where the media are told apart: coefficients of what goes straight on
   deposited  as of order_media
   low, count  the points that the light may reach, as of points_in
   items   first of this launch and end */
__kernel void order_lights(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                           ORDERS orders, __global float *light, int number, int times, float log_factorial,
                           int4 low, int4 count, int2 items DEPOSITED_ARGUMENT OF_WAY_ARGUMENTS)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_in(orders, low, count, item);
  if (!any_lane(points.wanted))
    return;
  SCENE(scene, ints(-1), ints(-1));
  OF_WAY(scene);
  LIGHT_BUFFERS(buffers);
  LIGHT from = lights + number;
  const Vec3 centre = position_of(orders, &points);
  const Amounts deposits = DEPOSITED_IN(orders, &points);
  const float least_weight = LEAST_WEIGHT / orders->spacing;
  Floats sum[TFM_ORDER_COLOURS], weight[TFM_CHANNELS];
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c)
    sum[c] = floats(0.0f);
  for (int c = 0; c < TFM_CHANNELS; ++c)
    weight[c] = floats(0.0f);
  EACH_SAMPLE(orders) {
    const Vec3 point = sample_of_cell(orders, centre, i, j, k);
    const Amounts density = density_at(&scene, orders, point, &deposits);
    Floats here[TFM_CHANNELS];
    for (int c = 0; c < TFM_CHANNELS; ++c) {
      here[c] = extinguished(media, &density, c) + least_weight;
      weight[c] += here[c];
    }
    const Arrival arrival = arrival_at(&scene, &of_way, from, &buffers, point, points.wanted);
    if (!any_lane(arrival.strength > 0.0f))
      continue;
    for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
      const int channel = TFM_CHANNELS == 3 ? c : 0;
      sum[c] += arrival.tint[c] * here[channel] * arrival.strength *
                left_after(orders, &arrival, c, times, log_factorial);
    }
  }
#if TFM_ORDER_DEGREE
  Floats y[HARMONICS];
  harmonics_of(way_of_light(from, centre), y);
#endif
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    const Floats more = COLOUR_OF(from->intensity, c) * sum[c] / weight[TFM_CHANNELS == 3 ? c : 0];
#if TFM_ORDER_DEGREE
    for (int n = 0; n < HARMONICS; ++n) {
      __global float *numbers = light + (size_t)(n * TFM_ORDER_COLOURS + c) * padded_size(orders);
      const Floats sum = numbers_at(numbers, &points) + y[n] * more;
      if (points.first)
        *(__global FloatRow *)(numbers + points.first) = sum;
      else
        store_floats(numbers, points.at, points.wanted, sum);
    }
#else
    __global float *numbers = light + (size_t)c * padded_size(orders);
    store_floats(numbers, points.at, points.wanted, gather_floats(numbers, points.at) + INVERSE_SPHERE * more);
#endif
  }
}

#if TFM_ORDER_WALLS
/* Adds what patches of solids reflect of a light.
   patches    of all of them places x, y, z, normals x, y, z, and albedo R, G, B
   reflected  of each colour of all patches, adds to
   count      of patches
   times, log_factorial, way_view, way_media  as of order_lights */
__kernel void order_walls(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                          ORDERS orders, __global const float *patches, __global float *reflected, int number, int times,
                          float log_factorial, int count, int2 items OF_WAY_ARGUMENTS)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Ints n = item * TFM_LANES + LANE_Y * TILE_WIDTH + LANE_X;
  const Ints wanted = n < count, at = wanted ? n : ints(0);
  Floats known[9];
  for (int i = 0; i < 9; ++i)
    known[i] = gather_floats(patches + (size_t)i * count, at);
  const Vec3 point = vec3(known[0], known[1], known[2]);
  SCENE(scene, ints(-1), ints(-1));
  OF_WAY(scene);
  LIGHT_BUFFERS(buffers);
  LIGHT from = lights + number;
  const Floats cosine = -dot3(way_of_light(from, point), vec3(known[3], known[4], known[5]));
  const Ints faces = wanted & (cosine > 0.0f);
  if (!any_lane(faces))
    return;
  const Arrival arrival = arrival_at(&scene, &of_way, from, &buffers, point, faces);
  if (!any_lane(arrival.strength > 0.0f))
    return;
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    const Floats arrives = COLOUR_OF(from->intensity, c) * arrival.tint[c] * arrival.strength * cosine *
                           left_after(orders, &arrival, c, times, log_factorial);
    __global float *out = reflected + (size_t)c * count;
    store_floats(out, at, faces, gather_floats(out, at) + 4.0f * INVERSE_SPHERE * known[6 + c] * arrives);
  }
}
#endif

#if TFM_ORDER_DEGREE
/* Finds what order_beyond must know of a light at the points that it may reach: whatever the camera, which may move.
   arrived  out, of these points, by their work-items and lanes, `room` numbers each: in which direction it goes, x, y, z; of
            each colour what is left of it but for what it scatters on its way; and of each by how much that is, as a place
            among the rows of `lobes.beyond`
   way_view, way_media  where the media are told apart: coefficients of what they scatter */
__kernel void order_arrived(VIEW view, MEDIUM media, BODY bodies, GRID_ARGUMENTS, LIGHT lights, LIGHT_ARGUMENTS,
                            ORDERS orders, __global float *arrived, int number, int room, int4 low, int4 count,
                            int2 items OF_WAY_ARGUMENTS)
{
  const int item = items.x + (int)get_global_id(0);
  if (item >= items.y)
    return;
  const Points points = points_in(orders, low, count, item);
  SCENE(scene, ints(-1), ints(-1));
  OF_WAY(scene);
  LIGHT_BUFFERS(buffers);
  LIGHT from = lights + number;
  const Vec3 centre = position_of(orders, &points), way = way_of_light(from, centre);
  const Arrival arrival = arrival_at(&scene, &of_way, from, &buffers, centre, points.wanted);
  const Ints lit = arrival.strength > 0.0f;
  __global float *out = arrived + (size_t)item * TFM_LANES;
  *(__global FloatRow *)out = way.x;
  *(__global FloatRow *)(out + room) = way.y;
  *(__global FloatRow *)(out + 2 * (size_t)room) = way.z;
  for (int c = 0; c < TFM_ORDER_COLOURS; ++c) {
    Floats left = floats(0.0f), row = floats(0.0f);
    if (any_lane(lit)) {
      const Floats depth = arrival.depth[TFM_CHANNELS == 3 ? c : 0];
#if TELLS_APART
      const Floats met = arrival.of_way[TFM_CHANNELS == 3 ? c : 0];
#else
      const Floats met = orders->albedo[c] * depth;
#endif
      left = COLOUR_OF(from->intensity, c) * arrival.tint[c] * arrival.strength * transmittance_of(depth - met);
      row = met / (met + BEYOND_HALF) * (float)(BEYOND_DEPTHS - 1);
      left = lit ? left : floats(0.0f);
      row = lit ? row : floats(0.0f);
    }
    *(__global FloatRow *)(out + (size_t)(3 + c) * room) = left;
    *(__global FloatRow *)(out + (size_t)(3 + TFM_ORDER_COLOURS + c) * room) = row;
  }
}
#endif
