/* Which primitives the rays of a camera or a light may meet: lists for the bins of its pixels or texels. A bin's rays lie in
   a cone; it looks through the list of the larger bin around it, so that lists come in order, whatever runs first.
   Includes expected before: the headers of the primitives' kinds. Requires: TFM_PRIMITIVE_SEEN(source, set, eye, seen), one
   of theirs; TFM_FROM_LIGHT, 1 with a light header included before, 0 for the camera. */
#if TFM_FROM_LIGHT
#include "light/sample.h"
#define ORIGIN LIGHT light
#else
#include "view/camera.h"
#define ORIGIN VIEW view
#endif
#include "core/store.h"

/* Primitives as they are seen from somewhere.
   sets       of which body a primitive is
   footprint  width of a texel: at the origin, and what it gains per unit of distance
   seen       out */
__kernel void see_primitives(SOURCE sources, SET sets, float4 origin, float2 footprint, __global Primitive *seen, int count)
{
  const int i = (int)get_global_id(0);
  if (i >= count)
    return;
  SOURCE source = sources + i;
  SET set = sets + source->set;
  __global Primitive *found = seen + i;
  const Eye eye = {{origin.x, origin.y, origin.z}, footprint.x, footprint.y};
  const float amount = TFM_PRIMITIVE_SEEN(source, set, &eye, found);
  for (int k = 0; k < 3; ++k) {
    __global const float *row = set->weights + 3 * k;
    found->amount[k] = amount * (row[0] * source->colour[0] + row[1] * source->colour[1] + row[2] * source->colour[2]);
  }
  found->kind = set->kind;
  found->medium = set->medium;
}

/* The rays of a bin begin within a distance of its origin, and lie in the cone around its axis. */
typedef struct {
  Vec3 origin, axis;
  float radius, cosine, sine;
} Bundle;

/* x, y: positions between texels. */
TFM_INLINE Ray ray_between(ORIGIN, int4 size, float x, float y)
{
#if TFM_FROM_LIGHT
  return light_texel_ray(light, floats(x / (float)size.x), floats(y / (float)size.y));
#else
  (void)size;
  return ray_through(view, floats(x), floats(y));
#endif
}
#if TFM_FROM_LIGHT
#define RAY_BETWEEN(size, x, y) ray_between(light, size, x, y)
#else
#define RAY_BETWEEN(size, x, y) ray_between(view, size, x, y)
#endif

#define SIDE 3 /* rays along a side that tell where those of a bin lie */

/* margin: of a cone's sine, where rays between those that are looked at may lie outside of their cone. */
TFM_INLINE Bundle bundle_of(ORIGIN, int4 size, int x0, int y0, int edge, float margin)
{
  Ray rays[SIDE * SIDE];
  Vec3 origins = vec3(floats(0.0f), floats(0.0f), floats(0.0f)), axes = origins;
  for (int i = 0; i < SIDE * SIDE; ++i) {
    const float x = (float)x0 + (float)(i % SIDE * edge) / (float)(SIDE - 1);
    const float y = (float)y0 + (float)(i / SIDE * edge) / (float)(SIDE - 1);
    rays[i] = RAY_BETWEEN(size, x < (float)size.x ? x : (float)size.x, y < (float)size.y ? y : (float)size.y);
    const Vec3 o = rays[i].origin, d = rays[i].direction;
    origins = vec3(origins.x + o.x, origins.y + o.y, origins.z + o.z);
    axes = vec3(axes.x + d.x, axes.y + d.y, axes.z + d.z);
  }
  Bundle bundle;
  bundle.origin = scale3(floats(1.0f / (SIDE * SIDE)), origins);
  const Floats square = dot3(axes, axes);
  bundle.axis = scale3(reciprocal_sqrt(square), axes);
  float widest = 0.0f, least_cosine = 1.0f;
  for (int i = 0; i < SIDE * SIDE; ++i) {
    const Vec3 o = rays[i].origin, away = vec3(o.x - bundle.origin.x, o.y - bundle.origin.y, o.z - bundle.origin.z);
    const float square_away = greatest_float(dot3(away, away));
    const float cosine = least_float(dot3(rays[i].direction, bundle.axis));
    widest = square_away > widest ? square_away : widest;
    least_cosine = cosine < least_cosine ? cosine : least_cosine;
  }
  const float sine = least_cosine < 0.0f ? 1.0f : sqrt(least_cosine > 1.0f ? 0.0f : 1.0f - least_cosine * least_cosine);
  bundle.sine = (1.0f + margin) * sine + 1e-4f;
  bundle.sine = bundle.sine < 1.0f ? bundle.sine : 1.0f;
  bundle.cosine = sqrt(1.0f - bundle.sine * bundle.sine);
  bundle.radius = 1.0001f * sqrt(widest);
  return bundle;
}

/* Flatter than that, a cone takes everything. */
#define FLATTEST 0.2f

/* The lanes whose sphere the rays of a bundle may meet. */
TFM_INLINE Ints may_meet(const Bundle *bundle, Vec3 centre, Floats reach)
{
  const Vec3 v = vec3(centre.x - bundle->origin.x, centre.y - bundle->origin.y, centre.z - bundle->origin.z);
  const Floats along = dot3(v, bundle->axis);
  const Vec3 beside = vec3(v.x - along * bundle->axis.x, v.y - along * bundle->axis.y, v.z - along * bundle->axis.z);
  const Floats square = dot3(beside, beside), distance = square * reciprocal_sqrt(square);
  const Floats within = 1.0001f * reach + bundle->radius;
  const Ints near = (distance * bundle->cosine - along * bundle->sine <= within) & (along >= -within);
  return bundle->cosine < FLATTEST ? ints(-1) : near;
}

/* Lists the primitives of each bin, or only counts them.
   primitives      as seen from the origin of the rays
   parent_starts   [parents + 1], parent_members: lists of bins 2^parent_shift times as wide
   size            texels along x and y
   bins            columns, rows, texels along a side of a bin, columns of the parents
   counts          out, [bins]: where bin_members is not written
   bin_starts      where each list goes, bin_members out: where writes is not 0
   whole           primitives that the one parent has, all of them; 0: it has a list */
__kernel void list_primitives(ORIGIN, PRIMITIVE primitives, __global const int *parent_starts,
                              __global const int *parent_members, int4 size, int4 bins, int parent_shift, float margin,
                              __global int *counts, __global const int *bin_starts, __global int *bin_members, int whole,
                              int writes)
{
  const int x = (int)get_global_id(0), y = (int)get_global_id(1);
  if (x >= bins.x || y >= bins.y)
    return;
#if TFM_FROM_LIGHT
  const Bundle bundle = bundle_of(light, size, x * bins.z, y * bins.z, bins.z, margin);
#else
  const Bundle bundle = bundle_of(view, size, x * bins.z, y * bins.z, bins.z, margin);
#endif
  const int bin = y * bins.x + x, parent = (y >> parent_shift) * bins.w + (x >> parent_shift);
  const int first = whole ? 0 : parent_starts[parent], end = whole ? whole : parent_starts[parent + 1];
  int found = writes ? bin_starts[bin] : 0;
  for (int start = first; start < end; start += TFM_LANES) {
    FloatArray place[3], reach;
    IntArray number;
    for (int lane = 0; lane < TFM_LANES; ++lane) {
      const int i = start + lane < end ? start + lane : end - 1;
      number.lane[lane] = whole ? i : parent_members[i];
      PRIMITIVE one = primitives + number.lane[lane];
      for (int axis = 0; axis < 3; ++axis)
        place[axis].lane[lane] = one->centre[axis];
      reach.lane[lane] = start + lane < end ? one->reach : -INFINITY;
    }
    IntArray meets;
    meets.lanes = may_meet(&bundle, vec3(place[0].lanes, place[1].lanes, place[2].lanes), reach.lanes) &
                  (reach.lanes > 0.0f);
    if (!any_lane(meets.lanes))
      continue;
    for (int lane = 0; lane < TFM_LANES; ++lane)
      if (meets.lane[lane]) {
        if (writes)
          bin_members[found] = number.lane[lane];
        ++found;
      }
  }
  if (!writes)
    counts[bin] = found;
}
